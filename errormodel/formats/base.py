"""What every table format offers: column names, the wanted columns, and where a cell stands in the file."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

EMPTY_CELLS = ("", "NaN", "nan", "NAN", "NA", "N/A", "null")  # a cell without a value, as the quick reader knows it
DASH_CELLS = ("-", "--", "---", "----", "\u2013", "\u2014")
NO_VALUE_WORDS = frozenset(
    word.lower() for word in (*EMPTY_CELLS, *DASH_CELLS, "n.a.", "none", "nil", "#N/A", "#NA", "#NV")
)
LISTED_ROWS = 12  # rows in a note


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
        """Columns by name, and notes on how they were read.

        Returns
        -------
        frame : DataFrame
            `numbers` as float64 with NaN for empty cells, but as text where a column holds a cell that is no number;
            `texts` as text. The index counts the data rows from 0.
        notes : tuple of str
        """

    def line(self, row: int) -> int | None:
        """Line of the file, from 1, on which the data row `row`, from 0, begins; None if the format has no lines."""
        return None

    def cell(self, row: int, column: str) -> str:
        """A cell as messages call it; `row` counts from 0, the message from 1."""
        line = self.line(row)
        return f"{self.name}, row {row + 1}{f' (line {line})' if line else ''}, column {column}"


def as_numbers(text: pd.Series[str], decimal_comma: bool = False) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Numbers in a column of text, NaN for empty cells, and which cells are neither."""
    text = text.fillna("").str.strip()
    empty = text.str.lower().isin(NO_VALUE_WORDS).to_numpy(dtype=bool)
    if decimal_comma:
        text = text.str.replace(r"^([^.,]*),([^.,]*)$", r"\1.\2", regex=True)
    values = pd.to_numeric(text.mask(empty), errors="coerce").to_numpy(dtype=np.float64, na_value=np.nan)
    return values, np.isnan(values) & ~empty


def words_note(name: str, text: pd.Series[str]) -> str | None:
    """A note on the cells of a column of numbers, as text, in which a word stands for no value; its index is from 0."""
    text = text.fillna("").str.strip()
    said = text[(text != "") & text.str.lower().isin(NO_VALUE_WORDS)]
    if said.empty:
        return None
    words = " and ".join(f"'{word}'" for word in said.unique())
    rows = [int(k) + 1 for k in said.index]
    return f"{words} in column {name} of {spoken(rows)} read as no value"


def spoken(rows: Sequence[float]) -> str:
    """Rows for a note: how many, and the numbers of the first."""
    numbers = ", ".join(str(int(r)) for r in rows[:LISTED_ROWS]) + (" ..." if len(rows) > LISTED_ROWS else "")
    return f"{len(rows)} rows ({numbers})" if len(rows) > 1 else f"row {numbers}"
