"""Table columns whose sign, unit or zero is wrong, or that are swapped; corrected when a table is read.

This is a mistake of bookkeeping and not physics: it moves nothing. Units: mm and rad.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar, TypeVar

from errormodel import conventions
from errormodel.arrays import Array
from errormodel.effects.base import FIXED, Channels, Effect, EffectTerm
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.machine import Machine
from errormodel.surveys.columns import MEASURED, TOOL_COLUMNS

if TYPE_CHECKING:
    import pandas as pd

Table = TypeVar("Table", "pd.DataFrame", dict[str, Array])

DIAMETER = 2.0, 0.5  # times: radii that should be diameters of a turned part, and the other way round


class AxisBlunder(Effect):
    """Correct value of a column: ``factor * column + offset`` (mm or rad).

    With `swap`, the correct `column` is `factor` times the column named by `swap`, and the correct column `swap` is
    `column` divided by `factor`.
    """

    effect: ClassVar[str] = "axis-blunder"
    family: ClassVar[str] = "blunder"
    source: ClassVar[str] = "bookkeeping"
    separate: ClassVar[str] = "correct the table or the program that writes it"
    example: ClassVar[Mapping[str, object]] = {"column": "X", "factor": -1.0}

    column: str
    factor: Annotated[float, FIXED] = 1.0
    offset: Annotated[float, FIXED] = 0.0
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
        """Copy of a table, or of its columns by name, with this mistake corrected."""
        table = table.copy()
        here, there = self.column, self.swap
        if there:
            table[here], table[there] = table[there] * self.factor, table[here] / self.factor
        else:
            table[here] = table[here] * self.factor + self.offset
        return table

    def mar(self, table: Table) -> Table:
        """Copy of a table with this mistake introduced: the inverse of `mend`."""
        if self.swap:  # a swap is its own inverse
            return self.mend(table)
        table = table.copy()
        table[self.column] = (table[self.column] - self.offset) / self.factor
        return table

    def text(self, machine: Machine) -> str:
        """Description of the mistake for a report."""
        if self.swap:
            return f"columns {self.column} and {self.swap} are swapped"
        if self.offset:
            turns = any(j.name == self.column and j.type == "rotary" for j in machine.joints)
            missing = f"{math.degrees(self.offset):.3f} deg" if turns else f"{self.offset:.3f} mm"
            return f"column {self.column} has another zero than the machine's dimensions, {missing} must be added"
        if self.factor == -1:
            return f"the sign of column {self.column} is wrong"
        if self.factor in DIAMETER:
            one, other = ("diameters", "radii") if self.factor == 0.5 else ("radii", "diameters")
            return f"column {self.column} has {one} for {other}: it must be multiplied by {self.factor:g}"
        return f"column {self.column} is in another unit: it must be multiplied by {self.factor:.6g}"


def mended(table: pd.DataFrame, machine: Machine) -> pd.DataFrame:
    """Correct the mistakes that the machine's ``effects:`` declare in a table."""
    for effect in _known(machine):
        table = effect.mend(table)
    return table


def mended_words(machine: Machine) -> list[str]:
    """The mistakes that the machine's ``effects:`` declare, in words."""
    return [effect.text(machine) for effect in _known(machine)]


def marred(table: pd.DataFrame, machine: Machine) -> pd.DataFrame:
    """Introduce the mistakes that the machine's ``effects:`` declare into a table of positions, as its file has it."""
    for effect in reversed(_known(machine)):
        table = effect.mar(table)
    return table


def _known(machine: Machine) -> list[AxisBlunder]:
    """The column mistakes among the machine's effects, in their order."""
    from errormodel.effects import make

    found = (make(spec) for spec in machine.effects if spec.effect == AxisBlunder.effect)
    return [effect for effect in found if isinstance(effect, AxisBlunder)]
