"""Delimited text files (CSV) of spreadsheets and instruments: any usual delimiter, decimal points or commas."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from errormodel.exceptions import InputError
from errormodel.formats.base import EMPTY_CELLS, NO_VALUE_WORDS, Table, as_numbers, words_note
from errormodel.formats.digit_groups import ungrouped

if TYPE_CHECKING:
    import pandas as pd

SUFFIXES = (".csv", ".txt", ".tsv", ".dat")  # file suffixes of this format

# delimiters, with their names in messages
_DELIMITER_WORDS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}
AS_IT_IS = ", or take it in as it is with `errormodel import`"  # of a file as an instrument or a program wrote it
_HEADER_BYTES = 1 << 18  # bytes within which the header must end


@dataclass(frozen=True)
class CsvTable(Table):
    """A delimited text file in UTF-8."""

    delimiter: str
    skip: int  # number of lines up to and including the header

    def read(self, numbers: Collection[str], texts: Collection[str]) -> tuple[pd.DataFrame, tuple[str, ...]]:
        import pandas as pd
        import pyarrow as pa

        comma = self.delimiter != ","  # a decimal comma is distinguishable from the delimiter
        place = {name: str(i) for i, name in enumerate(self.columns)}
        notes = [] if not comma else [f"columns separated by {_DELIMITER_WORDS[self.delimiter]}"]
        frame: dict[str, pd.Series[Any]] = {}
        words: list[str | None] = []
        for decimal in (".", ",") if comma else (".",):
            try:
                arrow = self._arrow({place[n] for n in numbers}, {place[n] for n in texts}, decimal)
            except pa.ArrowInvalid:
                continue
            frame = {n: pd.Series(arrow[place[n]].to_numpy()) for n in numbers}
            words = self._words({n: place[n] for n in numbers if frame[n].hasnans})
            break
        else:  # some cell is no number, or some line is blank: read all as text and convert columns of numbers
            decimal = "."
            self._check_utf8()
            try:
                arrow = self._arrow(set(), {place[n] for n in (*numbers, *texts)}, decimal, self._if_not_blank)
            except pa.ArrowInvalid as error:
                raise self._ragged(error) from error
            cells = ungrouped({n: pd.Series(arrow[place[n]].to_pandas(), dtype="str") for n in numbers})
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
        frame |= {n: pd.Series(arrow[place[n]].to_pandas(), dtype="str").str.strip() for n in texts}
        return pd.DataFrame(frame), (*notes, *(word for word in words if word))

    def _words(self, place: dict[str, str]) -> list[str | None]:
        """Notes on words for no value in columns of numbers with gaps; `place` gives their positions by name."""
        import pandas as pd
        import pyarrow as pa
        import pyarrow.compute as pc

        if not place:
            return []
        arrow = self._arrow(set(), set(place.values()), ".")
        out = []
        for name, number in place.items():
            column = arrow[number].combine_chunks()
            lower = pc.utf8_lower(pc.utf8_trim_whitespace(column))
            rows = pc.indices_nonzero(pc.is_in(lower, pa.array(sorted(NO_VALUE_WORDS - {""}))))
            out.append(words_note(name, pd.Series(column.take(rows).to_pylist(), rows.to_numpy(), dtype="str")))
        return out

    def line(self, row: int) -> int | None:
        for number, (line, _) in enumerate(self._records()):
            if number == row:
                return line
        return None

    def _arrow(self, numbers: Collection[str], texts: Collection[str], decimal: str, ragged: Any = None) -> Any:
        """Read the wanted columns by position (``"0"``, ``"1"``, ...); ArrowInvalid if a cell does not fit its type."""
        import pyarrow as pa
        from pyarrow import csv as arrow

        with self.path.open("rb") as file:
            quoted = b'"' in file.read(_HEADER_BYTES)
        return arrow.read_csv(
            self.path,
            arrow.ReadOptions(column_names=[str(i) for i in range(len(self.columns))], skip_rows=self.skip),
            arrow.ParseOptions(
                delimiter=self.delimiter,
                newlines_in_values=quoted,
                invalid_row_handler=ragged,
            ),
            arrow.ConvertOptions(
                column_types=dict.fromkeys(numbers, pa.float64()) | dict.fromkeys(texts, pa.string()),
                include_columns=[*numbers, *texts],
                null_values=EMPTY_CELLS,
                strings_can_be_null=False,
                decimal_point=decimal,
            ),
        )

    def _if_not_blank(self, row: Any) -> str:
        return "error" if row.text.strip(f" \t\r\n{self.delimiter}") else "skip"

    def _records(self) -> Iterator[tuple[int, list[str]]]:
        """Line and fields of every data row, without blank lines, as in `_arrow`."""
        with self.path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
            reader = csv.reader(file, delimiter=self.delimiter)
            last = 0
            try:
                for fields in reader:
                    line, last = last + 1, reader.line_num
                    blank = len(fields) != len(self.columns) and not "".join(fields).strip()
                    if last > self.skip and not blank:
                        yield line, fields
            except csv.Error:
                return

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

    def _ragged(self, error: Exception) -> InputError:
        """Error for text that is no table: most likely the first row of another length."""
        row = 0
        for row, (line, fields) in enumerate(self._records(), start=1):
            if len(fields) != len(self.columns):
                found = f"{len(fields)} fields where the header has {len(self.columns)}"
                cure = "Give every row one field a column, empty where there is no value"
                if self.delimiter == "," and len(fields) > len(self.columns):
                    cure += "; if commas are decimal signs, separate the columns with semicolons"
                return InputError(f"{self.name}, row {row} (line {line})", found, cure)
        if row == 0:
            return InputError(self.name, "no rows below the header", "Give a row a pose")
        reason = str(error).splitlines()[0]
        return InputError(self.name, f"not readable as CSV: {reason}", "Write it again as plain CSV")


def open_table(path: Path, name: str) -> Table:
    """Find the delimiter and read the header of a delimited file."""
    with path.open("rb") as file:
        head = file.read(_HEADER_BYTES)
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise InputError(name, "text in UTF-16", f"Save the file as UTF-8 (in a spreadsheet: 'CSV UTF-8'){AS_IT_IS}")
    if b"\0" in head:
        raise InputError(name, "not a text file", "Give CSV in UTF-8, or Parquet with the suffix .parquet")
    text = head.decode("utf-8-sig", errors="replace")
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
    where = f"{name}, header (line {reader.line_num})"
    columns = tuple(" ".join(n.split()) for n in names)
    if not columns:
        raise InputError(name, "no columns' names", "Give a header with the columns' names and a row a pose")
    if any("\ufffd" in n for n in columns):
        raise InputError(where, "bytes that are not UTF-8", f"Save the file as UTF-8{AS_IT_IS}")
    if all(re.fullmatch(r"[-+]?[\d.]+(e[-+]?\d+)?", n, re.IGNORECASE) for n in columns if n):
        raise InputError(
            where, "numbers where the columns' names belong", f"Put a line with the names above the data{AS_IT_IS}"
        )
    if len(columns) == 1 and " " in columns[0]:
        raise InputError(where, f"one column, '{columns[0]}'", f"Separate the columns with commas{AS_IT_IS}")
    return CsvTable(path, name, columns, delimiter, reader.line_num)
