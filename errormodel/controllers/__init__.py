"""Controllers that take compensation tables: a plug-in registry, one class per file of this package."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from errormodel.controllers.base import instead, registry, target

__all__ = ["instead", "registry", "target"]


def __getattr__(name: str) -> Any:
    """Load the registry when it is first asked for: modules of this package are used by what it needs."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("errormodel.controllers.base"), name)
