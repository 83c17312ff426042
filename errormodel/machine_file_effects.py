"""The ``effects`` block of ``machine.yaml``: each entry read, and tried on the machine before anything is computed."""

from __future__ import annotations

import re
from collections.abc import Sequence

from errormodel.conventions import FRAME, INSTRUMENT, TOOL
from errormodel.effects import make, registry
from errormodel.exceptions import EffectError, InputError, nearest
from errormodel.machine import EffectSpec, Joint, Machine, Shape
from errormodel.yamlfile import Document, Keys, shown


def read_effect(document: Document, keys: Keys, elements: Sequence[Joint | Shape]) -> EffectSpec:
    """One effect; its own keys are left to the effect, but for the names of elements."""
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
    """InputError if the effect cannot be that of this machine, about the key that says so."""
    if spec.effect not in registry():
        return
    try:
        make(spec).channels(machine)
    except EffectError as error:
        raise document.error((*keys, error.key), error.found, error.cure) from error
    except InputError as error:  # from its terms, which speak of an element and not of a key
        words = re.findall(r"\w+", f"{error.where} {error.found}")
        named = ((key, value) for key, value in spec.options.items() if isinstance(value, str) and value in words)
        key, value = next(named, ("effect", ""))
        found = error.found if value in error.found else f"'{value}': {error.found}"
        raise document.error((*keys, key), found, error.cure) from error
