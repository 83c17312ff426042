"""Numbers of things and rows in words, as messages and notes of an import have them."""

from __future__ import annotations

from errormodel.arrays import Index

LISTED = 6  # rows in a line


def counted(number: int, word: str) -> str:
    """A number of things: 1 row, 2 rows."""
    return f"{number} {word}{'s' * (number != 1)}"


def row_ranges(rows: Index) -> str:
    """First and last rows (k, 2), from 0, as a person counts them."""
    shown = ", ".join(f"{a + 1} to {b + 1}" for a, b in rows[:LISTED].tolist())
    return f"rows {shown}{' ...' if len(rows) > LISTED else ''}"
