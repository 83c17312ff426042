"""How lines of text are laid out for a terminal, and numbers of things in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence


def one_line(message: str) -> str:
    """A message as a terminal may show it: names in it are anybody's."""
    return "".join(c if c.isprintable() else " " for c in message)


def counted(number: int, word: str) -> str:
    """A number of things: 1 row, 2 rows."""
    return f"{number} {word}{'' if number == 1 else 's'}"


def table_lines(rows: Sequence[Sequence[str]], align: str, indent: int = 0, least: int = 0) -> Iterator[str]:
    """Rows of cells in columns as wide as their longest cell, two blanks apart, whatever the numbers.

    Parameters
    ----------
    align : "<" or ">" for each column.
    indent : blanks before each row.
    least : the least width of a column.
    """
    widths = [max(least, *map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (f"{cell:{side}{width}}" for cell, side, width in zip(row, align, widths, strict=True))
        yield " " * indent + "  ".join(cells).rstrip()
