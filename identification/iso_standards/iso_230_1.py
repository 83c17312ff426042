"""ISO 230-1: straightness and angular error motions of linear axes, squareness and parallelism between axes.

Straightness is the range about a reference straight line (least squares, end points, minimum zone); the slope of that
line is no straightness error but part of squareness or of the setting up. Angular error motions are ranges. Squareness
and parallelism are between least-squares lines, signed as in `errormodel.location_errors`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.conventions import ROTATIONS, TRANSLATIONS, Motion, iso_symbol
from errormodel.location_errors import ALIGNED_COSINE, LINE_TARGETS, one_of_each_pair, rotation_of_line
from identification.iso_standards.base import (
    COVERAGE_FACTOR,
    Chart,
    Evaluation,
    Quantity,
    Sheet,
    Standard,
    shown_unit,
    spread,
    text,
)
from identification.iso_standards.fitted import FittedMachine
from identification.iso_standards.measured_lines import STATED, MeasuredLine, lines_of
from identification.iso_standards.reference_lines import LEAST_SQUARES, LINES, least_squares, straightened, straightness
from identification.iso_standards.series import DRAWS, Series, series_of
from identification.results.axis_lines import SAME_POSITION, spoken_place

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from errormodel.machine import Joint, Machine
    from errormodel.survey import Survey

FEWEST_TARGETS = 3  # of which a line leaves something
LEAST_CURVATURE_MM = 1e-6  # of a fitted model: what is smaller is rounding, and terms of second order


@dataclass(frozen=True)
class Curve:
    """One error motion over the targets.

    Attributes
    ----------
    motion : dx ... ec; `values` (1 + draws, m) mm or rad, the estimate first.
    """

    label: str
    joint: Joint
    motion: Motion
    q: Array
    values: Array

    @property
    def symbol(self) -> str:
        return iso_symbol(self.joint.name, self.motion)

    @property
    def unit(self) -> str:
        return "mm" if self.motion in TRANSLATIONS else "rad"


class Geometry(Standard):
    """Straightness, angles, squareness and parallelism."""

    number = "230-1"
    title = "ISO 230-1:2012, geometric accuracy: straightness, angles, squareness, parallelism"
    needs = (
        "readings across the motion of one linear joint (or its angles) at three targets or more, while the others "
        "stand still: rows about its error motions (column joint), measured points, or observations of straightness "
        "and angles along a line; squareness of the latter needs one reference line, or lines whose slope is stated"
    )

    def of_survey(self, survey: Survey, machine: Machine) -> Evaluation:
        rng = np.random.default_rng(0)
        found = [s for s in series_of(survey, machine) if s.joint.type == "prismatic"]
        lines = list(lines_of(survey, machine))
        curves = [c for s in (*found, *(line.series for line in lines)) for c in _curves(s, rng)]
        squares = list(_between_lines(survey, machine, found, rng))
        squares += _of_readings(machine, lines, {q.symbol for q in squares}, rng)
        if not curves and not squares:
            raise self.lacking(survey, "no linear joint was read across its motion, nor its angles")
        basis = "noise of the instrument as declared"
        stated = any(line.reference == STATED for line in lines)
        notes = ("angles between lines of readings hold the stated slopes of their reference lines to be right",)
        return _evaluation(self, f"survey {survey.source.name}", curves, squares, basis, notes if stated else ())

    def of_fit(self, model: FittedMachine) -> Evaluation:
        curves, place = [], model.lines.place
        for joint in model.joints:
            if joint.type != "prismatic" or np.ptp(model.covered[joint.name]) == 0:
                continue
            q = model.path(joint, LINE_TARGETS, place)
            k, axis = model.joints.index(joint), model.toward(joint, place)
            came = np.ones_like(q)
            both = (model.errors(q, came) + model.errors(q, -came)) / 2
            curves += [
                Curve(joint.name, joint, motion, q[:, k], both[:, :, TRANSLATIONS.index(motion)])
                for motion in _across(axis)
            ]
        largest = [float(np.abs(straightened(c.q, c.values, LEAST_SQUARES)).max()) for c in curves]
        flat = ", ".join(c.symbol for c, v in zip(curves, largest, strict=True) if v < LEAST_CURVATURE_MM)
        unknown = (f"the model has no term of straightness for {flat}, and says nothing of it",) if flat else ()
        curves = [c for c, v in zip(curves, largest, strict=True) if v >= LEAST_CURVATURE_MM]
        squares = model.location_errors()
        notes = (
            *unknown,
            "straightness, squareness and parallelism are those of the tip's paths through the middle of the measured "
            f"travels ({spoken_place(model.joints, place)}) unless another place is stated; angles need rows about "
            "error motions, or two tools, and are not given",
            *_elsewhere(model),
        )
        return replace(_evaluation(self, model.source, curves, squares, "covariance of the fit", notes), sheets=())


def _elsewhere(model: FittedMachine) -> Iterator[str]:
    """A note on the location errors that are others between other lines, by more than their uncertainty."""
    errors = {e.symbol: e for e in model.chain.location_errors}
    found = []
    for e in model.locations:
        low, high = model.lines.elsewhere(errors[e.symbol])
        if max(high - e.value, e.value - low) > COVERAGE_FACTOR * e.std:
            found.append(f"{e.symbol} {text(low, 'rad')} to {text(high, 'rad')}")
    if found:
        yield (
            "squareness and parallelism depend on the place, by angular error motions: between lines along the edges "
            f"of the measured travels {', '.join(found)} {shown_unit('rad')}"
        )


def _across(axis: Array) -> list[Motion]:
    """Translations across a motion along a principal direction; none of an oblique one."""
    k = int(np.argmax(np.abs(axis)))
    return [m for i, m in enumerate(TRANSLATIONS) if i != k] if abs(axis[k]) > ALIGNED_COSINE else []


def _curves(series: Series, rng: np.random.Generator) -> Iterator[Curve]:
    """Straightness and angular error motions of a series: means at the targets, with draws of the declared noise."""
    for motions, values, sigma in (
        (_across(series.axis), series.deviation, series.sigma), (list(ROTATIONS), series.turn, series.turn_sigma),
    ):  # fmt: skip
        for motion in motions:
            column = [*(TRANSLATIONS if motion in TRANSLATIONS else ROTATIONS)].index(motion)
            own = np.isfinite(values[:, column])
            targets, means, std = _means(
                series.q[own], values[own, column], None if sigma is None else sigma[own, column]
            )
            if len(targets) < FEWEST_TARGETS:
                continue
            drawn = means[None]
            if std is not None and np.isfinite(std).all():
                drawn = np.vstack([means, means + rng.standard_normal((DRAWS, len(means))) * std])
            yield Curve(series.label, series.joint, motion, targets, drawn)


def _means(q: Array, values: Array, sigma: Array | None) -> tuple[Array, Array, Array | None]:
    """Targets, means there, and their declared standard uncertainties."""
    place = np.round(q / SAME_POSITION).astype(np.int64)
    _, first, number = np.unique(place, return_index=True, return_inverse=True)
    count = np.bincount(number)
    means = np.bincount(number, values) / np.maximum(count, 1)
    std = None if sigma is None else np.sqrt(np.bincount(number, np.square(sigma))) / np.maximum(count, 1)
    return q[first], means, std


def _between_lines(
    survey: Survey, machine: Machine, found: list[Series], rng: np.random.Generator
) -> Iterator[Quantity]:
    """Squareness and parallelism of lines whose points were measured in one frame."""
    if survey.frame not in ("shared", "fixed"):
        return
    longest: dict[str, Series] = {}
    for series in found:
        whole = series.at and np.isfinite(series.deviation).all()
        if whole and (series.joint.name not in longest or np.ptp(series.q) > np.ptp(longest[series.joint.name].q)):
            longest[series.joint.name] = series
    directions = {name: _direction(series, rng) for name, series in longest.items()}
    for error in one_of_each_pair(Chain(machine).location_errors):
        reference, line = error.reference.joint.name, error.line.joint.name
        if reference not in directions or line not in directions:
            continue
        about = np.eye(3)[error.about]
        values = _tilt(longest[line].axis, directions[line], about) - _tilt(
            longest[reference].axis, directions[reference], about
        )
        known = longest[line].sigma is not None and longest[reference].sigma is not None
        value, expanded = spread(values if known else values[:1])
        basis = "noise of the instrument as declared" if known else "the survey declares no noise of its instrument"
        words = f"{error.words} (lines at {longest[line].at}; {longest[reference].at})"
        yield Quantity(error.symbol, "", words, value, "rad", expanded, basis)


def _of_readings(
    machine: Machine, lines: list[MeasuredLine], have: set[str], rng: np.random.Generator
) -> Iterator[Quantity]:
    """Squareness and parallelism of lines that were read against one direction; of each the longest one."""
    longest: dict[tuple[str, str, int], Series] = {}
    for line in lines:
        key = (line.reference, line.series.joint.name, line.component)
        if line.reference and (key not in longest or np.ptp(line.series.q) > np.ptp(longest[key].q)):
            longest[key] = line.series
    slopes = {key: _direction(series, rng)[:, key[2]] for key, series in longest.items()}
    for error in one_of_each_pair(Chain(machine).location_errors):
        about = np.eye(3)[error.about]
        for reference in dict.fromkeys(key[0] for key in longest):
            tilts, places = [], []
            for joint in (error.line.joint.name, error.reference.joint.name):
                own = [k for k in longest if k[:2] == (reference, joint)]
                toward = np.cross(about, np.round(longest[own[0]].axis)) if own else np.zeros(3)
                key = (reference, joint, int(np.argmax(np.abs(toward))))
                if toward.any() and key in longest:
                    tilts.append(toward[key[2]] * slopes[key])
                    places.append(longest[key])
            if len(tilts) < 2 or error.symbol in have:
                continue
            known = all(series.sigma is not None for series in places)
            values = tilts[0] - tilts[1]
            value, expanded = spread(values if known else values[:1])
            basis = "noise of the instrument as declared" if known else "the survey declares no noise of its instrument"
            words = f"{error.words} (lines {places[0].at}; {places[1].at})"
            have = have | {error.symbol}
            yield Quantity(error.symbol, "", words, value, "rad", expanded, basis)


def _direction(series: Series, rng: np.random.Generator) -> Array:
    """Slopes (1 + draws, 3) of the deviations over the travel, mm/mm."""
    out = []
    for k in range(3):
        sigma = None if series.sigma is None else series.sigma[:, k]
        q, means, std = _means(series.q, series.deviation[:, k], sigma)
        noise = np.zeros((DRAWS, len(q))) if std is None else rng.standard_normal((DRAWS, len(q))) * std
        out.append(least_squares(q, np.vstack([means, means + noise]))[0])
    return np.stack(out, axis=-1)


def _tilt(axis: Array, slopes: Array, about: Array) -> Array:
    """Rotation (draws,) of a line along `axis` about a principal direction, rad: the slope along ``about x axis``."""
    principal = np.round(axis)
    return rotation_of_line(about, principal, slopes)


def _evaluation(
    kind: Geometry, source: str, curves: list[Curve], squares: list[Quantity], basis: str, notes: tuple[str, ...]
) -> Evaluation:
    quantities: list[Quantity] = []
    for c in curves:
        why = basis if len(c.values) > 1 else "the survey declares no noise of its instrument"
        if c.unit == "rad":
            words = f"range of the angular error motion of {c.joint.name} about {'xyz'[ROTATIONS.index(c.motion)]}"
            quantities.append(Quantity(c.symbol, _where(c), words, *_spread(np.ptp(c.values, axis=-1), c.unit), why))
            continue
        for line in LINES:
            symbol = c.symbol if line == LEAST_SQUARES else f"{c.symbol} {line}"
            words = f"straightness of {c.joint.name} in {c.motion[1]}, reference line by {line}"
            values = straightness(c.q, c.values, line)
            quantities.append(Quantity(symbol, _where(c), words, *_spread(values, c.unit), why))
    quantities += squares
    labels = list(dict.fromkeys(c.label for c in curves))
    charts = tuple(
        Chart(
            f"error motions {label}",
            f"{label}: straightness about the least-squares line with the narrowest zone dashed, and angular error "
            "motions from their first value"
            f"{'; bands are ± 2 standard uncertainties' if len(curves[0].values) > 1 else ''}.",
            f"Curves of the error motions of {label} over its travel",
            partial(_draw, label, [c for c in curves if c.label == label]),
        )
        for label in labels
    )
    data: dict[str, dict[str, object]] = {label: {} for label in labels}
    for c in curves:
        data[c.label][c.symbol] = {"unit": c.unit, "q": c.q.tolist(), "values": c.values[0].tolist()}
    sheets = tuple(_sheet(label, [c for c in curves if c.label == label]) for label in labels)
    return Evaluation(kind.number, kind.title, source, tuple(quantities), sheets, charts, notes, data)


def _where(curve: Curve) -> str:
    """The place of a series; the joint itself is in the symbol."""
    return "" if curve.label == curve.joint.name else curve.label


def _spread(values: Array, unit: str) -> tuple[float, str, float | None]:
    value, expanded = spread(values)
    return value, unit, expanded


def _left(curve: Curve) -> Array:
    if curve.unit == "mm":
        return straightened(curve.q, curve.values, LEAST_SQUARES)
    return np.asarray(curve.values - curve.values[:, :1])


def _sheet(label: str, curves: list[Curve]) -> Sheet:
    targets = sorted({float(q) for c in curves for q in c.q})
    head = [f"{label.partition(' ')[0]} / mm", *(f"{c.symbol} / {shown_unit(c.unit)}" for c in curves)]
    values = [dict(zip(c.q.tolist(), _left(c)[0].tolist(), strict=True)) for c in curves]
    rows = [
        [f"{q:.3f}", *(text(v.get(q), c.unit) for v, c in zip(values, curves, strict=True))] for q in targets
    ]  # fmt: skip
    return Sheet(f"motions-{label}", f"{label}: deviations from the least-squares lines, and angles", head, rows)


def _draw(label: str, curves: list[Curve]) -> Figure:
    from matplotlib.figure import Figure

    from identification.plots import style
    from identification.results.parameter_table import printed

    rows = -(-len(curves) // 2)
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, 2.1 * rows + 0.2), facecolor="white")
    for n, c in enumerate(curves):
        factor, name = printed(c.unit)
        across, down = n % 2, n // 2
        axes = style.panel(figure, 0.7 + 3.9 * across, 0.5 + 2.1 * (rows - 1 - down), 3.05, 1.3)
        left = factor * _left(c)
        axes.plot(c.q, left[0], marker=".", ms=5, lw=1.2, color=style.FITTED)
        if len(left) > 1:
            band = 2 * np.sqrt(np.mean(np.square(left[1:] - left[0]), axis=0))
            axes.fill_between(c.q, left[0] - band, left[0] + band, color=style.FITTED, alpha=0.18, lw=0)
        if c.unit == "mm":
            zone = straightened(c.q, c.values[0], "minimum zone")
            middle = factor * (_left(c)[0] - zone)
            for side in (zone.min(), zone.max()):
                axes.plot(c.q, middle + factor * side, ls="--", lw=0.8, color=style.MUTED)
        style.dress(axes, f"{style.plain(c.joint.name)} / mm", name, f"{c.symbol}: {np.ptp(left[0]):.2f} {name}")
    return figure
