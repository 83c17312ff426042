"""Best pair of (sensor, lag) regressors for one thermal effect, by exhaustive search.

No single sensor follows both the air (at once) and the casting (an hour later). Adding a second regressor to the best
single one misses such pairs, because the best single one is a compromise between them. Each pair is a small linear
system.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.effects.base import Effect
from identification.diagnosis.linear.linear_model import LinearModel


def best_pair(linear: LinearModel, effect: Effect, effects: Sequence[Effect]) -> tuple[Effect, Effect, float] | None:
    """The two causes that together explain most of an effect, the greater one first, and the log Bayes factor.

    Parameters
    ----------
    linear : with all fitted but this finding.
    effects : proposals, of which those are taken that move the same by another cause.

    Returns
    -------
    The log Bayes factor is that of the pair against the best single cause (Schwarz), less the pairs' trials.
    """
    family = [
        e for e in effects if type(e) is type(effect) and e.random == effect.random and _moved(e) == _moved(effect)
    ]
    if not effect.cause & set(type(effect).model_fields) or len(family) < 2:
        return None
    columns = np.array(list(linear.left_of(family)))
    m, k, _ = columns.shape
    norms = np.linalg.norm(columns, axis=2, keepdims=True)
    flat = (columns / np.where(norms > 0, norms, 1.0)).reshape(m * k, -1)
    gram, slope = flat @ flat.T + 1e-9 * np.eye(m * k), flat @ linear.residual
    one, other = np.triu_indices(m, 1)
    singles = decreases(gram, slope, np.arange(m)[:, None] * k + np.arange(k))
    first, second = (np.arange(k) + k * i[:, None] for i in (one, other))
    drops = decreases(gram, slope, np.hstack([first, second]))
    best = int(np.argmax(drops))
    left = np.maximum(linear.square - np.array([singles.max(), drops[best]]), 1e-12 * linear.square)
    evidence = linear.freedom / 2 * np.log(left[0] / left[1]) - k / 2 * np.log(linear.freedom) - np.log(len(drops))
    pair = sorted((int(one[best]), int(other[best])), key=lambda i: -singles[i])
    return family[pair[0]], family[pair[1]], float(evidence)


def decreases(gram: Array, slope: Array, choices: Index) -> Array:
    """Decrease of the residual sum of squares by each choice of columns (choices, columns of one choice)."""
    grams = gram[choices[:, :, None], choices[:, None, :]]
    slopes = slope[choices]
    return np.asarray(np.einsum("ij,ij->i", slopes, np.linalg.solve(grams, slopes[:, :, None])[:, :, 0]))


def _moved(effect: Effect) -> dict[str, object]:
    return effect.model_dump(exclude=set(effect.cause))
