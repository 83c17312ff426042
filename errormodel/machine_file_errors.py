"""Reading and writing of the ``errors`` block of ``machine.yaml``: the error motions that are parameters.

``shapes`` lists the constant motions of each shape, ``joints`` the model of each joint's motions over its position.
Motions that a present block does not list are no parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

from errormodel.conventions import MOTIONS, Motion, iso_symbol, motion_of_iso
from errormodel.exceptions import enumerated, nearest
from errormodel.machine import Basis, Joint, Shape
from errormodel.yamlfile import Document, Keys, shown

if TYPE_CHECKING:
    from errormodel.joint_models.base import JointModel

LARGEST = 50  # of the number that a model may have
_WORDS: dict[str, tuple[Motion, ...]] = {"all": MOTIONS, "none": ()}

Models = dict[Motion, Basis]


def _models() -> Mapping[str, type[JointModel]]:
    from errormodel.joint_models import registry

    return registry()


def _counted() -> list[str]:
    """Words of the models that have a number."""
    return [word for word, model in _models().items() if model.counts]


def _words() -> list[str]:
    """What may stand where a model belongs."""
    return ["none", *_models()]


def _cure() -> str:
    """What to write: every model as in an example."""
    forms = [f"{{{word}: {m.example}}}" if m.counts else word for word, m in _models().items()]
    return f"Write {enumerated(['none', *forms], 'or')}"


def read_shapes(document: Document, keys: Keys, shapes: Sequence[Shape]) -> dict[str, tuple[Motion, ...]]:
    """Error motions of each shape by name, from the value at `keys`."""
    value = document.value_at(keys)
    if isinstance(value, str) and value in _WORDS:
        return {shape.name: _WORDS[value] for shape in shapes}
    if not isinstance(value, dict):
        raise document.error(keys, shown(value), "Write all, none or motions by shape such as {T1: [dx, ea], T2: all}")
    _check_names(document, keys, "shape", [shape.name for shape in shapes])
    listed = {name: _shape_motions(document, (*keys, name)) for name in value}
    return {shape.name: listed.get(shape.name, ()) for shape in shapes}


def _check_names(document: Document, keys: Keys, kind: str, names: Sequence[str]) -> None:
    for name in document.value_at(keys):
        if name not in names:
            raise document.error((*keys, name), f"the chain has no {kind} '{name}'", nearest(name, names))


def _shape_motions(document: Document, keys: Keys) -> tuple[Motion, ...]:
    value = document.value_at(keys)
    if isinstance(value, str) and value in _WORDS:
        return _WORDS[value]
    if not isinstance(value, list):
        raise document.error(keys, shown(value), "Write all, none or a list of motions such as [dx, ea]")
    for i, motion in enumerate(value):
        if motion not in MOTIONS:
            raise document.error((*keys, i), f"{shown(motion)} is no error motion", nearest(str(motion), MOTIONS))
    return tuple(motion for motion in MOTIONS if motion in value)


def read_joints(document: Document, keys: Keys, joints: Sequence[Joint]) -> dict[str, Models]:
    """Models of each joint by name, from the value at `keys`."""
    value = document.value_at(keys)
    names, families = [joint.name for joint in joints], _counted()
    family = isinstance(value, dict) and len(value) == 1 and next(iter(value)) in {*families} - {*names}
    if family or not isinstance(value, dict):  # one model for all joints
        return {joint.name: _spread(joint, _basis(document, keys, joint)) for joint in joints}
    for key, model in value.items():
        near = bool(get_close_matches(key, families, n=1))
        if key not in names and (near or isinstance(model, int | float)):  # a model of all joints, misspelt
            raise document.error((*keys, key), f"unknown model '{key}'", f"{nearest(key, _words())}. {_cure()}")
    _check_names(document, keys, "joint", names)
    return {j.name: _joint_models(document, (*keys, j.name), j) if j.name in value else {} for j in joints}


def _joint_models(document: Document, keys: Keys, joint: Joint) -> Models:
    value = document.value_at(keys)
    if not isinstance(value, dict):
        return _spread(joint, _basis(document, keys, joint))
    families = _counted()
    whole = [key for key in value if key == "all" or key in families]
    if len(whole) > 1:
        raise document.error((*keys, whole[1]), f"a second model of all motions, after '{whole[0]}'", "Write one")
    models: Models = {}
    if whole == ["all"]:
        models = _spread(joint, _basis(document, (*keys, "all"), joint))
    elif whole:
        models = _spread(joint, _family(document, (*keys, whole[0]), joint))
    seen: dict[Motion, str] = {}
    for key in value:
        if key in whole:
            continue
        motion = next((m for m in MOTIONS if m == key.lower()), None) or motion_of_iso(key, joint.name)
        if motion is None:
            symbols = [iso_symbol(joint.name, m) for m in MOTIONS]
            valid = ["all", *families, *(s.lower() if key.islower() else s for s in symbols)]
            raise document.error((*keys, key), f"'{key}' is no error motion of {joint.name}", nearest(key, valid))
        if motion in seen:
            found = f"a second model of {motion}, after '{seen[motion]}'"
            raise document.error((*keys, key), found, "Write one of the two")
        seen[motion] = key
        models.pop(motion, None)
        basis = _basis(document, (*keys, key), joint)
        if basis is not None:
            models[motion] = _checked(document, (*keys, key), joint, motion, basis)
    return {motion: models[motion] for motion in MOTIONS if motion in models}


def _checked(document: Document, keys: Keys, joint: Joint, motion: Motion, basis: Basis) -> Basis:
    model = _models()[basis.kind]
    if motion not in model.motions(joint):
        raise document.error(keys, *model.refused(joint, motion))
    return basis


def _spread(joint: Joint, basis: Basis | None) -> Models:
    """One model for all motions of a joint that can have it."""
    return {} if basis is None else dict.fromkeys(_models()[basis.kind].motions(joint), basis)


def _basis(document: Document, keys: Keys, joint: Joint) -> Basis | None:
    """One model as written at `keys`; None for ``none``."""
    value = document.value_at(keys)
    if value == "none":
        return None
    if isinstance(value, dict) and len(value) == 1:
        family = next(iter(value))
        if family not in _counted():
            raise document.error((*keys, family), f"unknown model '{family}'", nearest(family, _counted()))
        return _family(document, (*keys, family), joint)
    if isinstance(value, str):
        model = _models().get(value)
        if model is None:
            raise document.error(keys, f"unknown model '{value}'", f"{nearest(value, _words())}. {_cure()}")
        if model.counts:
            raise document.error(keys, f"'{value}' without a number", f"Write {{{value}: {model.example}}}")
        return _suited(document, keys, joint, Basis(value))
    raise document.error(keys, shown(value), _cure())


def _family(document: Document, keys: Keys, joint: Joint) -> Basis:
    """The model whose name is the last of `keys` and whose order stands there."""
    family, n = str(keys[-1]), document.value_at(keys)
    if isinstance(n, bool) or not isinstance(n, int) or not 1 <= n <= LARGEST:
        cure = f"Write {family}: n with a whole number n from 1 to {LARGEST}, the {_models()[family].counts}"
        raise document.error(keys, shown(n), cure)
    return _suited(document, keys, joint, Basis(family, n))


def _suited(document: Document, keys: Keys, joint: Joint, basis: Basis) -> Basis:
    """The model, if the joint's type can have it."""
    if joint.type not in _models()[basis.kind].joints:
        others = [word for word in _counted() if joint.type in _models()[word].joints]
        found = f"{basis.kind} of the {joint.type} joint {joint.name}"
        raise document.error(keys, found, f"Write {' or '.join(others)}")
    return basis


def written_shapes(shapes: Sequence[Shape]) -> Any:
    """The value of ``errors.shapes`` that :func:`read_shapes` reads as these shapes' motions."""
    each = {shape.name: _written_motions(shape.motions) for shape in shapes}
    for word in ("all", "none"):
        if all(value == word for value in each.values()):
            return word
    return {name: value for name, value in each.items() if value != "none"}


def _written_motions(motions: Sequence[Motion]) -> Any:
    return "all" if set(motions) == set(MOTIONS) else list(motions) or "none"


def written_joints(joints: Sequence[Joint]) -> Any:
    """The value of ``errors.joints`` that :func:`read_joints` reads as these joints' models."""
    return {joint.name: _written_models(joint) for joint in joints} or "none"


def _written_models(joint: Joint) -> Any:
    models: Mapping[Motion, Basis] = joint.models
    if not models:
        return "none"
    for basis in models.values():  # one model for all motions, if any of those present is that
        if models == _spread(joint, basis):
            return _written_basis(basis)
    return {iso_symbol(joint.name, motion): _written_basis(basis) for motion, basis in models.items()}


def _written_basis(basis: Basis) -> Any:
    return {basis.kind: basis.n} if _models()[basis.kind].counts else basis.kind
