"""What a survey cannot tell from the truth: other places, and other names in their textbook forms.

A rival cannot be told where what it leaves of the projected effect is too small to decide: less than `VISIBLE` in
chi-squared, of the size that the effect has in that recording. Two models whose fits differ by D in chi-squared are put
in the wrong order by noise with probability Phi(-sqrt(D)/2), 0.6 % for 25; a penalty for a parameter takes 7 of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.proof.hidden import BOUND, Hidden
from tests.proof.kinematics import Array
from tests.proof.projection import Bench, span
from tests.proof.rivals import FORMS

VISIBLE = 25.0


@dataclass(frozen=True)
class Alike:
    """The projected, whitened effect `left` (3 n,) of the amplitude that it has, `beside` (3 n, k) other effects."""

    bench: Bench
    hidden: Hidden
    left: Array
    beside: Array

    def places(self) -> list[str]:
        """Elements whose motions, with the effect's own course, look the same."""
        out = list(self.hidden.where)
        if self.hidden.field is None or self.hidden.effect in BOUND:
            return out
        motions = self.hidden.field(self.bench.sit)
        scalars = np.unique(np.concatenate(list(motions.values()), axis=1).round(12), axis=1)
        scalars = scalars[:, np.ptp(scalars, axis=0) + np.abs(scalars).max(axis=0) > 0]
        for name, lever in self.bench.levers.items():
            block = np.concatenate([lever * s[:, None, None] for s in scalars.T], axis=2)
            if name not in out and self.unseen(block):
                out.append(name)
        return out

    def unseen(self, block: Array) -> bool:
        """Whether columns (n, 3, k) fit the effect so well that what is left cannot be seen."""
        u = span(np.column_stack([self.bench.off(self.bench.whitened(block)), self.beside]))
        rest = self.left - u @ (u.T @ self.left)
        return bool(rest @ rest < VISIBLE)

    def names(self) -> dict[str, list[str]]:
        """The other names that fit as well in their textbook form, and where."""
        out = {}
        for name in FORMS.keys() - {self.hidden.effect}:
            where = list(dict.fromkeys(at for at, block in FORMS[name](self.bench) if self.unseen(block)))
            if where:
                out[name] = where
        return out
