"""Controllers that take compensation tables: a plug-in registry, one class per file of this package."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from errormodel.controllers.base import Target


@cache
def registry() -> Mapping[str, type[Target]]:
    """All controllers by name; a name that is registered twice raises an error."""
    from errormodel.controllers.base import Target
    from errormodel.discovery import by_word, classes

    found = by_word((kind.name, kind) for kind in classes(__name__, Target))  # type: ignore[type-abstract]
    return dict(sorted(found.items()))


def instead(kind: type[Target] | None = None) -> str:
    """What to use where a controller cannot hold the errors of a machine: words of those that hold any, with "or".

    Parameters
    ----------
    kind : `Controller` or `Rewriter`, to have those only.
    """
    return " or ".join(n for n, k in registry().items() if k.general and (kind is None or issubclass(k, kind)))


def target(name: str) -> Target:
    """Controller of a given name.

    Raises
    ------
    InputError
        There is no such controller.
    """
    from errormodel.exceptions import InputError, nearest

    if name not in registry():
        raise InputError(f"--controller {name}", "there is no such controller", nearest(name, registry()))
    return registry()[name]()
