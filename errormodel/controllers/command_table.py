"""A CSV of commands: one column per joint, in mm and degrees; all other columns stay as they are."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.setup import Setup
from errormodel.controllers.text import Lines
from errormodel.surveys.columns import TOOL_COLUMNS

CELL = re.compile(r'(?:^|,)((?:"(?:[^"]|"")*"|[^,"])*)')  # quoted cells may hold commas
SAME_TIP = 1e-3  # mm: a nearer tip is the same


@dataclass(frozen=True)
class CommandTable:
    """Commands `q` (n, axes), mm and deg, in the columns `places` of the `cells`, whose first row are the names."""

    lines: Lines
    cells: tuple[tuple[str, ...], ...]
    places: tuple[int, ...]
    q: Array

    @classmethod
    def of(cls, name: str, text: str, setup: Setup) -> CommandTable:
        """Read a table.

        Raises
        ------
        InputError
            A joint has no column or two, a command is no number or beyond the travel, or a column says of the commands
            what their correction does not follow: another tool, directions of arrival.
        """
        lines = Lines.of(name, text)
        cells = tuple(tuple(CELL.findall(line)) for _, line in lines.lines)
        head = [w.strip() for w in cells[0]] if cells else []
        joints = [a.joint for a in setup.axes]
        if any(head.count(j) != 1 for j in joints):
            cure = f"Write {','.join(joints)}; other columns may stand beside them"
            raise lines.error(1, f"columns {', '.join(head)}", cure)
        for (number, _), row in zip(lines.lines, cells, strict=True):
            if len(row) != len(head):
                raise lines.error(number, f"{len(row)} cells where {len(head)} belong", "Write the file again")
        places = tuple(map(head.index, joints))
        table = cls(lines, cells, places, np.zeros((0, len(joints))))
        q = table._numbers(places)
        for (number, _), row in zip(lines.lines[1:], q, strict=True):
            for axis, value in zip(setup.axes, row, strict=True):
                if not axis.travel[0] - 1e-6 <= value <= axis.travel[1] + 1e-6:
                    found = f"{axis.joint} at {value:g}, beyond its travel {axis.travel[0]:g} to {axis.travel[1]:g}"
                    raise lines.error(number, found, "Write a position that the machine reaches")
        table._refuse_unfollowed(head, setup)
        return cls(lines, cells, places, q)

    def _numbers(self, places: tuple[int, ...]) -> Array:
        rows = zip(self.lines.lines[1:], self.cells[1:], strict=True)
        found = [self.lines.numbers(k, ",".join(row[p] for p in places), len(places), ",") for (k, _), row in rows]
        return np.array(found, dtype=np.float64).reshape(-1, len(places))

    def _refuse_unfollowed(self, head: list[str], setup: Setup) -> None:
        arrivals = [f"dir_{a.joint}" for a in setup.axes if f"dir_{a.joint}" in head]
        if arrivals:
            cure = "Leave it out, and write the rows in the order in which they are reached"
            raise self.lines.error(1, f"column {arrivals[0]}, where directions of arrival are those of the rows", cure)
        given = [k for k, name in enumerate(TOOL_COLUMNS) if name in head]
        if not given:
            return
        tips = self._numbers(tuple(head.index(TOOL_COLUMNS[k]) for k in given))
        far = np.abs(tips - np.array(setup.tool)[given]).max(axis=1, initial=0.0) > SAME_TIP
        if far.any():
            row = int(np.argmax(far))
            tip = " ".join(f"{TOOL_COLUMNS[k]} {v:g}" for k, v in zip(given, tips[row], strict=True))
            own = " ".join(f"{v:g}" for v in setup.tool)
            cure = "Give --tool X Y Z and rows of one tool, or leave the columns out"
            raise self.lines.error(
                self.lines.lines[row + 1][0], f"{tip}, where commands are for the tip at {own}", cure
            )

    def text(self, q: Array, figures: int) -> str:
        """The table with other commands (n, axes), and so many decimals."""
        out = [list(row) for row in self.cells]
        for row, values in zip(out[1:], q, strict=True):
            for place, value in zip(self.places, values, strict=True):
                row[place] = f"{value:.{figures}f}"
        return "\n".join(map(",".join, out)) + "\n"

    def notes(self, setup: Setup) -> Iterator[str]:
        """Columns of what errors change with: the correction is for one value of it."""
        known = {"target": f"the tip at {' '.join(f'{v:g}' for v in setup.tool)}", **setup.conditions}
        for name in map(str.strip, self.cells[0]):
            if name in known:
                yield f"column {name} stays as it is, and is not followed: all rows are for {known[name]}"
