"""Delimited text files (CSV) of spreadsheets and instruments: any usual delimiter, decimal points or commas."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from errormodel.exceptions import InputError, NoRowsError
from errormodel.formats.base import NO_VALUE_WORDS, RowRanges, Table, as_numbers, decimal_numbers, words_note
from errormodel.formats.csv_ranges import PLAIN_CURE, Lines, read_plain
from errormodel.formats.digit_groups import ungrouped

if TYPE_CHECKING:
    import pandas as pd

SUFFIXES = (".csv", ".txt", ".tsv", ".dat")  # file suffixes of this format

# delimiters, with their names in messages
_DELIMITER_WORDS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}
AS_IT_IS = ", or take it in as it is with `errormodel import`"  # of a file as an instrument or a program wrote it
_HEADER_BYTES = 1 << 18  # bytes within which the header must end
_PART_CELLS = 100_000  # cells that are read at a time: some MB
_COMMA_TO_POINT = str.maketrans({",": ".", ".": "?"})  # a point in a number with decimal commas makes it none
_NUMBER = re.compile(r"[-+]?[\d.,]+(e[-+]?\d+)?", re.IGNORECASE)  # with a decimal point or comma
_NOT_UTF8 = re.compile("[\udc80-\udcff]")  # what stands for a byte that is not UTF-8


@dataclass(frozen=True)
class CsvTable(Table):
    """A delimited text file in UTF-8."""

    delimiter: str
    skip: int  # number of lines up to and including the header

    def read(self, numbers: Collection[str], texts: Collection[str]) -> tuple[pd.DataFrame, tuple[str, ...]]:
        import pandas as pd

        comma = self.delimiter != ","  # a decimal comma is distinguishable from the delimiter
        notes = [] if not comma else [f"columns separated by {_DELIMITER_WORDS[self.delimiter]}"]
        frame: dict[str, pd.Series[Any]] = {}
        words: list[str | None] = []
        for decimal in (".", ",") if comma else (".",):
            found = self._plain(numbers, texts, decimal)
            if found is not None:
                frame, words = found
                break
        else:  # some cell is no number: take all as text and convert columns of numbers
            decimal = "."
            frame = self._texts([*numbers, *texts])
            cells = ungrouped({n: frame[n] for n in numbers})
            if cells.ambiguous is not None:
                raise self._ambiguous(*cells.ambiguous, str(cells.columns[cells.ambiguous[0]][cells.ambiguous[1]]))
            if cells.separators:
                notes.append("digits in groups of three")
            for name, text in cells.columns.items():
                values, bad = as_numbers(text, comma)
                # a cell that is no number is named as it stands, the others in the form that every reader takes
                frame[name] = text.where(bad, pd.Series(values).astype("str")) if bad.any() else pd.Series(values)
                words.append(words_note(name, text))
                if comma and text.str.contains(",", regex=False).any():
                    decimal = ","
        if decimal == ",":
            notes.append("decimal commas")
        return pd.DataFrame(frame), (*notes, *(word for word in words if word))

    def in_ranges(self) -> RowRanges:
        return CsvRows(self)

    def _plain(
        self, numbers: Collection[str], texts: Collection[str], decimal: str
    ) -> tuple[dict[str, pd.Series[Any]], list[str | None]] | None:
        """Columns, and notes on words for no value; None if a cell of `numbers` is neither a number nor such a word.

        A part of the file at a time, since cells as Python objects take much memory.
        """
        import pandas as pd

        values: dict[str, list[NDArray[np.float64]]] = {n: [] for n in numbers}
        strings: dict[str, list[str]] = {n: [] for n in texts}
        said: dict[str, dict[int, str]] = {n: {} for n in numbers}  # words for no value, by row
        place = {name: k for k, name in enumerate(self.columns)}
        above = 0
        for rows in self._parts():
            columns = list(zip(*rows, strict=True))
            for name in numbers:
                written = columns[place[name]]
                cells = list(written)
                if decimal == ",":
                    cells = [c.translate(_COMMA_TO_POINT) for c in cells]
                try:
                    own = decimal_numbers(cells)
                except ValueError:
                    empty = [k for k, cell in enumerate(written) if cell.strip().lower() in NO_VALUE_WORDS]
                    said[name] |= {above + k: written[k] for k in empty}
                    for k in empty:
                        cells[k] = ""
                    try:
                        own = decimal_numbers(cells)
                    except ValueError:
                        return None
                values[name].append(own)
            for name in texts:
                strings[name] += [cell.strip() for cell in columns[place[name]]]
            above += len(rows)
        notes = [words_note(n, pd.Series(list(w.values()), list(w), dtype="str")) for n, w in said.items() if w]
        frame: dict[str, pd.Series[Any]] = {n: pd.Series(np.concatenate(v)) for n, v in values.items()}
        return frame | {n: pd.Series(self._decoded(v), dtype="str") for n, v in strings.items()}, notes

    def _texts(self, names: Sequence[str]) -> dict[str, pd.Series[Any]]:
        """Columns as text, without surrounding blanks."""
        import pandas as pd

        cells: dict[str, list[str]] = {n: [] for n in names}
        for rows in self._parts():
            for name, own in cells.items():
                place = self.columns.index(name)
                own += [row[place].strip() for row in rows]
        return {n: pd.Series(self._decoded(own), dtype="str") for n, own in cells.items()}

    def line(self, row: int) -> int | None:
        for number, (line, _) in enumerate(self._records()):
            if number == row:
                return line
        return None

    def _parts(self) -> Iterator[list[list[str]]]:
        """Rows, some thousand at a time, each with as many fields as the header.

        Raises
        ------
        InputError
            A row has another number of fields, or there is none.
        """
        width, empty = len(self.columns), True
        count = max(1, _PART_CELLS // width)
        with self._rows() as reader:
            while part := list(islice(reader, count)):
                if any(len(fields) != width for fields in part):
                    part = [fields for fields in part if not self._blank(fields)]
                    if any(len(fields) != width for fields in part):
                        raise self._ragged()
                if part:
                    empty = False
                    yield part
        if empty:
            raise NoRowsError(self.name)

    @contextmanager
    def _rows(self) -> Iterator[Any]:
        """Reader of the rows below the header; bytes that are not UTF-8 become halves of characters."""
        with self.path.open(encoding="utf-8-sig", errors="surrogateescape", newline="") as file:
            reader = csv.reader(file, delimiter=self.delimiter)
            try:
                while reader.line_num < self.skip and next(reader, None) is not None:
                    pass
                yield reader
            except csv.Error as error:
                where, cure = f"{self.name}, line {reader.line_num}", "Write it again as plain CSV"
                raise InputError(where, f"not readable as CSV: {error}", cure) from error

    def _blank(self, fields: list[str]) -> bool:
        return len(fields) != len(self.columns) and not "".join(fields).strip()

    def _records(self) -> Iterator[tuple[int, list[str]]]:
        """Line and fields of every data row."""
        with self._rows() as reader:
            last = self.skip
            for fields in reader:
                line, last = last + 1, reader.line_num
                if not self._blank(fields):
                    yield line, fields

    def _decoded(self, cells: list[str]) -> list[str]:
        """The cells; InputError where the file is not UTF-8."""
        if any(map(_NOT_UTF8.search, cells)):
            self._check_utf8()
        return cells

    def _check_utf8(self) -> None:
        with self.path.open("rb") as file:
            for number, raw in enumerate(file, start=1):
                try:
                    raw.decode("utf-8")
                except UnicodeDecodeError as bad:
                    byte = f"the byte 0x{raw[bad.start]:02x}, which is not UTF-8"
                    raise InputError(f"{self.name}, line {number}", byte, f"Save the file as UTF-8{AS_IT_IS}") from bad

    def _ambiguous(self, column: str, row: int, cell: str) -> InputError:
        plain = cell.replace(".", "").replace(",", "")
        found = f"'{cell}' in a file with another decimal sign: {plain} in groups of digits, or a number with decimals"
        return InputError(
            self.cell(row, column), found, f"Write {plain} without a separator, or one decimal sign in the whole file"
        )

    def _ragged(self) -> InputError:
        """Error for the first row with another number of fields than the header."""
        rows = enumerate(self._records(), start=1)
        row, line, count = next((k, at, len(f)) for k, (at, f) in rows if len(f) != len(self.columns))
        found = f"{count} fields where the header has {len(self.columns)}"
        cure = "Give every row one field a column, empty where there is no value"
        if self.delimiter == "," and count > len(self.columns):
            cure += "; if commas are decimal signs, separate the columns with semicolons"
        return InputError(f"{self.name}, row {row} (line {line})", found, cure)


@dataclass(frozen=True)
class CsvRange(CsvTable):
    """A range of the rows of a delimited file: `length` bytes from `offset`."""

    whole: CsvTable
    start: int
    offset: int
    length: int

    def read(self, numbers: Collection[str], texts: Collection[str]) -> tuple[pd.DataFrame, tuple[str, ...]]:
        import pandas as pd

        notes: tuple[str, ...] = ()
        frame = read_plain(self._bytes(), self.columns, self.delimiter, numbers, texts)
        if frame is None:
            frame, notes = super().read(numbers, texts)
            odd = next((n for n in notes if n in ("decimal commas", "digits in groups of three")), None)
            if odd is not None:
                raise InputError(self.name, odd, PLAIN_CURE)
        frame.index = pd.RangeIndex(self.start, self.start + len(frame))
        return frame, notes

    def line(self, row: int) -> int | None:
        return self.whole.line(row)

    def _bytes(self) -> bytes:
        with self.path.open("rb") as file:
            file.seek(self.offset)
            return file.read(self.length)

    @contextmanager
    def _rows(self) -> Iterator[Any]:
        text = self._bytes().decode("utf-8", errors="surrogateescape")
        yield csv.reader(io.StringIO(text, newline=""), delimiter=self.delimiter)

    def _ragged(self) -> InputError:
        return self.whole._ragged()


class CsvRows(RowRanges):
    """A delimited file of plain lines whose rows are read a range at a time."""

    def __init__(self, table: CsvTable) -> None:
        self._table = table
        self._lines = Lines.of(table.path, table.name, table.skip)

    def __len__(self) -> int:
        return self._lines.count

    def rows(self, start: int, stop: int) -> Table:
        t, stop = self._table, min(stop, len(self))
        offset, end = self._lines.bytes_of(t.path, start, stop)
        return CsvRange(t.path, t.name, t.columns, t.delimiter, 0, t, start, offset, end - offset)


def open_table(path: Path, name: str) -> Table:
    """Find the delimiter and read the header of a delimited file."""
    with path.open("rb") as file:
        head = file.read(_HEADER_BYTES)
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise InputError(name, "text in UTF-16", f"Save the file as UTF-8 (in a spreadsheet: 'CSV UTF-8'){AS_IT_IS}")
    if b"\0" in head:
        raise InputError(name, "not a text file", "Give CSV in UTF-8, or Parquet with the suffix .parquet")
    text = head.decode("utf-8-sig", errors="replace")
    above = _comments(text.splitlines())
    text = "".join(text.splitlines(keepends=True)[above:])
    first = next((line for line in text.splitlines() if line.strip()), "")
    if not first:
        raise InputError(name, "an empty file", "Give a header with the columns' names and a row a pose")
    outside = re.sub(r'"[^"]*"', "", first)
    delimiter = max(_DELIMITER_WORDS, key=outside.count)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)
    try:
        names = next((fields for fields in reader if "".join(fields).strip()), [])
    except csv.Error as error:
        raise InputError(f"{name}, line 1", f"not readable as CSV: {error}", "Write it again as plain CSV") from error
    where = f"{name}, header (line {above + reader.line_num})"
    columns = tuple(" ".join(n.split()) for n in names)
    if not columns:
        raise InputError(name, "no columns' names", "Give a header with the columns' names and a row a pose")
    if any("\ufffd" in n for n in columns):
        raise InputError(where, "bytes that are not UTF-8", f"Save the file as UTF-8{AS_IT_IS}")
    if all(_NUMBER.fullmatch(n) for n in columns if n):
        raise InputError(
            where, "numbers where the columns' names belong", f"Put a line with the names above the data{AS_IT_IS}"
        )
    if len(columns) == 1 and " " in columns[0]:
        raise InputError(where, f"one column, '{columns[0]}'", f"Separate the columns with commas{AS_IT_IS}")
    return CsvTable(path, name, columns, delimiter, above + reader.line_num)


def _comments(lines: Sequence[str]) -> int:
    """Number of lines above the header, where the first ones begin with ``#``; a header may begin so as well.

    Below a comment another one follows, or names: cells none of which is a number.
    """
    full = [k for k, line in enumerate(lines) if line.strip()]
    header = 0
    for k, below in pairwise(full):
        delimiter = max(_DELIMITER_WORDS, key=lines[below].count)
        cells = [cell.strip() for cell in lines[below].split(delimiter)]
        if not lines[k].lstrip().startswith("#") or any(map(_NUMBER.fullmatch, cells)):
            break
        header = below
    return header
