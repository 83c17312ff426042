"""Controllers that take compensation tables: one class a file, found by itself."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from errormodel.controllers.base import Target


@cache
def registry() -> Mapping[str, type[Target]]:
    """Every controller by its word. Registering a word twice is a mistake of the project's own and raises."""
    import importlib
    import inspect
    import pkgutil

    from errormodel.controllers.base import Target

    found: dict[str, type[Target]] = {}
    for module in pkgutil.iter_modules(__path__):
        for value in vars(importlib.import_module(f"{__name__}.{module.name}")).values():
            own = isinstance(value, type) and value.__module__ == f"{__name__}.{module.name}"
            if own and issubclass(value, Target) and not inspect.isabstract(value):
                if value.name in found:
                    raise RuntimeError(f"controller {value.name} is defined twice")
                found[value.name] = value
    return dict(sorted(found.items()))


def target(name: str) -> Target:
    """The controller of that name.

    Raises
    ------
    InputError
        There is none.
    """
    from errormodel.exceptions import InputError, nearest

    if name not in registry():
        raise InputError(f"--controller {name}", "there is no such controller", nearest(name, registry()))
    return registry()[name]()
