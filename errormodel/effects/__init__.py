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
    from errormodel.discovery import by_word, classes
    from errormodel.effects.base import Effect

    return by_word((kind.effect, kind) for kind in classes(__name__, Effect))  # type: ignore[type-abstract]


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
