"""Targets whose places in the last frame are not known exactly: their offsets are unknowns of the machine's model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from errormodel.effects.target_offset import TargetOffset
from errormodel.machine import EffectSpec, Machine
from errormodel.surveys.file import FileEntry, TargetPlace


def places_of(files: Sequence[FileEntry]) -> dict[str, TargetPlace]:
    """Targets that are near a place, or at it with a standard uncertainty; those known exactly are not among them.

    A target of one name has one place in all files, or is another one in each, named with its file.
    """
    out: dict[str, TargetPlace] = {}
    for entry in files:
        for name, target in entry.targets.items():
            if target.near is not None or target.sigma is not None:
                own = name if out.get(name, target) == target else f"{name} of {entry.path}"
                out[own] = target
    return out


def with_places(machine: Machine, places: Mapping[str, TargetPlace]) -> Machine:
    """The machine with an offset of each target whose place is not known exactly, as of `errormodel.effects`.

    A target that the machine has an offset of already is left to it.
    """
    known = [spec.options.get("tool") for spec in machine.effects if spec.effect == TargetOffset.effect]
    taken = [tuple(tool) for tool in known if isinstance(tool, list | tuple)]
    specs: list[EffectSpec] = []
    for name, target in places.items():
        if target.point not in taken:
            taken.append(target.point)
            options: dict[str, Any] = {"tool": [*target.point], "std": target.sigma or "unknown", "target": name}
            specs.append(EffectSpec(TargetOffset.effect, options))
    return replace(machine, effects=(*machine.effects, *specs)) if specs else machine
