"""Products of effects' columns under each noise model, made once for all linear models of one geometry.

A linear model is the geometry and some effects. What it needs behind the filter that makes a noise white are products
of their columns, and these are the same in every model of that geometry: one with an effect less, or with another one,
is put together of what is there. Only the equations that tie random effects to zero differ: no filter touches these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.effects.base import Effect
from identification.diagnosis.linear.known_models import of_any_size
from identification.diagnosis.linear.linear_model import LinearModel
from identification.estimation.noise import Noise, series_edges
from identification.estimation.orthonormal_basis import LEFT

GEOMETRY = 0  # its number; effects have those from 1 on


@dataclass(frozen=True)
class Part:
    """The geometry's basis, or the columns of an effect.

    Attributes
    ----------
    left : (k, N) without what the geometry spans: at the observations, and where the geometry is tied.
    taken : (k, r) along the geometry's basis.
    free : numbers of those that are left; of random effects all, as an equation of their own ties each.
    """

    left: Array
    taken: Array
    free: Index


class WeighedProducts:
    """Products, by the inverse covariances of some noises, of what the geometry leaves of effects' columns.

    Parameters
    ----------
    noises : None is white noise.
    name : of these noises: what is kept is found by it.
    """

    def __init__(self, linear: LinearModel, noises: Sequence[Noise | None], name: str) -> None:
        assert linear.lineage is not None
        self.noises, self._edges = noises, series_edges(linear.index)
        self._linear, self._name, self._known = linear, name, linear.lineage.known
        self._effects = dict[int, Effect]()
        size, rank = linear.plain or linear.basis.shape
        self._basis = linear.basis[:size, :rank]

    def number(self, effect: Effect) -> int:
        """A short name of an effect; random effects of another size have the same columns."""
        numbers = self._known.numbers
        if effect not in numbers:
            numbers[effect] = numbers.setdefault(of_any_size(effect), len(numbers) + 1)
        self._effects[numbers[effect]] = effect
        return numbers[effect]

    def part(self, number: int) -> Part:
        """The geometry, or the columns of an effect."""
        rank = self._basis.shape[1]
        if number == GEOMETRY:
            return Part(self._basis.T, np.eye(rank), np.arange(rank))
        known: Part | None = self._known.parts.find(number)
        if known is None:
            effect = self._effects[number]
            columns = self._linear.columns(effect)[0][:, : len(self._basis)]
            taken = columns @ self._basis
            left = columns - taken @ self._basis.T
            seen = np.linalg.norm(left, axis=1) > LEFT * np.linalg.norm(columns, axis=1)
            known = Part(left, taken, np.arange(len(left)) if effect.random else np.flatnonzero(seen))
            self._known.parts.keep(number, known, left.nbytes)
        return known

    def between(self, some: Sequence[int], others: Sequence[int]) -> dict[tuple[int, int], Array]:
        """Products (noises, k, l) of each of some with each of others, and the other way round."""
        kept, out = self._known.products, dict[tuple[int, int], Array]()
        missing = dict[int, set[int]]()
        for one, other in {(min(pair), max(pair)) for pair in product(some, others)}:
            if (found := kept.find((self._name, one, other))) is not None:
                out |= _both(one, other, found)
            else:
                missing.setdefault(one, set()).add(other)
                missing.setdefault(other, set()).add(one)
        while missing:  # the filter is for those that most others wait for
            one = min(missing, key=lambda n: (-len(missing[n]), n))
            beside = sorted(missing.pop(one))
            for other, made in zip(beside, self._made(one, beside), strict=True):
                pair = (one, other) if one <= other else (other, one)
                own = made if one <= other else made.transpose(0, 2, 1)
                out |= _both(*pair, own)
                kept.keep((self._name, *pair), own, own.nbytes)
                if other != one:
                    missing[other].discard(one)
                    if not missing[other]:
                        del missing[other]
        return out

    def _made(self, one: int, others: Sequence[int]) -> list[Array]:
        columns, parts = self.part(one).left, [self.part(other).left for other in others]
        out = [np.empty((len(self.noises), len(columns), len(p))) for p in parts]
        for k, noise in enumerate(self.noises):
            weighed = columns if noise is None else noise.weighed(columns, self._edges)
            for own, part in zip(out, parts, strict=True):
                np.matmul(weighed, part.T, out=own[k])
        return out

    def weighed(self, columns: Array) -> Array:
        """Columns (k, N) weighed by each noise: (noises, k, N)."""
        return np.array([columns if n is None else n.weighed(columns, self._edges) for n in self.noises])


def _both(one: int, other: int, products: Array) -> dict[tuple[int, int], Array]:
    return {(one, other): products, (other, one): products.transpose(0, 2, 1)}
