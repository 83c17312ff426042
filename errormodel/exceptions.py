"""Named errors that carry the place, what was found there, and the cure."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class ErrorModelError(Exception):
    """Base class of everything this project raises on purpose."""


class InputError(ErrorModelError):
    """What the user gave is wrong; the command line turns it into exit code 2.

    Parameters
    ----------
    where : str
        The place: a file, with row and column or with line and key, e.g. ``survey.csv, row 7, column mx``.
    found : str
        What stands there.
    cure : str
        What to write instead.
    """

    def __init__(self, where: str, found: str, cure: str) -> None:
        super().__init__(where, found, cure)
        self.where, self.found, self.cure = where, found, cure

    def __str__(self) -> str:
        return f"{self.where}: {self.found}. {self.cure}"


class EffectError(InputError):
    """A key of an effect's entry is wrong; `key` is its name."""

    def __init__(self, where: str, found: str, cure: str, key: str = "effect") -> None:
        super().__init__(where, found, cure)
        self.key = key


def nearest(name: str, valid: Iterable[str]) -> str:
    """Return ``did you mean 'X'? Valid: ...`` for a name that is not among `valid`."""
    names = sorted(valid)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    if not close:  # names such as `x` for `X` differ in case only
        close = [n for n in names if n.lower() == name.lower()][:1]
    hint = f"Did you mean '{close[0]}'? " if close else ""
    return f"{hint}Valid: {', '.join(names) if names else '(none)'}"
