"""Machines as controllers see them, without a fit: axes, grids, and simple kinematics."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from errormodel.controllers.base import Controller
from errormodel.controllers.setup import Axis, Setup
from errormodel.controllers.tables import Table, Tables, Term
from tests.helpers.chains import Array

ALONG = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0), "C": (0.0, 0.0, 1.0)}


def levers(q: Array) -> tuple[Array, Array]:
    """Of a chain X Y Z with a tool of 100 mm, and C that turns nothing: error motions, and the axes' own."""
    n, axes = q.shape
    out, tip = np.zeros((n, 3, 6 * axes)), np.zeros((n, 3, axes))
    for k in range(axes):
        arm = np.zeros((n, 3))
        for later in range(k + 1, min(axes, 3)):
            arm[:, later] = q[:, later]
        arm[:, 2] -= 100.0
        out[:, :, 6 * k : 6 * k + 3] = np.eye(3)
        out[:, :, 6 * k + 3 : 6 * k + 6] = np.cross(np.eye(3)[None], arm[:, None]).transpose(0, 2, 1)
        if k < 3:
            tip[:, k, k] = 1.0
    return out, tip


@st.composite
def setups(draw: st.DrawFn) -> Setup:
    """Three linear axes, sometimes a table: any travels, reversing axes, parts of the travel measured."""
    axes = []
    for name in ("X", "Y", "Z", *draw(st.sampled_from([(), ("C",)]))):
        low = draw(st.integers(-900, 300)) + draw(st.sampled_from([0.0, 0.25, 0.123]))
        span = draw(st.integers(40, 900))
        travel = (low, low + span) if name != "C" else (-90.0, 270.0)
        part = draw(st.sampled_from([(0.0, 1.0), (0.1, 0.9)]))
        measured = tuple(travel[0] + p * (travel[1] - travel[0]) for p in part)
        intervals = draw(st.integers(2, 7))
        axes.append(Axis(name, name, name == "C", travel, (measured[0], measured[1]), ALONG[name], intervals))
    reversing = draw(st.frozensets(st.sampled_from([a.name for a in axes])))
    return Setup("test machine", tuple(axes), ("X", "Y", "Z"), reversing, levers=levers)


def plain_setup(**more: object) -> Setup:
    """X -200 to 400, Y 0 to 300, Z -250 to -50."""
    travels = {"X": (-200.0, 400.0), "Y": (0.0, 300.0), "Z": (-250.0, -50.0)}
    axes = tuple(Axis(n, n, False, t, t, ALONG[n], 6) for n, t in travels.items())
    return Setup("test machine", axes, ("X", "Y", "Z"), levers=levers, **more)  # type: ignore[arg-type]


def filled(
    controller: Controller, setup: Setup, terms: list[Term], rng: np.random.Generator, size: float = 0.03
) -> Tables:
    """Terms with random values within the format's slopes, zero where they must be."""
    out = []
    for term in terms:
        values = rng.uniform(-size, size, term.shape) * (1e-3 if term.output[:2] in ("EA", "EB", "EC") else 1.0)
        slope = controller.most_slope(setup, term)
        for axis, grid in enumerate(term.grids):
            steepest = np.abs(np.diff(values, axis=axis)).max(initial=0.0) / (grid[1] - grid[0])
            if slope is not None and steepest > slope:
                values *= 0.95 * slope / steepest
        if term.zero:
            g = np.asarray(term.grids[0])
            values = values - np.interp(min(max(0.0, g[0]), g[-1]), g, values)
        out.append(Table(term, values))
    return tuple(out)
