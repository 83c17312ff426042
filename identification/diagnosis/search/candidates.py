"""Candidate effects of a survey as design columns, and the log Bayes factor of each against the current model.

The marginal likelihood of a linear-Gaussian model with priors of physical size, in closed form (C. M. Bishop, Pattern
Recognition and Machine Learning, 2006, section 3.5). A shape parameter is averaged over its grid: that is its trials
factor. All log Bayes factors are natural logarithms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from math import log
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from errormodel.arrays import Array, Columns, Index, Mask
from errormodel.effects import registry
from errormodel.effects.base import Effect
from errormodel.effects.search_space.survey_summary import Scene
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.projection_cache import Directions
from identification.diagnosis.linear.random_effects import RandomEffects
from identification.runtime.parallel import parallel_map

AT_ONCE = 16  # columns made in one go: they stay within the processor's cache
Part = tuple[Index, Columns, Array]  # proposals' numbers, columns and sizes
Scored = tuple[Array, Array, Array, Array]  # evidence, delta chi2, absorbed part and expected delta chi2 of proposals
BLOCK = 250  # proposals scored in one go
MANY, PARTS = 1000, 4  # proposals beyond which products are kept, and columns made in parallel, in so many parts
MEMORY = 2_400_000_000  # bytes of all proposals' columns
USUAL = 2  # parameters of a proposal
SIZES = {0.1: 0.1, 0.3: 0.2, 1.0: 0.4, 3.0: 0.2, 10.0: 0.1}  # times the usual one: how often
WIDEST = 3 * max(SIZES)  # times the usual one: standard deviation of the prior of the final fit
NOTHING = 1e-300  # length squared of a column
SINGLE = np.float32  # of the columns that are kept: what is left of one, a thousandth at least, is known to 1e-4
ABSORBED = 0.999  # of a column's length squared: beyond it an effect is collinear with the geometry
FORM_ABSORBED = 0.99  # the same for a form that has no size of its own


class Block(NamedTuple):
    """Proposals with the same number of parameters, and their products without the geometry.

    The geometry is the first `rank` columns of the linear model's basis. It is projected out once; what has been
    accepted since is projected out when the proposals are scored.

    Attributes
    ----------
    numbers : (m,) the proposals'.
    columns : (m, k, N) of parameters as large as is usual; `sizes` (m, k) what is usual.
    gram : (m, k, k) products of the columns without what the geometry spans.
    square : (m, k) the columns' own lengths squared.
    """

    numbers: Index
    columns: Columns
    sizes: Array
    gram: Array
    square: Array
    rank: int
    exact: bool

    @classmethod
    def of(cls, linear: LinearModel, numbers: Index, columns: Columns, sizes: Array, exact: bool = False) -> Block:
        """A block; `exact`: products in double precision, as random effects need them."""
        m, k, n = columns.shape
        rank = linear.basis.shape[1]
        plain = cls(numbers, columns, sizes, np.empty((m, k, 0)), np.empty((m, k)), rank, exact)
        with np.errstate(over="ignore"):  # readings without noise weigh beyond single precision: undefined, below
            gram = np.array([c @ c.T for c in plain.parts()], float) if exact else columns @ columns.transpose(0, 2, 1)
        whole = gram.astype(float)
        undefined = ~np.isfinite(whole).all(axis=(1, 2))
        columns[undefined], whole[undefined] = 0.0, 0.0
        inner = plain.times(linear.basis[:n])
        square = np.maximum(np.diagonal(whole, axis1=1, axis2=2), NOTHING)
        return plain._replace(gram=whole - inner @ inner.transpose(0, 2, 1), square=square)

    def parts(self) -> Iterator[Array]:
        """The columns (k, N) of each proposal, in double precision."""
        return (own.astype(float) for own in self.columns)

    def times(self, vectors: Array) -> Array:
        """Products (m, k, r) of the columns with vectors (N, r)."""
        m, k, n = self.columns.shape
        if self.exact:
            return np.array([own @ vectors for own in self.parts()]).reshape(m, k, -1)
        flat = self.columns.reshape(m * k, n) @ vectors.astype(self.columns.dtype)
        return flat.reshape(m, k, -1).astype(float)

    def part(self, some: Mask) -> Block:
        """Some of its proposals."""
        gram, square = self.gram[some], self.square[some]
        return Block(self.numbers[some], self.columns[some], self.sizes[some], gram, square, self.rank, self.exact)


Products = Callable[[Block], Array]  # of a block's columns with some vectors: (m, k, vectors)


@dataclass(frozen=True, eq=False)
class Candidates:
    """Proposals with their columns, in blocks of the same number of parameters.

    Attributes
    ----------
    effects : all proposals; `keys` their keys (one key: all shapes of one effect at one place).
    """

    effects: list[Effect]
    blocks: list[Block]
    keys: list[tuple[object, ...]] = field(default_factory=list)
    _known: WeakKeyDictionary[LinearModel, Scores] = field(default_factory=WeakKeyDictionary, repr=False)
    _directions: Directions = field(default_factory=Directions, repr=False)

    @classmethod
    def of(cls, linear: LinearModel, effects: Sequence[Effect] | None = None) -> Candidates:
        """All proposals of the library (or the given ones) whose channels the survey has."""
        if effects is None:
            effects = proposed(linear.scene)
        lists = list(_alike(effects))
        # not as many as there are cores: results must not depend on them
        parts = [lists[k::PARTS] for k in range(PARTS)] if len(effects) > MANY else [lists]
        listed = [[e for alike in part for e in alike] for part in parts]
        first = np.cumsum([0, *map(len, listed)]).tolist()
        jobs = [partial(_blocks, linear, part, first[k]) for k, part in enumerate(parts)]
        blocks = [block for made in parallel_map(jobs) for block in made]
        every = [e for part in listed for e in part]
        return cls(every, blocks, [e.key for e in every])._that_move()

    def _that_move(self) -> Candidates:
        """Without proposals that move nothing in these rows, or are not defined in some."""
        moves = [block.square.max(axis=1) > NOTHING for block in self.blocks]
        if all(m.all() for m in moves):
            return self
        kept = np.zeros(len(self.effects), dtype=bool)
        for block, some in zip(self.blocks, moves, strict=True):
            kept[block.numbers[some]] = True
        number = np.cumsum(kept) - 1
        blocks = []
        for block, some in zip(self.blocks, moves, strict=True):
            own = block if some.all() else block.part(some)  # most stay as they are: a copy would be of gigabytes
            if some.any():
                blocks.append(own._replace(numbers=number[own.numbers]))
        effects = [e for e, keep in zip(self.effects, kept, strict=True) if keep]
        return Candidates(effects, blocks, [e.key for e in effects])

    @cached_property
    def of_key(self) -> dict[tuple[object, ...], list[int]]:
        """The proposals' numbers by their key."""
        out: dict[tuple[object, ...], list[int]] = {}
        for n, key in enumerate(self.keys):
            out.setdefault(key, []).append(n)
        return out

    def joined(self, other: Candidates) -> Candidates:
        """Both lists as one."""
        shift = len(self.effects)
        blocks = [*self.blocks, *(block._replace(numbers=block.numbers + shift) for block in other.blocks)]
        keys = [*self.keys, *other.keys]
        return Candidates([*self.effects, *other.effects], blocks, keys, _directions=self._directions)

    def branch(self) -> Candidates:
        """A copy for an independent search, so that the order of searches does not change how scores are rounded."""
        return Candidates(self.effects, self.blocks, self.keys, _directions=self._directions.copy())

    def scores(self, linear: LinearModel) -> Scores:
        """Scores of each proposal, given the effects that the linear model holds."""
        if linear not in self._known:
            self._known[linear] = self._scored(linear)
        return self._known[linear]

    def _scored(self, linear: LinearModel) -> Scores:
        evidence = np.full(len(self.effects), -np.inf)
        delta_chi2 = np.zeros(len(self.effects))
        absorbed = np.ones(len(self.effects))
        expected_delta_chi2 = np.full(len(self.effects), np.inf)
        products = self._products(linear)
        alike: dict[tuple[bool, int], list[Block]] = {}
        for block in self.blocks:
            kind = self.effects[block.numbers[0]].random, block.columns.shape[1]
            alike.setdefault(kind, []).append(block)
        for (random, _), blocks in alike.items():
            own = np.concatenate([block.numbers for block in blocks])
            if random:
                scores = _random_scores(linear, blocks, products)
            else:
                scores = _free_scores(linear, blocks, products, np.array([self.effects[n].empirical for n in own]))
            evidence[own], delta_chi2[own], absorbed[own], expected_delta_chi2[own] = scores
        return Scores(
            self, evidence - np.array([e.cost for e in self.effects]), delta_chi2, absorbed, expected_delta_chi2
        )

    def _products(self, linear: LinearModel) -> Products:
        """Products of a block's columns with the accepted effects' basis vectors, and with the residual.

        All blocks were made with one linear model.
        """
        rank, n = next(((b.rank, b.columns.shape[-1]) for b in self.blocks), (0, 0))
        beyond = np.column_stack(
            [linear.basis[:n, rank:], linear.residual[:n]]
        )  # rows behind them are those of random effects
        if len(self.effects) > MANY:
            coordinates = self._directions.coordinates(beyond)
            return lambda block: self._directions.products(block.columns, block.times, coordinates)
        return lambda block: block.times(beyond)


def proposed(scene: Scene) -> list[Effect]:
    """Every effect of the library at every place that a survey shows, by what it recorded."""
    return [e for kind in registry().values() for e in kind.proposals(scene) if scene.shows(e.where)]


def enough_rows(effects: Sequence[Effect]) -> int:
    """Rows of a survey of which all these proposals' columns fit into memory: an arm has many times as many."""
    return MEMORY // (USUAL * 3 * np.dtype(SINGLE).itemsize * max(len(effects), 1))


def _alike(effects: Sequence[Effect]) -> Iterator[list[Effect]]:
    """The effects in lists that differ in their kind's shape only, and are as many as columns may be made at once."""
    lists: dict[tuple[object, ...], list[Effect]] = {}
    for effect in effects:
        shape = type(effect).shape
        if not shape:
            yield [effect]
            continue
        key = (type(effect), getattr(effect, shape) is None, *(v for k, v in vars(effect).items() if k != shape))
        own = lists.setdefault(key, [])
        own.append(effect)
        if len(own) == AT_ONCE:
            yield lists.pop(key)
    yield from lists.values()


def _blocks(linear: LinearModel, lists: Sequence[Sequence[Effect]], first: int) -> list[Block]:
    """The effects of some lists, numbered from `first` on, in blocks."""
    stacks: dict[tuple[bool, int], _Stack] = {}
    for alike in lists:
        terms = linear.terms(alike)
        kind = (alike[0].random, len(terms))
        if kind not in stacks:
            stacks[kind] = _Stack(len(terms), linear.size)
        sizes = np.array([t.size for t in terms])
        room = stacks[kind].room(first, len(alike), sizes)
        linear.fill(terms, room, scaled=True)
        first += len(alike)
    return [Block.of(linear, *part, random) for (random, _), stack in sorted(stacks.items()) for part in stack.parts()]


class _Stack:
    """Proposals of the same number of parameters, gathered in blocks that fit into a cache's neighbourhood."""

    def __init__(self, parameters: int, observations: int) -> None:
        self._shape = (parameters, observations)
        self._full: list[Part] = []
        self._count, self._numbers, self._columns, self._sizes = self._empty()

    def room(self, first: int, count: int, size: Array) -> Columns:
        """Where the columns (count, k, N) of the proposals from number `first` on go; their sizes are (k,)."""
        if self._count + count > BLOCK:
            self._full += self._last()
            self._count, self._numbers, self._columns, self._sizes = self._empty()
        own = slice(self._count, self._count + count)
        self._sizes[own], self._numbers[own] = size, np.arange(first, first + count)
        self._count = own.stop
        return self._columns[own]

    def parts(self) -> list[Part]:
        """A part for each block."""
        return self._full + self._last()

    def _empty(self) -> tuple[int, Index, Columns, Array]:
        columns = np.empty((BLOCK, *self._shape), SINGLE)
        return 0, np.empty(BLOCK, dtype=np.intp), columns, np.empty((BLOCK, self._shape[0]))

    def _last(self) -> list[Part]:
        m = self._count
        return [(self._numbers[:m], self._columns[:m], self._sizes[:m])] if m else []


class Ranked(NamedTuple):
    """The best proposal of a key: its log Bayes factor, averaged over the key's shapes, and its delta chi-squared."""

    effect: Effect
    evidence: float
    delta_chi2: float


@dataclass(frozen=True)
class Scores:
    """Scores of each proposal.

    Attributes
    ----------
    evidence : log Bayes factor against the model without it.
    delta_chi2 : decrease of the residual sum of squares, in noise variances.
    absorbed : share of the effect that is collinear with the geometry (R squared).
    expected_delta_chi2 : what delta chi-squared would be at the effect's usual size.
    """

    candidates: Candidates
    evidence: Array
    delta_chi2: Array
    absorbed: Array
    expected_delta_chi2: Array

    def beside(self, before: LinearModel, after: LinearModel) -> Scores:
        """With the expected delta chi-squared for the noise that remains once more has been explained."""
        noise = (before.square / before.freedom) / (after.square / after.freedom)
        return replace(self, expected_delta_chi2=self.expected_delta_chi2 * noise)

    def by_key(self) -> list[tuple[float, int]]:
        """(evidence of the key with its shapes integrated out, its best proposal), best first."""
        lists = list(self.candidates.of_key.values())
        if not lists:
            return []
        numbers, counts = np.concatenate(lists), np.array([len(n) for n in lists])
        first = np.cumsum(counts) - counts
        values = self.evidence[numbers]
        most = np.maximum.reduceat(values, first)
        finite = np.isfinite(most)
        above = np.repeat(np.where(finite, most, 0.0), counts)
        share = np.add.reduceat(np.exp(values - above), first) / counts
        mean = above[first] + np.log(np.where(finite, share, 1.0))
        best = np.minimum.reduceat(np.where(values == above, np.arange(len(values)), len(values)), first)
        return sorted(zip(mean[finite].tolist(), numbers[best[finite]].tolist(), strict=True), reverse=True)

    def ranking(self) -> list[Ranked]:
        """The keys whose evidence outweighs how many there are, best first."""
        ranked = self.by_key()
        effects = self.candidates.effects
        return [Ranked(effects[n], e, float(self.delta_chi2[n])) for e, n in ranked if e >= log(len(ranked))]


def _free_scores(linear: LinearModel, blocks: Sequence[Block], products: Products, empirical: Mask) -> Scored:
    """Scores of proposals with fixed effects, of blocks with the same number of parameters.

    The prior of a physical effect is a mixture over `SIZES` times its usual size, as machines are small and large. An
    empirical term has no usual size: its scale maximises the evidence, and 1 is subtracted for that choice.
    """
    from scipy.special import logsumexp

    gram, slope = _left(blocks, products)
    norm = np.sqrt(np.concatenate([block.square for block in blocks]))
    unit = gram / norm[:, :, None] / norm[:, None, :]
    values, vectors = np.linalg.eigh(unit)
    seen = values > 1 - np.where(empirical, FORM_ABSORBED, ABSORBED)[:, None]
    t = np.einsum("aij,ai->aj", vectors, slope / norm)
    variance = linear.square / linear.freedom
    # directions of the scaled columns have prior sizes of their own: those of the columns, taken along them
    prior = np.einsum("aij,ai->aj", np.square(vectors), np.square(norm))
    expected_delta_chi2 = np.sum(np.maximum(values, 0.0) / variance * prior, axis=1)
    gain = np.where(seen, values / variance * prior, 0.0)
    count = np.maximum(seen.sum(axis=1), 1)
    safe = np.where(seen, values, 1.0)
    delta_chi2 = np.where(seen, t**2 / safe, 0.0) / variance
    fitting = np.maximum(delta_chi2.sum(axis=1) / count, 1.0) - 1.0
    gain = np.where(empirical[:, None], np.where(seen, fitting[:, None], 0.0), gain)
    by_size = np.array(
        [_log_evidence(linear, delta_chi2, np.where(empirical[:, None], gain, gain * s**2)) for s in SIZES]
    )
    evidence = logsumexp(by_size, axis=0, b=np.array([*SIZES.values()])[:, None]) - empirical
    absorbed = 1 - np.where(seen.any(axis=1), values.mean(axis=1), values.max(axis=1))
    return (
        np.where(seen.any(axis=1), evidence, -np.inf),
        delta_chi2.sum(axis=1),
        np.clip(absorbed, 0.0, 1.0),
        expected_delta_chi2,
    )


def _left(blocks: Sequence[Block], products: Products) -> tuple[Array, Array]:
    """Products of the projected columns of blocks with each other (m, k, k) and with the residual (m, k).

    The projected columns themselves are never formed.
    """
    gram, all_products = (np.concatenate(a) for a in zip(*((b.gram, products(b)) for b in blocks), strict=True))
    inner = all_products[..., :-1]
    return gram - inner @ inner.transpose(0, 2, 1), all_products[..., -1]


def _random_scores(linear: LinearModel, blocks: Sequence[Block], products: Products) -> Scored:
    """Scores of proposals whose parameters are random effects; their usual size is not known."""
    rows = []
    wholes = np.concatenate([block.square for block in blocks]).sum(axis=1)
    for gram, slopes, whole in zip(*_left(blocks, products), wholes.tolist(), strict=True):
        own = RandomEffects.from_products(gram, slopes, whole, linear.square, linear.freedom)
        _, evidence, noise = own.best()
        rows.append((evidence, linear.freedom * (1 - noise * linear.freedom / linear.square), own.absorbed, np.inf))
    evidence, delta_chi2, absorbed, expected_delta_chi2 = np.array(rows).T
    return evidence, delta_chi2, absorbed, expected_delta_chi2


def _log_evidence(linear: LinearModel, delta_chi2: Array, gain: Array) -> Array:
    """Evidence (m,) of independent directions (m, k) with prior variances of `gain` times those of their estimates."""
    kept = (delta_chi2 * gain / (1 + gain)).sum(axis=1)
    left = np.log1p(-np.minimum(kept / linear.freedom, 1 - 1e-12))
    return np.asarray(-linear.freedom / 2 * left - 0.5 * np.log1p(gain).sum(axis=1))
