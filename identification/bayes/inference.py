"""Bayesian inference for a fitted machine: prior, sufficient statistics, sampling, predictive checks.

The method is exact where the posterior is Gaussian, quadrature for one hyperparameter, and emcee otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from errormodel.arrays import Array
from errormodel.exceptions import InputError, nearest
from errormodel.machine import Machine
from errormodel.yamlfile import Document
from identification.bayes.applied import departure, machine_at, with_posterior
from identification.bayes.checks import predictive_checks
from identification.bayes.evidence import evidence_of
from identification.bayes.full_posterior import Whole
from identification.bayes.hyperparameters import Coordinate
from identification.bayes.marginal_posterior import Collapsed
from identification.bayes.outliers import in_doubt, mixture_of, squares_of
from identification.bayes.pointwise import log_likelihood, prior_draws
from identification.bayes.posterior import Method, Posterior
from identification.bayes.priors import prior_of
from identification.bayes.sampling import Chains, Reference, Target, inside, sample, walkers_for
from identification.bayes.settings import PriorForm, prior_error
from identification.bayes.shape_parameters import shape_interpolations
from identification.bayes.statistics import gather, kind_with_outliers
from identification.bayes.unknowns import (
    check_against_data,
    coordinates_of,
    counted,
    free_kinds,
    with_prior,
)
from identification.estimation.result import Fit
from identification.results.groups import groups_of
from identification.runtime.blas import one_blas_thread
from identification.runtime.progress import Progress, Steps, silent, uncounted

EXACT_CHAINS, EXACT_DRAWS = 4, 1000  # of exact draws
MOST_KEPT_DRAWS = 8000  # kept of a chain
QUADRATURE_POINTS = 400  # points of a quadrature
MOST_DENSITIES = 2_000_000  # kept of the log-likelihood: draws times rows
MOST_LOG_LIKELIHOOD_ERROR = 0.5  # of the log likelihood, by which the linear model may miss the exact kinematics


def bayesian(
    fit: Fit,
    refit: Callable[[Machine], Fit],
    given: Mapping[str, PriorForm] | None = None,
    document: Document | None = None,
    *,
    robust: bool = False,
    seed: int = 0,
    folder: Path | None = None,
    progress: Progress = silent,
    count: Steps = uncounted,
) -> Fit:
    """A fit with the posterior of its parameters, noise levels, shape parameters and, if `robust`, outliers.

    Parameters
    ----------
    fit : least-squares fit.
    refit : fits a machine with other shape parameters to the same survey.
    given : the user's priors by name; `document`: their file, for messages.
    robust : model rows as a mixture of noise and outliers.
    seed : of all random numbers.
    folder : where an unfinished chain is stored.
    progress, count : progress callbacks for stages and for the steps of the chain.

    Returns
    -------
    Fit
        With the posterior's means, covariance and shape parameters.

    Raises
    ------
    InputError
        A prior contradicts itself, another or the data, or too few walkers start inside its bounds.
    NotConvergedError
        The chain has not converged.
    """
    given = given or {}
    with one_blas_thread():
        with progress("Gathering sufficient statistics"):
            linear, whole, notes = model_of(fit, given, document, robust)
        posterior, moved = drawn(fit, linear, whole, seed, folder, count)
        with progress("Checking the posterior"):
            values = posterior.values.reshape(-1, len(posterior.names))
            away = departure(fit, linear, values, moved[:, : len(linear.coordinates)])
            if away > MOST_LOG_LIKELIHOOD_ERROR:
                notes = (
                    *notes,
                    f"the kinematics bend over the posterior: log-probabilities are off by up to {away:.1f}",
                )
            posterior = _with_likelihood(fit, posterior, linear, whole, moved, seed)
            if linear.statistics.interpolations:
                shapes = linear.shapes(moved).mean(axis=0)
                fit = refit(machine_at(fit.chain.machine, linear.statistics.interpolations, shapes))
            fit = with_posterior(fit, posterior)
            checks = predictive_checks(fit, posterior, np.random.default_rng(seed))
            posterior = replace(
                posterior, checks=checks, evidence=evidence_of(fit), departure=away, notes=(*posterior.notes, *notes)
            )
    return replace(fit, posterior=posterior)


def _with_likelihood(
    fit: Fit, posterior: Posterior, linear: Collapsed, whole: Whole | None, moved: Array, seed: int
) -> Posterior:
    """The posterior with the log-likelihood of each row at some of the draws, and with draws from the prior."""
    chains, draws, p = posterior.values.shape
    every = min(-(-chains * draws * len(fit.survey) // MOST_DENSITIES), draws)
    kept = moved.reshape(chains, draws, -1)[:, ::every]
    found = log_likelihood(
        fit, linear, whole, posterior.values[:, ::every].reshape(-1, p), kept.reshape(-1, kept.shape[2])
    )
    values, coordinates = prior_draws(linear, posterior.unknowns, np.random.default_rng(seed))
    return replace(
        posterior, every=every, prior_values=values, prior_coordinates=coordinates,
        log_likelihood={kind: log.reshape(chains, -1, len(fit.survey)) for kind, log in found.items()},
    )  # fmt: skip


def model_of(
    fit: Fit, given: Mapping[str, PriorForm], document: Document | None, robust: bool
) -> tuple[Collapsed, Whole | None, tuple[str, ...]]:
    """The marginal posterior; the full one if parameters are bounded or rows have outliers, else None; notes."""
    known = fit.solution.unknowns
    prior = prior_of(fit, {n: f for n, f in given.items() if n in known}, document)
    check_against_data(fit, prior, given, document)
    interpolations, notes = shape_interpolations(fit)
    share = 1.0 if robust else counted(fit)
    if share < 1:
        notes = (*notes, f"noise is correlated from row to row: each row counts as {share:.2f} of one")
    keep, square, seen, level = None, np.zeros(0), np.zeros(0), 1.0
    if robust:
        level = fit.solution.sigma[kind_with_outliers(fit)] * fit.inflation
        square, seen = squares_of(fit)
        keep = in_doubt(square, seen, level)
    statistics = gather(fit, interpolations, keep, share)
    own = (with_prior(c, given, document) for c in coordinates_of(fit, statistics, prior))
    linear = Collapsed(statistics, prior, tuple(own), free_kinds(fit, statistics))
    mixture = None
    if robust:
        mixture = mixture_of(statistics.apart, square, seen, level)
        first, second = (with_prior(c, given, document) for c in mixture.coordinates)
        mixture = replace(mixture, coordinates=(first, second))
    names = [c.name for c in (*linear.coordinates, *(mixture.coordinates if mixture else ()))]
    for name in given:
        if name not in names and name not in known:
            raise prior_error(document, name, "there is no such unknown", nearest(name, [*names, *statistics.names]))
    return linear, Whole.of(linear, mixture) if robust or prior.bounded else None, notes


def drawn(
    fit: Fit, linear: Collapsed, whole: Whole | None, seed: int, folder: Path | None = None, count: Steps = uncounted
) -> tuple[Posterior, Array]:
    """The posterior without checks, and the hyperparameters (n, q) of its draws on the sampled scale."""
    rng = np.random.default_rng(seed)
    (mean,), (covariance,) = linear.closed(linear.start())
    closed_mean, closed_std = mean, np.sqrt(np.diag(covariance))
    q, chains = len(linear.coordinates), None
    outliers: tuple[tuple[str, int, float], ...] = ()
    target: Target = linear if whole is None else whole
    unknowns = linear.coordinates if whole is None else whole.coordinates
    method: Method = "emcee" if whole is not None or q > 1 else "quadrature" if q else "exact"
    if method == "emcee":
        points, chains = _sampled(target, unknowns, len(mean) if whole else 0, seed, folder, count)
        flat = points.reshape(-1, points.shape[2])
        shape = points.shape[:2]
    else:
        flat, shape = np.zeros((EXACT_CHAINS * EXACT_DRAWS, 0)), (EXACT_CHAINS, EXACT_DRAWS)
        if q:
            grid, weights = _grid(linear)
            flat = rng.choice(grid, len(flat), p=weights)[:, None]
            mean, covariance = moments(linear, grid[:, None], weights)
    if whole is None:
        values, moved = linear.parameters(flat, rng), flat
        if chains is not None:
            some = flat[:: max(1, len(flat) // 500)]
            mean, covariance = moments(linear, some, np.full(len(some), 1 / len(some)))
    else:
        values, _ = whole.split(flat)
        moved = flat[:, len(mean) :]
        mean, covariance = values.mean(axis=0), np.atleast_2d(np.cov(values.T))
        outliers = _outliers(fit, whole, flat)
    natural = np.stack([c.value(x) for c, x in zip(unknowns, moved.T, strict=True)], axis=1) if unknowns else moved
    units = {p["id"]: p["unit"] for p in groups_of(fit)}
    names = linear.statistics.names
    posterior = Posterior(
        method, names, tuple(units[n] for n in names), values.reshape(*shape, len(names)),
        natural.reshape(*shape, len(unknowns)), unknowns, mean, covariance, closed_mean, closed_std,
        linear.prior.std, whole is not None, chains, outliers,
    )  # fmt: skip
    return posterior, moved


def _sampled(
    target: Target, unknowns: Sequence[Coordinate], linear: int, seed: int, folder: Path | None, count: Steps
) -> tuple[Array, Chains]:
    """Draws (walkers, draws, dimension) by emcee, thinned to `MOST_KEPT_DRAWS`, and the chains."""
    scale = np.array([*np.ones(linear), *(c.scale for c in unknowns)])
    center = np.array([*np.zeros(linear), *(c.start for c in unknowns)])
    walkers, reference = walkers_for(len(scale)), Reference(center, scale)
    start = inside(target, reference, walkers, np.random.default_rng(seed))
    if len(start) < walkers:
        found = f"{len(start)} of {walkers} walkers that start from the closed-form posterior are inside the bounds"
        raise InputError("--priors", found, "Widen the bounds: the data lie outside them")
    chains = sample(target, reference, start, seed, folder, count)
    points = chains.points
    most = max(1, MOST_KEPT_DRAWS // len(points))
    return points[:, :: -(-points.shape[1] // most)], chains


def _grid(linear: Collapsed) -> tuple[Array, Array]:
    """Grid (QUADRATURE_POINTS,) of the one hyperparameter on the sampled scale, and its probabilities."""
    (c,) = linear.coordinates
    center, scale = c.start, c.scale
    for _ in range(6):  # recentre and rescale the grid by the moments of the density
        grid = center + scale * np.linspace(-8, 8, QUADRATURE_POINTS)
        log = linear.log_prob(grid[:, None])
        weights = np.exp(log - log.max())
        weights /= weights.sum()
        center = float(weights @ grid)
        scale = max(float(np.sqrt(weights @ np.square(grid - center))), 1e-3 * scale)
    return grid, weights


def moments(linear: Collapsed, points: Array, weights: Array) -> tuple[Array, Array]:
    """Mean (p,) and covariance (p, p) of the parameters over points (n, coordinates) with weights (n,)."""
    points, weights = points[weights > 1e-9], weights[weights > 1e-9]
    means, covariances = linear.closed(points)
    mean = weights @ means
    within = np.tensordot(weights, covariances, axes=1)
    return mean, within + (means - mean).T @ ((means - mean) * weights[:, None])


def _outliers(fit: Fit, whole: Whole, points: Array) -> tuple[tuple[str, int, float], ...]:
    """File, row and probability of rows with an outlier probability above 0.5."""
    if whole.mixture is None or not len(whole.mixture.apart.index):
        return ()
    some = points[:: max(1, len(points) // 200)]
    values, own = whole.split(some)
    level = whole.linear.levels(own)[:, whole.linear.statistics.kinds.index(whole.mixture.apart.kind)]
    extended = whole.linear.statistics.extended(values, whole.linear.shapes(own))
    probability = whole.mixture.probability(some[:, values.shape[1] + own.shape[1] :], level, extended).mean(axis=0)
    found = np.flatnonzero(probability > 0.5)
    rows = fit.survey.table.iloc[whole.mixture.apart.index[found]]
    return tuple(sorted(zip(rows["file"].astype(str), rows["row"].tolist(), probability[found].tolist(), strict=True)))
