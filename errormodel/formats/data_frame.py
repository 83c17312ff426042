"""A pandas DataFrame as the table of a survey."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from errormodel.formats.base import RowRanges, Table, as_numbers

FRAME_TABLE_NAME = "DataFrame"  # name of the table in messages


@dataclass(frozen=True)
class FrameTable(Table):
    """A DataFrame whose columns are named as those of a survey's file."""

    frame: pd.DataFrame = field(default_factory=pd.DataFrame)

    def read(self, numbers: Collection[str], texts: Collection[str]) -> tuple[pd.DataFrame, tuple[str, ...]]:
        columns: dict[str, object] = {name: self._text(name) for name in texts}
        for name in numbers:
            column = self.frame[name]
            if pd.api.types.is_numeric_dtype(column) and not pd.api.types.is_bool_dtype(column):
                columns[name] = column.to_numpy(dtype=np.float64, na_value=np.nan)
                continue
            text = self._text(name)
            values, bad = as_numbers(text)
            columns[name] = text if bad.any() else values
        order = [*numbers, *texts]
        return pd.DataFrame({name: columns[name] for name in order}), ()

    def in_ranges(self) -> RowRanges:
        return FrameRows(self)

    def _text(self, name: str) -> pd.Series[str]:
        column = self.frame[name].reset_index(drop=True)
        return column.astype("str").mask(column.isna(), "")


@dataclass(frozen=True)
class FrameRange(FrameTable):
    """A range of the rows of a DataFrame, from the row `start` (from 0) on."""

    start: int = 0

    def read(self, numbers: Collection[str], texts: Collection[str]) -> tuple[pd.DataFrame, tuple[str, ...]]:
        frame, notes = super().read(numbers, texts)
        frame.index = pd.RangeIndex(self.start, self.start + len(frame))
        return frame, notes


class FrameRows(RowRanges):
    """A DataFrame whose rows are read a range at a time."""

    def __init__(self, table: FrameTable) -> None:
        self._table = table
        self._frame = table.frame

    def __len__(self) -> int:
        return len(self._frame)

    def rows(self, start: int, stop: int) -> Table:
        table = self._table
        return FrameRange(table.path, table.name, table.columns, self._frame.iloc[start:stop], start)


def table_of(frame: pd.DataFrame) -> FrameTable:
    """Wrap a DataFrame as a table; its index is ignored."""
    return FrameTable(
        Path(FRAME_TABLE_NAME),
        FRAME_TABLE_NAME,
        tuple(str(c).strip() for c in frame.columns),
        frame.rename(columns=str.strip),
    )
