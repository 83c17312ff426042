"""Where the lines of a delimited text file begin, and a fast parser of plain numbers: for reading a range of its rows.

Only plain text is read in ranges, a line a row: no quotation marks, which may hide the end of a line, no empty lines
between rows and no decimal commas. Anything else is refused, since a part of it could be read differently by itself.
"""

from __future__ import annotations

import io
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from errormodel.arrays import Index
from errormodel.exceptions import InputError, NoRowsError

if TYPE_CHECKING:
    import pandas as pd

_SCANNED_BYTES = 1 << 23  # bytes that are looked through at a time
_MARK_ROWS = 1 << 14  # rows from one noted line to the next: a range begins at most so many before its first row
PLAIN_CURE = "Write it as plain CSV with decimal points (or as Parquet), or leave out --stream"


@dataclass(frozen=True)
class Lines:
    """Where rows begin.

    Attributes
    ----------
    marks : byte at which every `_MARK_ROWS`-th row begins, and at last the one behind the rows.
    count : number of rows.
    """

    marks: tuple[int, ...]
    count: int

    @classmethod
    def of(cls, path: Path, name: str, skip: int) -> Lines:
        """Look through a file whose rows follow `skip` lines.

        Raises
        ------
        InputError
            It is not plain text, a line a row; or it has no rows.
        """
        marks, count = list[int](), 0
        with path.open("rb") as file:
            for _ in range(skip):
                file.readline()
            at, before, over = file.tell(), b"\n", False
            while not over and (piece := file.read(_SCANNED_BYTES)):
                if b'"' in piece:
                    raise InputError(name, "quotation marks, which may hide the end of a line", PLAIN_CURE)
                both = before + piece
                if b"\n\n" in both or b"\n\r\n" in both:
                    piece, over = _without_empty_lines(name, file, before, piece), True
                ends = _ends(piece)
                firsts = np.concatenate([[0] if before.endswith(b"\n") and piece else [], ends + 1]).astype(int)
                firsts = firsts[firsts < len(piece)]  # of rows that begin in this piece
                marks += (at + firsts[-count % _MARK_ROWS :: _MARK_ROWS]).tolist()
                count += len(firsts)
                at, before = at + len(piece), piece[-2:] or before
        if not count:
            raise NoRowsError(name)
        return cls((*marks, at), count)

    def bytes_of(self, path: Path, start: int, stop: int) -> tuple[int, int]:
        """First byte of the row `start`, and the one behind the row before `stop`."""
        k = start // _MARK_ROWS
        first, last = self.marks[k], self.marks[min(-(-stop // _MARK_ROWS), len(self.marks) - 1)]
        with path.open("rb") as file:
            file.seek(first)
            ends = _ends(file.read(last - first))
        above = k * _MARK_ROWS  # the row that begins at `first`
        low = int(ends[start - above - 1]) + 1 if start > above else 0
        high = int(ends[stop - above - 1]) + 1 if stop - above <= len(ends) else last - first
        return first + low, first + high


def _ends(piece: bytes) -> Index:
    return np.flatnonzero(np.frombuffer(piece, dtype=np.uint8) == ord("\n"))


def _without_empty_lines(name: str, file: BinaryIO, before: bytes, piece: bytes) -> bytes:
    """The piece up to its first empty line; InputError if anything but empty lines follows."""
    both = before + piece
    first = max(min(k for k in (both.find(b"\n\n"), both.find(b"\n\r\n")) if k >= 0) + 1 - len(before), 0)
    rest = piece[first:]
    while rest:
        if rest.strip():
            raise InputError(name, "an empty line between rows", PLAIN_CURE)
        rest = file.read(_SCANNED_BYTES)
    return piece[:first]


def read_plain(
    text: bytes, columns: Sequence[str], delimiter: str, numbers: Collection[str], texts: Collection[str]
) -> pd.DataFrame | None:
    """Columns of plain rows by PyArrow's parser; None where it is not installed, or a cell is no plain number."""
    try:
        import pyarrow as pa
        from pyarrow import csv as arrow_csv
    except ImportError:
        return None
    import pandas as pd

    kinds = dict.fromkeys(numbers, pa.float64()) | dict.fromkeys(texts, pa.string())
    places = {name: f"c{k}" for k, name in enumerate(columns)}  # names in a header may be empty, and so twice
    try:
        table = arrow_csv.read_csv(
            io.BytesIO(text),
            arrow_csv.ReadOptions(use_threads=False, column_names=list(map("c{}".format, range(len(columns))))),
            arrow_csv.ParseOptions(delimiter=delimiter, quote_char=False),
            arrow_csv.ConvertOptions(
                column_types={places[n]: kind for n, kind in kinds.items()},
                include_columns=[places[n] for n in kinds],
                null_values=[""],
            ),
        )
    except pa.ArrowException:
        return None
    out: dict[str, Any] = {}
    for name in numbers:
        column = table[places[name]]
        values = column.to_numpy()
        if np.isfinite(values).sum() + column.null_count < len(values):  # a word that PyArrow takes for a number
            return None
        out[name] = values
    for name in texts:
        out[name] = pd.Series(table[places[name]].to_pandas(), dtype="str").str.strip()
    return pd.DataFrame(out)
