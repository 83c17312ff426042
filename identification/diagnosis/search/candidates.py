"""Candidate effects of a survey as design columns, and the log Bayes factor of each against the current model.

A shape parameter is averaged over its grid: that is its trials factor. All log Bayes factors are natural logarithms.
"""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from math import log
from typing import NamedTuple, TypeVar

import numpy as np

from errormodel.arrays import Array, Mask
from errormodel.effects.base import Effect
from errormodel.effects.search_space.survey_summary import Scene
from identification.diagnosis.decisions.constants import SIZES
from identification.diagnosis.linear.known_models import Latest, Lineage
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search.alike_blocks import AlikeBlocks
from identification.diagnosis.search.blocks import (
    NOTHING,
    Block,
    Kind,
    Made,
    Vectors,
    blocks_of,
    columns_of,
    gram_of,
    products,
)
from identification.diagnosis.search.known_products import KnownProducts, begun_with, keep_begun, known_products
from identification.diagnosis.search.marginal_likelihood import Scored, free_scores, random_scores
from identification.diagnosis.search.proposals import proposed
from identification.runtime.parallel import parallel_map

# log Bayes factor, by judgement: nobody would mention less. Kernels of linear algebra differ by a hundredth of it
# at the beginning of a search, and by as much where nearly all is explained (single precision, a real recording)
TIE = 0.1
AT_ONCE = 16  # columns made in one go: they stay within the processor's cache
T = TypeVar("T")
MANY, PARTS = 1000, 4  # proposals beyond which columns are made in parallel, in so many parts
KNOWN_BYTES = 150_000_000  # of products with fitted effects: as many as an arm's model has; by judgement
BEGUN_BYTES = 30_000_000  # of products of projected columns that other models begin with; by judgement
KEPT = 48  # linear models whose scores are kept; by judgement: a search that begins anew returns to about as many
WIDEST = 3 * max(SIZES)  # times the usual one: standard deviation of the prior of the final fit


@dataclass(frozen=True, eq=False)
class Candidates:
    """Proposals with their columns, in blocks of the same number of parameters.

    Attributes
    ----------
    effects : all proposals; `keys` their keys (one key: all shapes of one effect at one place).
    parts : lists that were joined to this one, which has no blocks of its own then.
    """

    effects: list[Effect]
    blocks: list[Block]
    keys: list[tuple[object, ...]] = field(default_factory=list)
    parts: tuple[Candidates, ...] = ()
    _known: OrderedDict[Lineage, Scored] = field(default_factory=OrderedDict, repr=False)
    _products: Latest = field(default_factory=partial(Latest, KNOWN_BYTES), repr=False)
    _begun: Latest = field(default_factory=partial(Latest, BEGUN_BYTES), repr=False)
    _survey: list[tuple[Array, Array]] = field(default_factory=list, repr=False)  # none yet, or one

    @classmethod
    def of(cls, linear: LinearModel, effects: Sequence[Effect] | None = None) -> Candidates:
        """All proposals of the library (or the given ones) whose channels the survey has."""
        if effects is None:
            effects = proposed(linear)
        lists = list(_listed(effects))
        # not as many as there are cores: results must not depend on them
        parts = [lists[k::PARTS] for k in range(PARTS)] if len(effects) > MANY else [lists]
        listed = [[e for alike in part for e in alike] for part in parts]
        first = np.cumsum([0, *map(len, listed)]).tolist()
        jobs = [partial(columns_of, linear, part, first[k]) for k, part in enumerate(parts)]
        columns: dict[Kind, list[Made]] = {}
        for made in parallel_map(jobs):
            for kind, own in made.items():
                columns.setdefault(kind, []).extend(own)
        del made
        blocks = blocks_of(linear, columns)
        every = [e for part in listed for e in part]
        return cls(every, blocks, [e.key for e in every])._that_move()

    def _that_move(self) -> Candidates:
        """Without proposals that move nothing in these rows, or are not defined in some."""
        kept = np.zeros(len(self.effects), dtype=bool)
        for block in self.blocks:
            kept[block.numbers] = block.square.max(axis=1) > NOTHING
        return self.part(kept)

    def part(self, kept: Mask) -> Candidates:
        """Some of the proposals, and what is known of their scores."""
        if kept.all():
            return self
        number, blocks = np.cumsum(kept) - 1, []
        for block in self.blocks:
            some = kept[block.numbers]
            own = block if some.all() else block.part(some)  # most stay as they are: a copy would be of gigabytes
            if some.any():
                blocks.append(own._replace(numbers=number[own.numbers]))
        effects = [e for e, keep in zip(self.effects, kept, strict=True) if keep]
        known = OrderedDict[Lineage, Scored]()
        for lineage, (evidence, delta_chi2, absorbed, expected) in self._known.items():
            known[lineage] = evidence[kept], delta_chi2[kept], absorbed[kept], expected[kept]
        ends = np.cumsum([len(part.effects) for part in self.parts], dtype=int)
        of_parts = zip(self.parts, np.split(kept, ends)[:-1], strict=True)
        parts = tuple(part.part(own) for part, own in of_parts if own.any())
        return Candidates(effects, blocks, [e.key for e in effects], parts, known)

    def without(self, lost: Callable[[Effect], bool]) -> Candidates:
        """Those whose columns are not lost, and their scores beside effects whose columns are not."""
        some = self.part(np.array([not lost(e) for e in self.effects]))
        parts = tuple(part.without(lost) for part in some.parts)
        known = OrderedDict((key, own) for key, own in some._known.items() if not any(map(lost, key.effects)))
        return Candidates(some.effects, some.blocks, some.keys, parts, known)

    @cached_property
    def of_key(self) -> dict[tuple[object, ...], list[int]]:
        """The proposals' numbers by their key."""
        out: dict[tuple[object, ...], list[int]] = {}
        for n, key in enumerate(self.keys):
            out.setdefault(key, []).append(n)
        return out

    @cached_property
    def places(self) -> Counter[str]:
        """At how many places, or by how many drivers, each effect is proposed."""
        return Counter(self.effects[numbers[0]].effect for numbers in self.of_key.values())

    def joined(self, other: Candidates) -> Candidates:
        """Both lists as one."""
        parts = (*(self.parts or (self,)), *(other.parts or (other,)))
        return Candidates([*self.effects, *other.effects], [], [*self.keys, *other.keys], parts)

    def listed(self) -> Candidates:
        """The proposals without their columns, which are large."""
        return Candidates(self.effects, [], self.keys)

    def branch(self) -> Candidates:
        """A copy for an independent search, so that the order of searches does not change how scores are rounded."""
        parts = tuple(part.branch() for part in self.parts)
        known = self._known.copy(), self._products.copy(), self._begun.copy(), self._survey
        return Candidates(self.effects, self.blocks, self.keys, parts, *known)

    def ended(self) -> None:
        """The search is over: of what it has made only the scores are still wanted."""
        self._products.clear()
        self._begun.clear()
        for part in self.parts:
            part.ended()

    def learn(self, branch: Candidates) -> None:
        """Take over the scores that a branch has found."""
        for lineage, values in branch._known.items():
            if lineage not in self._known:
                _keep(self._known, lineage, values)
        for part, own in zip(self.parts, branch.parts, strict=True):
            part.learn(own)

    def scores(self, linear: LinearModel) -> Scores:
        """Scores of each proposal, given the effects that the linear model holds."""
        if linear.lineage is None:
            return self._scored(linear)
        if linear.lineage not in self._known:
            _keep(self._known, linear.lineage, self._scored(linear).values)
        self._known.move_to_end(linear.lineage)
        return Scores(self, *self._known[linear.lineage])

    def _scored(self, linear: LinearModel) -> Scores:
        if self.parts:
            of_parts = [part.scores(linear).values for part in self.parts]
            return Scores(self, *(np.concatenate(values) for values in zip(*of_parts, strict=True)))
        evidence = np.full(len(self.effects), -np.inf)
        delta_chi2 = np.zeros(len(self.effects))
        absorbed = np.ones(len(self.effects))
        expected_delta_chi2 = np.full(len(self.effects), np.inf)
        cost, changing = self._in_survey(linear.scene)
        left = self._left(linear) if linear.freedom > 0 else []  # a few rows are explained by anything
        for alike, (gram, slope) in zip(self._alike, left, strict=bool(left)):
            own = alike.numbers
            square = alike.square * changing[own, None]
            if alike.random:
                scores = random_scores(linear, gram, slope, square)
            else:
                scores = free_scores(linear, gram, slope, square, alike.empirical)
            evidence[own], delta_chi2[own], absorbed[own], expected_delta_chi2[own] = scores
        return Scores(self, evidence - cost, delta_chi2, absorbed, expected_delta_chi2)

    def _in_survey(self, scene: Scene) -> tuple[Array, Array]:
        """Of each proposal its cost and changing share, in the survey that all of them are of."""
        if not self._survey:
            self._survey.append((np.array([e.cost(scene) for e in self.effects]), changing_shares(self.effects, scene)))
        return self._survey[0]

    @cached_property
    def _alike(self) -> list[AlikeBlocks]:
        """The blocks of proposals with as many parameters, together."""
        lists: dict[tuple[bool, int], list[int]] = {}
        for k, block in enumerate(self.blocks):
            lists.setdefault((self.effects[block.numbers[0]].random, block.sizes.shape[1]), []).append(k)
        return [AlikeBlocks.of(self.effects, self.blocks, random, own) for (random, _), own in lists.items()]

    def _left(self, linear: LinearModel) -> list[tuple[Array, Array]]:
        """Products of projected columns with each other (m, k, k) and with the residual (m, k), of those alike.

        The projected columns themselves are never formed. All blocks were made with one linear model; what the
        effects that were accepted since take of their products is taken off.
        """
        if not self.blocks:
            return []
        if linear.basis.shape[1] == self.blocks[0].rank:
            return [(alike.gram, alike.slope) for alike in self._alike]
        known, begun = begun_with(self._begun, linear.lineage) or ([alike.gram for alike in self._alike], 0)
        grams = [gram.copy() for gram in known]
        slopes = [np.empty_like(alike.slope) for alike in self._alike]
        for n, rows, product, slope in self._along(linear, begun):
            taken = gram_of(product)
            if not np.isfinite(taken).all():
                raise FloatingPointError("products of design columns are not finite")
            slopes[n][rows] = slope
            grams[n][rows] -= taken
        keep_begun(self._begun, linear.lineage, grams, linear.basis.shape[1] - self.blocks[0].rank)
        return list(zip(grams, slopes, strict=True))

    def _along(self, linear: LinearModel, begun: int) -> Iterator[tuple[int, slice, Array, Array]]:
        """Products (m, k, r) of columns with the basis from some column on, and (m, k) with the residual.

        They are of some proposals of a list of those alike, whose number comes first. Columns of the basis are counted
        from the end of the geometry.
        """
        (size, _), rank = linear.plain or linear.basis.shape, self.blocks[0].rank
        if (known := self._known_products(linear, begun)) is not None:
            for n, slopes in enumerate(known.slopes):
                for rows, product in known.with_basis(n):
                    yield n, rows, product[..., begun:].astype(float), slopes[rows]
            return
        both = Vectors(np.column_stack([linear.basis[:size, rank + begun :], linear.residual[:size]]))
        place = {k: (n, rows) for n, alike in enumerate(self._alike) for k, rows in alike.places.items()}
        for k, own in enumerate(products(self.blocks, both)):
            yield *place[k], own[..., :-1], own[..., -1]

    def _known_products(self, linear: LinearModel, begun: int) -> KnownProducts | None:
        """Those of the effects of a model, where they are less work than products with the basis from a column on."""
        further = linear.basis.shape[1] - self.blocks[0].rank
        columns, values = (sum(own) for own in zip(*((b.sizes.size, b.columns.size) for b in self.blocks), strict=True))
        work = further**2 * (columns + linear.size)  # of triangular systems, and of products of the effects' columns
        if linear.lineage is None or work > values * (further - begun) or 4 * columns * further > KNOWN_BYTES:
            return None
        return known_products(self._products, self._alike, self.blocks, linear)


def _keep(kept: OrderedDict[Lineage, T], lineage: Lineage, value: T) -> None:
    kept[lineage] = value
    if len(kept) > KEPT:
        kept.popitem(last=False)


def changing_shares(effects: Sequence[Effect], scene: Scene) -> Array:
    """Share of each effect that is due to changes of a temperature; the same for all by one of them."""
    known: dict[object, float] = {}
    keys = [(effect.effect, effect.drivers) for effect in effects]
    for key, effect in zip(keys, effects, strict=True):
        if key not in known:
            known[key] = effect.changing(scene)
    return np.array([known[key] for key in keys])


def _listed(effects: Sequence[Effect]) -> Iterator[list[Effect]]:
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

    @property
    def values(self) -> tuple[Array, Array, Array, Array]:
        return self.evidence, self.delta_chi2, self.absorbed, self.expected_delta_chi2

    def alone(self) -> Scores:
        """The same without the proposals' columns."""
        return replace(self, candidates=self.candidates.listed())

    def beside(self, before: LinearModel, after: LinearModel) -> Scores:
        """With the expected delta chi-squared for the noise that remains once more has been explained."""
        noise = (before.square / before.freedom) / (after.square / after.freedom)
        return replace(self, expected_delta_chi2=self.expected_delta_chi2 * noise)

    def by_key(self) -> list[tuple[float, int]]:
        """(evidence of the key with its shapes integrated out, its best proposal), best first.

        What differs by no more than `TIE` has a fixed order: of the shapes of a key the first proposal is its best, and
        of keys the one that is proposed last comes first. How scores are rounded then does not choose.
        """
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
        best = np.minimum.reduceat(np.where(values >= above - TIE, np.arange(len(values)), len(values)), first)
        ranked = zip(mean[finite].tolist(), numbers[best[finite]].tolist(), strict=True)
        return sorted(ranked, key=lambda own: (round(own[0] / TIE), own[1]), reverse=True)

    def ranking(self) -> list[Ranked]:
        """The keys whose evidence outweighs how many there are, best first."""
        ranked = self.by_key()
        effects = self.candidates.effects
        return [Ranked(effects[n], e, float(self.delta_chi2[n])) for e, n in ranked if e >= log(len(ranked))]


def score_of(linear: LinearModel, effect: Effect) -> tuple[float, float, float] | None:
    """Log Bayes factor of one effect, its delta chi-squared and its absorbed part; None where it moves nothing.

    As `Candidates.scores`, from columns in double precision: of a few effects these are no more work.
    """
    columns, sizes = linear.columns(effect)
    scaled = columns * sizes[:, None]
    whole, inner = scaled @ scaled.T, scaled @ linear.basis
    if not np.isfinite(whole).all() or np.diag(whole).max(initial=0.0) <= NOTHING:
        return None
    gram, slope = (whole - inner @ inner.T)[None], (scaled @ linear.residual)[None]
    square = np.maximum(np.diag(whole), NOTHING)[None] * effect.changing(linear.scene)
    if effect.random:
        scores = random_scores(linear, gram, slope, square)
    else:
        scores = free_scores(linear, gram, slope, square, np.array([effect.empirical]))
    evidence, delta_chi2, absorbed = (float(v[0]) for v in scores[:3])
    return evidence - effect.cost(linear.scene), delta_chi2, absorbed
