"""What model comparison by ArviZ needs beside the draws: the log-likelihood of each row, and draws from the prior.

Both are those of the model that was sampled: kinematics linear about the fit, effects interpolated over their shapes.
"""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Array
from identification.bayes.full_posterior import Whole
from identification.bayes.hyperparameters import Coordinate
from identification.bayes.marginal_posterior import Collapsed
from identification.bayes.statistics import equations, extended
from identification.estimation.result import Fit
from identification.observation.models import Kind, View

CHUNK = 500  # rows at a time
DRAWS = 1000  # from the prior
SWEEPS = 30  # of a Gibbs sampler, where bounds cut the prior


def log_likelihood(fit: Fit, linear: Collapsed, whole: Whole | None, values: Array, moved: Array) -> dict[Kind, Array]:
    """Log density of what each row of the survey measured, at draws; NaN in rows that measured nothing of a kind.

    Parameters
    ----------
    fit : that the linear model was made from.
    whole : the model with outliers, if it has any.
    values : (n, p) parameters; `moved`: (n, coordinates).

    Returns
    -------
    dict
        (n, rows) of each kind of observation, of densities in mm or rad.
    """
    rows = extended(fit, linear.statistics.interpolations)
    own = moved[:, : len(linear.coordinates)]
    unknowns = linear.statistics.extended(values, linear.shapes(own))
    levels = linear.levels(own)
    mixture = None if whole is None or whole.mixture is None else np.exp(moved[:, -2:])
    zero = np.zeros(len(rows.problem.chain.ids))
    out: dict[Kind, Array] = {}
    for view in rows.problem.views:
        table = out.setdefault(view.kind, np.full((len(values), len(fit.survey)), np.nan))
        level = levels[:, linear.statistics.kinds.index(view.kind)]
        for start in range(0, len(view), CHUNK):
            part = view.part(slice(start, start + CHUNK))
            design, gap = equations(part, rows.place, rows.at, zero)
            gaps = gap - np.tensordot(unknowns, design, axes=(1, 2))
            log = _log_normal(part, level, np.einsum("nmc,nmc->nm", gaps, gaps))
            if mixture is not None and view.kind == linear.statistics.apart.kind:
                share, width = mixture[:, :1], mixture[:, 1:]
                far = _log_normal(part, level / width[:, 0] ** 2, np.einsum("nmc,nmc->nm", gaps, gaps))
                log = np.logaddexp(np.log1p(-share) + log, np.log(share) + far)
            seen = part.components.any(axis=1)
            where = part.index[seen]
            table[:, where] = np.nan_to_num(table[:, where]) + log[:, seen]
    return out


def _log_normal(view: View, level: Array, square: Array) -> Array:
    """Log densities (n, m) of rows with squared whitened residuals `square` at inverse variances `level` (n,)."""
    if view.whitener.ndim == 1:
        count = np.where(view.whitener > 0, len(view.outputs), 0)
        log_whitener = count * np.log(np.where(view.whitener > 0, view.whitener, 1.0))
    else:
        count = view.components.sum(axis=1)
        sizes = np.linalg.svd(view.whitener, compute_uv=False)
        sizes = np.where(np.arange(sizes.shape[1]) < count[:, None], sizes, 1.0)
        log_whitener = np.log(sizes).sum(axis=1)
    constant = log_whitener - 0.5 * count * np.log(2 * np.pi)
    return np.asarray(0.5 * np.log(level)[:, None] * count + constant - 0.5 * level[:, None] * square)


def prior_draws(linear: Collapsed, unknowns: tuple[Coordinate, ...], rng: np.random.Generator) -> tuple[Array, Array]:
    """Draws (n, p) of the parameters and (n, q) of the other unknowns, as nothing but the prior has them."""
    prior = linear.prior
    others = np.column_stack([_of_coordinate(c, rng) for c in unknowns]) if unknowns else np.zeros((DRAWS, 0))
    start = len(linear.coordinates) - len(prior.ties)
    precision = prior.precisions(others[:, start : start + len(prior.ties)])
    d = 1 / np.sqrt(np.diagonal(precision, axis1=1, axis2=2))
    factor = np.linalg.cholesky(precision * d[:, :, None] * d[:, None, :])
    noise = rng.standard_normal((DRAWS, len(prior.mean), 1))
    values = prior.mean + d * np.linalg.solve(factor.transpose(0, 2, 1), noise)[:, :, 0]
    return (_within(values, precision, linear, rng) if prior.bounded else values), others


def _of_coordinate(c: Coordinate, rng: np.random.Generator) -> Array:
    """Draws (n,): normal within the bounds where the user said so, else flat as the sampler moves it."""
    if not np.isfinite(c.std):
        return np.asarray(c.value(rng.uniform(c.moved(c.low), c.moved(c.high), DRAWS)))
    return _truncated(np.full(DRAWS, c.mean), np.full(DRAWS, c.std), c.low, c.high, rng)


def _within(values: Array, precision: Array, linear: Collapsed, rng: np.random.Generator) -> Array:
    """Draws of a normal prior within its bounds, by Gibbs sampling that begins with draws (n, p) of the whole."""
    prior = linear.prior
    values = np.clip(values, prior.low, prior.high)
    for _ in range(SWEEPS):
        for k in range(values.shape[1]):
            away = values - prior.mean
            own = precision[:, k, k]
            pull = np.einsum("nj,nj->n", precision[:, k], away) - own * away[:, k]
            std = 1 / np.sqrt(own)
            values[:, k] = _truncated(prior.mean[k] - pull / own, std, prior.low[k], prior.high[k], rng)
    return values


def _truncated(mean: Array, std: Array, low: float, high: float, rng: np.random.Generator) -> Array:
    from scipy.stats import truncnorm

    return np.asarray(truncnorm.rvs((low - mean) / std, (high - mean) / std, mean, std, random_state=rng))
