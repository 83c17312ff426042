"""Standards of tests: a plug-in registry, one class a file of this package, found by its ``number``.

A standard takes a survey, a fitted model, or both, and returns quantities with their uncertainties, tables and charts.
Other distributions add classes by the entry point group ``identification.iso_standards``.
"""

from __future__ import annotations

from functools import cache

from errormodel.discovery import by_word, classes
from errormodel.exceptions import InputError, nearest
from identification.iso_standards.base import Standard


@cache
def registry() -> dict[str, type[Standard]]:
    """All standards by their numbers."""
    kinds = (kind for kind in classes(__name__, Standard) if kind is not Standard)
    return dict(sorted(by_word((kind.number, kind) for kind in kinds).items()))


def standards(text: str) -> list[Standard]:
    """The standards of numbers with commas between; none of them twice."""
    found = {kind.number: kind for kind in map(standard, text.split(","))}
    return list(found.values())


def standard(number: str) -> Standard:
    """The standard of a number, however it is spelled: ``230-2``, ``ISO 230-2``, ``ISO 230-2:2014``.

    Raises
    ------
    InputError
        There is none of that number.
    """
    plain = number.strip().upper().removeprefix("ISO").strip(" -_/").partition(":")[0].lower()
    if plain not in registry():
        raise InputError("STANDARD", f"there is no standard '{number}'", nearest(plain, [*registry(), "list"]))
    return registry()[plain]()
