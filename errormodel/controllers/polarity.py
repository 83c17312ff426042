"""Polarity check: tables with one peak per axis, positions to visit, and the readings expected of an indicator.

There are two positions. At the first the direct table of every axis has its peak, each of another height, so that
interchanged axes show. At the second the cross tables have theirs, including products and angles with a lever. At both
positions every axis that a table of the check moves is read. Readings in mm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.base import Controller, read_back, written
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import LONGER, Table, Tables, Term

# mm, peaks of the first, second, third axis: clearly visible, harmless, and distinct; by judgement
OWN_MM = (0.050, 0.040, 0.030)
CROSS_MM = (0.030, 0.050, 0.040)  # mm, peaks of the cross tables, in another order than the direct ones
MOST_LEVER_MM = 0.2  # mm, largest value of a table that is multiplied by a short lever; by judgement
LEAST_READING_MM = 0.005  # mm: smaller displacements cannot be read on an indicator; by judgement
TRAVEL_MARGIN_MM = 1.0  # mm between any position and the ends of the travel; by judgement


@dataclass(frozen=True)
class Step:
    """One reading of the check.

    Attributes
    ----------
    axis : axis on which the indicator is read.
    place : machine positions of all axes (mm, deg), by name.
    reading : mm, expected displacement by the compensation, positive in plus direction.
    by_itself : mm, displacement if a pure multiplier table acted directly; None: there is no such table.
    table : description of the table that causes it.
    """

    axis: str
    place: Mapping[str, float]
    reading: float
    by_itself: float | None
    table: str


def polarity_check(controller: Controller, setup: Setup, terms: Sequence[Term]) -> tuple[dict[str, str], list[Step]]:
    """Files with a peak for each axis, and the readings expected once they are loaded."""
    terms = [t for t in terms if t.factor != LONGER]  # the check is made with the tables' own tool
    own = {m: t for m in setup.watched if (t := _own(controller, setup, terms, m)) and len(_grid(setup, m, t)) > 1}
    if not own:
        return {}, []
    places = _places(setup, own)
    first, second = ({m: place[k] for m, place in places.items()} for k in (0, 1))
    rests = {a.name: min(max(0.0, a.measured[0]), a.measured[1]) for a in setup.axes}
    crosses = _crosses(controller, setup, terms, {**rests, **second}, list(own))
    sized = [(t, OWN_MM[setup.watched.index(m)], first, second) for m, t in own.items()]
    sized += [(t, height, second, first) for t, height in crosses]
    peaks = [Table(t, _peak(controller, setup, t, height, {**rests, **top}, away)) for t, height, top, away in sized]
    tables: Tables = tuple(replace(p, term=u) for p in peaks for u in _twins(terms, p.term))
    files = written(controller, tables, setup)
    back = read_back(controller, files, setup)
    steps = []
    for place, kind in ((first, "own table"), (second, "cross table")):
        full = {**rests, **{m: _within(setup, m, x) for m, x in place.items()}}
        q = np.array([[full[n] for n in setup.names]])
        seen = controller.emulate(back, setup, q, np.ones_like(q))[0]
        alone = controller.by_itself(tables, setup, q)
        steps += [
            Step(m, full, float(seen[setup.movers.index(m)]), alone.get(m), kind)
            for m in setup.watched
            if abs(seen[setup.movers.index(m)]) >= LEAST_READING_MM
        ]
    return files, steps


def _own(controller: Controller, setup: Setup, terms: Sequence[Term], mover: str) -> Term | None:
    """Plainest table that corrects an axis as a function of its own position."""
    still = {*setup.watched}  # the other axes do not move
    mine = [t for t in terms if t.inputs and controller.moved(t.output) == mover and not t.factor and t.direction >= 0]
    return min(
        mine, key=lambda t: (mover not in t.inputs, not {*t.inputs} <= still, len(t.inputs), -t.size), default=None
    )


def _twins(terms: Sequence[Term], term: Term) -> list[Term]:
    """The term and that of the other direction: both get the same peak, whatever the direction of approach."""
    return [t for t in terms if replace(t, direction=term.direction) == term]


def _places(setup: Setup, own: Mapping[str, Term]) -> dict[str, tuple[float, float]]:
    """Positions of each axis for its direct peak and for the cross tables, at nodes of its table."""
    out = {}
    for m, term in own.items():
        grid = _grid(setup, m, term)
        zero = float(np.clip(0.0, grid[0], grid[-1])) if term.zero else None
        high = _node(grid, 0.75, [zero] if zero is not None else [])
        out[m] = (high, _node(grid[grid != high], 0.25, [high, *([zero] if zero is not None else [])]))
    return out


def _grid(setup: Setup, m: str, term: Term) -> Array:
    """Distinct positions of an axis at which its table has nodes."""
    own = term.grids[term.inputs.index(m)] if m in term.inputs else np.linspace(*setup.axis(m).measured, 9)
    return np.unique(np.asarray(own))


def _within(setup: Setup, name: str, x: float) -> float:
    """A position inside the travel by the margin, if the table's node lies too close to an end."""
    low, high = setup.axis(name).travel
    return float(np.clip(x, min(low + TRAVEL_MARGIN_MM, high), max(high - TRAVEL_MARGIN_MM, low)))


def _node(grid: Array, share: float, away: Sequence[float]) -> float:
    """A node near a share of the grid, as far as possible from positions where a table must be zero."""
    wanted = grid[0] + share * (grid[-1] - grid[0])
    span = max(grid[-1] - grid[0], 1e-9)

    def rank(x: float) -> float:
        gap = min((abs(x - z) for z in away), default=span)
        return float(abs(x - wanted) + 100 * max(0.0, span / 8 - gap))

    return float(min(grid, key=rank))


def _crosses(
    controller: Controller, setup: Setup, terms: Sequence[Term], place: Mapping[str, float], axes: Sequence[str]
) -> list[tuple[Term, float]]:
    """A cross table for each axis, products before plain ones; of angles only the one with the largest effect."""
    q = np.array([[place[n] for n in setup.names]])
    out: list[tuple[Term, float]] = []
    plain = [t for t in terms if len(t.inputs) == 1 and t.inputs[0] in axes and t.direction >= 0]
    turning = [t for t in plain if not controller.moved(t.output)]
    arm = {t: float(np.abs(controller.influence(setup, t.output, q)).max()) for t in turning}
    if arm and max(arm.values()) > 0:
        best = max(turning, key=lambda t: arm[t])
        return [(best, OWN_MM[0] / arm[best])]
    for k, m in enumerate(axes):
        causes = [*axes[k + 1 :], *axes[:k]]
        mine = [t for t in plain if controller.moved(t.output) == m and t.inputs[0] in causes and " " not in t.factor]
        lever = {t: abs(place[t.factor]) / 1000 if t.factor else 0.0 for t in mine}
        found = min(mine, key=lambda t: (lever[t] < 0.1, causes.index(t.inputs[0]), -lever[t]), default=None)
        if found is not None:
            out.append((found, min(CROSS_MM[k % 3] / (lever[found] or 1.0), MOST_LEVER_MM)))
    return out


def _peak(
    controller: Controller, setup: Setup, term: Term, height: float, top: Mapping[str, float], away: Mapping[str, float]
) -> Array:
    """Values with a peak at the node nearest to `top`, within the format's slope, and zero at `away`."""
    slope = controller.most_slope(setup, term) or np.inf
    out = np.full(term.shape, height)
    mesh = np.meshgrid(*term.grids, indexing="ij")
    for axis, points, x in zip(term.inputs, term.grids, mesh, strict=True):
        g = np.asarray(points)
        middle = float(g[np.argmin(np.abs(g - top[axis]))])
        zeros = [away[axis]] if axis in away else []
        zeros += [float(np.clip(0.0, g[0], g[-1]))] if term.zero else []
        reach = min((abs(middle - z) for z in zeros), default=g[-1] - g[0])
        steep = min(slope, height / (g[1] - g[0]))
        out = np.minimum(out, np.maximum(0.0, min(height, steep * reach) - steep * np.abs(x - middle)))
    return out
