"""Discovery of plug-in classes: a class in a new file of a package is found without an entry in any list.

Other distributions add classes by an entry point whose group is the package's name here, such as
``errormodel.effects``, and whose value is their module.
"""

from __future__ import annotations

import inspect
import pkgutil
import sys
from collections.abc import Iterable, Iterator
from functools import lru_cache
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any, TypeVar

T = TypeVar("T")


def classes(package: str, kind: type[T]) -> Iterator[type[T]]:
    """Concrete subclasses of `kind` that the modules of a package define, in the order of the files.

    Classes of other distributions come last, in the order of their modules' names.
    """
    for name in modules(package):
        for value in vars(import_module(name)).values():
            own = isinstance(value, type) and value.__module__ == name
            if own and issubclass(value, kind) and not inspect.isabstract(value):
                yield value


def modules(package: str) -> list[str]:
    """Module names of a package, and of the entry points of other distributions in that group."""
    inside = pkgutil.iter_modules(import_module(package).__path__)
    outside = {point.value.partition(":")[0] for point in _installed(tuple(sys.path)).select(group=package)}
    return [f"{package}.{module.name}" for module in inside] + sorted(outside)


@lru_cache(maxsize=1)
def _installed(path: tuple[str, ...]) -> Any:
    """The entry points of all distributions on a path: finding them takes as long as loading many modules."""
    return entry_points()


def by_word(pairs: Iterable[tuple[str, type[T]]]) -> dict[str, type[T]]:
    """Classes by their names in files; two classes of one name are a programming error and raise."""
    found: dict[str, type[T]] = {}
    for word, value in pairs:
        if word in found:
            raise RuntimeError(f"{word} is defined twice, by {found[word].__module__} and {value.__module__}")
        found[word] = value
    return found
