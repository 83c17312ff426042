"""ISO 230-3: thermal effects: drift of a standing machine over the time (environment, spindle, moving axes).

Displacements and tilts at one commanded position, from their first value; ranges over the first hour, over the last
hour, and over the whole time, with the temperatures beside them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import takewhile
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.conventions import MOTIONS, TRANSLATIONS, Motion
from identification.iso_standards.base import Chart, Evaluation, Quantity, Sheet, Standard, shown_unit, spread, text
from identification.iso_standards.series import DRAWS, measured_points, series_of
from identification.results.axis_lines import SAME_POSITION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from errormodel.machine import Machine
    from errormodel.survey import Survey

FEWEST_READINGS = 5  # at one position: fewer are no curve over the time
HOUR = 3600.0  # s
WORDS = {"dx": "displacement in x", "dy": "displacement in y", "dz": "displacement in z"} | {
    f"e{a}": f"tilt about {x}" for a, x in zip("abc", "xyz", strict=True)
}


@dataclass(frozen=True)
class Drift:
    """One displacement or tilt over the time at one position.

    Attributes
    ----------
    label : the position; empty where there is one only.
    time : (n,) s from the first reading; `values` (n,) mm or rad from the first; `sigma` (n,), where declared.
    """

    label: str
    motion: Motion
    time: Array
    values: Array
    sigma: Array | None
    temperatures: dict[str, Array]

    @property
    def unit(self) -> str:
        return "mm" if self.motion in TRANSLATIONS else "rad"


class ThermalDrift(Standard):
    """Drift over the time."""

    number = "230-3"
    title = "ISO 230-3:2020, thermal effects: drift over the time"
    needs = (
        f"a column time, and {FEWEST_READINGS} readings or more at one commanded position, as measured points or as "
        "rows about error motions"
    )

    def of_survey(self, survey: Survey, machine: Machine) -> Evaluation:
        if "time" not in survey.table or survey.table["time"].isna().any():
            raise self.lacking(survey, "no column time, or gaps in it")
        found = list(_drifts(survey, machine))
        if not found:
            raise self.lacking(survey, f"no position with {FEWEST_READINGS} readings over the time")
        rng = np.random.default_rng(0)
        quantities = [q for d in found for q in _quantities(d, rng)]
        labels = list(dict.fromkeys(d.label for d in found))
        charts = tuple(
            Chart(
                f"drift {label}".strip(),
                f"{label or 'Drift'}: displacements and tilts from the first reading, and temperatures.",
                f"Curves over the hours {label}".strip(),
                partial(_draw, [d for d in found if d.label == label]),
            )
            for label in labels
        )
        data: dict[str, Any] = {
            f"{d.label} {d.motion}".strip(): {"unit": d.unit, "time": d.time.tolist(), "values": d.values.tolist()}
            for d in found
        }
        rows = [
            [d.label or "the position", WORDS[d.motion], text(float(d.values[-1]), d.unit), shown_unit(d.unit)]
            for d in found
        ]
        hours = max(float(d.time[-1]) for d in found) / HOUR
        sheet = Sheet("ends", f"Drift at the end, after {hours:.2f} h", ["position", "of", "drift", "unit"], rows)
        return Evaluation(
            self.number, self.title, f"survey {survey.source.name}", tuple(quantities), (sheet,), charts,
            tuple(_notes(found, survey, machine)), data,
        )  # fmt: skip


def _notes(found: list[Drift], survey: Survey, machine: Machine) -> Iterator[str]:
    carrying = [j.name for j in takewhile(lambda j: j.type == "rotary", machine.joints)]
    turned = [name for name in carrying if np.ptp(survey.commands([name])) > SAME_POSITION]
    if turned and len({d.label for d in found}) > 1:
        yield (
            f"displacements of points are along the workpiece's axes, which {' and '.join(turned)} "
            f"turn{'s' if len(turned) == 1 else ''}: one drift of the machine is another in x and in y at each of its "
            "positions"
        )
    if all(d.time[-1] < 4 * HOUR for d in found):
        yield "recorded for less than four hours; ISO 230-3 has 4 h for spindles and axes"
    if not any(d.temperatures for d in found):
        yield "no temperatures (columns T_<sensor>) were recorded beside the drift"


def _quantities(d: Drift, rng: np.random.Generator) -> Iterator[Quantity]:
    drawn = d.values[None]
    if d.sigma is not None and np.isfinite(d.sigma).all():
        drawn = np.vstack([d.values, d.values + d.sigma * rng.standard_normal((DRAWS, len(d.values)))])
    basis = (
        "noise of the instrument as declared" if len(drawn) > 1 else "the survey declares no noise of its instrument"
    )
    end = float(d.time[-1])
    windows = {"": np.ones(len(d.time), dtype=bool)}
    if end > HOUR:
        windows["first hour"], windows["last hour"] = d.time <= HOUR, d.time >= end - HOUR
    for name, own in windows.items():
        if own.sum() < 2:
            continue
        value, expanded = spread(np.ptp(drawn[:, own], axis=-1))
        over = f"over {end / HOUR:.2f} h" if not name else f"over the {name}"
        yield Quantity(
            f"{d.motion} {name}".strip(),
            d.label,
            f"range of the {WORDS[d.motion]} {over}",
            value,
            d.unit,
            expanded,
            basis,
        )


def _drifts(survey: Survey, machine: Machine) -> Iterator[Drift]:
    table = survey.table
    time = table["time"].to_numpy(dtype=np.float64)
    sensors = [str(c) for c in table.columns if str(c).startswith("T_")]
    parts: list[tuple[str, Index, Array, Array, Array | None, Array | None]] = []
    for series in series_of(survey, machine):
        if series.at:
            continue
        place = np.round(series.q / SAME_POSITION).astype(np.int64)
        for code in dict.fromkeys(place.tolist()):
            own = np.flatnonzero(place == code)
            value = np.degrees(series.q[own[0]]) if series.unit == "rad" else series.q[own[0]]
            parts.append(
                (
                    f"{series.joint.name} {value:g}", series.index[own], series.deviation[own], series.turn[own],
                    None if series.sigma is None else series.sigma[own],
                    None if series.turn_sigma is None else series.turn_sigma[own],
                )
            )  # fmt: skip
    points = measured_points(survey, machine, Chain(machine))
    if points is not None:
        q = survey.commands([j.name for j in machine.joints])[points.index]
        _, codes = np.unique(np.round(q / SAME_POSITION).astype(np.int64), axis=0, return_inverse=True)
        for code in dict.fromkeys(codes.ravel().tolist()):
            own = np.flatnonzero(codes.ravel() == code)
            at = ", ".join(f"{j.name} {v:g}" for j, v in zip(machine.joints, _shown(machine, q[own[0]]), strict=True))
            sigma = None if points.sigma is None else points.sigma[own]
            parts.append((at, points.index[own], points.deviation[own], np.full((len(own), 3), np.nan), sigma, None))
    parts = [p for p in parts if len(p[1]) >= FEWEST_READINGS and np.ptp(time[p[1]]) > 0]
    for at, rows, moved, turned, sigma, turn_sigma in parts:
        order = np.argsort(time[rows], kind="stable")
        temperatures = {n: table[n].to_numpy(dtype=np.float64)[rows[order]] for n in sensors}
        label = at if len(parts) > 1 else ""
        for k, motion in enumerate(MOTIONS):
            values = (moved if k < 3 else turned)[order, k % 3]
            known = np.isfinite(values)
            if known.sum() < FEWEST_READINGS:
                continue
            std = sigma if k < 3 else turn_sigma
            when = time[rows][order][known]
            yield Drift(
                label, motion, when - when[0], values[known] - values[known][0],
                None if std is None else std[order, k % 3][known], {n: v[known] for n, v in temperatures.items()},
            )  # fmt: skip


def _shown(machine: Machine, q: Array) -> Array:
    return np.where([j.type == "rotary" for j in machine.joints], np.degrees(q), q)


def _draw(drifts: list[Drift]) -> Figure:
    from matplotlib.figure import Figure

    from identification.plots import style
    from identification.results.parameter_table import printed

    units = [u for u in ("mm", "rad") if any(d.unit == u for d in drifts)]
    warm = {n: v for n, v in drifts[0].temperatures.items() if np.isfinite(v).any()}
    panels = [*units, *(["degC"] if warm else [])]
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, 1.9 * len(panels) + 0.5), facecolor="white")
    for n, unit in enumerate(panels):
        last = n == len(panels) - 1
        axes = style.panel(figure, 0.75, 0.5 + 1.9 * (len(panels) - 1 - n), 6.0, 1.45)
        if unit == "degC":
            for name, values in list(warm.items())[:8]:
                axes.plot(drifts[0].time / HOUR, values, lw=1.0, label=style.plain(name, 12))
            style.dress(axes, "hours", "°C")
        else:
            factor, name = printed(unit)
            for d in (d for d in drifts if d.unit == unit):
                colour = style.AXIS_COLOURS[MOTIONS.index(d.motion) % 3]
                axes.plot(d.time / HOUR, factor * d.values, lw=1.3, color=colour, label=d.motion)
            style.dress(axes, "hours" if last else "", name)
        axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=style.SMALL_TEXT, frameon=False)
    return figure
