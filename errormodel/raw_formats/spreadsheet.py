"""Spreadsheets (``.xlsx``, ``.xls``, ``.ods``): the sheet asked for, or the first that is no cover sheet."""

from __future__ import annotations

import io
import zipfile
from dataclasses import replace

from errormodel.exceptions import InputError
from errormodel.extras import optional
from errormodel.raw_formats.base import Asked, RawFile, RawFormat, Recording

COVER = 0.5  # of the numbers of the fullest sheet: those with fewer are looked at last; by judgement
LARGEST_UNPACKED = 300_000_000  # bytes: some millions of cells; by judgement
_ZIP, _OLD = b"PK\x03\x04", b"\xd0\xcf\x11\xe0"  # of xlsx and ods, of xls
_SHEET = (b"xl/workbook", b"spreadsheet")  # a name of a part of the archive, a type in it


class Spreadsheet(RawFormat):
    """Cells as they are stored, dates as ISO 8601; then whatever format the table itself is of."""

    name = "spreadsheet"
    title = "a spreadsheet"
    source = "ECMA-376 and OpenDocument, read by python-calamine (extra errormodel[xlsx])"
    seen = True
    uses = ("sheet",)

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        return raw.data.startswith(_OLD) or (raw.data.startswith(_ZIP) and any(s in raw.data for s in _SHEET))

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        calamine = optional("python_calamine", raw.name, "a spreadsheet", "save the sheet as CSV")
        _check_size(raw)
        try:
            book = calamine.CalamineWorkbook.from_filelike(io.BytesIO(raw.data))
            sheets = [(name, book.get_sheet_by_name(name).to_python()) for name in book.sheet_names]
        except (calamine.CalamineError, ValueError, OSError) as error:
            raise InputError(raw.name, f"not a readable spreadsheet: {error}", "Save it again, or as CSV") from error
        from errormodel.raw_formats.base import format_of

        asked_for = [(name, rows) for name, rows in sheets if name == asked.sheet]
        fullest = max((_numbers(rows) for _, rows in sheets), default=0)
        for name, rows in asked_for or sorted(sheets, key=lambda s: _numbers(s[1]) < COVER * fullest):
            text = "\n".join("\t".join(_cell(c) for c in row) for row in rows)
            table = RawFile(raw.path, f"{raw.name}, sheet {name}", text.encode(), counts=raw.counts)
            if not text.strip() or table.layout is None:
                continue
            recording = format_of(table).read(table, asked)
            others = f"; not read: {', '.join(n for n, _ in sheets if n != name)} (--sheet)" if len(sheets) > 1 else ""
            notes = tuple(n for n in recording.notes if n != "columns separated by tabs")
            return replace(recording, notes=(f"sheet {name} of the spreadsheet{others}", *notes))
        what = f"no rows of numbers of equal width in its sheet {asked.sheet}" if asked_for else ""
        found = what or "no sheet with rows of numbers of equal width"
        raise InputError(raw.name, found, f"Give the table as CSV; its sheets are {', '.join(n for n, _ in sheets)}")


def _numbers(rows: list[list[object]]) -> int:
    """Numbers in a sheet."""
    return sum(isinstance(cell, float | int) for row in rows for cell in row)


def _check_size(raw: RawFile) -> None:
    """Raise InputError where the archive says that it holds far more than a table."""
    if not raw.data.startswith(_ZIP):
        return
    try:
        size = sum(entry.file_size for entry in zipfile.ZipFile(io.BytesIO(raw.data)).infolist())
    except (zipfile.BadZipFile, NotImplementedError, ValueError, OSError) as error:  # or an archive of another kind
        raise InputError(raw.name, f"not a readable spreadsheet: {error}", "Save it again, or as CSV") from error
    if size > LARGEST_UNPACKED:
        raise InputError(raw.name, f"a spreadsheet of {size / 1e6:.0f} MB unpacked", "Save the one sheet as CSV")


def _cell(value: object) -> str:
    """A cell as text: numbers in the shortest form that reads back, dates as ISO 8601."""
    if isinstance(value, float):
        return repr(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
    if hasattr(value, "isoformat"):
        return str(value.isoformat())
    return " ".join(str(value).split())
