"""Log Bayes factors under correlated noise: white plus first-order autoregressive, averaged over both hypotheses.

Moving air and a drifting instrument leave residuals that correlate with anything that changes slowly. The marginal
likelihood with an effect and that without it are therefore both averaged over a grid of noise models (Bayesian model
averaging). Neither side's noise is estimated from what the other would explain.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import Array
from errormodel.effects.base import Effect
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.random_effects import EXACT, RandomEffects
from identification.diagnosis.search.blocks import NOTHING
from identification.diagnosis.search.candidates import free_scores, random_scores
from identification.estimation.noise import Noise, noises, series_edges

WHITE = 0.5  # prior probability of white noise
# rows, part of the longest series (but never less than the first) and white variances: beyond them it is no noise any
# more, but a drift with a cause
LONGEST, PART, LARGEST = (20.0, 60.0), 1 / 15, 2.0


@dataclass(frozen=True)
class _Filtered:
    """A linear model behind the filter that makes a noise white.

    Attributes
    ----------
    slabs : rows (k, up to r) of the Cholesky factor of the products of the filtered basis, which smaller models share;
        none for white noise, which has no filter.
    taken : (r,) the residual along the filtered basis.
    square, freedom : of what that leaves of the residual.
    """

    noise: Noise | None
    slabs: tuple[Array, ...]
    taken: Array
    square: float
    freedom: int

    @property
    def rank(self) -> int:
        return sum(map(len, self.slabs))

    @property
    def triangle(self) -> Array:
        """The Cholesky factor (r, r)."""
        out, last = np.zeros((self.rank, self.rank)), 0
        for slab in self.slabs:
            out[last : last + len(slab), : slab.shape[1]] = slab
            last += len(slab)
        return out

    @property
    def likelihood(self) -> float:
        """Restricted log likelihood, up to a constant."""
        determinant = sum(float(np.log(np.diag(s[:, s.shape[1] - len(s) :])).sum()) for s in self.slabs)
        return -self.freedom / 2 * float(np.log(self.square)) - determinant

    def products(self, linear: LinearModel, columns: Array) -> tuple[Array, Array, Array]:
        """Filtered columns (k, N + ties) themselves, their products with the filtered basis, and with what is left."""
        from scipy.linalg import solve_triangular

        if self.noise is None:
            return columns, columns @ linear.basis, columns @ linear.residual
        weighed = self.noise.weighed(columns, series_edges(linear.index))
        inner = solve_triangular(self.triangle, (weighed @ linear.basis).T, lower=True).T
        return weighed, inner, weighed @ linear.residual - inner @ self.taken


def evidence(linear: LinearModel, groups: Sequence[Sequence[Effect]]) -> list[tuple[float, float]]:
    """Log Bayes factor of each group of effects, given the linear model: in white noise, and over all noises."""
    from scipy.special import logsumexp

    parts = [[linear.columns(e) for e in group] for group in groups]
    stacked = np.vstack([c * s[:, None] for own in parts for c, s in own])
    ends = np.cumsum([0, *(sum(len(s) for _, s in own) for own in parts)]).tolist()
    mains = [main for main, *_ in groups]
    kinds: dict[tuple[bool, int], list[int]] = {}
    for k, main in enumerate(mains):
        kinds.setdefault((main.random, ends[k + 1] - ends[k]), []).append(k)
    rows = []
    for filtered in _filtered(linear):
        weighed, inner, slopes = filtered.products(linear, stacked)
        gains = np.empty(len(groups))
        for (random, _), some in kinds.items():
            own = [slice(ends[k], ends[k + 1]) for k in some]
            whole = np.array([weighed[s] @ stacked[s].T for s in own])
            undefined = ~np.isfinite(whole).all(axis=(1, 2))
            left, slope = np.array([inner[s] @ inner[s].T for s in own]), np.array([slopes[s] for s in own])
            whole[undefined], left[undefined], slope[undefined] = 0.0, 0.0, 0.0
            square = np.maximum(np.diagonal(whole, axis1=1, axis2=2), NOTHING)
            if random:
                gains[some] = random_scores(filtered, whole - left, slope, square)[0]
            else:
                empirical = np.array([mains[k].empirical for k in some])
                gains[some] = free_scores(filtered, whole - left, slope, square, empirical)[0]
        gains -= np.array([main.cost for main in mains])
        rows.append([filtered.likelihood, *(filtered.likelihood + gains)])
    without, *with_each = logsumexp(rows, axis=0, b=_beforehand(len(rows))).tolist()
    white = np.array(rows[0][1:]) - rows[0][0]
    return [(float(w), each - without) for w, each in zip(white, with_each, strict=True)]


def random_evidence(linear: LinearModel, columns: Array) -> float:
    """Log Bayes factor, over all noises, of columns (k, N + ties) whose parameters are random effects of any size.

    Noise that drifts more than instruments do counts as noise here.
    """
    from scipy.special import logsumexp

    rows = []
    for filtered in _made(linear, [], all_noises=True):
        weighed, inner, slopes = filtered.products(linear, columns)
        gram = weighed @ columns.T
        left = gram - inner @ inner.T
        random = RandomEffects.from_products(left, slopes, float(np.trace(gram)), filtered.square, filtered.freedom)
        rows.append([filtered.likelihood, filtered.likelihood + random.best()[1]])
    without, with_them = logsumexp(rows, axis=0, b=_beforehand(len(rows))).tolist()
    return float(with_them - without)


def _beforehand(count: int) -> Array:
    """Prior probability of each noise model (count, 1): the first is white, the others are equally likely."""
    return np.array([WHITE, *[(1 - WHITE) / (count - 1)] * (count - 1)])[:, None]


def _filtered(linear: LinearModel) -> list[_Filtered]:
    """A linear model behind the filter of each noise; first without one."""
    lineage = linear.lineage
    if lineage is None:
        return list(_made(linear, []))
    kept = lineage.known.filtered
    known: list[_Filtered] | None = None
    for count in range(len(lineage.effects), -1, -1):  # the model with most of the effects of which they are known
        if (known := kept.find(lineage.first(count))) is not None:
            break
    if known is not None and count == len(lineage.effects):
        return known
    made = list(_made(linear, known or []))
    kept.keep(lineage, made, sum(f.slabs[-1].nbytes for f in made if f.slabs))
    return made


def _made(linear: LinearModel, known: Sequence[_Filtered], *, all_noises: bool = False) -> Iterator[_Filtered]:
    """The same, made anew; `known`, where there are any: of a model that has the first columns of the basis."""
    from scipy.linalg import solve_triangular

    yield _Filtered(None, (), np.zeros(0), linear.square, linear.freedom)
    edges = series_edges(linear.index)
    # of a model that has less than half of the columns: all products anew, by symmetry, are less work
    smaller = {f.noise: f for f in known if 2 * f.rank > linear.basis.shape[1]}
    longest = np.clip(PART * np.diff(edges).max(), *LONGEST)
    for noise in noises():
        if not all_noises and (noise.length > longest or noise.part > LARGEST):
            continue
        old = smaller.get(noise)
        rank = old.rank if old else 0
        further = np.vstack([linear.basis[:, rank:].T, linear.residual])
        # what was orthonormal before is nearly so behind the filter: its products are well conditioned
        if old:
            weighed = noise.weighed(further, edges)
            slab, along, square = weighed[:-1] @ linear.basis, weighed[-1] @ linear.basis, weighed[-1] @ linear.residual
            slab[:, :rank] = solve_triangular(old.triangle, slab[:, :rank].T, lower=True).T
            slab[:, rank:] -= slab[:, :rank] @ slab[:, :rank].T
        else:
            white = noise.whitened(further, edges)
            whole = white @ white.T
            slab, along, square = whole[:-1, :-1], whole[-1, :-1], whole[-1, -1]
        slab[:, rank:] = np.linalg.cholesky(slab[:, rank:])
        made = _Filtered(noise, (*(old.slabs if old else ()), slab), np.zeros(0), 0.0, linear.freedom)
        taken = solve_triangular(made.triangle, along, lower=True)
        yield replace(made, taken=taken, square=max(float(square - taken @ taken), EXACT))
