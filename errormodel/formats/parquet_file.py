"""Apache Parquet files as tables."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from errormodel.exceptions import InputError
from errormodel.extras import optional
from errormodel.formats.base import Table, as_numbers, words_note

if TYPE_CHECKING:
    import pandas as pd

SUFFIXES = (".parquet", ".pq")  # file suffixes of this format


class ParquetTable(Table):
    """A Parquet file; numbers of any type, and numbers written as text."""

    def read(self, numbers: Collection[str], texts: Collection[str]) -> tuple[pd.DataFrame, tuple[str, ...]]:
        import pandas as pd

        pa, pq = _pyarrow(self.name)
        try:
            arrow = pq.read_table(self.path, columns=[*numbers, *texts])
        except (pa.ArrowException, OSError) as error:
            raise _broken(self.name, error) from error
        frame = pd.DataFrame({n: _column(pa, arrow[n], number=n in numbers) for n in (*numbers, *texts)})
        written = [n for n in numbers if pa.types.is_string(arrow[n].type) or pa.types.is_large_string(arrow[n].type)]
        notes = (words_note(n, pd.Series(arrow[n].to_pandas(), dtype="str")) for n in written)
        return frame, tuple(note for note in notes if note)


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
