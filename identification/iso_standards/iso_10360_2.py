"""ISO 10360-2: length measurement error E0 of a coordinate measuring machine, of its fitted model.

Five lengths in each of seven positions (four body diagonals, three along the axes), the longest 66 % of the line or
more. A machine reads its scales: a length that it indicates is the commanded one, while the tip's real distance is that
of the actual points, so that the error of indication is minus the difference of the errors along the line. Probing
(E150, R0) is not part of a model of the machine.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from errormodel.arrays import Array, corners_of_cube
from errormodel.exceptions import InputError
from identification.iso_standards.base import Chart, Evaluation, Quantity, Sheet, Standard, spread, text
from identification.iso_standards.fitted import FittedMachine

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LENGTHS = (0.2, 0.4, 0.6, 0.8, 1.0)  # of the longest: spaced evenly
MOST_DIAGONALS = 64  # all those of seven linear axes
LONGEST_SHARE = 0.8  # of the line through the measured volume; the standard has at least 0.66


class Line(NamedTuple):
    """One position: lengths in mm, and errors (1 + draws, lengths) in mm."""

    name: str
    lengths: Array
    errors: Array


class LengthError(Standard):
    """Length measurement error of a CMM."""

    number = "10360-2"
    title = "ISO 10360-2:2009, length measurement error E0"

    def of_fit(self, model: FittedMachine) -> Evaluation:
        linear = model.linear
        if len(linear) < 3:
            found = f"{len(linear)} linear axes moved in its survey; the standard has three"
            raise InputError(str(model.folder), found, "Measure the whole volume of a machine with three linear axes")
        lines = list(_lines(model, linear))
        quantities = []
        for line in lines:
            for k, length in enumerate(line.lengths):
                value, expanded = spread(line.errors[:, k])
                words = f"error of indication of {length:.4g} mm along {line.name}"
                basis = "covariance of the fit"
                quantities.append(
                    Quantity(
                        "E0", f"{line.name} {length:.4g}", words, value, "mm", expanded, basis, length=float(length)
                    )
                )
        worst = max(quantities, key=lambda q: abs(q.value))
        head = ["position", *(f"{share:g} of the longest" for share in LENGTHS)]
        rows = [
            [f"{line.name} ({line.lengths[-1]:.4g} mm)", *(text(float(v), "mm") for v in line.errors[0])]
            for line in lines
        ]
        chart = Chart(
            "E0",
            "Errors of indication against the length, with bars of expanded uncertainty (k = 2); one colour for "
            "each of the seven positions.",
            "Errors of indication of lengths in seven positions",
            partial(_draw, lines),
        )
        notes = (
            f"largest: {text(worst.value, 'mm')} µm, {worst.words}",
            "geometry only: without the probe's error and the repeatability that a test by material standards contains",
        )
        data = {line.name: {"lengths": line.lengths.tolist(), "errors": line.errors[0].tolist()} for line in lines}
        sheet = Sheet("lengths", "Errors of indication in µm", head, rows)
        return Evaluation(self.number, self.title, model.source, tuple(quantities), (sheet,), (chart,), notes, data)


def _lines(model: FittedMachine, linear: Sequence[int]) -> Iterator[Line]:
    low, high = (np.array([model.range(model.joints[k])[side] for k in linear]) for side in (0, 1))
    names = [model.joints[k].name for k in linear]
    for corner in corners_of_cube(len(linear) - 1, MOST_DIAGONALS):
        sign = np.array([*(1.0 - 2.0 * corner), 1.0])
        start, end = np.where(sign > 0, low, high), np.where(sign > 0, high, low)
        name = "".join(f"{'+' if s > 0 else '-'}{n}" for s, n in zip(sign, names, strict=True))
        yield _line(model, linear, name, start, end)
    middle = (low + high) / 2
    for k, name in enumerate(names):
        start, end = middle.copy(), middle.copy()
        start[k], end[k] = low[k], high[k]
        yield _line(model, linear, name, start, end)


def _line(model: FittedMachine, linear: Sequence[int], name: str, start: Array, end: Array) -> Line:
    """Lengths from one end of the middle part of a line."""
    edge = (1 - LONGEST_SHARE) / 2
    share = edge + LONGEST_SHARE * np.array([0.0, *LENGTHS])
    q = np.tile(model.middle(), (len(share), 1))
    q[:, list(linear)] = start + share[:, None] * (end - start)
    points = model.nominal(q)
    along = points[-1] - points[0]
    along /= np.linalg.norm(along)
    errors = model.errors(q) @ along
    return Line(name, np.linalg.norm(points[1:] - points[0], axis=1), -(errors[:, 1:] - errors[:, :1]))


def _draw(lines: list[Line]) -> Figure:
    from matplotlib.figure import Figure

    from identification.plots import style

    figure = Figure(figsize=(style.REPORT_WIDTH_IN, 3.6), facecolor="white")
    axes = style.panel(figure, 0.75, 0.6, 5.7, 2.7)
    colours = (*style.AXIS_COLOURS, style.ACCENT, style.NOMINAL, "#56B4E9", style.INK)
    for n, line in enumerate(lines):
        half = [spread(line.errors[:, k])[1] or 0.0 for k in range(len(line.lengths))]
        axes.errorbar(
            line.lengths, 1e3 * line.errors[0], 1e3 * np.array(half), marker="o", ms=3.5, lw=1.1, capsize=2,
            color=colours[n % len(colours)], label=style.plain(line.name, 20),
        )  # fmt: skip
    axes.axhline(0.0, lw=0.8, color=style.MUTED)
    style.dress(axes, "length / mm", "error of indication / µm")
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=style.SMALL_TEXT, frameon=False)
    return figure
