"""What a survey cannot tell from the truth: other places, and other names in their textbook forms.

A rival cannot be told where what it leaves of the projected effect is too small to decide: less than `VISIBLE` in
chi-squared, of the size that the effect has in that recording. Two models whose fits differ by D in chi-squared are put
in the wrong order by noise with probability Phi(-sqrt(D)/2), 0.6 % for 25; a penalty for a parameter takes 7 of it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tests.proof.hidden import BOUND, Hidden
from tests.proof.kinematics import Array
from tests.proof.projection import Bench, span
from tests.proof.rivals import FORMS

VISIBLE = 25.0
NOTHING = 1e-7  # of a column's length
RANK = 1e-10  # of a Gram matrix of unit columns


@dataclass(frozen=True)
class Alike:
    """The projected, whitened effect `left` (3 n,) of the amplitude that it has, `beside` (3 n, k) other effects."""

    bench: Bench
    hidden: Hidden
    left: Array
    beside: Array

    @cached_property
    def _others(self) -> Array:
        """Orthonormal basis of the other effects."""
        return span(self.beside)

    def _alone(self, columns: Array) -> Array:
        """Columns (3 n,) or (3 n, k) without what the other effects may be."""
        out: Array = columns - self._others @ (self._others.T @ columns)
        return out

    @cached_property
    def _rest(self) -> Array:
        return self._alone(self.left)

    @property
    def delta(self) -> float:
        """Length of what neither geometry nor the other effects explain."""
        return float(np.linalg.norm(self._rest))

    def places(self) -> list[str]:
        """Elements whose motions, with the effect's own course, look the same."""
        out = list(self.hidden.where)
        if self.hidden.field is None or self.hidden.effect in BOUND:
            return out
        motions = self.hidden.field(self.bench.sit)
        scalars = np.unique(np.concatenate(list(motions.values()), axis=1).round(12), axis=1)
        scalars = scalars[:, np.ptp(scalars, axis=0) + np.abs(scalars).max(axis=0) > 0]
        blocks = [
            (name, np.concatenate([lever * s[:, None, None] for s in scalars.T], axis=2))
            for name, lever in self.bench.levers.items()
            if name not in out
        ]
        return out + self.unseen(blocks)

    def names(self) -> dict[str, list[str]]:
        """The other names that fit as well in their textbook form, and where."""
        found = {name: self.unseen(FORMS[name](self.bench)) for name in FORMS.keys() - {self.hidden.effect}}
        return {name: where for name, where in sorted(found.items()) if where}

    def unseen(self, blocks: Iterable[tuple[str, Array]]) -> list[str]:
        """The places, each once, of columns (n, 3, k) that fit the effect so well that what is left cannot be seen."""
        listed = list(blocks)
        if not listed:
            return []
        columns = self.bench.whitened(np.concatenate([block for _, block in listed], axis=2))
        own = self._alone(self.bench.off(columns))
        whole, length = np.linalg.norm(columns, axis=0), np.linalg.norm(own, axis=0)
        own = own / np.where(length > NOTHING * whole, length, np.inf)
        counts = np.array([block.shape[2] for _, block in listed])
        first = np.cumsum(counts) - counts
        seen = np.ones(len(listed), dtype=bool)
        for k in np.unique(counts):
            some = np.flatnonzero(counts == k)
            parts = own[:, first[some][:, None] + np.arange(k)]  # (3 n, m, k)
            values, vectors = np.linalg.eigh(np.einsum("nmi,nmj->mij", parts, parts))
            along = np.einsum("mij,mi->mj", vectors, np.einsum("nmi,n->mi", parts, self._rest))
            fitted = np.where(values > RANK, along**2 / np.maximum(values, RANK), 0.0).sum(axis=1)
            seen[some] = self.delta**2 - fitted >= VISIBLE
        return list(dict.fromkeys(place for (place, _), s in zip(listed, seen, strict=True) if not s))
