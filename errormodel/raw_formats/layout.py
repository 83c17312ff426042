"""Layout of a table in text: comments, preamble, delimiter, names and units of its columns, and its rows.

Nothing is known beforehand. The delimiter is the one that gives most lines the same width with numbers in the same
columns. The table is where the lines agree; what stands above is comments, a preamble, the names and the units.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from errormodel.exceptions import InputError
from errormodel.raw_formats.cells import PLAIN, is_rule, kind_of, split, without_units, without_words
from errormodel.raw_formats.failed_rows import from_failed, with_signs
from errormodel.raw_formats.unit_words import bracketed, is_unit_word, stated_length, unit_word

COMMENT = re.compile(r"\s*(//|#|%|!|\*|;)")
DELIMITERS = {"\t": "tabs", ";": "semicolons", "|": "bars", ",": "commas", " ": "blanks"}
TRIED_LINES = 400  # from the end of the file, by which a delimiter is chosen; by judgement
MOST_COLUMNS = 10_000  # of a table, as of a survey's: instruments write some ten
LONGEST_LINE = 1_000_000  # characters: ten thousand columns with room for names
BLANKS_WITHIN = 0.75  # blanks count so much less where tabs, semicolons or bars split all lines evenly: `P 1`
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
    length_unit : unit of lengths that a line above the table states for all of it: ``Units: inch``.
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
    length_unit: str = ""

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

    def judged(self, counts: Callable[[int], bool]) -> Layout:
        """The table without text among the numbers of rows that count for nothing; `counts`: whether a row does."""
        own = [self.column(k) for k in range(len(self.names))]
        columns = [without_words(cells, counts) for cells in own]
        return self if columns == own else _without_units(replace(self, rows=tuple(zip(*columns, strict=True))))


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
    if not body or sum(line.lstrip().startswith("{") for _, line in body) > len(body) / 2:  # objects of JSON
        return None
    delimiter = _delimiter([line for _, line in body[-TRIED_LINES:]])
    if delimiter is None:
        return None
    if delimiter == "," and _one_column([line.strip() for _, line in body]):
        delimiter = " "
    cells = [(k, split(line, delimiter)) for k, line in body]
    width, kinds = _shape([c for _, c in cells[-TRIED_LINES:]])
    if width == 1:  # blanks separate nothing: a name and its unit are one cell
        cells = [(k, [line.strip()]) if len(c) > 1 else (k, c) for (k, c), (_, line) in zip(cells, body, strict=True)]
    if width > MOST_COLUMNS:
        raise InputError(f"line {cells[-1][0]}", f"more than {MOST_COLUMNS} columns", "Give those of the survey only")
    cells = [*with_signs(cells, comments, delimiter, kinds)]
    first = next((i for i, (_, c) in enumerate(cells) if _is_data(c, width, kinds)), None)
    if first is None:
        return None
    first = from_failed(cells, _below_names(cells, first, width, kinds), kinds)
    rows, below, notes = _rows(cells[first:], width, kinds, delimiter, _text_of(cells[:first]))
    top = [(k, c) for k, c in cells[:first] if not is_rule(c)]
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
        stated_length([*preamble, *(text for k, text in above if k < cells[first][0])]),
    )  # fmt: skip
    return _without_empty_end(_without_units(table))


def _below_names(cells: Sequence[tuple[int, list[str]]], first: int, width: int, kinds: Sequence[str]) -> int:
    """The row below the names, where a preamble has lines as wide as the table: what stands above names is no data.

    Only where the first line that looks like data has no names above it, and fewer such lines stand above the names
    than below.
    """
    if first and _heading(cells[first - 1][1], width, kinds):
        return first
    names = next((i for i in range(first, len(cells)) if _heading(cells[i][1], width, kinds)), None)
    if names is None or names - first >= sum(_is_data(c, width, kinds) for _, c in cells[names:]):
        return first
    return next((i for i in range(names, len(cells)) if _is_data(cells[i][1], width, kinds)), first)


def _heading(row: Sequence[str], width: int, kinds: Sequence[str]) -> bool:
    """Whether a line has the table's width, and a name of its own over each column of numbers."""
    if len(row) != width:
        return False
    names = [cell for cell, kind in zip(row, kinds, strict=True) if kind == "number"]
    return len({*names}) == len(names) > 1 and all(kind_of(cell) == "text" for cell in names)


def _text_of(cells: Sequence[tuple[int, list[str]]]) -> set[tuple[str, ...]]:
    """Lines of words above the rows, by their cells."""
    return {tuple(c) for _, c in cells if not any(kind_of(cell) == "number" for cell in c)}


def _without_units(table: Layout) -> Layout:
    """The table without the unit that stands in every cell of a column, which is the column's."""
    columns = [without_units(table.column(k)) for k in range(len(table.names))]
    if not any(unit for _, unit in columns):
        return table
    units = tuple(unit or stated for (_, unit), stated in zip(columns, table.units, strict=True))
    rows = tuple(zip(*(own for own, _ in columns), strict=True))
    return replace(table, rows=rows, units=units)


def _one_column(lines: Sequence[str]) -> bool:
    """Whether lines are one number with a decimal comma: as many digits in all, below one name or with zeros first."""
    found = [re.fullmatch(r"[-+]?\d+,(\d+)", line) for line in lines]
    first = next((k for k, match in enumerate(found) if match), len(found))
    digits = [match[1] for match in found[first:] if match]
    if len(digits) < 2 or len(digits) < len(found) - first or len({*map(len, digits)}) > 1:
        return False
    named = first > 0 and "," not in lines[first - 1]
    return named or any(len(d) > 1 and d[0] == "0" for d in digits)


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
    best, score, even = None, 0.0, 0.0
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
        if delimiter == " " and best in ("\t", ";", "|") and even == 1:
            value *= BLANKS_WITHIN
        if value > score + 1e-12:
            best, score, even = delimiter, value, len(own) / len(cells)
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
    cells: Sequence[tuple[int, list[str]]], width: int, kinds: Sequence[str], delimiter: str,
    heads: set[tuple[str, ...]],
) -> tuple[list[tuple[int, list[str]]], list[int], list[str]]:  # fmt: skip
    """Data rows; the lines below them that are passed over, and notes on these.

    Within the rows, lines of `heads` that come again are passed over, and titles: one cell of several words.
    """
    last = next(i for i in range(len(cells) - 1, -1, -1) if _is_data(cells[i][1], width, kinds))
    rows: list[tuple[int, list[str]]] = []
    again, titles, below_names = 0, 0, False
    for line, row in cells[: last + 1]:
        if tuple(row) in heads or (below_names and is_rule(row)):
            again, below_names = again + 1, True
            continue
        below_names = False
        if _is_title(row, width, delimiter):
            titles += 1
            continue
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
    if len(rows) < BLOCK_SHARE * (len(cells) - again - titles):
        raise InputError(f"line {cells[0][0]}", f"a table of {len(rows)} rows and more below it", "Give one table")
    more = ((len(below), "below the table"), (again, "of names that come again"), (titles, "of words between the rows"))
    notes = [f"{n} line{'s' * (n > 1)} {what} passed over" for n, what in more if n]
    return rows, [line for line, _ in below], notes


def _is_title(row: Sequence[str], width: int, delimiter: str) -> bool:
    """Whether a line between rows holds words in one cell only, and is no row that was cut off."""
    words = [cell for cell in row if cell]
    return width > 2 and delimiter != " " and len(words) == 1 and words[0] == row[0] and " " in words[0].strip()


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
    ends = [cell[-1] in ";:," for cell in words]
    if any(ends[:-1]) and not all(ends):  # a sentence of as many words as there are columns
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
    rows = tuple(row[:width] for row in table.rows)
    return replace(table, names=table.names[:width], units=table.units[:width], rows=rows)
