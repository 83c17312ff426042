"""Any table in text, under the names of its columns; columns without names are numbered from 1."""

from __future__ import annotations

from errormodel.exceptions import InputError
from errormodel.raw_formats.base import Asked, RawFile, RawFormat, Recording
from errormodel.raw_formats.table_columns import columns_of


class DelimitedTable(RawFormat):
    """What no other format recognises, if lines agree in their width and hold numbers."""

    name = "delimited-table"
    title = "a table"
    source = "no description: encoding, comments, preamble, delimiter, names and units are found in the file"
    seen = True
    fallback = True
    bare = True

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        try:
            return raw.layout is not None
        except InputError:  # a table with a broken row: reading it says which
            return True

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        return columns_of(raw, asked, by_rows=True)
