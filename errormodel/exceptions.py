"""Exceptions that name the place of an error, the value found there and the correction."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence


class ErrorModelError(Exception):
    """Base class of all deliberate errors of this project."""


class InputError(ErrorModelError):
    """Invalid user input; the command line turns it into exit code 2.

    Parameters
    ----------
    where : str
        The place: a file, with row and column or with line and key, e.g. ``survey.csv, row 7, column mx``.
    found : str
        The value that stands there.
    cure : str
        The correction: what to write instead.
    """

    def __init__(self, where: str, found: str, cure: str) -> None:
        super().__init__(where, found, cure)
        self.where, self.found, self.cure = where, found, cure

    def __str__(self) -> str:
        return f"{self.where}: {self.found}" + (f". {self.cure}" if self.cure else "")


class ReadValueError(InputError):
    """A number of a table that was read, which cannot be: the table read as a file of another format has it as well."""


class NoRowsError(InputError):
    """A table with nothing below its header; of several parts the others may do."""

    def __init__(self, name: str) -> None:
        super().__init__(name, "no rows below the header", "Give a row a pose")

    def __reduce__(self) -> tuple[type[NoRowsError], tuple[str]]:
        return type(self), (self.where,)


class EffectError(InputError):
    """Invalid key of an effect's entry; `key` is its name."""

    def __init__(self, where: str, found: str, cure: str, key: str = "effect") -> None:
        super().__init__(where, found, cure)
        self.key = key


def enumerated(names: Sequence[str], word: str = "and") -> str:
    """Several names as one says them: ``X, Y and Z``; nothing of none."""
    return f" {word} ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


MISTYPED = 0.75  # share of its characters that a mistyped name keeps, where others may be like it too; by judgement


def alike(name: str, others: Iterable[str], least: float = 0.5) -> str:
    """The name among others that is most like one (`least`: share of characters), or nothing."""
    names = sorted(others)
    same = [n for n in names if n.lower() == name.lower()]  # names such as `x` for `X` differ in case only
    return next(iter(same or difflib.get_close_matches(name, names, n=1, cutoff=least)), "")


def nearest(name: str, valid: Iterable[str], most: int | None = None) -> str:
    """Return ``did you mean 'X'? Valid: ...`` for a name not among `valid` (at most `most` listed), or nothing."""
    names = sorted(valid)
    if not names:
        return ""
    hint = f"Did you mean '{close}'? " if (close := alike(name, names)) else ""
    more = f" and {len(names) - most} more" if most is not None and len(names) > most else ""
    return f"{hint}Valid: {', '.join(names[:most])}{more}"
