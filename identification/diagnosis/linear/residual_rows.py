"""Residuals of a linear model, arranged again as rows of the survey's views."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from errormodel.arrays import Array
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search.criteria import cross_validation_residuals
from identification.estimation.result import Fit
from identification.observation.models import PositionView


def views_of(fit: Fit, linear: LinearModel) -> Iterator[PositionView]:
    """The rows of each view of the fit that the linear model holds."""
    for view in fit.problem.views:
        if isinstance(view, PositionView) and (own := np.isin(view.index, linear.index)).any():
            yield view.part(own)


def by_rows(fit: Fit, linear: LinearModel, values: Array) -> Iterator[tuple[PositionView, Array]]:
    """Values (N,) of the linear model's observations as (m, 3) a view, NaN where nothing was measured."""
    first = 0
    for part in views_of(fit, linear):
        last = first + part.count
        out = np.full((3, len(part)), np.nan)
        out[part.components.T] = values[first:last]  # component by component
        first = last
        yield part, out.T


def heldout_um(fit: Fit, linear: LinearModel) -> float:
    """Root mean square of the 3-D residual of blocks of rows, each predicted without it, um."""
    square, count = 0.0, 0
    for part, left in by_rows(fit, linear, cross_validation_residuals(linear)):
        white = np.nan_to_num(left)
        if part.whitener.ndim == 1:
            gap = white / part.whitener[:, None]
        else:
            gap = np.einsum("mij,mj->mi", np.linalg.pinv(part.whitener), white)
        square += float(np.sum(gap**2))
        count += len(part)
    return 1e3 * fit.solution.sigma["position"] * float(np.sqrt(square / count))
