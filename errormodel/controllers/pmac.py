"""Delta Tau PMAC and Turbo PMAC: ``DEFINE COMP`` tables of one motor's position, correcting another.

Values are integer sixteenths of a count. A table has N entries at equal spacings from the motor's zero, where the
correction is zero. Positions wrap around, so negative positions use the end of the table; its last entry is the zero
again. Of an axis that goes round the table is one turn long.

Source: PMAC and Turbo PMAC software references, DEFINE COMP (Turbo p. 302-305).
"""

from __future__ import annotations

import re
from typing import ClassVar

import numpy as np

from errormodel.arrays import Index
from errormodel.controllers.base import Controller, header
from errormodel.controllers.dialect import Dialect
from errormodel.controllers.setup import FULL_TURN, Setup
from errormodel.controllers.tables import (
    Table,
    Tables,
    Term,
    check_points,
    even_step,
    shift_lines,
    shift_terms,
    shifts_of,
)
from errormodel.controllers.text import Comment, Files, one_file
from errormodel.exceptions import InputError

COMP_TABLE = re.compile(r"#(\d+) DEFINE COMP (\d+),#(\d+)D,#(\d+),(\d+)\s+([-\d\s]+)")


class Pmac(Controller):
    """One-dimensional tables, cross tables included."""

    name: ClassVar[str] = "pmac"
    title: ClassVar[str] = "Delta Tau PMAC / Turbo PMAC position compensation (DEFINE COMP)"
    source: ClassVar[str] = "Turbo PMAC software reference, DEFINE COMP, p. 302-305"
    needs: ClassVar[str] = "a PMAC or Turbo PMAC whose motors home; counts a mm or deg of every motor (--resolution)"
    back: ClassVar[str] = "I51=0; #n DELETE COMP for each table, SAVE"
    doubt: ClassVar[str] = "the sign of the entries (taken as a correction, added to the commanded position)"
    comment: ClassVar[Comment | None] = Comment("; ")
    sign_known: ClassVar[bool] = False
    other_sign: ClassVar[str] = "write the tables again with --invert"
    dialect: ClassVar[Dialect | None] = None  # axis definitions and offsets differ from machine to machine
    backlash_parameter: ClassVar[str] = "I{number}86 (with I{number}85 above 0)"
    first_number: ClassVar[int | None] = 1
    number_form: ClassVar[str] = "#{}"
    beyond: ClassVar[str] = (
        "to the ends of the travel the correction of its edge is held; beyond the travel the tables roll over, those "
        "of an axis measured all round at every turn"
    )
    most_points: ClassVar[int] = 1000
    most_tables: ClassVar[int | None] = 32
    few_tables: ClassVar[int | None] = 8

    def unit(self, setup: Setup) -> float:
        """A sixteenth of a count, mm."""
        return (setup.resolution or 0.001) / 16

    def quantum(self, setup: Setup) -> float:
        return 0.5 * self.unit(setup) * len(setup.moving) + 1e-9

    def backlash_value(self, setup: Setup, axis: str, size: float) -> str:
        return f"{round(size / self.unit(setup)):+d} sixteenths of a count"

    def about(self, tables: Tables, setup: Setup) -> list[str]:
        turning = {t.term.inputs[0] for t in tables if t.term.inputs and setup.axis(t.term.inputs[0]).turns}
        beside = [
            f"tables over {i} do not repeat at {FULL_TURN:g} deg: let {i} stay within one turn"
            for i in sorted(turning)
            if not all(self._round(setup, t) for t in tables if t.term.inputs == (i,))
        ]
        return [*(() if self.heed(tables) else (self.needed(tables),)), *beside]

    def needed(self, tables: Tables) -> str:
        return f"{super().needed(tables)}: a PMAC holds 8, a Turbo PMAC 32"

    def terms(self, setup: Setup) -> list[Term]:
        curves = [
            Term(m, (i,), (setup.grid(i, self.most_points, anchored=True),), zero=True)
            for m in setup.linear
            for i in setup.moving
        ]
        return [*curves, *shift_terms(curves)]

    def _nodes(self, setup: Setup, name: str, step: float, round_: bool) -> Index:
        """Integer multiples of the step that cover the travel and zero; `round_`: one turn with both its ends."""
        axis = setup.axis(name)
        low, high = axis.measured if round_ else (min(axis.travel[0], 0.0), max(axis.travel[1], 0.0))
        return np.arange(int(np.floor(low / step + 1e-9)), int(np.ceil(high / step - 1e-9)) + 1)

    def _round(self, setup: Setup, table: Table) -> bool:
        """Whether a table can repeat at every turn: its steps divide it, and its ends, which are one place, agree."""
        turns = FULL_TURN / even_step(table.term)
        ends = np.rint(table.values[[0, -1]] / self.unit(setup))
        return setup.axis(table.term.inputs[0]).turns and abs(turns - round(turns)) < 1e-6 and ends[0] == ends[1]

    def write(self, tables: Tables, setup: Setup) -> dict[str, str]:
        shifts, tables = shift_lines(tables), tuple(t for t in tables if t.term.inputs)
        if len(tables) > 32:
            raise InputError("tables", f"{len(tables)} tables, and there are 32 motors to hold one", "Leave some out")
        unit, counts = self.unit(setup), 1 / (16 * self.unit(setup))
        lines, comment = header(self, setup, *shifts), self.comment or Comment("; ")
        lines += [f"; {counts:.9g} counts a mm (or deg): set --resolution to this machine's count", "DELETE GATHER"]
        lines += [f"#{m} DELETE COMP" for m in range(1, len(tables) + 1)]
        for m in range(len(tables), 0, -1):
            table = tables[m - 1]
            term, source = table.term, table.term.inputs[0]
            check_points(term, self.most_points)
            step = even_step(term)
            place = term.grids[0][0] / step
            if abs(place - round(place)) > 1e-6:
                found = f"positions from {term.grids[0][0]:g}, no whole multiple of the spacing {step:g}"
                raise InputError(f"table {term.output} over {source}", found, "Entries count from the motor's zero")
            round_ = self._round(setup, table)
            nodes = self._nodes(setup, source, step, round_)
            values = np.rint(np.interp(nodes * step, term.grids[0], table.values) / unit).astype(int)
            size = len(nodes) - round_  # the end of a turn is its start
            at_zero = values[nodes % size == 0][0]
            if at_zero:
                found = f"{at_zero * unit:g} mm at the motor's zero, where the table is zero by definition"
                raise InputError(f"table {term.output} over {source}", found, "Take that value off the whole table")
            entries = np.zeros(size, dtype=int)
            entries[nodes % size] = values
            count = round(size * step * counts)
            numbers = (self.number(setup, source), self.number(setup, term.output))
            lines.append(comment.line(f"over {source} (motor {numbers[0]}) for {term.output} (motor {numbers[1]})"))
            lines.append(f"#{m} DEFINE COMP {size},#{numbers[0]}D,#{numbers[1]},{count}")
            ordered = [*entries[1:], 0]
            lines += [" ".join(map(str, ordered[k : k + 10])) for k in range(0, len(ordered), 10)]
        return {"comp.pmc": "\n".join([*lines, "I51=1"]) + "\n"}

    def read(self, files: Files, setup: Setup) -> Tables:
        name, text = one_file(files, ".pmc")
        if not text.rstrip().endswith("I51=1"):
            raise InputError(name, "no I51=1 at its end: the file is not whole", "Copy the file again")
        unit, out = self.unit(setup), []
        plain = "\n".join(line.split(";")[0] for line in text.splitlines())
        for motor, count, source, target, length, body in COMP_TABLE.findall(plain):
            entries = [int(v) for v in body.split()]
            if len(entries) != int(count) or entries[-1]:
                found = f"{len(entries)} entries, {count} announced, the last {entries[-1] if entries else 'missing'}"
                raise InputError(f"{name}, table {motor}", found, "The last entry must be 0")
            step = float(round(int(length) * 16 * unit / len(entries), 9))
            letter = self.numbered(setup, int(source))
            round_ = setup.axis(letter).turns and abs(len(entries) * step - FULL_TURN) < 1e-6
            nodes = self._nodes(setup, letter, step, round_)
            values = unit * np.array([0, *entries[:-1]])[nodes % len(entries)]
            grid = tuple(float(round(k * step, 9)) for k in nodes)
            out.append(Table(Term(self.numbered(setup, int(target)), (letter,), (grid,), zero=True), values))
        return (*reversed(out), *shifts_of(text))

    def checklist(self, setup: Setup) -> list[str]:
        return [
            "compare the motor numbers above and counts a mm (--resolution); position 0 must be the motor's zero after "
            "homing",
            "delete TCOMP, BLCOMP, TBUF, ROTARY, LOOKAHEAD buffers first; tables go in from the highest motor down",
            "download comp.pmc, I51=1 switches compensation on, I51=0 off; SAVE once it is right",
        ]
