"""Reading and writing of ``machine.yaml``, the file form of :class:`~errormodel.machine.Machine`.

A file may use any units and short forms; a Machine is in mm and rad with everything resolved. An axis with two drives
is one joint with ``drives: [Y1, Y2]``, its columns in a survey, and their ``spacing`` (`errormodel.drives`).
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from errormodel import machine_file_errors as errorblock
from errormodel.conventions import FRAME, INSTRUMENT, TOOL
from errormodel.exceptions import InputError, nearest
from errormodel.files import write_text_atomic
from errormodel.machine import Joint, Machine, Shape, Vector
from errormodel.machine_file_effects import check_effect, read_effect
from errormodel.machine_library import library
from errormodel.machine_plausibility import check_degrees, doubts
from errormodel.serial_chain import check_line, check_words
from errormodel.units import UnitsBlock, factor
from errormodel.yamlfile import (
    Document,
    FileModel,
    Keys,
    Number,
    Vector3,
    VersionedModel,
    load,
    parse,
    shown,
    validate,
)

MACHINE_FILE = "machine.yaml"
INCH = 25.4  # mm
# Names of survey columns; a joint of such a name would be indistinguishable from them.
_COLUMN_WORDS = """
    mx my mz mrx mry mrz tool_x tool_y tool_z run time feed load sigma sigma_x sigma_y sigma_z
    joint dx dy dz ea eb ec
"""
_RESERVED_COLUMNS = frozenset(_COLUMN_WORDS.split())
_COLUMN_PREFIXES = ("T_", "w_", "dir_")

LEAST_SPACING_SHARE = 0.01  # of the travel: drives of one axis are not so close together
# most entries, of which a description takes a few seconds; machines have some twenty elements and a few effects
MOST_ELEMENTS, MOST_EFFECTS = 150, 200
LONGEST_NAME = 200  # characters of a machine's name, which stands in titles; by judgement
_NAME_RULE = "a name of letters, digits and _, such as X or T1"
_AXIS_WORDS = {sign + "xyz"[i]: i for i in range(3) for sign in ("", "+", "-")}  # words for an axis, with its index


class _JointEntry(FileModel):
    joint: str = Field(description=_NAME_RULE)
    type: Literal["prismatic", "rotary"] = Field(description="prismatic or rotary")
    axis: Any = Field(description="x, y or z, or -x, -y or -z, or a unit vector such as [0, 0.6, 0.8]")
    travel: Annotated[list[Number], Field(min_length=2, max_length=2)] = Field(
        description="the lowest and the highest position, such as [-400, 400]"
    )
    drives: Annotated[list[str], Field(min_length=2, max_length=2)] | None = Field(
        None,
        description="the columns of the two drives of one axis, such as [Y1, Y2]; their mean is its position",
    )
    spacing: Annotated[Number, Field(gt=0)] | None = Field(
        None, description="the distance between the two drives, above 0, such as 1200"
    )


class _ShapeEntry(FileModel):
    shape: str = Field(description=_NAME_RULE)
    offset: Vector3 = Field([0.0, 0.0, 0.0], description="three numbers, such as [0, 0, 150]")
    rotation: Vector3 = Field([0.0, 0.0, 0.0], description="three angles about x, y, z, such as [0, 0, 90]")


class _ErrorsBlock(FileModel):
    shapes: Any = "none"  # motions that a present block does not list are no parameters
    joints: Any = "none"


class MachineForm(VersionedModel):
    """``machine.yaml``."""

    name: Annotated[str, Field(max_length=LONGEST_NAME)] | None = Field(
        None, description=f"the machine's name, in quotes if need be, of at most {LONGEST_NAME} characters"
    )
    units: UnitsBlock = Field(UnitsBlock(), description="units such as {length: mm, angle: deg}")
    chain: Annotated[list[dict[str, Any]], Field(min_length=1, max_length=MOST_ELEMENTS)] = Field(
        description=f"the joints and shapes from the workpiece to the tool, at most {MOST_ELEMENTS}, each a line such "
        "as "
        "- {joint: X, type: prismatic, axis: x, travel: [0, 500]} or - {shape: T1, offset: [0, 0, 100]}"
    )
    tool: Vector3 = Field(
        [0.0, 0.0, 0.0], description="three numbers, the functional point in the last frame, such as [0, 0, -150]"
    )
    errors: _ErrorsBlock = Field(
        _ErrorsBlock(shapes="all", joints="first-order"),
        description="such as {shapes: all, joints: {X: first-order}}",
    )
    effects: Annotated[list[dict[str, Any]], Field(max_length=MOST_EFFECTS)] | None = Field(
        None, description=f"a list of at most {MOST_EFFECTS}, such as [{{effect: ram-sag, joint: W}}]"
    )
    notes: str | None = Field(None, description="text, in quotes if need be")
    source: str | None = Field(None, description="text, in quotes if need be")


def read_machine(source: str | Path | Mapping[str, Any]) -> Machine:
    """Read a machine and check that its effects suit it; implausible entries are listed in its ``doubts``.

    Parameters
    ----------
    source : str, Path or mapping
        A file, a folder with ``machine.yaml``, a name of the library, or the content of such a file as a dict.

    Returns
    -------
    Machine
        The chain, its error models and effects, in mm and rad.

    Raises
    ------
    InputError
        There is no such machine, its file is invalid, or it is no serial chain.

    Examples
    --------
    >>> from errormodel import read_machine
    >>> [joint.name for joint in read_machine("vertical_three_axis").joints]
    ['X', 'Y', 'Z']
    """
    document = _document(source)
    machine = resolve(document)
    check_line(document, machine.elements)
    check_degrees(document, machine.elements)
    for i, spec in enumerate(machine.effects):
        check_effect(document, ("effects", i), spec, machine)
    return replace(machine, doubts=tuple(doubts(document, machine.elements)))


def _document(source: str | Path | Mapping[str, Any]) -> Document:
    if isinstance(source, str | Path):
        return load(_find(source))
    return parse(json.dumps(source, default=str), "machine")


def _find(name_or_path: str | Path) -> Path:
    path, name = Path(name_or_path), str(name_or_path)
    try:
        if (path / MACHINE_FILE).is_file():
            return path / MACHINE_FILE
        is_folder = path.is_dir()
        if path.exists() and not is_folder:
            return path
    except (OSError, ValueError):  # a name too long, or with a NUL
        is_folder = False
    machines = library()
    if name in machines:
        return machines[name]
    if is_folder:
        raise InputError(
            name, f"a folder without {MACHINE_FILE}", f"Give a folder that holds {MACHINE_FILE}, or a file"
        )
    cure = f"Give a file, or a machine of the library. {nearest(path.stem, machines)}"
    raise InputError(shown(name).strip("'"), "no such file, and no machine of the library", cure)


def resolve(document: Document) -> Machine:
    """Machine that a parsed ``machine.yaml`` describes, in mm and rad."""
    check_words(document, MachineForm.model_fields)
    file = validate(document, MachineForm)
    length, angle = factor(file.units.length, "length"), factor(file.units.angle, "angle")
    elements = [_element(document, ("chain", i), length, angle) for i in range(len(file.chain))]
    _check_names(document, elements)
    path = Path(document.name)
    return Machine(
        name=file.name if file.name is not None else path.parent.name if path.name == MACHINE_FILE else path.stem,
        elements=_with_errors(document, file.errors, elements),
        tool=_vector(document, ("tool",), file.tool, length),
        effects=tuple(read_effect(document, ("effects", i), elements) for i in range(len(file.effects or ()))),
        source=path,
        notes="\n".join(text for text in (file.notes, file.source) if text),
        inches=abs(length - INCH) < 1e-9,
    )


def _element(document: Document, keys: Keys, length: float, angle: float) -> Joint | Shape:
    entry = document.value_at(keys)
    if ("joint" in entry) == ("shape" in entry):
        found = "both 'joint' and 'shape'" if "joint" in entry else f"neither 'joint' nor 'shape' in {shown(entry)}"
        raise document.error(keys, found, "Write either 'joint: NAME' or 'shape: NAME'")
    if "shape" in entry:
        shape = validate(document, _ShapeEntry, keys)
        offset = _vector(document, (*keys, "offset"), shape.offset, length)
        return Shape(shape.shape, offset, _vector(document, (*keys, "rotation"), shape.rotation, angle))
    joint = validate(document, _JointEntry, keys)
    low, high = joint.travel
    if not low < high:
        cure = f"Write travel: [{high:g}, {low:g}]" if low > high else "Write the lowest and the highest position"
        raise document.error((*keys, "travel"), f"[{low:g}, {high:g}], which does not rise", cure)
    scaled = _scaled(document, (*keys, "travel"), joint.travel, length if joint.type == "prismatic" else angle)
    drives, spacing = _drives(document, keys, joint), None
    if joint.spacing is not None:
        spacing = _scaled(document, (*keys, "spacing"), [joint.spacing], length)[0]
        if joint.type == "prismatic" and spacing < LEAST_SPACING_SHARE * (scaled[1] - scaled[0]):
            found = f"{spacing:.6g} mm between two drives of an axis that travels {scaled[1] - scaled[0]:.6g} mm"
            raise document.error((*keys, "spacing"), found, "Write the distance of the drives in the file's unit")
    axis = _axis(document, (*keys, "axis"))
    return Joint(joint.joint, joint.type, axis, (scaled[0], scaled[1]), drives=drives, spacing=spacing)


def _drives(document: Document, keys: Keys, joint: _JointEntry) -> tuple[str, ...]:
    """Columns of a joint's two drives; empty for a joint with one drive."""
    if joint.drives is None:
        if joint.spacing is not None:
            raise document.error((*keys, "spacing"), "a distance of drives without drives", "Write drives: [Y1, Y2]")
        return ()
    if joint.type != "prismatic":
        raise document.error((*keys, "drives"), f"two drives of the rotary joint {joint.joint}", "Remove the key")
    return tuple(joint.drives)


def _scaled(document: Document, keys: Keys, values: Sequence[float], unit: float) -> list[float]:
    scaled = [value * unit for value in values]
    if not all(map(math.isfinite, scaled)):
        raise document.error(keys, shown(list(values)), "Write numbers of a machine's size")
    return scaled


def _vector(document: Document, keys: Keys, values: Sequence[float], unit: float) -> Vector:
    x, y, z = _scaled(document, keys, values, unit)
    return x, y, z


def _axis(document: Document, keys: Keys) -> Vector:
    value = document.value_at(keys)
    if isinstance(value, str):
        if value not in _AXIS_WORDS:
            cure = nearest(value, (name for name in _AXIS_WORDS if not name.startswith("+")))
            raise document.error(keys, f"unknown axis '{value}'", f"{cure}, or a unit vector such as [0, 0.6, 0.8]")
        sign = -1.0 if value.startswith("-") else 1.0
        x, y, z = (sign if i == _AXIS_WORDS[value] else 0.0 for i in range(3))
        return x, y, z
    if not isinstance(value, list) or len(value) != 3 or not all(map(_moderate, value)):
        raise document.error(keys, shown(value), "Write x, y or z, or a unit vector such as [0, 0.6, 0.8]")
    size = math.hypot(*value)
    if size == 0:
        raise document.error(keys, shown(value), "Write a vector of length 1, such as [0, 0.6, 0.8]")
    x, y, z = (v / size for v in value)
    if abs(size - 1) > 1e-6:
        cure = f"Write axis: [{x:.9g}, {y:.9g}, {z:.9g}]"
        raise document.error(keys, f"{shown(value)}, of length {size:.6g} and not 1", cure)
    return x, y, z


def _moderate(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e9


def _check_names(document: Document, elements: Sequence[Joint | Shape]) -> None:
    places: dict[str, Keys] = {}
    for keys, name in _names(elements):
        if not re.fullmatch("[A-Za-z_][A-Za-z0-9_]*", name):
            raise document.error(keys, shown(name), f"Write {_NAME_RULE}, beginning with a letter")
        if name in places:
            found = f"the name '{name}' is already taken in line {document.line_of(places[name])}"
            raise document.error(keys, found, "Write another name")
        places[name] = keys
        shape = keys[-1] == "shape"
        # a shape may be named `frame`, as in some published machines: a shape is no column
        column = not shape and (name in _RESERVED_COLUMNS or name.startswith(_COLUMN_PREFIXES))
        if column or name in (TOOL, INSTRUMENT) or (not shape and name == FRAME):
            what = "a column of a survey" if column else "a place of its own"
            raise document.error(keys, f"the name '{name}', which is {what}", f"Write another name, such as {name}1")
    if not any(isinstance(element, Joint) for element in elements):
        cure = "Add at least one, such as - {joint: X, type: prismatic, axis: x, travel: [0, 500]}"
        raise document.error(("chain",), "no joint in the chain", cure)


def _names(elements: Sequence[Joint | Shape]) -> Iterator[tuple[Keys, str]]:
    """Names in the chain, including those of drives, with their keys in the file."""
    for i, element in enumerate(elements):
        yield ("chain", i, "joint" if isinstance(element, Joint) else "shape"), element.name
        if isinstance(element, Joint):
            yield from ((("chain", i, "drives", k), drive) for k, drive in enumerate(element.drives))


def _with_errors(
    document: Document, block: _ErrorsBlock, elements: Sequence[Joint | Shape]
) -> tuple[Joint | Shape, ...]:
    full = replace(document, data={**document.data, "errors": block.model_dump()})  # with defaults for missing keys
    motions = errorblock.read_shapes(full, ("errors", "shapes"), [e for e in elements if isinstance(e, Shape)])
    models = errorblock.read_joints(full, ("errors", "joints"), [e for e in elements if isinstance(e, Joint)])
    return tuple(
        replace(e, motions=motions[e.name]) if isinstance(e, Shape) else replace(e, models=models[e.name])
        for e in elements
    )


def write_machine(machine: Machine, path: str | Path) -> None:
    """Write a machine as ``machine.yaml`` (mm, deg); its text is read back first, and the file replaced atomically.

    Parameters
    ----------
    machine : Machine
    path : str or Path

    Raises
    ------
    InputError
        The file cannot be written.
    """
    text = machine_text(machine)
    resolve(parse(text, str(path)))
    write_text_atomic(text, path)


def machine_text(machine: Machine) -> str:
    """Text of a ``machine.yaml`` from which the same machine is read."""
    from ruamel.yaml import YAML

    block: dict[str, Any] = {"errormodel": 1, "name": machine.name, "units": {"length": "mm", "angle": "deg"}}
    if machine.notes:
        block["notes"] = machine.notes
    block["chain"] = [_written(element) for element in machine.elements]
    block["tool"] = machine.tool
    block["errors"] = {
        "shapes": errorblock.written_shapes(machine.shapes),
        "joints": errorblock.written_joints(machine.joints),
    }
    if machine.effects:
        block["effects"] = [{"effect": spec.effect, **spec.options} for spec in machine.effects]
    yaml, stream = YAML(), StringIO()
    yaml.width = 120
    yaml.indent(mapping=2, sequence=4, offset=2)
    yaml.dump({key: _laid_out(value, _BLOCK_LEVELS.get(key, 0)) for key, value in block.items()}, stream)
    return stream.getvalue()


_BLOCK_LEVELS = {"chain": 1, "effects": 1, "errors": 2}  # levels written one entry per line; deeper ones on one line


def _laid_out(value: Any, levels: int) -> Any:
    """Plain data as nodes of ruamel.yaml: `levels` block levels, then ``{...}`` and ``[...]``."""
    from ruamel.yaml.comments import CommentedMap, CommentedSeq
    from ruamel.yaml.scalarstring import DoubleQuotedScalarString

    if isinstance(value, str):  # line ends would be lost in another style
        plain = value.isprintable() and not value.startswith((":", "?"))  # which would be read as part of a mapping
        return value if plain else DoubleQuotedScalarString(value)
    if hasattr(value, "tolist"):  # NumPy values in the options of an effect
        value = value.tolist()
    if not isinstance(value, Mapping | Sequence):
        whole = isinstance(value, float) and value.is_integer() and abs(value) < 1e15
        return int(value) if whole else value
    node: Any = CommentedMap() if isinstance(value, Mapping) else CommentedSeq()
    if isinstance(value, Mapping):
        node.update({_laid_out(key, 0): _laid_out(item, levels - 1) for key, item in value.items()})
    else:
        node.extend(_laid_out(item, levels - 1) for item in value)
    if levels <= 0 or not value:
        node.fa.set_flow_style()
    return node


def _written(element: Joint | Shape) -> dict[str, Any]:
    if isinstance(element, Joint):
        travel = element.travel if element.type == "prismatic" else [in_degrees(q) for q in element.travel]
        axis = _written_axis(element.axis)
        block: dict[str, Any] = {"joint": element.name, "type": element.type, "axis": axis, "travel": travel}
        block |= {"drives": list(element.drives)} if element.drives else {}
        return block | ({"spacing": element.spacing} if element.spacing else {})
    entry: dict[str, Any] = {"shape": element.name, "offset": element.offset}
    if any(element.rotation):
        entry["rotation"] = [in_degrees(r) for r in element.rotation]
    return entry


def _written_axis(axis: Vector) -> str | Vector:
    for name, i in _AXIS_WORDS.items():
        sign = -1.0 if name.startswith("-") else 1.0
        if axis[i] == sign and sum(map(abs, axis)) == 1:
            return name
    return axis


def in_degrees(angle: float) -> float:
    """Shortest number of degrees that is the same angle (rad) in floating point: a right angle is written as 90."""
    degrees = math.degrees(angle)
    short = float(f"{degrees:.12g}")
    return short if math.isclose(math.radians(short), angle, rel_tol=1e-15) else degrees
