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
    view : observation model of the candidates.
    space : rows of candidates and volume.
    blind : share of the volume where parameters act that no candidate identifies.
    """

    chain: Chain
    setup: Setup
    noise: Instrument | float
    table: pd.DataFrame
    scattered: int
    view: PositionView
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
    view = _position(problem)
    place = problem.place()
    groups = identifiable(chain, problem.views, problem.unknowns)
    near = design_rows(view, place, most=len(view))
    far_view = _position(build(chain, as_survey(chain, setup, volume(chain, setup, seed), 1.0)))  # 1 mm: rows in mm
    far = design_rows(far_view, place, most=len(far_view))
    base = groups.base
    norms = np.linalg.norm(near[:, base], axis=0)
    basis, mix = np.linalg.qr(near[:, base] / norms)
    inverse = np.linalg.inv(mix) / norms[:, None]
    rows = (basis, far[:, base] @ inverse)
    X, V = (np.ascontiguousarray(b.reshape(3, -1, groups.rank).transpose(1, 0, 2)) for b in rows)
    return Stage(chain, setup, noise, table, scattered, view, Space(X, V), _blind(groups, far))


def _position(problem: Problem) -> PositionView:
    """The position view of a problem."""
    return next(v for v in problem.views if isinstance(v, PositionView))


def _blind(groups: Groups, far: Array) -> float:
    """Share of the volume's poses whose rows are not in the span of the groups."""
    lost = np.abs(far - far[:, groups.base] @ groups.coefficients)
    scale = np.abs(far).max(axis=0)
    return float((lost > 1e-5 * np.where(scale > 0, scale, 1.0)).reshape(3, -1, far.shape[1]).any(axis=(0, 2)).mean())
