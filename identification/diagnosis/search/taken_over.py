"""What a search takes over from the one before it, where other directions of approach are all that is new."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from errormodel.channels import follows_sides
from errormodel.effects.base import Effect
from identification.diagnosis.linear.known_models import Lineage
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search.candidates import Candidates


@dataclass(frozen=True)
class Searched:
    """A linear model that was searched, the effects that were proposed, and those that are candidates."""

    linear: LinearModel
    library: Sequence[Effect]
    candidates: Candidates

    @classmethod
    def of(cls, linear: LinearModel, library: Sequence[Effect]) -> Searched:
        """A linear model that was not searched yet."""
        return cls(linear, library, Candidates.of(linear, library))

    def again(self, linear: LinearModel, library: Sequence[Effect]) -> Searched:
        """The same of a linear model whose directions of approach are others: only what follows these is made anew."""
        machine, before = linear.chain.machine, self.linear

        @cache
        def follows(effect: Effect) -> bool:
            return any(map(follows_sides, effect.channels(machine)))

        steady = [[e for e in own if not follows(e)] for own in (self.library, library)]
        if before.lineage is None or steady[0] != steady[1] or not _alike(before, linear):
            return Searched.of(linear, library)
        linear = replace(linear, lineage=Lineage(known=before.lineage.known.without(follows)))
        kept = self.candidates.without(follows)
        return Searched(linear, library, kept.joined(Candidates.of(linear, [e for e in library if follows(e)])))


def _alike(one: LinearModel, other: LinearModel) -> bool:
    """Whether two linear models differ in directions of approach only."""
    if one.first is not None or other.first is not None or one.round_off != other.round_off:
        return False
    pairs = [(getattr(one, name), getattr(other, name)) for name in ("residual", "basis", "index")]
    columns = [{n: v for n, v in own.scene.columns.items() if not follows_sides(n)} for own in (one, other)]
    for own, new in ((one.levers, other.levers), columns):
        if own.keys() != new.keys():
            return False
        pairs += [(own[name], new[name]) for name in own]
    return all(np.array_equal(a, b) for a, b in pairs)
