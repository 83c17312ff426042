"""ISO 230-6: positioning along body and face diagonals.

Each diagonal is tested as an axis of ISO 230-2: systematic deviation E, repeatability R and reversal B along it. The
figures of the machine are the largest over the diagonals of a kind. That a body diagonal is longer or shorter than
another shows squareness (the differences), and that all are, the scales.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.arrays import Array, Index, Mask
from errormodel.chain import Chain
from errormodel.machine import Joint
from identification.iso_standards.base import Evaluation, Quantity, Standard, spread
from identification.iso_standards.fitted import FittedMachine
from identification.iso_standards.measured_lengths import BEAM_NOTE, lengths_of
from identification.iso_standards.series import DRAWS, measured_points, sides_of
from identification.iso_standards.targets import Axis, as_json, axis_of, chart, of_readings, sheet
from identification.results.axis_lines import SAME_POSITION

if TYPE_CHECKING:
    from errormodel.machine import Machine
    from errormodel.survey import Survey

MODEL_TARGETS = 11  # of a fitted model: enough for curves that polynomials describe
FIGURES = {
    "E": "systematic deviation of positioning along the diagonal",
    "R": "repeatability of positioning along the diagonal",
    "B": "reversal error along the diagonal",
    "A": "accuracy of positioning along the diagonal",
}
KINDS = {2: "face", 3: "body"}  # diagonals by how many linear axes move
OFF_LINE_SHARE = 1e-6  # of a diagonal's length: commands closer to the line lie on it


@dataclass(frozen=True)
class Diagonal:
    """Readings along one diagonal.

    Attributes
    ----------
    name : the axes with the signs of their motion, such as ``+X-Y+Z``.
    axes : how many linear axes move.
    length : mm, between its ends.
    axis : means (1 + draws, m) and standard deviations at the targets, from its start.
    reverses : whether something is known of the reversal.
    repeatability : expanded uncertainty of R and A by the noise of a reading, mm; None where none is declared.
    """

    name: str
    axes: int
    length: float
    axis: Axis
    reverses: bool = True
    repeatability: float | None = None

    @property
    def best(self) -> Axis:
        """The estimate alone."""
        a = self.axis
        return replace(a, up=a.up[0], down=a.down[0])


class Diagonals(Standard):
    """Body and face diagonals."""

    number = "230-6"
    title = "ISO 230-6:2002, positioning on body and face diagonals"
    needs = (
        "measured points (all components), or lengths along the line, at three targets or more of a diagonal, on which "
        "two or three axes move"
    )

    def of_survey(self, survey: Survey, machine: Machine) -> Evaluation:
        beams = list(_of_lengths(survey, machine))
        found = [*_diagonals(survey, machine), *beams]
        if not found:
            what = "no rows lie on a diagonal with all components, or the length along it, measured"
            raise self.lacking(survey, what)
        known = len(found[0].axis.up) > 1
        basis = "noise of the instrument as declared" if known else "the survey declares no noise of its instrument"
        notes = tuple(f"{d.name}: {d.axis.one_sided}" for d in found if d.axis.one_sided)
        notes += (BEAM_NOTE,) if beams else ()
        return _evaluation(self, f"survey {survey.source.name}", found, basis, notes)

    def of_fit(self, model: FittedMachine) -> Evaluation:
        linear = model.linear
        found = [d for n in (3, 2) for axes in combinations(linear, n) for d in _of_model(model, axes)]
        if not found:
            raise self.no_axes(model)
        notes = (
            "A and R are of repeated readings and cannot come from a fitted model; the diagonals are those of the "
            "measured travels",
        )
        return replace(_evaluation(self, model.source, found, "covariance of the fit", notes), sheets=())

    def no_axes(self, model: FittedMachine) -> Exception:
        """Error for a machine without two linear axes."""
        from errormodel.exceptions import InputError

        return InputError(str(model.folder), "fewer than two linear axes moved in its survey", "Measure the volume")


def _of_model(model: FittedMachine, axes: Sequence[int]) -> Iterator[Diagonal]:
    low, high = (np.array([model.range(model.joints[k])[side] for k in axes]) for side in (0, 1))
    share = np.linspace(0.0, 1.0, MODEL_TARGETS)[:, None]
    for signs in product((1.0, -1.0), repeat=len(axes) - 1):
        sign = np.array([*signs, 1.0])  # the last axis always upward: a diagonal and its reverse are one
        start, end = np.where(sign > 0, low, high), np.where(sign > 0, high, low)
        q = np.tile(model.middle(), (MODEL_TARGETS, 1))
        q[:, list(axes)] = start + share * (end - start)
        came = np.ones_like(q)
        came[:, list(axes)] = sign
        points = model.nominal(q)
        length = float(np.linalg.norm(points[-1] - points[0]))
        along = (points[-1] - points[0]) / length
        none = np.full(MODEL_TARGETS, np.nan)
        up, down = model.errors(q, came) @ along, model.errors(q, -came) @ along
        name = _name([model.joints[k] for k in axes], sign)
        reverses = any(model.reversing(model.joints[k]) for k in axes)
        yield Diagonal(name, len(axes), length, Axis(length * share.ravel(), up, down, none, none, 0), reverses)


def _name(joints: Sequence[Joint], sign: Array) -> str:
    return "".join(f"{'+' if s > 0 else '-'}{j.name}" for j, s in zip(joints, sign, strict=True))


def _diagonals(survey: Survey, machine: Machine) -> Iterator[Diagonal]:
    """Runs of rows on one line on which two or three linear axes move and all components were measured."""
    chain = Chain(machine)
    points = measured_points(survey, machine, chain)
    if points is None:
        return
    joints = machine.joints
    q = survey.commands([j.name for j in joints])[points.index]
    linear = [k for k, j in enumerate(joints) if j.type == "prismatic"]
    still = np.delete(np.arange(len(joints)), linear)
    whole = np.asarray(np.isfinite(points.deviation).all(axis=1))
    merged: dict[tuple[Any, ...], list[Index]] = {}
    for rows in _lines(q[:, linear], q[:, still], whole):
        moved = np.ptp(q[rows][:, linear], axis=0)
        axes = [linear[k] for k in np.flatnonzero(moved > SAME_POSITION)]
        if len(axes) < 2 or len(np.unique(np.round(q[rows] / SAME_POSITION), axis=0)) < 3:
            continue
        ends = q[rows[[np.argmin(q[rows, axes[-1]]), np.argmax(q[rows, axes[-1]])]]]
        merged.setdefault(tuple(np.round(ends / SAME_POSITION).astype(int).ravel()), []).append(rows)
    rng = np.random.default_rng(0)
    for parts in merged.values():
        rows = np.concatenate(parts)
        moved = np.ptp(q[rows][:, linear], axis=0)
        axes = [linear[k] for k in np.flatnonzero(moved > SAME_POSITION)]
        first, last = rows[np.argmin(q[rows, axes[-1]])], rows[np.argmax(q[rows, axes[-1]])]
        step = points.nominal[last] - points.nominal[first]
        length = float(np.linalg.norm(step))
        along = step / length
        position = (points.nominal[rows] - points.nominal[first]) @ along
        side = sides_of(survey, joints[axes[-1]], points.index[rows], position)
        deviation = points.deviation[rows] @ along
        axis = axis_of(position, deviation, side)
        sigma = None if points.sigma is None else np.sqrt(np.square(points.sigma[rows]) @ np.square(along))
        sign = np.sign((q[last] - q[first])[axes])
        own = [joints[k] for k in axes]
        yield _measured(_name(own, sign), own, length, axis, sigma, rng)


def _of_lengths(survey: Survey, machine: Machine) -> Iterator[Diagonal]:
    """Diagonals along which an interferometer read the displacement."""
    rng = np.random.default_rng(0)
    used: set[str] = set()
    for lengths in lengths_of(survey, machine):
        if len(lengths.moving) < 2:
            continue
        joints = [machine.joints[k] for k in lengths.moving]
        first, last = np.argmin(lengths.position), np.argmax(lengths.position)
        name = _name(joints, np.sign((lengths.q[last] - lengths.q[first])[list(lengths.moving)]))
        name = f"{name} ({lengths.label})" if name in used else name
        used.add(name)
        axis = axis_of(lengths.position, lengths.deviation, lengths.direction)
        yield _measured(name, joints, float(np.ptp(lengths.position)), axis, lengths.sigma, rng)


def _measured(
    name: str, joints: Sequence[Joint], length: float, axis: Axis, sigma: Array | None, rng: np.random.Generator
) -> Diagonal:
    """A diagonal of readings with their declared standard uncertainties."""
    known = None if sigma is None else of_readings(2 * float(sigma.max()), max(axis.runs, 1), 1)["R"]
    return Diagonal(name, len(joints), length, _drawn(axis, sigma, rng), repeatability=known)


def _drawn(axis: Axis, sigma: Array | None, rng: np.random.Generator) -> Axis:
    """The means with draws of the declared noise of a reading."""
    up, down = axis.up[None], axis.down[None]
    if sigma is not None and np.isfinite(sigma).all():
        std = float(sigma.max()) / np.sqrt(max(axis.runs, 1))
        up = np.vstack([up, axis.up + std * rng.standard_normal((DRAWS, len(axis.up)))])
        down = np.vstack([down, axis.down + std * rng.standard_normal((DRAWS, len(axis.down)))])
    return replace(axis, up=up, down=down)


def _lines(q: Array, still: Array, whole: Mask) -> Iterator[Index]:
    """Runs of consecutive rows whose commands (n, axes) lie on one line while the other joints stand still."""
    start = 0
    for end in range(1, len(q) + 1):
        if end < len(q) and whole[end] and whole[start] and _one_line(q[start : end + 1], still[start : end + 1]):
            continue
        if end - start > 2 and whole[start]:
            yield np.arange(start, end)
        # the last row of one line, or of the way to it, may be the first of the next
        start = end - 1 if end - start > 1 and end < len(q) else end


def _one_line(q: Array, still: Array) -> bool:
    if np.ptp(still, axis=0).max(initial=0.0) > SAME_POSITION:
        return False
    about = q - q[0]
    far = about[np.argmax(np.linalg.norm(about, axis=1))]
    size = float(np.linalg.norm(far))
    if size <= SAME_POSITION:
        return True
    across = about - np.outer(about @ far / size, far / size)
    return bool(np.linalg.norm(across, axis=1).max() <= OFF_LINE_SHARE * size + SAME_POSITION)


def _evaluation(kind: Diagonals, source: str, found: list[Diagonal], basis: str, notes: tuple[str, ...]) -> Evaluation:
    quantities: list[Quantity] = []
    for n in (3, 2):
        own = [d for d in found if d.axes == n]
        every: dict[str, list[Array]] = {}
        for d in own:
            figures = d.axis.figures()
            # from one side only there is no figure of both
            figures |= {
                s: figures[f"{s}{a}"]
                for s in ("E", "A", "R")
                for a in "↑↓"
                if s not in figures and f"{s}{a}" in figures
            }
            for symbol in (s for s in FIGURES if s in figures and not (s == "B" and not d.reverses)):
                values = np.atleast_1d(figures[symbol])
                every.setdefault(symbol, []).append(values)
                value, expanded = spread(values)
                if symbol in ("R", "A"):  # standard deviations have no draws
                    expanded = d.repeatability
                words = FIGURES[symbol]
                quantities.append(Quantity(symbol, d.name, words, value, "mm", expanded, basis, length=d.length))
        for symbol, parts in every.items():
            shape = max(len(v) for v in parts)
            largest = np.max([np.broadcast_to(v, shape) for v in parts], axis=0)
            value, expanded = spread(largest)
            if symbol in ("R", "A"):
                expanded = own[0].repeatability
            words = f"largest {FIGURES[symbol].replace('the diagonal', f'a {KINDS[n]} diagonal')}"
            quantities.append(Quantity(f"{symbol} {KINDS[n]}", "", words, value, "mm", expanded, basis))
    quantities.sort(key=lambda q: bool(q.of))  # the machine first
    sheets = tuple(sheet(d.name, "mm", d.best) for d in found)
    charts = tuple(chart(d.name, "mm", d.best) for d in found)
    data: dict[str, Any] = {d.name: as_json(d.best, "mm") | {"length": d.length} for d in found}
    return Evaluation(kind.number, kind.title, source, tuple(quantities), sheets, charts, notes, data)
