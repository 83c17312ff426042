"""Log Bayes factors under correlated noise: white plus first-order autoregressive, averaged over both hypotheses.

Moving air and a drifting instrument leave residuals that correlate with anything that changes slowly. The marginal
likelihood with an effect and that without it are therefore both averaged over a grid of noise models (Bayesian model
averaging). Neither side's noise is estimated from what the other would explain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from errormodel.arrays import Array
from errormodel.effects.base import Effect
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search.candidates import Block, Candidates
from identification.estimation.noise import Noise, noises, series_edges

WHITE = 0.5  # prior probability of white noise
# rows, part of the longest series (but never less than the first) and white variances: beyond them it is no noise any
# more, but a drift with a cause
LONGEST, PART, LARGEST = (20.0, 60.0), 1 / 15, 2.0


def evidence(linear: LinearModel, groups: Sequence[Sequence[Effect]]) -> list[tuple[float, float]]:
    """Log Bayes factor of each group of effects, given the linear model: in white noise, and over all noises."""
    from scipy.special import logsumexp

    parts = [[linear.columns(e) for e in group] for group in groups]
    scaled = [np.vstack([c * s[:, None] for c, s in own]) for own in parts]
    sizes = [np.concatenate([s for _, s in own]) for own in parts]
    mains = [main for main, *_ in groups]
    kinds: dict[tuple[bool, int], list[int]] = {}
    for k, (main, size) in enumerate(zip(mains, sizes, strict=True)):
        kinds.setdefault((main.random, len(size)), []).append(k)
    edges = series_edges(linear.index)
    rows = []
    for likelihood, filtered, noise in _linear_models(linear):
        blocks = []
        for own in kinds.values():
            columns = np.array([scaled[k] for k in own])
            if noise is not None:
                columns = noise.whitened(columns.reshape(-1, linear.size), edges).reshape(columns.shape)
            blocks.append(Block.of(filtered, np.array(own), columns, np.array([sizes[k] for k in own])))
        gains = Candidates(mains, blocks, [main.key for main in mains]).scores(filtered).evidence
        rows.append([likelihood, *(likelihood + gains)])
    without, *with_each = logsumexp(rows, axis=0, b=_beforehand(len(rows))).tolist()
    white = np.array(rows[0][1:]) - rows[0][0]
    return [(float(w), each - without) for w, each in zip(white, with_each, strict=True)]


def _beforehand(count: int) -> Array:
    """Prior probability of each noise model (count, 1): the first is white, the others are equally likely."""
    return np.array([WHITE, *[(1 - WHITE) / (count - 1)] * (count - 1)])[:, None]


@lru_cache(maxsize=1)
def _linear_models(linear: LinearModel) -> list[tuple[float, LinearModel, Noise | None]]:
    """Restricted log likelihood of a linear model, and the model whitened, for each noise.

    Kept for the latest model: the explanations of one step are scored in several rounds.
    """
    from scipy.linalg.blas import dtrsm

    longest = np.clip(PART * np.diff(series_edges(linear.index)).max(), *LONGEST)
    out: list[tuple[float, LinearModel, Noise | None]] = [(_likelihood(linear, 0.0), linear, None)]
    for noise in noises():
        if noise.length > longest or noise.part > LARGEST:
            continue
        both = noise.whitened(np.vstack([linear.basis.T, linear.residual]), series_edges(linear.index))
        # what was orthonormal before is nearly so behind the filter: its products are well conditioned
        triangle = np.linalg.cholesky(both[:-1] @ both[:-1].T)
        basis = np.asarray(dtrsm(1.0, triangle, both[:-1].T, side=1, lower=1, trans_a=1))
        residual = both[-1] - basis @ (basis.T @ both[-1])
        filtered = replace(linear, basis=basis, residual=residual)
        out.append((_likelihood(filtered, float(np.log(np.diag(triangle)).sum())), filtered, noise))
    return out


def _likelihood(linear: LinearModel, determinant: float) -> float:
    return -linear.freedom / 2 * float(np.log(linear.square)) - determinant
