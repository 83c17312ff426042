"""Reading of the ``effects`` block of ``machine.yaml``; each effect is evaluated on the machine as a check."""

from __future__ import annotations

import re
from collections.abc import Sequence

from errormodel.conventions import FRAME, INSTRUMENT, TOOL
from errormodel.effects import make, registry
from errormodel.exceptions import EffectError, InputError, nearest
from errormodel.machine import EffectSpec, Joint, Machine, Shape
from errormodel.yamlfile import Document, Keys, shown


def read_effect(document: Document, keys: Keys, elements: Sequence[Joint | Shape]) -> EffectSpec:
    """Read one entry of ``effects:``; of the effect's own keys only the names of elements are checked here."""
    options = dict(document.value_at(keys))
    if "effect" not in options:
        raise document.error((*keys, "effect"), "the key 'effect' is missing", "Write effect: and its name")
    effect = options.pop("effect")
    if not isinstance(effect, str) or effect not in registry():
        raise document.error((*keys, "effect"), f"unknown effect {shown(effect)}", nearest(str(effect), registry()))
    joints = [e.name for e in elements if isinstance(e, Joint)]
    shapes = [e.name for e in elements if isinstance(e, Shape)]
    places = {"joint": joints, "shape": shapes, "where": [*joints, *shapes, FRAME, TOOL, INSTRUMENT]}
    for key, names in places.items():
        value = options.get(key)
        if isinstance(value, str) and value not in names:
            raise document.error((*keys, key), f"'{value}' is not in the chain", nearest(value, names))
    return EffectSpec(effect, options)


def check_effect(document: Document, keys: Keys, spec: EffectSpec, machine: Machine) -> None:
    """Raise InputError, about the key at fault, if the effect does not suit this machine."""
    if spec.effect not in registry():
        return
    try:
        make(spec).channels(machine)
    except EffectError as error:
        raise document.error((*keys, error.key), error.found, error.cure) from error
    except InputError as error:  # an error of its terms names an element and not a key
        words = re.findall(r"\w+", f"{error.where} {error.found}")
        options = ((k, v) for k, own in spec.options.items() for v in (own if isinstance(own, list) else [own]))
        named = ((key, value) for key, value in options if isinstance(value, str) and value in words)
        key, value = next(named, ("effect", ""))
        found = error.found if value in error.found else f"'{value}': {error.found}"
        raise document.error((*keys, key), found, error.cure) from error
