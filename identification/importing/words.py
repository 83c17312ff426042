"""Rows in words, as messages and notes of an import have them."""

from __future__ import annotations

from errormodel.arrays import Index

LISTED = 6  # rows in a line


def row_ranges(rows: Index) -> str:
    """First and last rows (k, 2), from 0, as a person counts them."""
    shown = ", ".join(f"{a + 1} to {b + 1}" for a, b in rows[:LISTED].tolist())
    return f"rows {shown}{' ...' if len(rows) > LISTED else ''}"
