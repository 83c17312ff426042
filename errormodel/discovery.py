"""How a package finds what its files define: a new class in a new file is there without being listed anywhere.

Other packages bring classes of their own by an entry point whose group is the name of the package here, such as
``errormodel.effects``, and whose value is their module.
"""

from __future__ import annotations

import inspect
import pkgutil
from collections.abc import Iterable, Iterator
from importlib import import_module
from importlib.metadata import entry_points
from typing import TypeVar

T = TypeVar("T")


def classes(package: str, kind: type[T]) -> Iterator[type[T]]:
    """Concrete classes of a kind that the modules of a package define themselves, in the order of the files.

    Those of other packages come last, in the order of their modules' names.
    """
    for name in modules(package):
        for value in vars(import_module(name)).values():
            own = isinstance(value, type) and value.__module__ == name
            if own and issubclass(value, kind) and not inspect.isabstract(value):
                yield value


def modules(package: str) -> list[str]:
    """Names of the modules of a package, and of those that other packages name as entry points of that group."""
    inside = pkgutil.iter_modules(import_module(package).__path__)
    outside = {point.value.partition(":")[0] for point in entry_points(group=package)}
    return [f"{package}.{module.name}" for module in inside] + sorted(outside)


def by_word(pairs: Iterable[tuple[str, type[T]]]) -> dict[str, type[T]]:
    """Classes by their words. Two of one word are a mistake of the project's own and raise."""
    found: dict[str, type[T]] = {}
    for word, value in pairs:
        if word in found:
            raise RuntimeError(f"{word} is defined twice, by {found[word].__module__} and {value.__module__}")
        found[word] = value
    return found
