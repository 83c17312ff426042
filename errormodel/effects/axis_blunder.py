"""A column that is not what its name says: sign, unit, zero, swap. Not physics: it is put right as a table is read."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, ClassVar, TypeVar

from errormodel import conventions
from errormodel.arrays import Array
from errormodel.effects.base import Channels, Effect, EffectTerm
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.machine import Machine
from errormodel.survey_columns import MEASURED, TOOL_COLUMNS

if TYPE_CHECKING:
    import pandas as pd

Table = TypeVar("Table", "pd.DataFrame", dict[str, Array])


class AxisBlunder(Effect):
    """What was meant is ``factor * column + offset`` (mm or rad); it moves nothing.

    With `swap` the column is `factor` times what stands in that one, and that one what stands here over `factor`.
    """

    effect: ClassVar[str] = "axis-blunder"
    family: ClassVar[str] = "blunder"
    source: ClassVar[str] = "bookkeeping"
    separate: ClassVar[str] = "correct the table or the program that writes it"
    example: ClassVar[Mapping[str, object]] = {"column": "X", "factor": -1.0}

    column: str
    factor: float = 1.0
    offset: float = 0.0
    swap: str = ""

    @property
    def where(self) -> str:
        if self.column in MEASURED:
            return conventions.INSTRUMENT
        return conventions.TOOL if self.column in TOOL_COLUMNS else self.column

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.column,)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        return []

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        return iter(())

    def mend(self, table: Table) -> Table:
        """The table, or its columns by name, as it was meant (a copy)."""
        table = table.copy()
        here, there = self.column, self.swap
        if there:
            table[here], table[there] = table[there] * self.factor, table[here] / self.factor
        else:
            table[here] = table[here] * self.factor + self.offset
        return table

    def mar(self, table: Table) -> Table:
        """The table as it would stand in a file with this mistake (a copy): what `mend` puts right."""
        if self.swap:  # an exchange undoes itself
            return self.mend(table)
        table = table.copy()
        table[self.column] = (table[self.column] - self.offset) / self.factor
        return table

    def text(self, machine: Machine) -> str:
        """What is wrong, for a report."""
        if self.swap:
            return f"columns {self.column} and {self.swap} are swapped"
        if self.offset:
            turns = any(j.name == self.column and j.type == "rotary" for j in machine.joints)
            missing = f"{math.degrees(self.offset):.3f} deg" if turns else f"{self.offset:.3f} mm"
            return f"column {self.column} has another zero than the machine's dimensions, {missing} must be added"
        if self.factor == -1:
            return f"the sign of column {self.column} is wrong"
        return f"column {self.column} is in another unit: it must be multiplied by {self.factor:.6g}"


def mended(table: pd.DataFrame, machine: Machine) -> pd.DataFrame:
    """A table with the mistakes that the machine's model knows of put right."""
    for effect in _known(machine):
        table = effect.mend(table)
    return table


def marred(table: pd.DataFrame, machine: Machine) -> pd.DataFrame:
    """A table of positions as a file has it: with the mistakes that the machine's model knows of."""
    for effect in reversed(_known(machine)):
        table = effect.mar(table)
    return table


def _known(machine: Machine) -> list[AxisBlunder]:
    from errormodel.effects import make

    found = (make(spec) for spec in machine.effects if spec.effect == AxisBlunder.effect)
    return [effect for effect in found if isinstance(effect, AxisBlunder)]
