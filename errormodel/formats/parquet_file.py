"""Apache Parquet files as tables."""

from __future__ import annotations

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
    cursor: _Cursor | None = None

    def read(self, numbers: Collection[str], texts: Collection[str]) -> tuple[pd.DataFrame, tuple[str, ...]]:
        import pandas as pd

        frame, notes = super().read(numbers, texts)
        frame.index = pd.RangeIndex(self.start, self.start + len(frame))
        return frame, notes

    def _arrow(self, pa: Any, pq: Any, columns: list[str]) -> Any:
        assert self.cursor is not None
        return self.cursor.read(pa, pq, columns, self.start, self.stop)


class _Cursor:
    """Reading of consecutive ranges: each row group is decoded once, unless a range lies before the last one."""

    def __init__(self, path: Path) -> None:
        self._path, self._columns = path, list[str]()
        self._batches: Iterator[Any] = iter(())
        self._last: Any = None  # batch
        self._at, self._end = 0, 0  # number of rows before it, and of those up to the end of its group

    def __getstate__(self) -> dict[str, Any]:
        return {"_path": self._path}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["_path"])  # type: ignore[misc]

    def read(self, pa: Any, pq: Any, columns: list[str], start: int, stop: int) -> Any:
        """Rows from `start` to before `stop`, which are in the file."""
        parts: list[Any] = []
        while start < stop:
            if columns != self._columns or not self._at <= start < self._end:
                self._open(pq, columns, start)
            while self._last is None or self._at + len(self._last) <= start:
                self._at += 0 if self._last is None else len(self._last)
                self._last = next(self._batches)
            low, high = start - self._at, min(stop - self._at, len(self._last))
            parts.append(self._last.slice(low, high - low))
            start += high - low
        return pa.Table.from_batches(parts)

    def _open(self, pq: Any, columns: list[str], start: int) -> None:
        """Go to the row group that holds the row `start`."""
        file = pq.ParquetFile(self._path)
        first = 0
        for group in range(file.metadata.num_row_groups):
            count = file.metadata.row_group(group).num_rows
            if first <= start < first + count:
                break
            first += count
        self._batches = file.iter_batches(_BATCH_ROWS, [group], columns, use_threads=False)
        self._columns, self._at, self._last, self._end = columns, first, None, first + count


class ParquetRows(RowRanges):
    """A Parquet file whose rows are read a range at a time; of a range, the row groups that it touches are decoded."""

    def __init__(self, table: ParquetTable) -> None:
        self._table, self._cursor = table, _Cursor(table.path)
        pa, pq = _pyarrow(table.name)
        try:
            self._count = int(pq.read_metadata(table.path).num_rows)
        except (pa.ArrowException, OSError) as error:
            raise _broken(table.name, error) from error

    def __len__(self) -> int:
        return self._count

    def rows(self, start: int, stop: int) -> Table:
        table = self._table
        return ParquetRange(table.path, table.name, table.columns, start, min(stop, self._count), self._cursor)


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
