"""Physics beyond the rigid error motions: one class a file, found by itself."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from errormodel.effects.base import Effect
    from errormodel.machine import EffectSpec


@cache
def registry() -> Mapping[str, type[Effect]]:
    """Every effect by its word. Registering a word twice is a mistake of the project's own and raises."""
    import importlib
    import pkgutil

    from errormodel.effects.base import Effect

    found: dict[str, type[Effect]] = {}
    for module in pkgutil.iter_modules(__path__):
        for value in vars(importlib.import_module(f"{__name__}.{module.name}")).values():
            concrete = isinstance(value, type) and issubclass(value, Effect) and hasattr(value, "effect")
            if concrete and value.__module__ == f"{__name__}.{module.name}":
                if value.effect in found:
                    raise RuntimeError(f"effect {value.effect} is defined twice")
                found[value.effect] = value
    return found


def make(spec: EffectSpec) -> Effect:
    """The effect of an entry of ``effects:``.

    Raises
    ------
    InputError
        The effect is not in the library, or a key of the entry is wrong.
    """
    from pydantic import ValidationError

    from errormodel.exceptions import InputError, nearest

    if spec.effect not in registry():
        raise InputError(f"effect {spec.effect}", "it is not in the library yet", nearest(spec.effect, registry()))
    kind = registry()[spec.effect]
    try:
        return kind.model_validate(dict(spec.options))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(k) for k in first["loc"]) or "its keys"
        raise InputError(
            f"effect {spec.effect}, key {key}",
            f"{first['msg'].lower()} (found {first.get('input')!r})",
            f"Example: {dict(kind.example)}; keys: {', '.join(kind.model_fields)}",
        ) from error
