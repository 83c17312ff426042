"""Readings at targets along a line from both sides: means, standard deviations, figures of ISO 230-2 and 230-6."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.arrays import Array
from identification.iso_standards.base import Chart, Sheet, shown_unit, text
from identification.results.axis_lines import SAME_POSITION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WORDS = {
    "A": "bidirectional accuracy of positioning",
    "A↑": "unidirectional accuracy of positioning, from below",
    "A↓": "unidirectional accuracy of positioning, from above",
    "E": "bidirectional systematic positioning error",
    "E↑": "unidirectional systematic positioning error, from below",
    "E↓": "unidirectional systematic positioning error, from above",
    "M": "mean bidirectional positioning error",
    "R": "bidirectional repeatability of positioning",
    "R↑": "unidirectional repeatability of positioning, from below",
    "R↓": "unidirectional repeatability of positioning, from above",
    "B": "reversal error",
    "B mean": "mean reversal error",
}
OF_BOTH = ("A", "E", "R", "B", "B mean")  # of WORDS: what compares readings from below with those from above


@dataclass(frozen=True)
class Axis:
    """Means and standard deviations at the targets, of one axis.

    Attributes
    ----------
    targets : (m,) mm or rad.
    up, down : (..., m) mean deviations from below and above; NaN where there are none.
    s_up, s_down : (m,) standard deviations; NaN with fewer than two runs.
    runs : fewest readings of a target from one side.
    one_sided : a remark on targets that were read from one side only, and take no part where others have both.
    apart : why readings from below and from above do not compare, as each side has zeros of its own; empty: they do.
    """

    targets: Array
    up: Array
    down: Array
    s_up: Array
    s_down: Array
    runs: int
    one_sided: str = ""
    apart: str = ""

    @property
    def both(self) -> bool:
        return bool(np.isfinite(self.up).all() and np.isfinite(self.down).all())

    @property
    def repeated(self) -> bool:
        sides = [s for m, s in ((self.up, self.s_up), (self.down, self.s_down)) if np.isfinite(m).all()]
        return bool(np.isfinite(sides).all())

    @property
    def alike(self) -> bool:
        """Whether it is a model's, without a difference between the sides."""
        return self.both and not self.repeated and not self.reversal.any()

    @property
    def mean(self) -> Array:
        """Mean bidirectional deviation at each target."""
        return (self.up + self.down) / 2

    @property
    def reversal(self) -> Array:
        """Reversal error ``B_i``: from below minus from above; NaN where the sides do not compare."""
        return np.full_like(self.up, np.nan) if self.apart else self.up - self.down

    @property
    def repeatability(self) -> Array:
        """Bidirectional repeatability ``R_i``."""
        together = 2 * self.s_up + 2 * self.s_down + np.abs(self.reversal)
        return np.maximum(np.maximum(together, 4 * self.s_up), 4 * self.s_down)

    def figures(self) -> dict[str, Array]:
        """The figures of the axis, each of the leading shape of the means, as far as the test gives them.

        Where the sides do not compare (`apart`), those that depend on both together are NaN. M is a range of their mean
        and does not depend on what lies between them.
        """
        out: dict[str, Array] = {}
        sides = {"↑": (self.up, self.s_up), "↓": (self.down, self.s_down)}
        sides = {arrow: pair for arrow, pair in sides.items() if np.isfinite(pair[0]).all()}
        lows, highs = [], []
        for arrow, (mean, s) in sides.items():
            out[f"E{arrow}"] = np.ptp(mean, axis=-1)
            lows.append(mean - 2 * s)
            highs.append(mean + 2 * s)
            if np.isfinite(s).all():
                out[f"A{arrow}"] = highs[-1].max(axis=-1) - lows[-1].min(axis=-1)
                out[f"R{arrow}"] = np.asarray(4 * s.max())
        if self.both:
            stacked = np.stack([self.up, self.down])
            out["E"] = stacked.max(axis=(0, -1)) - stacked.min(axis=(0, -1))
            out["M"] = np.ptp(self.mean, axis=-1)
            out["B"] = np.abs(self.reversal).max(axis=-1)
            out["B mean"] = self.reversal.mean(axis=-1)
            if self.repeated:
                out["A"] = np.stack(highs).max(axis=(0, -1)) - np.stack(lows).min(axis=(0, -1))
                out["R"] = self.repeatability.max(axis=-1)
        if self.apart:
            out |= {name: np.full_like(out[name], np.nan) for name in OF_BOTH if name in out}
        return {name: out[name] for name in WORDS if name in out}


def axis_of(position: Array, deviation: Array, direction: Array, apart: str = "") -> Axis:
    """Means and standard deviations of readings (n,) at their targets, by side of approach (+-1).

    `apart`: see `Axis`.
    """
    place = np.round(position / SAME_POSITION).astype(np.int64)
    targets, number = np.unique(place, return_inverse=True)
    shape = (2, len(targets))
    mean, s, count = np.full(shape, np.nan), np.full(shape, np.nan), np.zeros(shape, dtype=int)
    for k, side in enumerate((1.0, -1.0)):
        for i in range(len(targets)):
            own = deviation[(number == i) & (direction == side) & np.isfinite(deviation)]
            count[k, i] = len(own)
            if len(own):
                mean[k, i] = own.mean()
            if len(own) > 1:
                s[k, i] = own.std(ddof=1)
    q = np.array([position[number == i][0] for i in range(len(targets))])
    # a target that was read from one side only belongs to neither pass when others were read from both
    whole = (count > 0).all(axis=0) if (count > 0).all(axis=0).sum() >= 2 else np.ones(len(targets), dtype=bool)
    alone = q[~whole]
    remark = f"{len(alone)} of {len(q)} targets were read from one side only and take no part" if len(alone) else ""
    runs = int(count[:, whole].max(axis=0).min())
    return Axis(q[whole], mean[0, whole], mean[1, whole], s[0, whole], s[1, whole], runs, remark, apart)


def of_readings(reading: float, runs: int, targets: int) -> dict[str, float]:
    """Expanded uncertainties (k = 2) of repeatability and reversal from that of one reading, which is independent.

    Parameters
    ----------
    reading : expanded uncertainty of one reading by instrument and environment.
    runs, targets : readings of a target from one side, and targets.
    """
    one = {"R↑": 2 * reading, "R↓": 2 * reading, "R": float(np.sqrt(4 + 2 / runs)) * reading}
    return one | {"B": float(np.sqrt(2 / runs)) * reading, "B mean": float(np.sqrt(2 / runs / targets)) * reading}


def as_json(axis: Axis, unit: str) -> dict[str, Any]:
    """Values at the targets, for JSON."""
    return {
        "unit": unit, "targets": axis.targets.tolist(), "mean_up": axis.up.tolist(), "mean_down": axis.down.tolist(),
        "s_up": axis.s_up.tolist(), "s_down": axis.s_down.tolist(), "runs": axis.runs,
    }  # fmt: skip


def chart(label: str, unit: str, axis: Axis) -> Chart:
    """Deviations against the position, from both sides."""
    lines = (
        "deviations, the same from either side"
        if axis.alike
        else "mean deviations from below (blue) and above (orange)"
        f"{' with ± 2 s' if axis.repeated else ''}, and the mean of both (black)"
    )
    limits = f"The dashed lines are the limits that {'A' if axis.repeated else 'E'} lies between."
    limits = "Each side counts from zeros of its own: their distance is not determined." if axis.apart else limits
    return Chart(
        f"positioning {label}",
        f"{label}: {lines}. {limits}",
        f"Deviation of {label} against its position from both sides",
        partial(_draw, label, unit, axis),
    )


def sheet(label: str, unit: str, axis: Axis) -> Sheet:
    """Table of the targets."""
    angular = unit == "rad"
    head = ["target", "x̄↑", "s↑", "x̄↓", "s↓", "x̄", "B", "R"]
    place = np.degrees(axis.targets) if angular else axis.targets
    rows = []
    columns = (axis.up, axis.s_up, axis.down, axis.s_down, axis.mean, axis.reversal, axis.repeatability)
    for i, q in enumerate(place):
        rows.append([f"{q:.4f}", *(text(float(c[i]), unit) for c in columns)])
    kept = [0, *(k for k in range(1, 8) if any(row[k] for row in rows))]
    caption = f"{label}: targets in {'°' if angular else 'mm'}, all else in {shown_unit(unit)}"
    return Sheet(f"targets-{label}", caption, [head[k] for k in kept], [[row[k] for k in kept] for row in rows])


def _draw(label: str, unit: str, axis: Axis) -> Figure:
    from matplotlib.figure import Figure

    from identification.plots import style
    from identification.results.parameter_table import printed

    factor, name = printed(unit)
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, 3.4), facecolor="white")
    axes = style.panel(figure, 0.75, 0.6, 7.0, 2.35)
    place = np.degrees(axis.targets) if unit == "rad" else axis.targets
    alike = axis.alike
    ends = [axis.up] if alike else []
    for mean, s, colour, marker, words in (
        (axis.up, axis.s_up, style.FITTED, "^", "from below"),
        (axis.down, axis.s_down, style.AXIS_COLOURS[0], "v", "from above"),
    ):  # fmt: skip
        if alike or not np.isfinite(mean).any():
            continue
        band = 2 * np.nan_to_num(s)
        ends += [mean - band, mean + band]
        axes.plot(place, factor * mean, marker=marker, ms=4, lw=1.3, color=colour, label=words)
        if band.any():
            axes.fill_between(place, factor * (mean - band), factor * (mean + band), color=colour, alpha=0.15, lw=0)
    if axis.both:
        axes.plot(
            place, factor * axis.mean, color=style.INK, lw=1.0, label="from either side" if alike else "mean of both"
        )
    if not axis.apart:
        for level in (np.min(ends), np.max(ends)):
            axes.axhline(factor * level, color=style.MUTED, lw=0.9, ls="--")
        limits = "A" if axis.repeated else "E"
        axes.annotate(
            f"{limits}{'' if axis.both else ' of one side'}: {factor * (np.max(ends) - np.min(ends)):.2f} {name}",
            (1.0, 1.02), xycoords="axes fraction", ha="right", size=style.SMALL_TEXT, color=style.MUTED,
        )  # fmt: skip
    style.dress(axes, f"{style.plain(label)} / {'°' if unit == 'rad' else 'mm'}", f"deviation / {name}")
    figure.legend(loc="upper left", ncols=3, fontsize=style.SMALL_TEXT, frameon=False, bbox_to_anchor=(0.08, 0.99))
    return figure
