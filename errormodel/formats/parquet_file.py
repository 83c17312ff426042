"""Apache Parquet files as tables."""

from __future__ import annotations

import threading
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from errormodel.exceptions import InputError
from errormodel.extras import optional
from errormodel.formats.base import RowRanges, Table, as_numbers, words_note

if TYPE_CHECKING:
    import pandas as pd

SUFFIXES = (".parquet", ".pq")  # file suffixes of this format
_BATCH_ROWS = 1 << 16  # rows that are decoded at a time where a range is read: some MB


class ParquetTable(Table):
    """A Parquet file; numbers of any type, and numbers written as text."""

    def read(self, numbers: Collection[str], texts: Collection[str]) -> tuple[pd.DataFrame, tuple[str, ...]]:
        pa, pq = _pyarrow(self.name)
        try:
            arrow = self._arrow(pa, pq, [*numbers, *texts])
        except (pa.ArrowException, OSError) as error:
            raise _broken(self.name, error) from error
        return self._frame(pa, arrow, numbers, texts)

    def in_ranges(self) -> RowRanges:
        return ParquetRows(self)

    def _arrow(self, pa: Any, pq: Any, columns: list[str]) -> Any:
        return pq.read_table(self.path, columns=columns)

    def _frame(
        self, pa: Any, arrow: Any, numbers: Collection[str], texts: Collection[str]
    ) -> tuple[pd.DataFrame, tuple[str, ...]]:
        import pandas as pd

        frame = pd.DataFrame({n: _column(pa, arrow[n], number=n in numbers) for n in (*numbers, *texts)})
        written = [n for n in numbers if pa.types.is_string(arrow[n].type) or pa.types.is_large_string(arrow[n].type)]
        notes = (words_note(n, pd.Series(arrow[n].to_pandas(), dtype="str")) for n in written)
        return frame, tuple(note for note in notes if note)


@dataclass(frozen=True)
class ParquetRange(ParquetTable):
    """A range of the rows of a Parquet file."""

    start: int = 0
    stop: int = 0

    def read(self, numbers: Collection[str], texts: Collection[str]) -> tuple[pd.DataFrame, tuple[str, ...]]:
        import pandas as pd

        frame, notes = super().read(numbers, texts)
        frame.index = pd.RangeIndex(self.start, self.start + len(frame))
        return frame, notes

    def _arrow(self, pa: Any, pq: Any, columns: list[str]) -> Any:
        parts, start = list[Any](), self.start
        while start < self.stop:
            parts.append(_Group.holding(pq, self.path, columns, start).read(start, self.stop))
            start += len(parts[-1])
        return pa.Table.from_batches(parts)


class _Group:
    """The row group that a thread read last: of consecutive ranges each is decoded once.

    A thread keeps one, whichever file it is of: several would take several times the memory.
    """

    def __init__(self, pq: Any, key: tuple[Any, ...], path: Path, columns: list[str], start: int) -> None:
        self._key = key
        self._last: Any = None  # batch
        file = pq.ParquetFile(path)
        self._at = 0  # number of rows before the batch
        for group in range(file.metadata.num_row_groups):
            self._end = self._at + file.metadata.row_group(group).num_rows
            if self._at <= start < self._end:
                break
            self._at = self._end
        self._batches: Iterator[Any] = file.iter_batches(_BATCH_ROWS, [group], columns, use_threads=False)

    @classmethod
    def holding(cls, pq: Any, path: Path, columns: list[str], start: int) -> _Group:
        """The one that holds the row `start`, which has not been passed yet."""
        state = path.stat()
        key = path, state.st_mtime_ns, state.st_size, tuple(columns)
        kept: _Group | None = getattr(_thread, "group", None)
        if kept is None or kept._key != key or not kept._at <= start < kept._end:
            _thread.group = None  # its memory is free before the next one takes some
            kept = _thread.group = cls(pq, key, path, columns, start)
        return kept

    def read(self, start: int, stop: int) -> Any:
        """A batch of rows from `start` on, at most to before `stop`."""
        while self._last is None or self._at + len(self._last) <= start:
            self._at += 0 if self._last is None else len(self._last)
            self._last = next(self._batches)
        low = start - self._at
        return self._last.slice(low, min(stop - self._at, len(self._last)) - low)


_thread = threading.local()


class ParquetRows(RowRanges):
    """A Parquet file whose rows are read a range at a time; of a range, the row groups that it touches are decoded."""

    def __init__(self, table: ParquetTable) -> None:
        self._table = table
        pa, pq = _pyarrow(table.name)
        try:
            self._count = int(pq.read_metadata(table.path).num_rows)
        except (pa.ArrowException, OSError) as error:
            raise _broken(table.name, error) from error

    def __len__(self) -> int:
        return self._count

    def rows(self, start: int, stop: int) -> Table:
        table = self._table
        return ParquetRange(table.path, table.name, table.columns, start, min(stop, self._count))


def open_table(path: Path, name: str) -> Table:
    """Read the column names of a Parquet file."""
    pa, pq = _pyarrow(name)
    try:
        names = pq.read_schema(path).names
    except (pa.ArrowException, OSError) as error:
        raise _broken(name, error) from error
    return ParquetTable(path, name, tuple(n for n in names if not n.startswith("__index_level_")))


def _pyarrow(name: str) -> tuple[Any, Any]:
    what, instead = "a Parquet file", "give a CSV file"
    return optional("pyarrow", name, what, instead), optional("pyarrow.parquet", name, what, instead)


def _broken(name: str, error: Exception) -> InputError:
    reason = str(error).splitlines()[0]
    return InputError(name, f"not a readable Parquet file: {reason}", "Write it again as Parquet, or give a CSV file")


def _column(pa: Any, column: Any, number: bool) -> pd.Series[Any]:
    import pandas as pd

    kind = column.type
    if number and (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)):
        return pd.Series(column.cast(pa.float64(), safe=False).to_numpy())
    try:
        text = pd.Series(column.cast(pa.string()).to_pandas(), dtype="str").fillna("")
    except pa.ArrowException:  # lists, structures
        text = pd.Series([str(value) for value in column.to_pylist()], dtype="str")
    if number:
        values, bad = as_numbers(text)
        return text if bad.any() else pd.Series(values)
    return text
