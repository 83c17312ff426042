"""Which rows of a measured file belong to which commands: the table ``pairs.csv`` of an imported survey."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from errormodel.arrays import Index, Mask
from errormodel.exceptions import InputError
from errormodel.files import as_numbers, read_csv
from errormodel.inputs import noted

PAIR_COLUMNS = ("command", "first", "last")
START = "from"  # optional column: the command of the first pose, where a reading is between two
RUN = "run"  # optional column: the pass through the commands that a reading is of
CURE = "Import the files again, or correct the line"


@dataclass(frozen=True)
class PairTable:
    """Readings and their commands; all rows count from 0.

    Attributes
    ----------
    name : of the table, for messages.
    command : (n,) row of the command.
    first, last : (n,) rows of the measured file, whose mean is the reading.
    start : (n,) row of the command at which the distance begins; None: readings are of one pose.
    run : (n,) label of the pass; None: not said.
    """

    name: str
    command: Index
    first: Index
    last: Index
    start: Index | None = None
    run: tuple[str, ...] | None = None

    def has(self, row: int) -> bool:
        """Whether a row of the measured file, from 0, belongs to a reading."""
        return bool(((self.first <= row) & (row <= self.last)).any())

    def text(self) -> str:
        """The table as CSV, rows from 1."""
        columns: dict[str, list[str]] = {
            name: [str(k + 1) for k in rows.tolist()]
            for name, rows in zip(PAIR_COLUMNS, (self.command, self.first, self.last), strict=True)
        }
        if self.start is not None:
            columns[START] = [str(k + 1) for k in self.start.tolist()]
        if self.run is not None:
            columns[RUN] = [*self.run]
        return "\n".join([",".join(columns), *map(",".join, zip(*columns.values(), strict=True))]) + "\n"

    def check_readings(self, size: int, of: str) -> None:
        """InputError where a row is none of a measured file `of` so many rows."""
        bad = (self.first < 0) | (self.last >= size)
        if bad.any():
            row = int(bad.argmax())
            found = f"row {self.first[row] + 1} to {self.last[row] + 1} of {of}, which has {size}"
            raise InputError(f"{self.name}, row {row + 1}", found, CURE)

    def check_commands(self, size: int, of: str) -> None:
        """InputError where a row is none of the commands, a file `of` so many rows."""
        for rows in (self.command, self.start):
            if rows is None:
                continue
            bad: Mask = (rows < 0) | (rows >= size)
            if bad.any():
                row = int(bad.argmax())
                found = f"row {rows[row] + 1} of {of}, which has {size}"
                raise InputError(f"{self.name}, row {row + 1}", found, CURE)


def read_pairs(path: Path, name: str) -> PairTable:
    """Read the rows that belong together: command, first and last row of the measured file, all from 1.

    Raises
    ------
    InputError
        It cannot be read, a column is missing, or a cell is no row number.
    """
    try:
        table = read_csv(noted(path))
    except (OSError, ValueError) as error:
        raise InputError(name, f"it cannot be read ({error})", "Import the files again") from error
    missing = [c for c in PAIR_COLUMNS if c not in table]
    if missing or table.empty:
        found = f"no column '{missing[0]}'" if missing else "no rows"
        raise InputError(name, found, f"Write the columns {', '.join(PAIR_COLUMNS)}")
    numbers = [*PAIR_COLUMNS, *([START] if START in table else [])]
    values = table[numbers].apply(as_numbers).to_numpy(dtype=np.float64)
    bad = ~np.isfinite(values).all(axis=1) | (values != np.rint(values)).any(axis=1) | (values[:, 1] > values[:, 2])
    if bad.any():
        row = int(bad.argmax())
        found = ", ".join(str(v) for v in table[numbers].iloc[row])
        raise InputError(f"{name}, row {row + 1}", found, "Write whole row numbers from 1, the first before the last")
    rows: Index = values.astype(np.intp) - 1
    start = rows[:, 3] if START in table else None
    run = tuple(table[RUN].astype(str)) if RUN in table else None
    return PairTable(name, rows[:, 0], rows[:, 1], rows[:, 2], start, run)
