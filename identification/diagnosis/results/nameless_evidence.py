"""Evidence of functions without a name: error motions that follow what was recorded, as random effects of any size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from errormodel.arrays import Array
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.results.recorded_functions import Functions
from identification.diagnosis.search.correlated_noise import random_evidence

MOST_FUNCTIONS = 12  # whose evidence is computed, those with the largest score: the rest of some hundred has less


def best_of(linear: LinearModel, functions: Sequence[Functions]) -> tuple[float, float, Functions | None]:
    """Largest log Bayes factor of a motion that follows a channel, the sum of squares that it explains, and which."""
    seen = len(linear.index)
    scores, summed = list[tuple[float, int, int]](), dict[tuple[str, str], tuple[Array, Array]]()
    for k, function in enumerate(functions):
        if not function.motion:
            continue
        key = function.element, function.motion
        if key not in summed:
            residual = linear.residual[:seen, None]
            squares = replace(function, lever=None if function.lever is None else function.lever**2)
            summed[key] = function.summed(residual)[:, 0], squares.summed(np.ones_like(residual))[:, 0]
        rows, (slopes, weights) = function.by_row, summed[key]
        score = float(np.sum((slopes @ rows) ** 2)) / max(float(weights @ rows**2 @ np.ones(rows.shape[1])), 1e-300)
        scores.append((score, rows.shape[1], k))
    best: tuple[float, float, Functions | None] = (0.0, 0.0, None)
    # what functions explain is between their score, if they are alike, and so many times it as they are
    ranked = (sorted(scores, key=lambda s: -s[0] * s[1] ** power)[:MOST_FUNCTIONS] for power in (0.0, 0.5, 1.0))
    for k in sorted({k for own in ranked for _, _, k in own}):
        columns = functions[k].values.T
        random = linear.random(columns)
        ratio, evidence, _ = random.best()
        if evidence > best[0]:
            best = evidence, random.square - float(random.left(ratio)), functions[k]
    return best


def evidence_in_any_noise(linear: LinearModel, function: Functions) -> float:
    """Log Bayes factor of a function over all noises, also correlated ones."""
    columns = np.zeros((function.by_row.shape[1], linear.size))
    columns[:, : len(linear.index)] = function.values.T
    return random_evidence(linear, columns)
