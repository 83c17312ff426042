"""ISO 230-4: circular tests of two linear axes.

Circular deviation G: least radial separation of two concentric circles around the path, in one direction and of both
together. Radial deviation F: from the nominal radius about the least-squares centre, its largest and smallest value in
one direction and of both together. Mean bidirectional radial deviation D: radius of the least-squares circles of both
directions minus the nominal one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.arrays import Array
from errormodel.exceptions import InputError
from identification.iso_standards.base import Chart, Evaluation, Quantity, Standard, spread, text
from identification.iso_standards.circular_paths import Circle, arcs_of, circles_of
from identification.iso_standards.fitted import FittedMachine

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from errormodel.machine import Machine
    from errormodel.survey import Survey

MODEL_POINTS = 180  # of a circle of a fitted model: every two degrees
GAP_STEPS = 5.0  # usual distances of points, beyond which a chart leaves a gap in the path; by judgement
MODEL_RADIUS_SHARE = 0.4  # of the shorter measured travel; ISO 230-4 leaves the radius to be agreed on

WORDS = {
    "G+": "circular deviation, counter-clockwise",
    "G-": "circular deviation, clockwise",
    "G(b)": "bidirectional circular deviation",
    "F+ max": "largest radial deviation, counter-clockwise",
    "F+ min": "smallest radial deviation, counter-clockwise",
    "F- max": "largest radial deviation, clockwise",
    "F- min": "smallest radial deviation, clockwise",
    "F max": "largest radial deviation of both directions",
    "F min": "smallest radial deviation of both directions",
    "D": "mean bidirectional radial deviation",
}


def least_squares(angle: Array, radial: Array) -> tuple[Array, Array]:
    """Radius (...) of the least-squares circle of radial deviations (..., n), and what they are about its centre.

    A small shift of the centre takes ``x cos + y sin`` off. The radius is not their mean where the points do not lie
    evenly around the circle.
    """
    design = np.column_stack([np.ones_like(angle), np.cos(angle), np.sin(angle)])
    shares = radial @ np.linalg.pinv(design).T
    return np.asarray(shares[..., 0]), np.asarray(radial - shares[..., 1:] @ design[:, 1:].T)


def centred(angle: Array, radial: Array) -> Array:
    """Radial deviations (..., n) about their least-squares centre."""
    return least_squares(angle, radial)[1]


def minimum_zone(angle: Array, radial: Array) -> tuple[float, Array]:
    """Least radial separation of concentric circles around radial deviations (n,), and its centre (2,).

    A shift of the centre by a small (x, y) takes ``x cos + y sin`` off: a linear programme in x, y and two radii.
    """
    from scipy.optimize import linprog

    radial = radial - radial.mean()  # the programme's numbers are then of the size of the deviations
    size = max(float(np.ptp(radial)), 1e-12)
    columns = np.column_stack([np.cos(angle), np.sin(angle)])
    one, none = np.ones((len(angle), 1)), np.zeros((len(angle), 1))
    # x cos + y sin + outer >= radial, x cos + y sin + inner <= radial
    above = np.vstack([np.hstack([-columns, -one, none]), np.hstack([columns, none, one])])
    bound = np.concatenate([-radial, radial]) / size
    solved = linprog([0, 0, 1, -1], A_ub=above, b_ub=bound, bounds=[(None, None)] * 4, method="highs")
    if not solved.success:  # bounded and feasible by construction
        raise RuntimeError(f"circles: {solved.message}")
    x, y, outer, inner = (size * float(v) for v in np.asarray(solved.x))
    return outer - inner, np.array([x, y])


def figures(circle: Circle) -> dict[str, tuple[float, float | None]]:
    """Value and expanded uncertainty of each figure.

    Circular deviations are of the minimum zone; their uncertainty is that of the range about the least-squares centre.
    """
    out: dict[str, tuple[float, float | None]] = {}
    sizes = []
    for sign, sense in (("+", 1.0), ("-", -1.0)):
        angle, radial = circle.of(sense)
        if not len(angle):
            continue
        size, about = least_squares(angle, radial)
        out[f"G{sign}"] = (minimum_zone(angle, radial[0])[0], spread(np.ptp(about, axis=-1))[1])
        if circle.sized:
            out[f"F{sign} max"], out[f"F{sign} min"] = spread(about.max(axis=-1)), spread(about.min(axis=-1))
        sizes.append(size)
    about = centred(circle.angle, circle.radial)
    if len(sizes) == 2:
        out["G(b)"] = (minimum_zone(circle.angle, circle.radial[0])[0], spread(np.ptp(about, axis=-1))[1])
    if circle.sized:
        out["F max"], out["F min"] = spread(about.max(axis=-1)), spread(about.min(axis=-1))
    if len(sizes) == 2 and circle.sized:
        out["D"] = spread(np.mean(sizes, axis=0))
    return {symbol: out[symbol] for symbol in WORDS if symbol in out}


class Circles(Standard):
    """Circles of two linear axes."""

    number = "230-4"
    title = "ISO 230-4:2022, circular tests"
    needs = "measured points, or lengths of a ballbar, on a circle of commands of two linear axes, over 300° or more"

    def of_survey(self, survey: Survey, machine: Machine) -> Evaluation:
        found = list(circles_of(survey, machine))
        if not found:
            what = "no rows lie on a circle of two linear axes, with both components measured or a bar read"
            raise self.lacking(survey, what)
        known = len(found[0].radial) > 1
        basis = "noise of the instrument as declared" if known else "the survey declares no noise of its instrument"
        return _evaluation(
            self, f"survey {survey.source.name}", found, basis, tuple(_bar_notes(found, arcs_of(survey, found)))
        )

    def of_fit(self, model: FittedMachine) -> Evaluation:
        linear = model.linear
        found = [_of_model(model, a, b) for a, b in combinations(linear, 2)]
        if not found:
            raise InputError(str(model.folder), "fewer than two linear axes moved in its survey", "Measure the volume")
        notes = (
            "of the geometry and what the model has of play: a path at feed has errors of the drives as well, which "
            "a model of standing poses does not know",
        )
        return _evaluation(self, model.source, found, "covariance of the fit", notes)


def _bar_notes(found: Sequence[Circle], arcs: Sequence[str]) -> Iterator[str]:
    """What figures of lengths of a bar rest on, and which traces have none."""
    if arcs:
        yield f"no figures of {', '.join(arcs)}: less than 300° of a circle, or too few readings"
    lengths = dict.fromkeys(f"{c.bar:.7g} mm" for c in found if np.isfinite(c.bar))
    if lengths:
        yield f"F and D rest on the bar's calibrated length ({', '.join(lengths)}), which its survey states"
    if any(not c.sized for c in found):
        yield "of a bar whose length is not known there is no F and no D: G alone does not need it"


def _of_model(model: FittedMachine, a: int, b: int) -> Circle:
    first, second = model.joints[a], model.joints[b]
    radius = MODEL_RADIUS_SHARE * min(float(np.ptp(model.range(j))) for j in (first, second))
    angle = np.linspace(0.0, 2 * np.pi, MODEL_POINTS, endpoint=False) + np.pi / MODEL_POINTS  # off the quadrants
    q = np.tile(model.middle(), (MODEL_POINTS, 1))
    q[:, a] += radius * np.cos(angle)
    q[:, b] += radius * np.sin(angle)
    outward = np.outer(np.cos(angle), model.toward(first)) + np.outer(np.sin(angle), model.toward(second))
    came = np.ones_like(q)
    came[:, a], came[:, b] = -np.sign(np.sin(angle)), np.sign(np.cos(angle))
    radial = [np.einsum("kni,ni->kn", model.errors(q, sense * came), outward) for sense in (1.0, -1.0)]
    senses = np.repeat([1.0, -1.0], MODEL_POINTS)
    return Circle((first.name, second.name), radius, np.tile(angle, 2), np.hstack(radial), senses)


def _evaluation(kind: Circles, source: str, found: list[Circle], basis: str, notes: tuple[str, ...]) -> Evaluation:
    quantities, charts = [], []
    data: dict[str, Any] = {}
    for circle in found:
        label = circle.name if sum(c.name == circle.name for c in found) == 1 else f"{circle.name} r{circle.radius:.5g}"
        again = sum(name.partition(" no. ")[0] == label for name in data)  # at another height, say
        label += f" no. {again + 1}" if again else ""
        known = figures(circle)
        place = f"(radius {circle.radius:.4g} mm)"
        for symbol, (value, expanded) in known.items():
            words = f"{WORDS[symbol]} {place}"
            quantities.append(Quantity(symbol, label, words, value, "mm", expanded, basis))
        size = "The length of the bar is not known."
        if circle.sized:
            outside, inside = text(known["F max"][0], "mm"), text(-known["F min"][0], "mm")
            size = f"{outside} µm outside, {inside} µm inside the circle."
        charts.append(
            Chart(
                f"circle {label}",
                f"{label}: path at radius {circle.radius:.4g} mm, radial deviations about the least-squares centre, "
                "enlarged as the scale says; counter-clockwise blue, clockwise orange. " + size,
                f"Polar plot of the circular path of {label}",
                partial(_draw, circle),
            )
        )
        data[label] = {
            "radius": circle.radius, "angle": circle.angle.tolist(), "radial": circle.radial[0].tolist(),
            "sense": circle.sense.tolist(),
        }  # fmt: skip
    return Evaluation(kind.number, kind.title, source, tuple(quantities), (), tuple(charts), notes, data)


def _draw(circle: Circle) -> Figure:
    from matplotlib.figure import Figure

    from identification.plots import style

    figure = Figure(figsize=(style.REPORT_WIDTH_IN, 4.3), facecolor="white")
    axes = style.panel(figure, 1.9, 0.1, 4.1, 4.1)
    left = 1e3 * centred(circle.angle, circle.radial[0])
    step = _round(max(float(np.abs(left).max()), 1e-6))
    base = 4.0 * step  # of the nominal circle, in which the deviations are drawn
    around = np.linspace(0, 2 * np.pi, 361)
    for k in (-2, -1, 0, 1, 2):
        ring = base + k * step
        axes.plot(
            ring * np.cos(around),
            ring * np.sin(around),
            lw=1.2 if k == 0 else 0.6,
            color=style.MUTED if k == 0 else style.FAINT,
        )
    first, second = circle.of(1.0)[1], circle.of(-1.0)[1]
    alike = first.shape == second.shape and np.abs(first[0] - second[0]).max() < 1e-9
    words = "both ways" if alike else "counter-clockwise"
    senses = ((1.0, style.FITTED, words), (-1.0, style.AXIS_COLOURS[0], "clockwise"))
    for sense, colour, words in senses[: 1 if alike else 2]:
        own = circle.sense == sense
        if not own.any():
            continue
        angle, r = _closed(circle.angle[own], base + left[own])
        axes.plot(r * np.cos(angle), r * np.sin(angle), lw=1.2, color=colour, label=words)
    reach = base + 2.3 * step
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    axes.set_axis_off()
    axes.plot([0, 0.9 * base], [0, 0], lw=0.8, color=style.MUTED)
    axes.plot([0, 0], [0, 0.9 * base], lw=0.8, color=style.MUTED)
    axes.text(0.92 * base, 0, style.plain(circle.axes[0], 16), ha="right", va="bottom", size=style.BODY_TEXT)
    axes.text(0, 0.92 * base, style.plain(circle.axes[1], 16), ha="left", va="top", size=style.BODY_TEXT)
    axes.text(-1.4 * reach, -reach, f"one ring: {step:g} µm", size=style.SMALL_TEXT, color=style.MUTED)
    axes.legend(loc="upper left", bbox_to_anchor=(-0.4, 1.0), fontsize=style.SMALL_TEXT, frameon=False)
    return figure


def _closed(angle: Array, r: Array) -> tuple[Array, Array]:
    """Points of a path in the order of their angles, back to the first; a gap, of an arc say, is left open."""
    angle = np.mod(angle, 2 * np.pi)
    order = np.argsort(angle, kind="stable")
    order = np.append(order, order[0])
    angle, r = angle[order], r[order]
    steps = np.mod(np.diff(angle), 2 * np.pi)
    wide = 1 + np.flatnonzero(steps > GAP_STEPS * np.median(steps[steps > 0]))
    return np.insert(angle, wide, np.nan), np.insert(r, wide, np.nan)


def _round(size: float) -> float:
    """A scale of one, two or five times a power of ten of which two hold the size."""
    power = 10.0 ** np.floor(np.log10(size / 2))
    return float(next(power * k for k in (1, 2, 5, 10) if 2 * power * k >= size))
