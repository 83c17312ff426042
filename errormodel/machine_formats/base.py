"""A format in which others describe machines: reading into a Machine, and writing of its constant geometry.

A format is one class in one file of this package, or of a package from outside by the entry point
``errormodel.machine_formats``. What it writes it reads: every file is read back and compared before it is put in place.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import ClassVar

from errormodel.arrays import Array
from errormodel.conventions import MOTIONS
from errormodel.discovery import by_word, classes
from errormodel.exceptions import InputError, enumerated, nearest
from errormodel.machine import Basis, Joint, Machine, Shape, Vector
from errormodel.raw_formats.base import RawFile, open_raw, unreadable

LARGEST_DESCRIPTION = 20_000_000  # bytes; the largest published ones, with all their links, have 1 MB


@dataclass(frozen=True)
class Part:
    """Which part of a description is meant: the chain between two links; empty: all of it."""

    base: str = ""
    tip: str = ""


@dataclass(frozen=True)
class Description:
    """What was read: the chain in mm and rad, without error motions, and how it was read, as sentences."""

    name: str
    elements: tuple[Shape | Joint, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Written:
    """What was written.

    Attributes
    ----------
    text : of the file.
    notes : sentences.
    end : (4, 4) transformation from the last frame of the file to that of the machine, mm; None: they are one.
    """

    text: str
    notes: tuple[str, ...] = ()
    end: Array | None = field(default=None, compare=False)


@dataclass(frozen=True)
class Extras:
    """What a file may need beyond the chain: `heading` for a comment, `identity` as the format's own identifier."""

    heading: str = ""
    identity: str = ""


@dataclass(frozen=True)
class Template:
    """A description that is to be kept, but for its geometry.

    Attributes
    ----------
    raw : the file.
    part : the chain in it that is meant.
    nominal : the machine that was made of it, without errors.
    """

    raw: RawFile
    part: Part
    nominal: Machine


class MachineFormat(ABC):
    """What is common to the formats of descriptions.

    Attributes
    ----------
    name : word of ``--format``.
    title : what such a file is, as the end of "it does not look like ...".
    source : where the format is described.
    identified : whether it has an identifier of the robot.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    source: ClassVar[str]
    identified: ClassVar[bool] = False

    @classmethod
    @abstractmethod
    def recognises(cls, raw: RawFile) -> bool:
        """Whether a file is of this format, by its content."""

    @classmethod
    @abstractmethod
    def read(cls, raw: RawFile, part: Part) -> Description:
        """The chain that a file describes.

        Raises
        ------
        InputError
            Something in it is not understood, or is no serial chain.
        """

    @classmethod
    @abstractmethod
    def write(cls, machine: Machine, suffix: str, extras: Extras) -> Written:
        """Text that describes the nominal geometry of a machine.

        Parameters
        ----------
        machine : Machine
            Its error motions and effects are not written.
        suffix : of the file, such as ``.csv``, where a format has several forms.
        extras : what else the file may have.

        Raises
        ------
        InputError
            The format cannot hold such a machine.
        """

    @classmethod
    def rewrite(cls, machine: Machine, template: Template) -> Written:
        """The text of a file with the nominal geometry of a machine in place of its own.

        Raises
        ------
        InputError
            The format holds nothing but geometry, or the file is of another machine.
        """
        raise InputError("--into", f"{cls.title} holds nothing that is to be kept", "Leave --into out")


@lru_cache(maxsize=1)
def registry() -> dict[str, type[MachineFormat]]:
    """All formats of descriptions by their names."""
    kinds = classes("errormodel.machine_formats", MachineFormat)  # type: ignore[type-abstract]
    return by_word((kind.name, kind) for kind in kinds)


def format_named(name: str) -> type[MachineFormat]:
    """The format of that name.

    Raises
    ------
    InputError
        There is none.
    """
    if name not in registry():
        raise InputError("--format", f"'{name}'", nearest(name, registry()))
    return registry()[name]


def read_description(path: Path, name: str = "", part: Part | None = None) -> Description:
    """Read a description in the format of that name, or in the one that recognises it.

    Raises
    ------
    InputError
        No format recognises it, or something in it is wrong.
    """
    raw = open_raw(path, str(path))
    if len(raw.data) > LARGEST_DESCRIPTION:
        raise InputError(raw.name, f"longer than {LARGEST_DESCRIPTION} bytes", "Give the description of one machine")
    return described(raw, name, part or Part())


def described(raw: RawFile, name: str, part: Part) -> Description:
    """Like :func:`read_description`, of a file whose bytes are there already."""
    if raw.text is None:
        raise InputError(raw.name, unreadable(raw), f"Give a text file: {_titles()}")
    if name:
        return format_named(name).read(raw, part)
    found = [kind for kind in registry().values() if kind.recognises(raw)]
    if len(found) == 1:
        return found[0].read(raw, part)
    if found:
        names = " or ".join(kind.name for kind in found)
        raise InputError(raw.name, f"it may be read as {names}", f"Say which with --format {found[0].name}")
    first = next((line.strip() for line in raw.lines if line.strip()), "")[:60]
    raise InputError(raw.name, f"no description of a machine, beginning with '{first}'", f"Give {_titles()}")


def _titles() -> str:
    return enumerated([f"{kind.title} (--format {kind.name})" for kind in registry().values()], "or")


def identifiers(names: Collection[str], taken: Collection[str] = (), suffix: str = "_link") -> dict[str, str]:
    """Names as a machine's file may have them, each once: letters, digits and _; else unchanged."""
    out: dict[str, str] = {}
    used = set(taken)
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_]", "_", name) or "_"
        plain = f"_{plain}" if plain[0].isdigit() else plain
        while plain in used:
            plain += suffix
        used.add(plain)
        out[name] = plain
    return out


def with_errors(elements: tuple[Shape | Joint, ...]) -> tuple[Shape | Joint, ...]:
    """The chain with the error motions that an arm is calibrated by: constants of all members.

    Slides have what slides have by default, too.
    """
    from errormodel.joint_models import registry as models
    from errormodel.machine_file import MachineForm

    word = str(MachineForm.model_fields["errors"].default.joints)
    return tuple(
        replace(e, motions=MOTIONS)
        if isinstance(e, Shape)
        else replace(e, models={} if e.type == "rotary" else dict.fromkeys(models()[word].motions(e), Basis(word)))
        for e in elements
    )


def nominal(machine: Machine, tool: Vector | None = None) -> Machine:
    """The machine without error motions and effects."""
    elements = tuple(
        replace(e, motions=()) if isinstance(e, Shape) else replace(e, models={}) for e in machine.elements
    )
    return replace(machine, elements=elements, effects=(), tool=machine.tool if tool is None else tool)
