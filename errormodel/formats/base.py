"""Interface of the table formats: column names, reading of the wanted columns, and the place of a cell in the file."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from errormodel.exceptions import InputError

EMPTY_CELLS = ("", "NaN", "nan", "NAN", "NA", "N/A", "null")  # cells without a value, as most programmes write them
DASH_CELLS = ("-", "--", "---", "----", "\u2013", "\u2014")  # hyphens and dashes that stand for no value
# all words for no value, in lower case
NO_VALUE_WORDS = frozenset(
    word.lower() for word in (*EMPTY_CELLS, *DASH_CELLS, "n.a.", "none", "nil", "#N/A", "#NA", "#NV")
)
_NO_DECIMAL = re.compile(r"[^-+.0-9eE \t]")  # what does not occur in a decimal number
LISTED_ROWS = 12  # most row numbers in a note; by judgement


class RowRanges(ABC):
    """A table whose rows are counted, and read a range at a time: it may be larger than memory."""

    @abstractmethod
    def __len__(self) -> int:
        """Number of data rows."""

    @abstractmethod
    def rows(self, start: int, stop: int) -> Table:
        """The data rows from `start` (from 0) to before `stop`; the index of what it reads begins with `start`."""


@dataclass(frozen=True)
class Table(ABC):
    """One file, opened as far as its column names.

    Attributes
    ----------
    path : Path
    name : str
        The path as the user wrote it, for messages.
    columns : tuple of str
        Names above the columns, without surrounding blanks; empty where nothing stands there.
    """

    path: Path
    name: str
    columns: tuple[str, ...]

    @abstractmethod
    def read(self, numbers: Collection[str], texts: Collection[str]) -> tuple[pd.DataFrame, tuple[str, ...]]:
        """Read columns by name.

        Parameters
        ----------
        numbers : names of columns of numbers.
        texts : names of columns of text.

        Returns
        -------
        frame : DataFrame
            `numbers` as float64 with NaN for empty cells, but as text where a column holds a cell that is no number;
            `texts` as text. The index counts the data rows from 0.
        notes : tuple of str
            Remarks on how they were read.
        """

    def in_ranges(self) -> RowRanges:
        """The table as one whose rows are read a range at a time.

        Raises
        ------
        InputError
            The format has to be read as a whole.
        """
        found = f"a file of type '{self.path.suffix}', which is read as a whole"
        raise InputError(self.name, found, "Write it as Parquet or CSV, or leave out --stream")

    def line(self, row: int) -> int | None:
        """Line (from 1) on which the data row `row` (from 0) begins; None in formats without lines."""
        return None

    def cell(self, row: int, column: str) -> str:
        """Name of a cell in messages; `row` counts from 0, the message from 1."""
        line = self.line(row)
        return f"{self.name}, row {row + 1}{f' (line {line})' if line else ''}, column {column}"


def as_numbers(text: pd.Series[str], decimal_comma: bool = False) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Numbers in a column of text, NaN for empty cells, and a mask of cells that are neither."""
    text = text.fillna("").str.strip()
    empty = text.str.lower().isin(NO_VALUE_WORDS).to_numpy(dtype=bool)
    if decimal_comma:
        text = text.str.replace(r"^([^.,]*),([^.,]*)$", r"\1.\2", regex=True)
    cells = text.tolist()
    try:
        values = decimal_numbers(cells)
    except ValueError:  # a word, an infinite number, or text
        numbers = [np.nan if no else _number(cell) for cell, no in zip(cells, empty, strict=True)]
        values = np.array(numbers, dtype=np.float64)
    return values, np.isnan(values) & ~empty


def decimal_numbers(cells: Sequence[str]) -> NDArray[np.float64]:
    """The floats nearest to decimal numbers, NaN for empty cells.

    Raises
    ------
    ValueError
        A cell is no decimal number.
    """
    if _NO_DECIMAL.search("".join(cells)):
        raise ValueError
    if "" in cells:
        cells = [cell or "nan" for cell in cells]
    return np.fromiter(map(float, cells), np.float64, len(cells))


def _number(cell: str) -> float:
    """A cell as a number, infinite ones among them; NaN if it is none."""
    try:
        return float(cell) if cell.isascii() and "_" not in cell else np.nan
    except ValueError:
        return np.nan


def words_note(name: str, text: pd.Series[str]) -> str | None:
    """Note on cells of a column of numbers in which a word stands for no value; the index of `text` counts from 0."""
    text = text.fillna("").str.strip()
    said = text[(text != "") & text.str.lower().isin(NO_VALUE_WORDS)]
    if said.empty:
        return None
    words = " and ".join(f"'{word}'" for word in said.unique())
    rows = [int(k) + 1 for k in said.index]
    return f"{words} in column {name} of {spoken(rows)} read as no value"


def spoken(rows: Sequence[float]) -> str:
    """Rows in words for a note: their number, and the first of them."""
    numbers = ", ".join(str(int(r)) for r in rows[:LISTED_ROWS]) + (" ..." if len(rows) > LISTED_ROWS else "")
    return f"{len(rows)} rows ({numbers})" if len(rows) > 1 else f"row {numbers}"
