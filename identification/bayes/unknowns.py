"""Hyperparameters of a fit with their starting values and priors, and checks of the user's priors against the data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from errormodel.yamlfile import Document
from identification.bayes.hyperparameters import Coordinate
from identification.bayes.priors import Prior
from identification.bayes.settings import PriorForm, prior_error
from identification.bayes.statistics import Statistics
from identification.estimation.result import Fit
from identification.observation.normal_equations import total

PRIOR_CONFLICT_SIGMA = 5.0  # standard deviations between prior and estimate that contradict each other, by judgement
CORRELATED_VARIANCE_FACTOR = 1.02  # mean variance ratio above which correlated noise is taken into account


def counted(fit: Fit) -> float:
    """Weight of a row: 1, or the inverse mean variance ratio by which correlated noise widens the covariance."""
    s = fit.solution
    if not len(s.groups.base):
        return 1.0
    pick = np.ix_(s.groups.base, s.groups.base)
    gram = total(s.sums, s.sigma)[0][pick] + np.diag(s.precision[s.groups.base])
    ratio = float(np.sum(gram * s.covariance)) / len(s.groups.base)
    return 1 / ratio if ratio > CORRELATED_VARIANCE_FACTOR else 1.0


def check_against_data(fit: Fit, prior: Prior, given: Mapping[str, PriorForm], document: Document | None) -> None:
    """Raise InputError where a user's prior contradicts the data by more than `PRIOR_CONFLICT_SIGMA`."""
    s = fit.solution
    std = np.sqrt(np.diag(s.covariance)) * fit.inflation
    for k, j in enumerate(s.groups.base):
        name, value = s.unknowns[j], float(s.values[j])
        if (
            name in given
            and not prior.low[k] - PRIOR_CONFLICT_SIGMA * std[k] < value < prior.high[k] + PRIOR_CONFLICT_SIGMA * std[k]
        ):
            within = f"bounds {prior.low[k]:g} to {prior.high[k]:g}"
            found = f"{within}, the data say {value:.3g} ± {std[k]:.2g}: no walker fits in"
            raise prior_error(document, name, found, "Widen the bounds, or look for a mistake of unit or sign in them")
        if not any(member in given for member in s.groups.members(k)):
            continue
        name = next(m for m in s.groups.members(k) if m in given)
        apart = abs(value - prior.mean[k]) / float(np.hypot(std[k], prior.std[k]))
        if apart > PRIOR_CONFLICT_SIGMA:
            found = (
                f"it says {prior.mean[k]:.3g} ± {prior.std[k]:.2g} of {s.groups.name(k)}, the data say {value:.3g} ± "
                f"{std[k]:.2g}: {apart:.0f} standard deviations apart"
            )
            raise prior_error(document, name, found, "Widen its std, or look for a mistake of unit or sign in it")


def free_kinds(fit: Fit, statistics: Statistics) -> tuple[int, ...]:
    """Indices of kinds with unknown noise level: not declared, or declared too small for the residuals."""
    declared = fit.solution.declared if fit.inflation == 1 else frozenset[str]()
    return tuple(k for k, kind in enumerate(statistics.kinds) if kind not in declared)


def coordinates_of(fit: Fit, statistics: Statistics, prior: Prior) -> tuple[Coordinate, ...]:
    """Noise levels, shape parameters of effects and scales of random effects, with starting values from the fit."""
    out = []
    for k in free_kinds(fit, statistics):
        kind = statistics.kinds[k]
        unit = "1" if kind in fit.solution.declared else "rad" if kind in fit.problem.angular else "mm"
        level = fit.solution.sigma[kind] * fit.inflation
        scale = (2 * max(statistics.count[k], 1.0)) ** -0.5
        out.append(Coordinate(f"noise.{kind}", unit, float(np.log(level)), scale, 1e-3 * level, 1e3 * level))
    for shape in statistics.interpolations:
        for k, name in enumerate(shape.names):
            scale = float(shape.high[k] - shape.low[k]) / 14  # the interval ends 7 standard deviations out
            low, high = shape.low[k], shape.high[k]
            bounds = (float(np.exp(low)), float(np.exp(high))) if shape.logarithmic[k] else (float(low), float(high))
            unit = shape.effect.unit_of_shape(name, fit.chain.machine)
            label = f"{shape.effect.where}.{shape.effect.effect}.{name}"
            out.append(Coordinate(label, unit, float(shape.best[k]), scale, *bounds, shape.logarithmic[k]))
    tied = [n for n, ids in enumerate(fit.chain.effect_ids) if any(fit.solution.precision[_place(fit, i)] for i in ids)]
    for place, number in zip(prior.ties, tied, strict=True):
        spec = fit.chain.machine.effects[number]
        where = fit.chain.parameters[fit.chain.index[fit.chain.effect_ids[number][0]]].element
        scale = (2 * len(place)) ** -0.5
        out.append(Coordinate(f"{where}.{spec.effect}.scale", "1", 0.0, scale, 1e-2, 1e2))
    names = [c.name for c in out]
    # the same effect twice at one place: a prime is added to the name, as for its parameters
    return tuple(replace(c, name=c.name + "'" * names[:k].count(c.name)) for k, c in enumerate(out))


def _place(fit: Fit, identity: str) -> int:
    return fit.solution.unknowns.index(identity)


def with_prior(c: Coordinate, given: Mapping[str, PriorForm], document: Document | None) -> Coordinate:
    """A hyperparameter with the user's prior applied.

    Raises
    ------
    InputError
        The prior contradicts the data.
    """
    form = given.get(c.name)
    if form is None:
        return c
    low, high = max(c.low, form.low or -np.inf), min(c.high, np.inf if form.high is None else form.high)
    value = float(c.value(np.array(c.start)))
    deviation = c.scale * (value if c.logarithmic else 1.0)
    if not low - PRIOR_CONFLICT_SIGMA * deviation < value < high + PRIOR_CONFLICT_SIGMA * deviation:
        found = f"bounds {form.low} to {form.high} where the data say {value:.4g} ± {deviation:.2g}: no walker fits in"
        raise prior_error(document, c.name, found, "Widen the bounds, or look for a mistake of unit in them")
    if form.std is not None and abs(value - form.mean) > PRIOR_CONFLICT_SIGMA * np.hypot(form.std, deviation):
        found = f"it says {form.mean:.4g} ± {form.std:.2g}, the data say {value:.4g} ± {deviation:.2g}"
        raise prior_error(document, c.name, found, "Widen its std, or look for a mistake of unit in it")
    return replace(c, low=low, high=high, mean=form.mean, std=form.std or np.inf)
