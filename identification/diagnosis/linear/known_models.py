"""What was made of one linear model before: the models with further effects, and effects' columns.

A search asks for the same models again and again: without a finding, with one of its alternatives, from another start.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace
from typing import Any

from errormodel.effects.base import Effect

Question = tuple[tuple[Effect, ...], tuple[Effect, ...], tuple[Hashable, ...]]
MOST_BYTES = 60_000_000  # of each kind: limits the memory; by judgement: a search looks at some dozen models in turn


class Latest:
    """What was asked for lately, by a key, as long as all of it does not take up too many bytes."""

    def __init__(self, most: int = MOST_BYTES) -> None:
        self._most, self._bytes = most, 0
        self._kept: OrderedDict[Hashable, tuple[Any, int]] = OrderedDict()

    def copy(self) -> Latest:
        """One that begins with what is kept here."""
        other = Latest(self._most)
        other._bytes, other._kept = self._bytes, self._kept.copy()
        return other

    def clear(self) -> None:
        """Keep nothing."""
        self._bytes, self._kept = 0, OrderedDict()

    def find(self, key: Hashable) -> Any:
        """What is kept by that key; None where nothing is."""
        if key not in self._kept:
            return None
        self._kept.move_to_end(key)
        return self._kept[key][0]

    def make_room(self, size: int) -> None:
        """Forget now what would go when so many bytes more are kept."""
        while self._kept and self._bytes + size > self._most:
            self._bytes -= self._kept.popitem(last=False)[1][1]

    def keep(self, key: Hashable, value: object, size: int) -> None:
        """Keep a value of so many bytes; what was not asked for longest goes."""
        self._bytes += size - self._kept.pop(key, (None, 0))[1]
        self._kept[key] = value, size
        while self._bytes > self._most and len(self._kept) > 1:
            self._bytes -= self._kept.popitem(last=False)[1][1]


def of_any_size(effect: Effect) -> Effect:
    """The same one for all random effects that differ in their size only: these have the same columns."""
    return effect.model_copy(update={"size": None}) if effect.random and "size" in vars(effect) else effect


@dataclass(frozen=True)
class Known:
    """What was made of one linear model, for all models that were made of it.

    Attributes
    ----------
    further : by the effects of a model, what the last one adds to the basis, and the residual.
    columns : of effects.
    filtered : by the effects of a model, what it is behind the filter of each noise.
    parts, products : of effects, by their `numbers`: columns without the geometry, and their products under each noise.
    moves : of effects, the elements and motions that they move.
    answers : to questions about a model of some effects, by these, the effects asked about, and the question.
    """

    further: Latest = field(default_factory=Latest)
    columns: Latest = field(default_factory=Latest)
    filtered: Latest = field(default_factory=Latest)
    parts: Latest = field(default_factory=Latest)
    products: Latest = field(default_factory=Latest)
    numbers: dict[Effect, int] = field(default_factory=dict)
    moves: dict[Effect, frozenset[tuple[str, str]]] = field(default_factory=dict)
    answers: dict[Question, Any] = field(default_factory=dict)

    def copy(self) -> Known:
        """One for a search that runs beside others: what one has kept must not change another one's rounding."""
        further, columns, filtered = self.further.copy(), self.columns.copy(), self.filtered.copy()
        parts, products = self.parts.copy(), self.products.copy()
        numbers, moves, answers = self.numbers.copy(), self.moves.copy(), self.answers.copy()
        return Known(further, columns, filtered, parts, products, numbers, moves, answers)

    def only_answers(self) -> None:
        """Forget all that takes up memory."""
        for large in (self.further, self.columns, self.filtered, self.parts, self.products):
            large.clear()

    def of_columns(self) -> Known:
        """What does not depend on what was measured."""
        return replace(self, further=Latest(), filtered=Latest(), answers={})

    def without(self, lost: Callable[[Effect], bool]) -> Known:
        """What does not depend on effects whose columns are lost: answers, which are small."""
        gone = dict[Effect, bool]()

        def kept(effects: tuple[Effect, ...]) -> bool:
            for effect in effects:
                if effect not in gone:
                    gone[effect] = lost(effect)
            return not any(gone[effect] for effect in effects)

        answers = {key: own for key, own in self.answers.items() if kept(key[0]) and kept(key[1])}
        return Known(moves=self.moves, answers=answers)


@dataclass(frozen=True)
class Lineage:
    """How a linear model was made of a first one: by which effects in turn."""

    effects: tuple[Effect, ...] = ()
    known: Known = field(default_factory=Known, compare=False, repr=False)

    def further(self, effect: Effect) -> Lineage:
        """That of the model with one more effect."""
        return replace(self, effects=(*self.effects, effect))
