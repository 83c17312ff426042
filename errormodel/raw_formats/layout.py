"""Layout of a table in text: comments, preamble, delimiter, names and units of its columns, and its rows.

Nothing is known beforehand. The delimiter is the one that gives most lines the same width with numbers in the same
columns. The table is where the lines agree; what stands above is comments, a preamble, the names and the units.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache

from errormodel.exceptions import InputError
from errormodel.formats.base import NO_VALUE_WORDS
from errormodel.raw_formats.dates import looks_like_time
from errormodel.raw_formats.unit_words import bracketed, is_unit_word, unit_word

COMMENT = re.compile(r"\s*(//|#|%|!|\*|;)")
DELIMITERS = {"\t": "tabs", ";": "semicolons", "|": "bars", ",": "commas", " ": "blanks"}
NUMBER = re.compile(
    r"[-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+|\d{1,3}(?:[.,'\u2019\u00a0\u202f]\d{3})+(?:[.,]\d+)?)(?:[eEdD][-+]?\d+)?"
)
PLAIN = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?", re.ASCII)  # what most cells are: no date looks like that
SPECIAL = frozenset(("nan", "inf", "+inf", "-inf", "infinity", "-nan"))
TRIED_LINES = 400  # from the end of the file, by which a delimiter is chosen; by judgement
MOST_COLUMNS = 10_000  # of a table, as of a survey's: instruments write some ten
LONGEST_LINE = 1_000_000  # characters: ten thousand columns with room for names
BLOCK_SHARE = 0.5  # of the lines below the first of the table must have its width, or it is no table


@dataclass(frozen=True)
class Layout:
    """A table in text.

    Attributes
    ----------
    names : column names; "1", "2" ... where the file has none.
    units : unit of each column, empty where none is stated.
    rows : cells of the data rows, stripped.
    lines : line of each row, from 1.
    preamble : lines above the table that are neither names nor units.
    comments : text of comment lines above the table, without their sign.
    delimiter : as in `DELIMITERS`.
    named : whether the file has names.
    notes : what was passed over, as sentences.
    below : lines below the table that were passed over, from 1.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    preamble: tuple[str, ...]
    comments: tuple[str, ...]
    delimiter: str
    named: bool
    notes: tuple[str, ...] = ()
    below: tuple[int, ...] = ()

    def column(self, place: int) -> list[str]:
        """Cells of a column; `place` counts from 0."""
        return [row[place] for row in self.rows]

    @property
    def keys(self) -> dict[str, int]:
        """Places of the columns by their names in lower case without blanks and underscores."""
        return {re.sub(r"[\s_.]+", "", name).lower(): k for k, name in reversed(list(enumerate(self.names)))}

    def numeric(self, place: int) -> bool:
        """Whether every cell of a column is a number or empty, and one is a number."""
        cells = self.column(place)
        if all(map(PLAIN.fullmatch, cells)):
            return bool(cells)
        kinds = {kind_of(cell) for cell in cells}
        return kinds <= {"number", "empty"} and "number" in kinds


def kind_of(cell: str) -> str:
    """``number``, ``empty`` (or a word for no value) or ``text``."""
    return "number" if PLAIN.fullmatch(cell) else _kind_of(cell)


@lru_cache(maxsize=1 << 16)
def _kind_of(cell: str) -> str:
    cell = cell.strip()
    if cell.lower() in NO_VALUE_WORDS:
        return "empty"
    if cell.lower() in SPECIAL:
        return "number"
    return "number" if NUMBER.fullmatch(cell) and not looks_like_time(cell) else "text"


def split(line: str, delimiter: str) -> list[str]:
    """Cells of a line, without surrounding blanks and quotes."""
    plain = " ".join(line.split()) if delimiter == " " else line
    if '"' in line:
        with suppress(csv.Error):  # a quote within a cell, or a cell without an end
            return [cell.strip() for cell in next(csv.reader([plain], delimiter=delimiter, skipinitialspace=True), [])]
    return [cell.strip() for cell in plain.split(delimiter)]


def find_layout(lines: Sequence[str]) -> Layout | None:
    """The table in some lines, or None where there is none.

    Raises
    ------
    InputError
        A row within the table has another number of cells, or commas both separate cells and are decimal signs. The
        error's place is the line; callers add the file.
    """
    long = next((k for k, line in enumerate(lines, start=1) if len(line) > LONGEST_LINE), None)
    if long is not None:
        raise InputError(f"line {long}", f"more than {LONGEST_LINE} characters", "Give the file as it was written")
    full = [(k, line) for k, line in enumerate(lines, start=1) if line.strip()]
    cells_of = _semicolons([line for _, line in full])
    said = [
        bool(COMMENT.match(line)) and not (line.lstrip()[0] == ";" and line.count(";") in cells_of) for _, line in full
    ]
    body = [entry for entry, comment in zip(full, said, strict=True) if not comment]
    comments = [entry for entry, comment in zip(full, said, strict=True) if comment]
    if not body:
        return None
    delimiter = _delimiter([line for _, line in body[-TRIED_LINES:]])
    if delimiter is None:
        return None
    cells = [(k, split(line, delimiter)) for k, line in body]
    width, kinds = _shape([c for _, c in cells[-TRIED_LINES:]])
    if width == 1:  # blanks separate nothing: a name and its unit are one cell
        cells = [(k, [line.strip()]) if len(c) > 1 else (k, c) for (k, c), (_, line) in zip(cells, body, strict=True)]
    if width > MOST_COLUMNS:
        raise InputError(f"line {cells[-1][0]}", f"more than {MOST_COLUMNS} columns", "Give those of the survey only")
    first = next((i for i, (_, c) in enumerate(cells) if _is_data(c, width, kinds)), None)
    if first is None:
        return None
    rows, below, notes = _rows(cells[first:], width, kinds, delimiter)
    top = cells[:first]
    above = [(k, text[text.find(_sign(text)) + len(_sign(text)) :].strip()) for k, text in comments]
    spare = int(kinds[-1] == "empty")  # a delimiter at the end of the rows only
    names, units, used = _heads(top, [a for a in above if a[0] < cells[first][0]], width, spare, delimiter)
    preamble = tuple(lines[k - 1] for k, _ in top if k not in used)
    if preamble:
        notes.append(f"{len(preamble)} line{'s' * (len(preamble) > 1)} above the table passed over")
    named = names is not None
    table = Layout(
        tuple(names) if names is not None else tuple(str(i + 1) for i in range(width)),
        tuple(units), tuple(tuple(r) for _, r in rows), tuple(k for k, _ in rows), preamble,
        tuple(text for _, text in above), delimiter, named, tuple(notes), tuple(below),
    )  # fmt: skip
    return _without_empty_end(table)


def _semicolons(lines: Sequence[str]) -> set[int]:
    """Numbers of semicolons of a line that begins with one and is a row whose first cell is empty, no comment."""
    begin = [bool(re.match(r"\s*;", line)) for line in lines]
    if sum(begin) > len(lines) / 2:
        return {line.count(";") for line in lines}
    counts = Counter(line.count(";") for line, own in zip(lines, begin, strict=True) if not own)
    usual = max(counts, key=lambda n: counts[n], default=0)
    return {usual} if usual and counts[usual] > len(lines) / 2 else set()


def _sign(text: str) -> str:
    match = COMMENT.match(text)
    return match[1] if match else ""


def _delimiter(lines: Sequence[str]) -> str | None:
    """The delimiter that gives most numbers in lines of one width; None where no line has a number."""
    best, score = None, 0.0
    for delimiter in DELIMITERS:
        cells = [split(line, delimiter) for line in lines]
        cells = [c for c in cells if any(kind_of(cell) == "number" for cell in c)]
        counts = Counter(len(c) for c in cells)
        if not cells:
            continue
        width = max(counts, key=lambda w: (counts[w] * (w > 1), counts[w], w))
        if width < 2 and (delimiter != " " or best is not None):
            continue
        own = [c for c in cells if len(c) == width]
        kinds = [[kind_of(cell) for cell in c] for c in own]
        number = sum(k.count("number") for k in kinds)
        text = sum(k.count("text") for k in kinds)
        # lines that agree, and numbers among what they hold: a wrong delimiter leaves cells such as "1," or "5;2"
        value = len(own) / len(cells) * number / (number + text) * (1 + 1e-3 * min(width, 50))
        if value > score + 1e-12:
            best, score = delimiter, value
    return best


def _shape(cells: Sequence[Sequence[str]]) -> tuple[int, list[str]]:
    """The usual width of data rows, and what each of their columns holds."""
    counts = Counter(len(c) for c in cells if any(kind_of(cell) == "number" for cell in c))
    width = max(counts, key=lambda w: (counts[w], w))
    own = [c for c in cells if len(c) == width and any(kind_of(cell) == "number" for cell in c)]
    kinds = []
    for place in range(width):
        seen = Counter(kind_of(c[place]) for c in own)
        numbers, texts = seen["number"], seen["text"]
        kinds.append("number" if numbers > texts else "text" if texts else "empty")
    return width, kinds


def _is_data(cells: Sequence[str], width: int, kinds: Sequence[str]) -> bool:
    """Whether a line holds data: the width of the table, and more numbers than words where the table has numbers."""
    if len(cells) != width:
        return False
    own = [kind_of(cell) for cell in cells]
    wanted = [k for k, kind in enumerate(kinds) if kind == "number"]
    return sum(own[k] == "number" for k in wanted) > sum(own[k] == "text" for k in wanted)


def _rows(
    cells: Sequence[tuple[int, list[str]]], width: int, kinds: Sequence[str], delimiter: str
) -> tuple[list[tuple[int, list[str]]], list[int], list[str]]:
    """Data rows; the lines below them that are passed over, and notes on these."""
    last = next(i for i in range(len(cells) - 1, -1, -1) if _is_data(cells[i][1], width, kinds))
    rows: list[tuple[int, list[str]]] = []
    for line, row in cells[: last + 1]:
        cut = _fitted(row, width)
        if cut is None:
            found = f"{len(row)} cells where the table has {width}, separated by {DELIMITERS[delimiter]}"
            cure = "Give the whole file as it was written; if it is whole, name its --format"
            if delimiter == ",":
                cure += "; commas that are decimal signs need another sign between the cells"
            raise InputError(f"line {line}", found, cure)
        rows.append((line, cut))
    below = cells[last + 1 :]
    for line, row in below:
        if any(kind_of(cell) == "number" for cell in row) and kind_of(row[0]) != "text":
            found = f"{len(row)} cells below a table of {width}"
            raise InputError(f"line {line}", found, "Give the whole file as it was written, one table in it")
    if len(rows) < BLOCK_SHARE * len(cells):
        raise InputError(f"line {cells[0][0]}", f"a table of {len(rows)} rows and more below it", "Give one table")
    notes = [f"{len(below)} line{'s' * (len(below) > 1)} below the table passed over"] if below else []
    return rows, [line for line, _ in below], notes


def _fitted(row: list[str], width: int) -> list[str] | None:
    """A row of the table's width: empty cells at its end are added or taken away; None where others are."""
    if len(row) == width:
        return row
    if len(row) > width and not any(row[width:]):
        return row[:width]
    return None


def _heads(
    top: Sequence[tuple[int, list[str]]], comments: Sequence[tuple[int, str]], width: int, spare: int, delimiter: str
) -> tuple[list[str] | None, list[str], set[int]]:
    """Names and units above the table, and the lines that they were taken from."""
    used: set[int] = set()
    candidates = [(k, c) for k, c in top if _names_of(c, width, spare) is not None]
    units = [""] * width
    if candidates and all(not cell or is_unit_word(cell) for cell in candidates[-1][1][:width]):
        k, row = candidates.pop()
        units = [unit_word(cell) for cell in _padded(row, width)]
        used.add(k)
    names = None
    if candidates:
        k, row = candidates[-1]
        names = _names_of(row, width, spare)
        used.add(k)
    else:
        for _, text in reversed(comments[-2:]):  # `# X Y Z` right above the data
            row = split(text, delimiter)
            names = _names_of(row, width, spare) if width > 1 else None
            if names is not None:
                break
    if names is None:
        _refuse_names(top, width, delimiter)
        return None, units, used
    plain = []
    for place, name in enumerate(names):
        bare, unit = bracketed(name)
        plain.append(bare)
        units[place] = units[place] or unit
    counts = Counter(plain)
    twice = {n for n in plain if n and counts[n] > 1}
    if twice:  # the file's own names, with the place behind them where a name comes again
        seen: Counter[str] = Counter()
        for place, name in enumerate(plain):
            seen[name] += 1
            plain[place] = f"{name} ({seen[name]})" if name in twice and seen[name] > 1 else name
    return [name or str(place + 1) for place, name in enumerate(plain)], units, used


def _refuse_names(top: Sequence[tuple[int, list[str]]], width: int, delimiter: str) -> None:
    """InputError where fewer names than cells stand right above the rows: commas are decimal signs as well."""
    if not top or delimiter != ",":
        return
    line, row = top[-1]
    words = [cell for cell in row if cell]
    if len(words) > 1 and not any(kind_of(cell) == "number" for cell in words) and width > len(row):
        found = f"{len(row)} names above rows of {width} cells"
        cure = "Commas that are decimal signs need another sign between the cells: export with semicolons or tabs"
        raise InputError(f"line {line}", found, cure)


def _padded(row: list[str], width: int) -> list[str]:
    return (row + [""] * width)[:width]


def _names_of(row: list[str], width: int, spare: int) -> list[str] | None:
    """A row as names of columns, if it can be: words, about as many as there are columns."""
    if len(row) > width and any(row[width:]):
        return None
    if width - len(row) > spare:
        return None
    row = _padded(row, width)
    words = [cell for cell in row if cell]
    if not words or any(kind_of(cell) == "number" for cell in words) or len(words) < max(1, width / 2):
        return None
    return [" ".join(cell.split()) for cell in row]


def _without_empty_end(table: Layout) -> Layout:
    """The table without columns at its end that have neither a name nor a value (a delimiter ends each line)."""
    width = len(table.names)
    while width > 1 and not any(row[width - 1] for row in table.rows):
        if table.named and table.names[width - 1] != str(width):
            break
        width -= 1
    if width == len(table.names):
        return table
    return Layout(
        table.names[:width], table.units[:width], tuple(row[:width] for row in table.rows), table.lines,
        table.preamble, table.comments, table.delimiter, table.named, table.notes, table.below,
    )  # fmt: skip
