"""Leverage of each row, and predicted standard uncertainties after ten more poses (similar or A-optimal).

Optimal poses minimise the sum of the groups' variances relative to the present ones (A-optimality in units of the
present standard uncertainties). They are chosen one after another from random poses over the travels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array
from identification.estimation.scaled_equations import scaled_inverse
from identification.observation.models import PositionView, anywhere
from identification.observation.normal_equations import design_rows, total

if TYPE_CHECKING:
    import pandas as pd

    from identification.estimation.result import Fit

FURTHER_POSES = 10  # number of additional poses that are evaluated
FURTHER_POSE_CANDIDATES = 400  # random poses from which the best are chosen: limits the time
LEVERAGE_BLOCK_ROWS = 500  # rows whose M is held at a time: limits the memory; few curves are not zero in them


@dataclass(frozen=True)
class Gain:
    """Predicted standard uncertainties of the groups after ten more poses.

    Attributes
    ----------
    like_these : (rank,) with poses like those measured; in the groups' units, with the fit's Birge ratio.
    best : (rank,) with the A-optimal poses; None where no position was measured.
    poses : these poses (10 rows), joints in mm and degrees; None where no position was measured.
    """

    like_these: Array
    best: Array | None
    poses: pd.DataFrame | None


def gain_of(fit: Fit) -> Gain:
    """Predicted standard uncertainties of a fit after ten more poses with the same noise."""
    s = fit.solution
    rows = fit.fitted.n or len(fit.survey)
    std = np.sqrt(np.diag(s.covariance)) * fit.inflation
    # the covariance is also of serial correlation and of forms: it is taken to fall by as much as that of white noise
    pick = np.ix_(s.groups.base, s.groups.base)
    information, known = total(s.sums, s.sigma)[0][pick], np.diag(s.precision[s.groups.base])
    now, then = (np.diag(scaled_inverse(more * information + known)) for more in (1.0, 1 + FURTHER_POSES / rows))
    like = std * np.sqrt(then / now)
    view = next((v for v in fit.problem.views if isinstance(v, PositionView)), None)
    if view is None or not s.groups.rank:
        return Gain(like, None, None)
    somewhere = anywhere(view, FURTHER_POSE_CANDIDATES)
    design = (
        design_rows(somewhere, fit.problem.place(), FURTHER_POSE_CANDIDATES)[:, s.groups.base] / s.sigma["position"]
    )
    design = (design * np.sqrt(np.diag(s.covariance))).reshape(3, FURTHER_POSE_CANDIDATES, -1).transpose(1, 0, 2)
    variance, chosen = np.ones(s.groups.rank), []
    seen = design @ _unit(s.covariance)
    for _ in range(FURTHER_POSES):
        noise = np.linalg.inv(seen @ design.transpose(0, 2, 1) + np.eye(3))
        gained = np.einsum("nap,nab,nbp->n", seen, noise, seen)
        k = int(gained.argmax())
        chosen.append(k)
        less = noise[k] @ seen[k]
        variance -= np.einsum("ap,ap->p", seen[k], less)
        seen = seen - (design @ seen[k].T) @ less
    poses = _commands(fit, [c[chosen] for c in somewhere.rows])
    return Gain(like, std * np.sqrt(np.maximum(variance, 0.0)), poses)  # what poses all alike leave rounds below 0


def leverages(fit: Fit) -> Array:
    """Leverage (rows,) of each row of the survey; NaN where nothing was measured.

    The sum is the number of groups. A row with more than two or three times the mean dominates some group.
    """
    s, place = fit.solution, fit.problem.place()
    out = np.full(len(fit.survey), np.nan)
    for view in fit.problem.views:
        for start in range(0, len(view), LEVERAGE_BLOCK_ROWS):
            part = view.part(slice(start, start + LEVERAGE_BLOCK_ROWS))
            rows = design_rows(part, place, LEVERAGE_BLOCK_ROWS)[:, s.groups.base] / s.sigma[view.kind]
            seen = np.flatnonzero(rows.any(axis=0))
            rows = rows[:, seen]
            own = np.einsum("np,np->n", rows @ s.covariance[np.ix_(seen, seen)], rows)
            own = own.reshape(len(view.outputs), -1).sum(axis=0)
            out[part.index] = np.nan_to_num(out[part.index]) + own
    return out if fit.sorting is None else out * fit.sorting.weight


def _unit(covariance: Array) -> Array:
    """Correlation matrix of a covariance matrix."""
    std = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(std, std))


def _commands(fit: Fit, rows: list[Array]) -> pd.DataFrame:
    """Joint positions, mm and degrees."""
    import pandas as pd

    from errormodel.simulation import outward

    machine = fit.chain.machine
    table = pd.DataFrame({j.name: c for j, c in zip(machine.joints, rows, strict=False)})
    return outward(table, machine)
