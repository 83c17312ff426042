"""Rows of a table whose readings failed, where they look like something else: like comments, or like names."""

from __future__ import annotations

import re
from collections.abc import Sequence

from errormodel.raw_formats.cells import is_failed, is_rule, kind_of, split

SIGNS_FIRST = re.compile(r"\s*(##+|\*\*+)[\s;|,]")  # of a line: a cell of such signs, or a comment
Lines = Sequence[tuple[int, list[str]]]  # cells by their line


def with_signs(cells: Lines, comments: Sequence[tuple[int, str]], delimiter: str, kinds: Sequence[str]) -> Lines:
    """Lines, with those comments that are rows: their first number is ``#####``, which begins comments as well.

    Such a line has the width of the table and no text where it has numbers. One without any number may also be drawn
    below the names: it is a row only behind another one.
    """
    if kinds[0] != "number" or len(kinds) < 2:
        return cells
    rows = []
    for line, text in comments:
        own = split(text, delimiter) if SIGNS_FIRST.match(text) else []
        found = [kind_of(cell) for cell, kind in zip(own, kinds, strict=False) if kind == "number"]
        behind = any(k < line and _numbers(c, kinds) for k, c in cells)
        if len(own) == len(kinds) and "text" not in found and ("number" in found or behind):
            rows.append((line, own))
    return sorted([*cells, *rows]) if rows else cells


def from_failed(cells: Lines, first: int, kinds: Sequence[str]) -> int:
    """The first row of data at or right above `first`: rows whose readings all failed are no names of columns."""
    while first and _failed(cells[first - 1][1], kinds):
        first -= 1
    return first


def _numbers(row: Sequence[str], kinds: Sequence[str]) -> bool:
    """Whether a line has the width of the table, and a number in each of its columns of numbers."""
    wanted = zip(row, kinds, strict=False)
    return len(row) == len(kinds) and all(kind_of(cell) == "number" for cell, kind in wanted if kind == "number")


def _failed(row: Sequence[str], kinds: Sequence[str]) -> bool:
    """Whether a line has the width of the table, and in all columns of numbers signs or words of failed readings."""
    if len(row) != len(kinds) or is_rule(row) or "number" not in kinds:
        return False
    return all(is_failed(cell) for cell, kind in zip(row, kinds, strict=True) if kind == "number")
