"""Registry of physical effect models beyond the rigid error motions: one class per file of this package.

Files are imported by name (see `errormodel.discovery`), so a new effect needs no entry in any list.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pydantic import ValidationError

    from errormodel.effects.base import Effect
    from errormodel.machine import EffectSpec


@cache
def registry() -> Mapping[str, type[Effect]]:
    """All effect classes by their name in ``effects:``; two classes of one name are a programming error and raise."""
    from errormodel.discovery import by_word, classes
    from errormodel.effects.base import Effect

    return by_word((kind.effect, kind) for kind in classes(__name__, Effect))  # type: ignore[type-abstract]


def make(spec: EffectSpec) -> Effect:
    """Build the effect that an entry of ``effects:`` describes.

    Raises
    ------
    InputError
        The effect is not in the library, or a key of the entry is wrong.
    """
    from pydantic import ValidationError

    from errormodel.exceptions import EffectError, InputError, nearest

    if spec.effect not in registry():
        raise InputError(f"effect {spec.effect}", "it is not in the library yet", nearest(spec.effect, registry()))
    kind = registry()[spec.effect]
    try:
        return kind.model_validate(dict(spec.options))
    except ValidationError as error:
        key, found, cure = _wrong(kind, error)
        raise EffectError(f"effect {spec.effect}, key {key}", found, cure, key) from error


def _wrong(kind: type[Effect], error: ValidationError) -> tuple[str, str, str]:
    """Key of a faulty entry, the value found there, and the correction to print."""
    import re

    from errormodel.exceptions import nearest
    from errormodel.yamlfile import flow, shown

    details = error.errors(include_url=False)
    # a misspelt key is both unknown and missing: the unknown one can be named
    first = next((d for d in details if d["type"] == "extra_forbidden"), details[0])
    key, example = str(next(iter(first["loc"]), "effect")), flow({"effect": kind.effect, **kind.example})
    write = f"Example: {example}. Its keys: {', '.join(kind.model_fields)}"
    if first["type"] == "missing":
        return key, f"of {kind.effect} the key '{key}' is missing", write
    if first["type"] == "extra_forbidden":
        return key, f"unknown key '{key}'", f"{nearest(key, kind.model_fields)}. {write}"
    words = re.findall(r"'([^']*)'", str(first.get("ctx", {}).get("expected", "")))
    if words:
        return key, shown(first["input"]), f"{nearest(str(first['input']), words)}. {write}"
    own = first["type"] == "value_error"  # a sentence of the effect's
    rule = first["msg"].removeprefix("Value error, ") if own else first["msg"].partition(",")[0]
    rule = rule.replace("Input should be", "It must be").replace("a valid tuple", "a list in brackets, [ ]")
    return key, shown(first["input"]) if first["loc"] else "keys that contradict each other", f"{rule}. {write}"
