"""Design problem of a plan: whitened rows of the candidate poses and of the volume, in a common orthonormal basis.

Candidates are poses that may be measured; the volume are poses at which predictions are wanted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.instruments.base import Instrument
from errormodel.machine import Machine
from identification.estimation.least_squares import identifiable
from identification.observation.assembly import Problem, build
from identification.observation.identifiability import Groups
from identification.observation.models import PositionView
from identification.observation.normal_equations import design_rows
from identification.observation.readings import ReadingView
from identification.planning.design import Space
from identification.planning.poses import as_survey, candidates, volume
from identification.planning.setup import Setup

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Stage:
    """The design problem of a plan.

    Attributes
    ----------
    chain, setup, noise : machine, circumstances, and instrument or standard uncertainty of a coordinate (mm).
    table : candidates, mm and rad; the first `scattered` of them are evenly distributed, the others near ends and
        middles of the travels.
    views : observation models of the candidates, each of all of them.
    space : rows of candidates and volume.
    blind : share of the volume where parameters act that no candidate identifies.
    """

    chain: Chain
    setup: Setup
    noise: Instrument | float
    table: pd.DataFrame
    scattered: int
    views: tuple[PositionView | ReadingView, ...]
    space: Space
    blind: float

    @property
    def positions(self) -> Array:
        """Joint positions of the candidates, (n, joints), mm and rad."""
        return self.table[[j.name for j in self.chain.machine.joints]].to_numpy(dtype=np.float64)


def prepare(machine: Machine, setup: Setup, noise: Instrument | float, seed: int) -> Stage:
    """The design problem of a machine and setup.

    Parameters
    ----------
    noise : an instrument, or one standard uncertainty of all coordinates, mm.
    seed : of the random poses.

    Raises
    ------
    InputError
        No pose is allowed.
    """
    chain = Chain(machine)
    table, scattered = candidates(chain, setup, seed)
    problem = build(chain, as_survey(chain, setup, table, noise))
    views = tuple(v for v in problem.views if isinstance(v, PositionView | ReadingView))
    place = problem.place()
    groups = identifiable(chain, problem.views, problem.unknowns)
    near = np.vstack([design_rows(v, place, most=len(v)) for v in views])
    points = setup.model_copy(update={"observations": {}})
    far_view = _position(build(chain, as_survey(chain, points, volume(chain, setup, seed), 1.0)))  # 1 mm: rows in mm
    far = design_rows(far_view, place, most=len(far_view))
    scale = np.abs(far).max(axis=0)
    if setup.observations and setup.frame != "fixed" and not problem.frames:
        far = _without_rigid(far_view, far)
    base = groups.base
    norms = np.linalg.norm(near[:, base], axis=0)
    basis, mix = np.linalg.qr(near[:, base] / norms)
    inverse = np.linalg.inv(mix) / norms[:, None]
    rows = (basis, far[:, base] @ inverse)
    count = len(near) // len(table)  # of readings at a pose
    X, V = (
        np.ascontiguousarray(b.reshape(c, -1, groups.rank).transpose(1, 0, 2))
        for b, c in zip(rows, (count, 3), strict=True)
    )
    return Stage(chain, setup, noise, table, scattered, views, Space(X, V), _blind(groups, far, scale))


def _without_rigid(view: PositionView, far: Array) -> Array:
    """Rows of the volume without the motion of the whole machine that fits each column best.

    Lengths from places that are unknown themselves do not show where the whole machine is, and nobody asks.
    """
    rigid = design_rows(view, {name: k for k, name in enumerate(view.chain.frame_ids)}, most=len(view))
    basis, _ = np.linalg.qr(rigid / np.linalg.norm(rigid, axis=0))
    return np.asarray(far - basis @ (basis.T @ far))


def _position(problem: Problem) -> PositionView:
    """The position view of a problem."""
    return next(v for v in problem.views if isinstance(v, PositionView))


def _blind(groups: Groups, far: Array, scale: Array) -> float:
    """Share of the volume's poses whose rows are not in the span of the groups, beyond rounding of columns so large."""
    lost = np.abs(far - far[:, groups.base] @ groups.coefficients)
    return float((lost > 1e-5 * np.where(scale > 0, scale, 1.0)).reshape(3, -1, far.shape[1]).any(axis=(0, 2)).mean())
