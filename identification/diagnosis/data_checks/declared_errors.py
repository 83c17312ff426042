"""What a linear fit of the machine's declared errors leaves of measured points, to compare ways to read a recording.

Errors of a machine make a pattern over the poses. A recording that is read as it was meant leaves noise; its mirror
image may lie as near to the nominal machine, and its pattern is none of this machine's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.survey import Survey
from identification.estimation.orthonormal_basis import orthonormal_basis
from identification.observation.assembly import Problem, build
from identification.observation.models import PositionView
from identification.observation.normal_equations import design_rows

MOST_ROWS = 4000  # evenly spaced; so many readings tell any two ways to read them apart
NO_EFFECT = 1e-12  # of the largest column of M: by rounding only
CLEAR = 3.0  # times the residual standard deviation of another way to read the same points
CLEARLY = 25.0  # log likelihood ratio


@dataclass(frozen=True)
class DeclaredErrors:
    """Positions of a survey beside the nominal machine, and what its declared errors and frames can make of them.

    Attributes
    ----------
    gaps : of each view, (3, n) mm in the machine's reference.
    basis : (components, rank), orthonormal and whitened.
    """

    views: tuple[PositionView, ...]
    gaps: tuple[Array, ...]
    basis: Array

    @classmethod
    def of(cls, problem: Problem) -> Self | None:
        """None where no positions with all components were measured, or too few to leave anything."""
        views = [v for v in problem.views if isinstance(v, PositionView)]
        if not views or not all(v.components.all() for v in views):
            return None
        step = -(-sum(map(len, views)) // MOST_ROWS)
        views = [v.part(slice(None, None, step)) for v in views]
        zero = np.zeros(len(problem.chain.ids))
        gaps = tuple(np.hstack([g for _, g in v.gaps(zero)]) for v in views)
        place = problem.place()
        design = np.vstack([design_rows(v, place, most=len(v)) for v in views])
        norms = np.linalg.norm(design, axis=0)
        seen = norms > NO_EFFECT * norms.max(initial=0.0)
        basis = orthonormal_basis(design[:, seen] / norms[seen])
        return cls(tuple(views), gaps, basis) if len(basis) > basis.shape[1] else None

    @property
    def freedom(self) -> int:
        """Components less the errors that they determine."""
        return int(len(self.basis) - self.basis.shape[1])

    @property
    def left(self) -> float:
        """Norm of what is left of the gaps, in units of the noise."""
        white = [v.whiten(slice(None), g).ravel() for v, g in zip(self.views, self.gaps, strict=True)]
        readings = np.concatenate(white)
        return float(np.linalg.norm(readings - self.basis @ (self.basis.T @ readings)))


def left_by_declared(chain: Chain, survey: Survey) -> tuple[float, int] | None:
    """Residual standard deviation of the rows to fit, in units of the noise, and degrees of freedom; None without any.

    It is per root mean square of the measured points about their middle: another unit of theirs alone fits no better.
    """
    found = DeclaredErrors.of(build(chain, survey.fit))
    if found is None:
        return None
    reach = max(float(np.sqrt(np.sum(np.nanvar(survey.fit.measured, axis=0)))), 1e-9)
    return found.left / np.sqrt(found.freedom) / reach, found.freedom
