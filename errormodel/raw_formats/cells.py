"""Cells of a table in text: which are numbers, how lines are split into them, and units that stand in each cell."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import lru_cache

from errormodel.formats.base import NO_VALUE_WORDS
from errormodel.raw_formats.dates import looks_like_time
from errormodel.raw_formats.unit_words import unit_word

NUMBER = re.compile(
    r"[-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+|\d{1,3}(?:[.,'\u2019\u00a0\u202f]\d{3})+(?:[.,]\d+)?)(?:[eEdD][-+]?\d+)?"
)
PLAIN = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?", re.ASCII)  # what most cells are: no date looks like that
SPECIAL = frozenset(("nan", "inf", "+inf", "-inf", "infinity", "-nan"))
# a number and its unit, with or without a blank between: 12.3 mm
WITH_UNIT = re.compile(
    rf"({NUMBER.pattern})\s*([um\u00b5\u03bc]m/m|mm|cm|m|um|\u00b5m|\u03bcm|in|inch|deg|\u00b0|rad|[mu\u00b5\u03bc]rad|arcsec|m?s|\u00b0C|degC)"
)
REMARK = re.compile(rf"({NUMBER.pattern})\s+(?:#|//|%).*")  # a comment behind the last number of a line
# what instruments write in the cell of a reading that failed, and spreadsheets in one that has no value
FAILED = frozenset((
    "lost", "invalid", "error", "err", "fail", "failed", "missing", "nodata", "no data", "not measured", "out of range",
    "no target", "no signal", "no beam", "no reading", "signal lost", "target lost", "beam lost", "beam broken",
    "beam break", "beam interrupted", "broken", "interrupted", "laser off", "n/v",
    "ung\u00fcltig", "fehler", "verloren", "unterbrochen", "strahl unterbrochen", "kein ziel", "kein signal",
    "perso", "persa", "interrotto", "non valido", "perdu", "interrompu", "invalide",
    "perdido", "interrumpido", "no v\u00e1lido",
    "#value!", "#div/0!", "#num!", "#ref!", "#wert!",
))  # fmt: skip
MARK = re.compile(r"#+|\*+|\?+")  # one sign instead of a number: also of a cell that was too narrow for it
BRACKETS = {"[": "]", "(": ")"}  # around the cells of a line
RULE = re.compile(r"[-=_*+|:.~]{2,}|[-+|]")  # a cell of a line that is drawn below the names


def kind_of(cell: str) -> str:
    """``number`` (with a unit behind it or not), ``empty`` (or a word for no value) or ``text``."""
    return "number" if PLAIN.fullmatch(cell) else _kind_of(cell)


@lru_cache(maxsize=1 << 16)
def _kind_of(cell: str) -> str:
    cell = cell.strip()
    if cell.lower() in NO_VALUE_WORDS or is_failed(cell):
        return "empty"
    if cell.lower() in SPECIAL:
        return "number"
    if NUMBER.fullmatch(cell):
        return "text" if looks_like_time(cell) else "number"
    return "number" if _unit_in(cell) else "text"


def is_failed(cell: str) -> bool:
    """Whether a cell says that its reading failed: a word for it, or a run of ``#``, ``*`` or ``?`` and nothing else.

    Only whole cells: what has a digit in it may be a number that was spoilt, which no one may drop without a word.
    """
    cell = cell.strip().lower()
    return cell in FAILED or MARK.fullmatch(cell) is not None


def without_words(cells: Sequence[str], counts: Callable[[int], bool]) -> list[str]:
    """Cells of a column of numbers without what is none in rows that count for nothing: text, and another unit.

    They stay as they are where others hold text.

    Parameters
    ----------
    counts : whether a row, from 0, counts for anything.
    """
    if all(map(PLAIN.fullmatch, cells)) or not any(kind_of(cell) == "number" for cell in cells):
        return [*cells]
    kept = [cell for row, cell in enumerate(cells) if counts(row) and kind_of(cell) != "empty"]
    if not kept or any(kind_of(cell) == "text" for cell in kept):
        return [*cells]
    units = {_unit_in(cell) for cell in kept}
    return [cell if kind_of(cell) != "text" and _unit_in(cell) in units else "" for cell in cells]


def _unit_in(cell: str) -> str:
    """The unit behind a number, empty where there is none."""
    match = WITH_UNIT.fullmatch(cell)
    return unit_word(match[2]) if match else ""


def without_units(cells: Sequence[str]) -> tuple[list[str], str]:
    """Cells of a column without the unit that stands in each of them, and that unit; as they are where units differ."""
    units = {_unit_in(cell) for cell in cells if kind_of(cell) != "empty"}
    if len(units) != 1 or not (unit := units.pop()):
        return [*cells], ""
    return [match[1] if (match := WITH_UNIT.fullmatch(cell)) else cell for cell in cells], unit


def split(line: str, delimiter: str) -> list[str]:
    """Cells of a line, without surrounding blanks and quotes, and without a comment behind a last number."""
    cells = _cells(line, delimiter)
    if len(cells) > 1 and cells[0][:1] in BRACKETS and cells[-1][-1:] == BRACKETS[cells[0][:1]]:  # a list of a language
        cells[0], cells[-1] = cells[0][1:].lstrip(), cells[-1][:-1].rstrip()
    if cells and (remark := REMARK.fullmatch(cells[-1])):
        cells[-1] = remark[1]
    return cells


def _cells(line: str, delimiter: str) -> list[str]:
    plain = " ".join(line.split()) if delimiter == " " else line
    if '"' in line:
        with suppress(csv.Error):  # a quote within a cell, or a cell without an end
            return [cell.strip() for cell in next(csv.reader([plain], delimiter=delimiter, skipinitialspace=True), [])]
    return [cell.strip() for cell in plain.split(delimiter)]


def is_rule(cells: Sequence[str]) -> bool:
    """Whether the cells of a line are a rule drawn between names and rows: ``---- ----``."""
    drawn = [cell for cell in cells if cell]
    return any(len(cell) > 1 for cell in drawn) and all(RULE.fullmatch(cell) for cell in drawn)
