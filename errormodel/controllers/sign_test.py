"""A table with one peak, and the programme that shows on a dial indicator whether it acts the right way."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.base import Controller
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Table, Tables, Term

PEAK = 0.05  # mm: plain to see on an indicator, harmless to a machine


def _chosen(terms: Sequence[Term]) -> Term:
    """The term that is easiest to understand: an axis' own curve, of the axis with the most points."""

    def rank(term: Term) -> tuple[bool, int]:
        own = len(term.inputs) == 1 and term.output.endswith(term.inputs[0]) and not term.factor
        return (not own, -term.size)

    return min((t for t in terms if t.inputs), key=rank)


def _peak(controller: Controller, setup: Setup, term: Term) -> tuple[Array, Array]:
    """Values of a term that rise to `PEAK` and fall again, no steeper than the format allows; its top (inputs,)."""
    grids = [np.asarray(g) for g in term.grids]
    at = [len(g) * 3 // 4 if len(g) > 2 else len(g) - 1 for g in grids]
    top = np.array([g[k] for g, k in zip(grids, at, strict=True)])
    slope = controller.most_slope(setup, term) or np.inf
    out = np.full(term.shape, PEAK)
    mesh = np.meshgrid(*grids, indexing="ij")
    for g, k, x in zip(grids, at, mesh, strict=True):
        reach = min(g[k] - g[0], g[-1] - g[k]) if 0 < k < len(g) - 1 else g[-1] - g[0]
        reach = min(reach, abs(g[k])) if term.zero and g[0] < 0 < g[-1] else reach
        steep = min(slope, PEAK / (g[1] - g[0])) if len(g) > 1 else 0.0
        out = np.minimum(out, np.maximum(0.0, min(PEAK, steep * reach) - steep * np.abs(x - g[k])))
    return out, top


def sign_test(controller: Controller, setup: Setup, terms: Sequence[Term]) -> dict[str, str]:
    """Files with one peak, and a programme that says what an indicator must show there."""
    chosen = _chosen(terms)
    values, top = _peak(controller, setup, chosen)
    alike = [t for t in terms if t.inputs == chosen.inputs and t.grids == chosen.grids]
    tables: Tables = tuple(Table(t, values if t == chosen else np.zeros(t.shape)) for t in alike)
    place = np.array([sum(a.measured) / 2 for a in setup.axes])
    place[[setup.place(i) for i in chosen.inputs]] = top
    files = controller.write(tables, setup)
    seen = controller.emulate(controller.read(files, setup), setup, place[None, :], np.ones((1, len(place))))[0]
    k = int(np.argmax(np.abs(seen)))
    axis, side = setup.movers[k], "plus" if seen[k] > 0 else "minus"
    words = " ".join(f"{a.name}{v:.3f}" for a, v in zip(setup.axes, place, strict=True))
    program = [
        "(SIGN TEST: one peak, to be run before the real tables are loaded)",
        f"(1 compensation off: an indicator against the spindle nose, along {axis})",
        "G90 G21",
        f"G0 {words}",
        "M0 (set the indicator to zero)",
        "(2 load the files of this folder, compensation on, approach again from the same side)",
        f"G0 {words}",
        f"M0 (the axis {axis} must now stand {seen[k]:+.4f} mm further, towards {side})",
        "(3 if it moved the other way, the controller wants the other sign: do not load the real tables)",
        "M30",
    ]
    return {**files, "sign_test.nc": "\n".join(program) + "\n"}
