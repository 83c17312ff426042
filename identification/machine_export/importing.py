"""A description of others as a machine with the error motions that it is calibrated by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from errormodel.exceptions import InputError
from errormodel.machine import Joint, Machine, Shape, Vector
from errormodel.machine_file import machine_text, resolve
from errormodel.machine_formats.base import Part, read_description, with_errors
from errormodel.yamlfile import parse


def imported(
    path: Path, form: str, base: str, tip: str, tool: Vector, joints: Sequence[str], name: str
) -> tuple[Machine, tuple[str, ...]]:
    """The machine, and how its description was read.

    Raises
    ------
    InputError
        The file cannot be read, or its names or numbers are none of a machine's file.
    """
    found = read_description(path, form, Part(base, tip))
    elements = _named(found.elements, joints) if joints else found.elements
    machine = Machine(name or found.name, with_errors(elements), tool, notes=f"Read from {path.name}.")
    document = parse(machine_text(machine), f"{path}, as a machine file")
    try:
        return resolve(document), found.notes
    except InputError as error:
        raise InputError(
            error.where, error.found, f"{error.cure}. Names of joints can be given with --joints"
        ) from error


def _named(elements: tuple[Shape | Joint, ...], names: Sequence[str]) -> tuple[Shape | Joint, ...]:
    """The chain with other names of its joints."""
    own = [e.name for e in elements if isinstance(e, Joint)]
    if len(names) != len(own) or len({*names}) < len(names) or not all(names):
        found = f"{len(names)} names ({', '.join(names)}) for {len(own)} joints ({', '.join(own)})"
        raise InputError("--joints", found, "Give each joint of the chain a name of its own")
    fresh = iter(names)
    members = {e.name for e in elements if isinstance(e, Shape)}
    return tuple(
        replace(e, name=next(fresh))
        if isinstance(e, Joint)
        else replace(e, name=_free(e.name, members | {*names}) if e.name in names else e.name)
        for e in elements
    )


def _free(name: str, taken: set[str]) -> str:
    while name in taken:
        name += "_link"
    return name
