"""A file as an instrument wrote it: its bytes, its text in whatever encoding, and the interface of raw formats.

A raw format is one class in one file of this package, or of a package from outside by the entry point
``errormodel.raw_formats``. It recognises files by their content, whatever their suffix, and returns columns and units.
"""

from __future__ import annotations

import codecs
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple

from errormodel.discovery import by_word, classes
from errormodel.exceptions import InputError, nearest
from errormodel.inputs import noted
from errormodel.raw_formats.layout import Layout, find_layout

if TYPE_CHECKING:
    import pandas as pd

    from errormodel.machine import Machine
    from errormodel.raw_formats.commanded_circle import CommandedCircle

DateOrder = Literal["", "day-first", "month-first"]

# byte-order marks, longest first: that of UTF-32 begins with that of UTF-16
MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
ENCODING_NAMES = {
    "utf-8": "UTF-8", "utf-16-le": "UTF-16", "utf-16-be": "UTF-16", "utf-32-le": "UTF-32", "utf-32-be": "UTF-32",
    "cp1252": "Windows-1252",
}  # fmt: skip
MOST_BLANKS = 2000  # in a row: columns of blanks have some ten; patterns take the square of it
NULLS_OF_UTF16 = 0.3  # share of null bytes on one side of the pairs: half of the text of any European language


@dataclass(frozen=True)
class Asked:
    """What the user or ``survey.yaml`` says about a raw file.

    Attributes
    ----------
    machine : Machine or None
        Names the joints, where a format needs them.
    dates : "day-first", "month-first" or ""
        Order of day and month where the file does not show it.
    joint : str
        The joint that the file is about, where it has one joint only.
    offsets, at, dialect : of a programme, as for ``compensate``.
    circle : CommandedCircle or None
        The circle that was run, of a trace without coordinates.
    units : mapping
        Unit of a column by the format's own word for it (`RawFormat.columns`), before that of the file.
    sheet : str
        Of a workbook that has it; empty: the first that is no cover sheet.
    """

    machine: Machine | None = None
    dates: DateOrder = ""
    joint: str = ""
    offsets: tuple[str, ...] = ()
    at: tuple[str, ...] = ()
    dialect: str = "auto"
    circle: CommandedCircle | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    sheet: str = ""


class ReadAs(NamedTuple):
    """From what a column was read: its word in ``units:``, the unit as which it was read, the option to correct it."""

    word: str
    unit: str
    option: str = "--units"


@dataclass(frozen=True)
class Recording:
    """The columns of a raw file.

    Attributes
    ----------
    frame : DataFrame
        Columns of numbers (float64, NaN: empty) and of text, index from 0. A column that the format knows has the
        toolkit's name (``mx``, ``time``, ``T_air``, a joint ...), ``point`` (its name in the file), ``target`` (the
        reflector) or ``station``; the others have the names of the file.
    units : mapping
        Unit of a column, as the file states it.
    lines : tuple of int
        Line of the file of each row, from 1; empty where a file has no lines.
    notes : tuple of str
        How the file was read.
    dated : bool
        Whether the column ``time`` is in seconds since 1970; else it is in seconds from any zero.
    trace : str
        Kind of trace (`errormodel.observations.base.Observation.trace`) whose readings it holds; empty: none.
    reach : float
        Length in mm that the readings of a trace are deviations from.
    calibrated : bool
        Whether the file states that length as the calibrated one.
    length_unit : str
        Unit that the file states for all its coordinates and not column by column; empty: none.
    again : tuple of int
        Rows of commands, from 0, at whose places the machine was commanded to and waited again: a row each time.
    beside_targets : bool
        Whether error motions come from positions that were compared with their targets, row by row.
    read_as : mapping
        Of columns that the format has computed and converted, from what and as which unit that was read.
    """

    frame: pd.DataFrame
    units: Mapping[str, str] = field(default_factory=dict)
    lines: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()
    dated: bool = False
    trace: str = ""
    reach: float = float("nan")
    calibrated: bool = False
    length_unit: str = ""
    again: tuple[int, ...] = ()
    beside_targets: bool = False
    read_as: Mapping[str, ReadAs] = field(default_factory=dict)

    @property
    def a_row_each(self) -> bool:
        """Whether each row is of a line of its own, and not one of several readings of it."""
        return len({*self.lines}) == len(self.lines)


@dataclass(frozen=True)
class RawFile:
    """A file as it came: `name` is the path as the user wrote it, `called` the columns of its table that he names.

    `counts` says whether a row of the table, from 0, counts for anything (None: all do): text among the numbers of one
    that does not makes no column text.
    """

    path: Path
    name: str
    data: bytes = field(repr=False)
    called: Mapping[str, str] = field(default_factory=dict)  # our name of a column by the file's own
    counts: Callable[[int], bool] | None = field(default=None, repr=False, compare=False)

    @cached_property
    def _decoded(self) -> tuple[str | None, str]:
        return decoded(self.data)

    @property
    def text(self) -> str | None:
        """Its text; None for bytes that are no text."""
        return self._decoded[0]

    @property
    def encoding(self) -> str:
        """Name of its encoding; empty for bytes that are no text."""
        return self._decoded[1]

    @cached_property
    def lines(self) -> tuple[str, ...]:
        """Lines without their ends; a carriage return alone ends a line as well."""
        text = self.text or ""
        text = text.replace("\r\n", "\n").replace("\r", "\n").replace("\u2212", "-")  # the minus of typesetters
        return tuple(text.split("\n"))

    @cached_property
    def layout(self) -> Layout | None:
        """The table in its text, or None where there is none."""
        table = None if self.text is None else find_layout(self.lines)
        if table is None or not self.called:
            return table
        return replace(table, names=tuple(self.called.get(n, n) for n in table.names), named=True)

    @property
    def clear_layout(self) -> Layout | None:
        """The table in its text, or None where there is none or its rows do not agree."""
        try:
            return self.layout
        except InputError:
            return None

    @property
    def notes(self) -> tuple[str, ...]:
        """How the bytes were read as text, where that is worth a note."""
        name = ENCODING_NAMES.get(self.encoding, self.encoding)
        return () if name in ("UTF-8", "") else (f"read as {name}",)


class RawFormat(ABC):
    """What is common to the formats of raw files.

    Attributes
    ----------
    name : word of ``format:`` in survey.yaml.
    title : what such a file is, as the end of "read as ...".
    source : where the format is described.
    seen : whether it was tried on a public recording; else it is written to its description only.
    fallback : read by it what no other format recognises.
    bare : its files may hold anything, so that columns without names may be commands.
    of_pairs : of nominal and actual of a joint: where lengths or commands are wanted, the same table may hold these.
    columns : words by which ``columns:`` and ``units:`` may name its own columns, beside those of a survey.
    uses : what of `Asked` it reads, beside machine, dates and units: ``joint``, ``offsets``, ``at``, ``dialect``.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    source: ClassVar[str]
    seen: ClassVar[bool] = False
    fallback: ClassVar[bool] = False
    bare: ClassVar[bool] = False
    of_pairs: ClassVar[bool] = False
    columns: ClassVar[tuple[str, ...]] = ()
    uses: ClassVar[tuple[str, ...]] = ()

    @classmethod
    @abstractmethod
    def recognises(cls, raw: RawFile) -> bool:
        """Whether a file is of this format, by its content."""

    @classmethod
    @abstractmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        """Columns of a file that is of this format.

        Raises
        ------
        InputError
            Something in it is not understood.
        """

    @classmethod
    def opened(cls, raw: RawFile, asked: Asked) -> Recording:
        """Columns of a file that is said to be of this format.

        Raises
        ------
        InputError
            It is not, or something in it is not understood.
        """
        if not cls.recognises(raw):
            try:
                _ = raw.layout
            except InputError as error:
                raise InputError(f"{raw.name}, {error.where}", error.found, error.cure) from error
            raise InputError(raw.name, f"it does not look like {cls.title}", "Leave --format out, or name another one")
        return cls.read(raw, asked)


@lru_cache(maxsize=1)
def raw_formats() -> dict[str, type[RawFormat]]:
    """All raw formats by their names."""
    kinds = classes("errormodel.raw_formats", RawFormat)  # type: ignore[type-abstract]
    return by_word((kind.name, kind) for kind in kinds)


def open_raw(path: Path, name: str) -> RawFile:
    """Read the bytes of a raw file.

    Raises
    ------
    InputError
        It is not there, is empty or cannot be read.
    """
    try:
        if path.is_dir():
            raise InputError(name, "a folder", "Give the files that the instrument wrote, one by one")
        data = noted(path).read_bytes()
    except FileNotFoundError as error:
        beside = [p.name for p in path.parent.glob("*") if p.is_file()]
        raise InputError(name, "no such file", nearest(path.name, beside, most=20)) from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(name, f"cannot be read: {reason}", "Give a file that can be read") from error
    if not data.strip():
        raise InputError(name, "an empty file", "Give the file that the instrument wrote")
    raw = RawFile(path, name, data)
    for number, line in enumerate(raw.lines, start=1):
        if len(line) > MOST_BLANKS and max(map(len, re.findall(r"\s+", line)), default=0) > MOST_BLANKS:
            found = f"more than {MOST_BLANKS} blanks in a row"
            raise InputError(f"{name}, line {number}", found, "Give the file as the instrument wrote it")
    return raw


def format_of(raw: RawFile, asked: str = "", plain: bool = False) -> type[RawFormat]:
    """The format of a file: the one that is asked for, or the one that recognises it; `plain`: of tables of anything.

    Raises
    ------
    InputError
        No such format, or none or several recognise the file.
    """
    known = raw_formats()
    if asked:
        if asked not in known:
            raise InputError(f"{raw.name}, format", f"'{asked}'", nearest(asked, known))
        return known[asked]
    own = [kind for kind in known.values() if not (plain or kind.fallback) and kind.recognises(raw)]
    own = own or [kind for kind in known.values() if kind.fallback and kind.recognises(raw)]
    if len(own) == 1:
        return own[0]
    if own:
        names = " and ".join(kind.name for kind in own)
        raise InputError(raw.name, f"it looks like {names} alike", f"Say which with --format {own[0].name}")
    raise InputError(raw.name, unreadable(raw), "Give a table as text or a spreadsheet, or name its --format")


def called(raw: RawFile, form: type[RawFormat], columns: Mapping[str, str]) -> RawFile:
    """A file whose columns have the names that a format's words give them; `columns`: the file's own by our words.

    Raises
    ------
    InputError
        The file has no such column.
    """
    own = {ours: theirs for ours, theirs in columns.items() if ours in form.columns}
    table = raw.clear_layout
    if not own or table is None:
        return raw
    for ours, theirs in own.items():
        place = int(theirs[1:]) - 1 if theirs.startswith("#") and theirs[1:].isdigit() else -1
        own[ours] = table.names[place] if 0 <= place < len(table.names) else theirs
        if own[ours] not in table.names:
            raise InputError(f"{raw.name}, columns: {ours}", f"no column '{theirs}'", nearest(theirs, table.names))
    return replace(raw, called={theirs: ours for ours, theirs in own.items()})


def unreadable(raw: RawFile) -> str:
    """What a file that nothing reads looks like, and what was tried."""
    if raw.text is None:
        start = raw.data[:8].hex(" ")
        return f"{len(raw.data)} bytes that are no text, beginning with {start}; no format for such bytes recognises it"
    first = next((line.strip() for line in raw.lines if line.strip()), "")[:60]
    return (
        f"{len(raw.lines)} lines of text ({raw.encoding}) without rows of numbers of equal width, beginning with "
        f"'{first}'; tried tabs, semicolons, bars, commas and blanks between the columns"
    )


def decoded(data: bytes) -> tuple[str | None, str]:
    """Text of some bytes and its encoding: by byte-order mark, UTF-16 by its null bytes, UTF-8, Windows-1252.

    Parameters
    ----------
    data : bytes

    Returns
    -------
    text : str or None
        None where the bytes are no text.
    encoding : str
    """
    for mark, encoding in MARKS:
        if data.startswith(mark):
            return _clean(data[len(mark) :], encoding)
    head = data[: 1 << 16]
    for encoding, nulls in (("utf-16-le", head[1::2]), ("utf-16-be", head[0::2])):
        if len(data) % 2 == 0 and nulls and nulls.count(0) > NULLS_OF_UTF16 * len(nulls):
            return _clean(data, encoding)
    text, encoding = _clean(data, "utf-8")
    return (text, encoding) if text is not None else _clean(data, "cp1252")


def _clean(data: bytes, encoding: str) -> tuple[str | None, str]:
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError:
        if encoding != "cp1252":
            return None, ""
        text = data.decode("latin-1")  # five bytes that Windows-1252 leaves open
    text = text.rstrip("\0").removesuffix("\x1a")  # blocks filled up; end of file of old programmes
    if any(ord(c) < 32 and c not in "\t\n\r\f\v" for c in set(text)) or "\ufffe" in text:
        return None, ""
    return text.replace("\f", "\n").replace("\v", " "), encoding


def joint_names(machine: Machine | None) -> Sequence[str]:
    """Names of the machine's joints; none without a machine."""
    return [] if machine is None else [j.name for j in machine.joints]
