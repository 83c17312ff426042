"""Residuals of a linear model, arranged again as rows of the survey's views."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from errormodel.arrays import Array
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.of_fit import Seen
from identification.diagnosis.linear.row_residuals import counts
from identification.diagnosis.search.criteria import cross_validation_residuals
from identification.estimation.result import Fit
from identification.observation.models import OrientationView, PositionView
from identification.observation.readings import ReadingView


def views_of(fit: Fit, linear: LinearModel) -> list[Seen]:
    """The rows of each view of the fit that the linear model holds; of many rows these are no orientations."""
    views = [v for v in fit.problem.views if isinstance(v, Seen)]
    parts = [v.part(own) for v in views if (own := np.isin(v.index, linear.index)).any()]
    others: list[Seen] = [part for part in parts if not isinstance(part, OrientationView)]
    return others if sum(part.count for part in others) == len(linear.index) else parts


def by_rows(fit: Fit, linear: LinearModel, values: Array) -> Iterator[tuple[Seen, Array]]:
    """Values (N,) of the linear model's observations as (m, 3) a view, (m, 1) of readings; NaN where not measured."""
    first = 0
    for part in views_of(fit, linear):
        last = first + part.count
        out = np.full((len(part.outputs), len(part)), np.nan)
        out[part.components.T] = values[first:last]  # component by component
        first = last
        yield part, out.T


def heldout_um(fit: Fit, linear: LinearModel) -> float:
    """Root mean square of the rows' residuals, in blocks that are each predicted without it, um."""
    return rms_um(fit, linear, cross_validation_residuals(linear))


def rms_um(fit: Fit, linear: LinearModel, values: Array) -> float:
    """Root mean square over the rows of whitened values (N,) of the linear model's observations, um.

    3-D vectors of points, gaps of lengths (`row_residuals`).
    """
    if fit.readings is not None:
        return _of_readings(fit, linear, values)
    square, count = 0.0, 0
    for part, left in by_rows(fit, linear, values):
        if isinstance(part, OrientationView):
            continue
        square += float(np.sum(unwhitened(part, left) ** 2))
        count += len(part)
    return 1e3 * fit.solution.sigma["position"] * float(np.sqrt(square / count))


def _of_readings(fit: Fit, linear: LinearModel, values: Array) -> float:
    """The same where lengths or angles are among the rows; a row with a point and a length counts once."""
    square = np.zeros(len(fit.survey))
    seen = np.zeros(len(fit.survey), dtype=bool)
    for part, left in by_rows(fit, linear, values):
        factor = counts(part, fit) if isinstance(part, ReadingView) else float(isinstance(part, PositionView))
        if factor:
            gap = factor * fit.solution.sigma[part.kind] * unwhitened(part, left)
            square[part.index] += np.sum(gap**2, axis=1)
            seen[part.index] = True
    return 1e3 * float(np.sqrt(square[seen].mean()))


def unwhitened(part: Seen, white: Array) -> Array:
    """Whitened residuals (m, outputs), NaN where not measured, in mm or rad."""
    white = np.nan_to_num(white)
    if part.whitener.ndim == 1:
        return np.asarray(white / part.whitener[:, None])
    gap: Array = np.einsum("mij,mj->mi", np.linalg.pinv(part.whitener), white)
    return gap
