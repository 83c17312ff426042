"""Prior of the parameter groups: wide normal distributions of physical size, and the user's priors.

A group is a sum of parameters, and its prior follows from those of its members. The default standard deviation is ten
times the usual size in machines (or the rms of this machine's parameters of the same unit, if that is larger): it moves
a well-determined estimate by less than a hundredth of its standard uncertainty. Units: mm, rad and derived ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from errormodel import effects
from errormodel.arrays import Array, Index
from errormodel.conventions import PLAUSIBLE_SIZES
from errormodel.effects.best_prediction import predicted_terms
from errormodel.yamlfile import Document
from identification.bayes.settings import PriorForm
from identification.estimation.bounded import limits
from identification.estimation.result import Fit

PRIOR_WIDTH_FACTOR = 10.0  # standard deviation of the default prior over the usual size of a parameter
BOUND_DOUBT_SIGMA = 6.0  # physical bounds farther than this from the estimate (standard uncertainties) are left out
# Prior standard deviation of the small parameters of frames, zeros and targets, after their alignment; uninformative
NUISANCE_STD = {"mm": 100.0, "rad": 0.1}


@dataclass(frozen=True)
class Prior:
    """Normal prior of the groups with bounds; random effects have a common, possibly unknown standard deviation.

    Attributes
    ----------
    mean, precision : (p,) and (p, p), random effects left out.
    low, high : (p,) bounds.
    ties : for each random effect the indices of its parameters; `sizes`: their nominal standard deviations.
    std : (p,) marginal standard deviation of each group.
    """

    mean: Array
    precision: Array
    low: Array
    high: Array
    ties: tuple[Index, ...]
    sizes: tuple[float, ...]
    std: Array

    @property
    def bounded(self) -> bool:
        """Whether any group has a bound."""
        return bool(np.isfinite(self.low).any() or np.isfinite(self.high).any())

    def precisions(self, scales: Array) -> Array:
        """Precisions (n, p, p) with the standard deviations of random effects times `scales` (n, ties)."""
        out = np.broadcast_to(self.precision, (len(scales), *self.precision.shape)).copy()
        for k, (place, size) in enumerate(zip(self.ties, self.sizes, strict=True)):
            out[:, place, place] += (size * scales[:, k, None]) ** -2.0
        return out

    def log_ties(self, scales: Array) -> Array:
        """Logarithm (n,) of the scale-dependent normalisation of the random effects' priors."""
        counts = np.array([len(place) for place in self.ties])
        return np.asarray(-np.log(scales) @ counts) if len(counts) else np.zeros(len(scales))


def prior_of(fit: Fit, given: Mapping[str, PriorForm], document: Document | None) -> Prior:
    """The groups' prior.

    Parameters
    ----------
    given : the user's priors by parameter name; `document`: their file, for messages.

    Raises
    ------
    InputError
        A prior names an unknown parameter, or bounds one that is not the base of a group.
    """
    solution, chain = fit.solution, fit.chain
    unknowns, groups = solution.unknowns, solution.groups
    place = {name: k for k, name in enumerate(unknowns)}
    base = {unknowns[j]: k for k, j in enumerate(groups.base)}
    std, mean = _widths(fit), np.zeros(len(unknowns))
    low, high = limits(chain, unknowns, groups, given, document)
    # physical bounds are used only where the estimate is close to them
    error = np.sqrt(np.diag(solution.covariance)) * fit.inflation
    value = solution.values[groups.base]
    known = np.array([unknowns[j] in given for j in groups.base], dtype=bool)
    low[~known & (value - BOUND_DOUBT_SIGMA * error > low)] = -np.inf
    high[~known & (value + BOUND_DOUBT_SIGMA * error < high)] = np.inf
    for name, form in given.items():
        if form.std is not None:
            std[place[name]], mean[place[name]] = form.std, form.mean
    tied = [np.array([base[i] for i in ids if i in base], dtype=np.intp) for ids in chain.effect_ids]
    ties = [(t, n) for n, t in enumerate(tied) if len(t) and effects.make(chain.machine.effects[n]).random]
    sizes = [float(chain.parameters[chain.index[unknowns[groups.base[t[0]]]]].prior or 1.0) for t, _ in ties]
    mix = groups.coefficients
    spread = (mix * std**2) @ mix.T
    free = np.setdiff1d(np.arange(len(base)), np.concatenate([np.zeros(0, np.intp), *(t for t, _ in ties)]))
    precision = np.zeros((len(base), len(base)))
    scale = 1 / np.sqrt(np.diag(spread)[free])
    unit = spread[np.ix_(free, free)] * np.outer(scale, scale)
    precision[np.ix_(free, free)] = np.linalg.inv(unit) * np.outer(scale, scale)
    return Prior(mix @ mean, precision, low, high, tuple(t for t, _ in ties), tuple(sizes), np.sqrt(np.diag(spread)))


def _widths(fit: Fit) -> Array:
    """Default prior standard deviations (unknowns,) of the parameters."""
    solution, chain = fit.solution, fit.chain
    named = solution.named()
    units = {p.id: p.unit for p in chain.parameters}
    own = {solution.unknowns[j] for j in solution.groups.base} - {*chain.frame_ids, *chain.tool_ids} - chain.of_effects
    sizes = dict(PLAUSIBLE_SIZES)
    for unit, usual in PLAUSIBLE_SIZES.items():
        values = [named[i] for i in own if units.get(i) == unit]
        sizes[unit] = max(usual, float(np.sqrt(np.mean(np.square(values)))) if values else 0.0)
    of_effects = {
        i: t.size
        for spec, ids in zip(chain.machine.effects, chain.effect_ids, strict=True)
        for i, t in zip(ids, predicted_terms(effects.make(spec), lambda _: np.ones(1), chain.machine), strict=True)
    }
    out = np.empty(len(solution.unknowns))
    for k, name in enumerate(solution.unknowns):
        tied = name in units and chain.parameters[chain.index[name]].prior
        if np.isinf(of_effects.get(name, 0.0)):  # the place of a target that nobody knows
            out[k] = NUISANCE_STD["mm"]
        elif name in of_effects:
            out[k] = tied or PRIOR_WIDTH_FACTOR * of_effects[name]
        elif name in units and name not in chain.frame_ids and name not in chain.tool_ids:
            out[k] = PRIOR_WIDTH_FACTOR * sizes[units[name]]
        else:
            out[k] = NUISANCE_STD["mm" if name.rsplit(".", 1)[1] in ("dx", "dy", "dz") else "rad"]
    return out
