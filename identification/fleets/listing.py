"""The list of a fleet: a CSV or Parquet file with a row for each survey of each machine."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from errormodel.exceptions import InputError, nearest
from identification.fleets.places import Base, fetched

if TYPE_CHECKING:
    import pandas as pd

MACHINE, SURVEY, IDENTITY, TYPE, DATE = "machine", "survey", "id", "type", "date"
REQUIRED = (MACHINE, SURVEY)
TAKEN = (  # columns of the tables that labels stand in
    "row", "status", "verdict", "rows", "rms_um", "heldout_um", "noise_um", "findings", "notes", "part", "seal", "rank",
    "surveys", "failed", "state", "out", "p", "q", "reasons", "effect_um", "why",
)  # fmt: skip
MOST_ROWS = 10_000_000
LONGEST_NAME = 40  # characters of a name in the name of a folder


@dataclass(frozen=True)
class Row:
    """One survey of one machine.

    Attributes
    ----------
    number : of the row, from 1.
    machine, survey : as the list has them.
    id : the machine that was measured; without the column, what `machine` says.
    type : of machine; "" where the list does not say, which leaves it to the machine's file.
    date : years since 1970, NaN where there is none; `dated` : as it is written.
    labels : all other columns.
    """

    number: int
    machine: str
    survey: str
    id: str
    type: str = ""
    date: float = float("nan")
    dated: str = ""
    labels: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Listing:
    """A list that was read.

    Attributes
    ----------
    name : of the file.
    base : folder that its paths are relative to.
    labels : names of the other columns.
    """

    name: str
    base: Base
    rows: tuple[Row, ...]
    labels: tuple[str, ...]


def read_list(source: str | Path) -> Listing:
    """Read the list of a fleet.

    Parameters
    ----------
    source : a file of this computer, or any address that fsspec knows (``s3://...``).

    Raises
    ------
    InputError
        A column or cell is missing or wrong; the message names row and column.
    """
    from errormodel.formats import open_tables

    name = str(source)
    base = Base.of(name)
    with fetched(base, base.last) as path:
        if path.is_dir():
            raise InputError(name, "a folder, not a list", "Give the CSV or Parquet file that lists machine and survey")
        (table,) = open_tables(path, name)
        columns = [c for c in table.columns if c]
        twice = next((c for k, c in enumerate(columns) if c in columns[:k]), None)
        if twice is not None:
            raise InputError(f"{name}, header", f"two columns '{twice}'", "Give each column a name of its own")
        for wanted in REQUIRED:
            if wanted not in columns:
                cure = f"Write a header with the columns machine and survey. {nearest(wanted, columns)}"
                raise InputError(f"{name}, header", f"no column '{wanted}'", cure)
        taken = next((c for c in columns if c in TAKEN), None)
        if taken is not None:
            found = f"a column '{taken}', which the tables of results have, too"
            raise InputError(f"{name}, header", found, "Give that label another name")
        frame, _ = table.read([], columns)
        frame = frame.apply(lambda column: column.fillna("").astype(str).str.strip())
        if not len(frame):
            raise InputError(name, "no row", "Write a row for each survey: its machine and its survey")
        if len(frame) > MOST_ROWS:
            raise InputError(name, f"{len(frame)} rows", f"Give at most {MOST_ROWS} in one list")
        rows = _rows(frame, columns, table.cell)
    return Listing(base.last, base, rows, tuple(c for c in columns if c not in (*REQUIRED, IDENTITY, TYPE, DATE)))


def _rows(frame: pd.DataFrame, columns: Sequence[str], cell: object) -> tuple[Row, ...]:
    assert callable(cell)
    others = [c for c in columns if c not in (*REQUIRED, IDENTITY, TYPE, DATE)]
    rows: list[Row] = []
    seen: dict[tuple[str, str], int] = {}
    types: dict[str, tuple[str, int]] = {}
    for k, given in enumerate(frame.to_dict("records")):
        for wanted in (*REQUIRED, *(c for c in (IDENTITY, TYPE) if c in columns)):
            if not given[wanted]:
                what = {MACHINE: "a machine.yaml or a name of the library", SURVEY: "the survey's file or folder"}
                raise InputError(cell(k, wanted), "an empty cell", f"Write {what.get(wanted, 'the ' + wanted)}")
        row = Row(
            k + 1, given[MACHINE], given[SURVEY], given.get(IDENTITY) or given[MACHINE], given.get(TYPE, ""),
            *_date(given.get(DATE, ""), cell(k, DATE)), {c: given[c] for c in others},
        )  # fmt: skip
        before = seen.setdefault((row.id, _same_place(row.survey)), row.number)
        if before != row.number:
            found = f"'{row.survey}' stands for {row.id} in row {before} already"
            raise InputError(cell(k, SURVEY), found, "List each survey of a machine once")
        kind, first = types.setdefault(row.id, (row.type, row.number))
        if kind != row.type:
            found = f"'{row.type}', and '{kind}' for the same machine {row.id} in row {first}"
            raise InputError(cell(k, TYPE), found, "Write one type for a machine")
        rows.append(row)
    return tuple(rows)


def _same_place(entry: str) -> str:
    """A survey's path in one of its spellings; addresses stay."""
    return entry if "://" in entry else posixpath.normpath(entry.replace("\\", "/"))


def _date(text: str, where: str) -> tuple[float, str]:
    """Years since 1970 of a date, and its text."""
    import pandas as pd

    if not text:
        return float("nan"), ""
    wrong = InputError(where, f"'{text}'", "Write a date as 2026-03-31 or 2026-03-31T14:05")
    if not re.match(r"\d{4}-\d\d-\d\d", text):
        raise wrong
    try:
        moment = pd.Timestamp(text)
    except ValueError as error:
        raise wrong from error
    moment = moment.tz_localize("UTC") if moment.tzinfo is None else moment.tz_convert("UTC")
    return moment.timestamp() / (365.25 * 86400), text


def name_part(text: str) -> str:
    """A text as part of the name of a folder."""
    word = re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_") or "x"
    return word[:LONGEST_NAME].strip("_")
