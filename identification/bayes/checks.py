"""Posterior predictive checks: statistics of the residuals against those of data simulated from the model."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from errormodel.arrays import Array
from identification.bayes.posterior import Check, Posterior
from identification.bayes.statistics import posed
from identification.estimation.result import Fit
from identification.observation.models import PositionView
from identification.observation.normal_equations import design_rows, view_vector

CHECK_DRAWS = 400  # draws of the posterior
MOST_CHECK_ROWS = 1200  # consecutive rows from the middle of a survey: limits time and memory
FEWEST_CHECK_ROWS = 12  # rows below which no check is made


def predictive_checks(fit: Fit, posterior: Posterior, rng: np.random.Generator) -> tuple[Check, ...]:
    """Posterior predictive checks of the positions; none for surveys with few or no positions.

    Residuals are computed at draws of the parameters (shapes at their means) and divided by draws of the noise level;
    simulated residuals are treated in the same way. Components that were not measured are left out.

    Parameters
    ----------
    fit : with the posterior's means as values.
    rng : generator of the draws.
    """
    views = [v for v in posed(fit, fit.chain.machine).views if isinstance(v, PositionView)]
    rows = sum(len(v) for v in views)
    if rows < FEWEST_CHECK_ROWS:
        return ()
    share = min(1.0, MOST_CHECK_ROWS / rows)
    views = [v.part(slice(int(len(v) * (1 - share) / 2), int(len(v) * (1 + share) / 2) + 1)) for v in views]
    place, base = fit.problem.place(), fit.solution.groups.base
    zero = np.zeros(len(fit.chain.ids))
    values = rng.multivariate_normal(np.zeros(len(base)), posterior.covariance, CHECK_DRAWS, method="cholesky")
    parts = []
    for view in views:
        vector = view_vector(view, place, fit.solution.values, zero)
        gap = np.hstack([view.whiten(part, g) for part, g in view.gaps(vector)])
        design = design_rows(view, place, most=len(view))[:, base].reshape(3, len(view), -1)
        own = gap - np.einsum("cmp,np->ncm", design, values)
        own[:, ~np.isfinite(fit.survey.measured[view.index]).T] = np.nan
        parts.append(own)
    residual = np.concatenate(parts, axis=2)
    noise = _column(posterior, "noise.position", rng)
    residual /= noise[:, None, None]
    drawn = rng.standard_normal(residual.shape)
    if any(c.name == "outliers.share" for c in posterior.unknowns):
        far = rng.random((CHECK_DRAWS, 1, residual.shape[2])) < _column(posterior, "outliers.share", rng)[:, None, None]
        drawn *= np.where(far, _column(posterior, "outliers.width", rng)[:, None, None], 1.0)
    drawn[np.isnan(residual)] = np.nan
    figures: list[tuple[str, str, Callable[[Array], Array]]] = [
        ("size", "mean square of a residual, in noise variances", lambda r: np.nanmean(r**2, axis=(1, 2))),
        ("largest", "largest component, in standard deviations", lambda r: np.nanmax(np.abs(r), axis=(1, 2))),
        ("tails", "mean fourth power over the squared mean square: 3 if normal", _tails),
        ("neighbours", "correlation of a row's residual with the next row's", _neighbours),
        ("axes", "mean square of the noisiest over the quietest axis", _axes),
    ]
    return tuple(Check(name, text, f(residual), f(drawn)) for name, text, f in figures)


def _column(posterior: Posterior, name: str, rng: np.random.Generator) -> Array:
    """Draws (CHECK_DRAWS,) of the hyperparameter `name`; ones if there is none of this name."""
    names = [c.name for c in posterior.unknowns]
    if name not in names:
        return np.ones(CHECK_DRAWS)
    return np.asarray(rng.choice(posterior.coordinates[:, :, names.index(name)].ravel(), CHECK_DRAWS))


def _tails(r: Array) -> Array:
    """Kurtosis about zero (draws,) of residuals (draws, components, rows)."""
    return np.asarray(np.nanmean(r**4, axis=(1, 2)) / np.nanmean(r**2, axis=(1, 2)) ** 2)


def _neighbours(r: Array) -> Array:
    """Correlation (draws,) of residuals of neighbouring rows."""
    return np.asarray(np.nanmean(r[:, :, 1:] * r[:, :, :-1], axis=(1, 2)) / np.nanmean(r**2, axis=(1, 2)))


def _axes(r: Array) -> Array:
    """Ratio (draws,) of the largest to the smallest mean square of a component."""
    seen = np.isfinite(r[0]).any(axis=1)
    square = np.nanmean(r[:, seen] ** 2, axis=2)
    return np.asarray(square.max(axis=1) / square.min(axis=1))
