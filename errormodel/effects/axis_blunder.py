"""A column that is not what its name says: a sign, a unit, a swap. Not physics: it is put right as a table is read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, ClassVar

from errormodel.effects.base import Channels, Effect, EffectTerm
from errormodel.effects.scene import Scene
from errormodel.machine import Machine

if TYPE_CHECKING:
    import pandas as pd

MEASURED = ("mx", "my", "mz")


class AxisBlunder(Effect):
    """``column`` times `factor`, or exchanged with `swap`, is what was meant; it moves nothing."""

    effect: ClassVar[str] = "axis-blunder"
    family: ClassVar[str] = "blunder"
    source: ClassVar[str] = "bookkeeping"
    separate: ClassVar[str] = "correct the table or the program that writes it"
    example: ClassVar[Mapping[str, object]] = {"column": "X", "factor": -1.0}

    column: str
    factor: float = 1.0
    swap: str = ""

    @property
    def where(self) -> str:
        return "instrument" if self.column in MEASURED else self.column

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.column,)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        return []

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        return iter(())

    def mend(self, table: pd.DataFrame) -> pd.DataFrame:
        """The table as it was meant (a copy)."""
        table = table.copy()
        if self.swap:
            table[[self.column, self.swap]] = table[[self.swap, self.column]].to_numpy()
        else:
            table[self.column] = table[self.column] * self.factor
        return table

    @property
    def text(self) -> str:
        """What is wrong, for a report."""
        if self.swap:
            return f"columns {self.column} and {self.swap} are swapped"
        if self.factor < 0:
            return f"the sign of column {self.column} is wrong"
        return f"column {self.column} is in another unit: it must be multiplied by {self.factor:.6g}"


def mended(table: pd.DataFrame, machine: Machine) -> pd.DataFrame:
    """A table with the mistakes that the machine's model knows of put right."""
    from errormodel.effects import make

    for spec in machine.effects:
        if spec.effect == AxisBlunder.effect:
            effect = make(spec)
            assert isinstance(effect, AxisBlunder)
            table = effect.mend(table)
    return table
