"""Log Bayes factors under correlated noise: white plus first-order autoregressive, averaged over both hypotheses.

Moving air and a drifting instrument leave residuals that correlate with anything that changes slowly. The marginal
likelihood with an effect and that without it are therefore both averaged over a grid of noise models (Bayesian model
averaging). Neither side's noise is estimated from what the other would explain.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice

import numpy as np

from errormodel.arrays import Array
from errormodel.effects.base import Effect
from identification.diagnosis.decisions.constants import EVEN, NOISE
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.random_effects import RandomEffects
from identification.diagnosis.search.blocks import NOTHING
from identification.diagnosis.search.filtered_models import DependentError, FilteredModel, FromBasis, FromProducts
from identification.diagnosis.search.marginal_likelihood import free_scores, joint_evidence, log_sum, random_scores
from identification.diagnosis.search.weighed_products import WeighedProducts
from identification.estimation.noise import Noise, noises, series_edges


def evidence(linear: LinearModel, groups: Sequence[Sequence[Effect]]) -> list[tuple[float, float]]:
    """Log Bayes factor of each group of effects, given the linear model: in white noise, and over all noises."""
    every = tuple(e for group in groups for e in group)
    return linear.answer(lambda: _evidence(linear, groups), every, "any noise", *map(len, groups))


def _evidence(linear: LinearModel, groups: Sequence[Sequence[Effect]]) -> list[tuple[float, float]]:
    usual = [[linear.columns(e)[1] for e in group] for group in groups]
    sizes, counts = [np.concatenate(own) for own in usual], [[*map(len, own)] for own in usual]
    ends = np.cumsum([0, *map(len, sizes)]).tolist()
    mains = [main for main, *_ in groups]
    changing = [main.changing(linear.scene) for main in mains]
    kinds: dict[tuple[bool, int, int], list[int]] = {}
    for k, main in enumerate(mains):
        kinds.setdefault((main.random, len(groups[k]), len(sizes[k])), []).append(k)
    rows, model = [], filtered_model(linear)
    for filtered, left in zip(model.filtered, model.left_of(groups), strict=True):
        gains = np.empty(len(groups))
        for (random, together, _), some in kinds.items():
            own, size = [slice(ends[k], ends[k + 1]) for k in some], np.array([sizes[k] for k in some])
            gram = np.array([left.grams[k] for k in some]) * size[:, :, None] * size[:, None, :]
            slope = np.array([left.slopes[s] for s in own]) * size
            square = np.array([changing[k] * left.squares[s] for k, s in zip(some, own, strict=True)]) * size**2
            undefined = ~np.isfinite(gram).all(axis=(1, 2))
            gram[undefined], slope[undefined], square[undefined] = 0.0, 0.0, 0.0
            square = np.maximum(square, NOTHING)
            if together > 1 and not random:
                each = zip(gram, slope, (counts[k] for k in some), strict=True)
                gains[some] = [joint_evidence(filtered, *own) for own in each]
            elif random:
                gains[some] = random_scores(filtered, gram, slope, square)[0]
            else:
                empirical = np.array([mains[k].empirical for k in some])
                gains[some] = free_scores(filtered, gram, slope, square, empirical)[0]
        gains -= np.array([sum({e.key: e.cost(linear.scene) for e in group}.values()) for group in groups])
        rows.append([filtered.likelihood, *(filtered.likelihood + gains)])
    without, *with_each = log_sum(np.array(rows), _beforehand(len(rows))).tolist()
    white = np.array(rows[0][1:]) - rows[0][0]
    return [(float(w), each - without) for w, each in zip(white, with_each, strict=True)]


def random_evidence(linear: LinearModel, columns: Array) -> float:
    """Log Bayes factor, over all noises, of columns (k, N + ties) whose parameters are random effects of any size.

    Noise that drifts more than instruments do counts as noise here.
    """
    rows = []
    for drifts in (False, True):
        model = filtered_model(linear, drifts=drifts)
        both = zip(model.filtered, model.left_of_columns(columns), strict=True)
        for filtered, left in islice(both, drifts, None):  # white noise is the first of either
            whole = float(left.squares.sum())
            random = RandomEffects.from_products(left.grams[0], left.slopes, whole, filtered.square, filtered.freedom)
            rows.append([filtered.likelihood, filtered.likelihood + random.best()[1]])
    without, with_them = log_sum(np.array(rows), _beforehand(len(rows))).tolist()
    return float(with_them - without)


def _beforehand(count: int) -> Array:
    """Prior probability of each noise model (count, 1): the first is white, the others are equally likely."""
    return np.array([EVEN, *[(1 - EVEN) / (count - 1)] * (count - 1)])[:, None]


def filtered_model(linear: LinearModel, *, drifts: bool = False) -> FilteredModel:
    """A linear model behind the filter of white and of each correlated noise; `drifts`: of those that are no noise."""
    considered = _noises(linear, drifts)
    if linear.lineage is None:
        return FromBasis(linear, considered)
    name = "drifts" if drifts else "noises"
    kept, key = linear.lineage.known.filtered, (name, linear.lineage)
    known: FilteredModel | None = kept.find(key)
    if known is None:
        kept.make_room(len(considered) * linear.basis.shape[1] ** 2 * linear.basis.itemsize)  # of its triangles
        try:
            known = FromProducts(linear, WeighedProducts(linear, considered, name))
        except DependentError:
            known = FromBasis(linear, considered)
        kept.keep(key, known, sum(f.triangle.nbytes for f in known.filtered))
    return known


def _noises(linear: LinearModel, drifts: bool) -> list[Noise | None]:
    """White noise, and all correlated noises that either drift or do not."""
    longest = float(np.clip(NOISE.part * np.diff(series_edges(linear.index)).max(), *NOISE.rows))
    return [None, *(n for n in noises() if (n.length > longest or n.part > NOISE.variance) == drifts)]
