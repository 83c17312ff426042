"""Tables of Denavit-Hartenberg parameters, as CSV and as YAML, for both conventions.

A row is a joint with ``a``, ``alpha``, ``d``, ``theta`` (its offset: what is added to the commanded position) and,
where two axes are nearly parallel, ``beta``. A row of type ``fixed`` has no joint: a base, or a tool.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from io import StringIO
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from errormodel.exceptions import InputError, nearest
from errormodel.machine import Joint, Machine, Shape
from errormodel.machine_formats.base import Description, identifiers
from errormodel.machine_formats.joint_axes import AlongX, AlongZ, screws
from errormodel.machine_formats.transforms import links_of, shape_of
from errormodel.raw_formats.base import RawFile
from errormodel.raw_formats.cells import kind_of
from errormodel.units import UnitsBlock, factor
from errormodel.yamlfile import Document, FileModel, Number, parse, validate

Convention = Literal["standard", "modified"]
FORMULAS = {
    "standard": "Rz(theta + q) Tz(d) Tx(a) Rx(alpha) Ry(beta)",
    "modified": "Rx(alpha) Tx(a) Ry(beta) Rz(theta + q) Tz(d)",
}
KEYS = ("a", "alpha", "d", "theta", "beta")
LENGTHS = ("a", "d")
# other names of the columns, in lower case
SYNONYMS = {
    "name": "joint", "kind": "type", "offset": "theta", "theta_offset": "theta", "thetaoffset": "theta", "r": "d",
    "α": "alpha", "θ": "theta", "β": "beta", "twist": "alpha", "min": "low", "max": "high", "lower": "low",
    "upper": "high", "alfa": "alpha",
}  # fmt: skip
JOINT_TYPES = {
    "rotary": "rotary", "revolute": "rotary", "r": "rotary", "prismatic": "prismatic", "p": "prismatic",
    "fixed": "fixed",
}  # fmt: skip
LARGEST = 1e9  # mm or rad: beyond all robots, and small enough to compute with
MOST_ROWS = 100  # of a table: more joints than any arm has, with room for fixed rows
LARGEST_ANGLE = 4 * math.pi  # rad: no table turns further; degrees that are said to be rad do
SMALLEST_ARM_MM = 10.0  # the largest a or d of a table below which its lengths are hardly mm; by judgement
DEFAULT_TRAVEL = (-180.0, 180.0)  # degrees, of a rotary joint that states none


@dataclass(frozen=True)
class Row:
    """A row of a table in mm and rad; `where` is its place in the file."""

    name: str
    type: str  # rotary, prismatic or fixed
    values: Mapping[str, float]
    travel: tuple[float, float] | None = None
    where: str = field(default="", compare=False)


def is_table(raw: RawFile, convention: Convention) -> bool:
    """Whether a file is such a table of that convention; one that states none may be of either."""
    text = raw.text or ""
    if re.search(r"^\s*<", text):
        return False
    head = [re.sub(r"[\s_]*[\[(].*?[\])]", "", w).strip().lower() for w in re.split(r"[,;\t|:{]", text[:20000])]
    words = {SYNONYMS.get(w, w) for line in head for w in line.split()}
    if not {"a", "alpha", "d"} <= words:
        return False
    said = re.search(r"convention\W+(\w+)", text)
    return said is None or said[1].lower() == convention


class _RowForm(FileModel):
    joint: str | None = Field(None, description="the name of the joint, such as J1")
    type: str = Field("rotary", description="rotary, prismatic or fixed")
    a: Number = Field(0.0, description="a length")
    alpha: Number = Field(0.0, description="an angle")
    d: Number = Field(0.0, description="a length")
    theta: Number = Field(0.0, description="an angle, added to the commanded one")
    beta: Number = Field(0.0, description="an angle, where two axes are nearly parallel")
    travel: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = Field(
        None, description="the lowest and the highest position, such as [-180, 180]"
    )


class _TableForm(FileModel):
    convention: Literal["standard", "modified"] = Field(description="standard, or modified (Craig)")
    name: str | None = Field(None, description="the name of the machine")
    units: UnitsBlock = Field(UnitsBlock(), description="units such as {length: mm, angle: deg}")
    rows: Annotated[list[_RowForm], Field(min_length=1, max_length=MOST_ROWS)] = Field(
        description=f"at most {MOST_ROWS} rows such as - {{joint: J1, type: rotary, a: 0, alpha: 90, d: 127.3}}"
    )


def read_table(raw: RawFile, convention: Convention) -> Description:
    """The chain of a table.

    Raises
    ------
    InputError
        A cell or key is wrong, or the file states the other convention.
    """
    text = raw.text or ""
    said = re.search(r"convention\W+(\w+)", text)
    if said is not None and said[1].lower() != convention:
        found = f"a table of the convention '{said[1]}', read as {convention}"
        raise InputError(raw.name, found, "Leave --format out, or correct the file")
    if re.search(r"^rows\s*:", text, re.MULTILINE):
        rows, name, stated = _rows_of_yaml(parse(text, raw.name))
        how = "units: {length: m, angle: rad}"
    else:
        rows, name, stated = _rows_of_csv(raw)
        how = "the units in the header, such as a [m], d [m], alpha [rad], theta [rad]"
    out = _described(raw.name, rows, name or raw.path.stem, convention)
    _check_units(raw.name, rows, stated, how)
    return out


def _check_units(where: str, rows: Sequence[Row], stated: Collection[str], how: str) -> None:
    """Raise InputError where lengths or angles without a unit are hardly in mm or degrees.

    Parameters
    ----------
    stated : the keys of the columns with a unit.
    how : how units are stated.
    """
    lengths, angles = LENGTHS, tuple(k for k in KEYS if k not in LENGTHS)
    largest = {
        keys: max(abs(row.values[k]) for row in rows for k in keys if k not in stated) if {*keys} - {*stated} else 0.0
        for keys in (lengths, angles)
    }
    if 0 < largest[lengths] < SMALLEST_ARM_MM:
        found = f"lengths up to {largest[lengths]:g} without a unit: mm, or m"
        raise InputError(where, found, f"Write {how}")
    degrees = math.degrees(largest[angles])
    if 0 < degrees <= 2 * math.pi:
        raise InputError(where, f"angles up to {degrees:g} without a unit: degrees, or rad", f"Write {how}")


def _rows_of_yaml(document: Document) -> tuple[list[Row], str, Collection[str]]:
    form = validate(document, _TableForm)
    said = form.units.model_fields_set
    stated = {k for k in KEYS if ("length" if k in LENGTHS else "angle") in said}
    length, angle = factor(form.units.length, "length"), factor(form.units.angle, "angle")
    rows = []
    for k, row in enumerate(form.rows):
        where = f"{document.name}, line {document.line_of(('rows', k))}"
        kind = _type(where, row.type)
        values = {key: getattr(row, key) * (length if key in LENGTHS else angle) for key in KEYS}
        unit = length if kind == "prismatic" else angle
        travel = None if row.travel is None else (row.travel[0] * unit, row.travel[1] * unit)
        rows.append(Row(row.joint or "", kind, values, travel, where))
    return rows, form.name or "", stated


def _rows_of_csv(raw: RawFile) -> tuple[list[Row], str, Collection[str]]:
    from errormodel.raw_formats.base import Asked
    from errormodel.raw_formats.table_columns import columns_of, renamed
    from errormodel.raw_formats.unit_words import quantity_of_unit

    recording = columns_of(raw, Asked())
    _check_all_rows(raw, len(recording.lines))
    names = {str(n): re.sub(r"[\s_]+$", "", str(n).strip().lower()) for n in recording.frame}
    recording = renamed(recording, {n: SYNONYMS.get(plain, plain) for n, plain in names.items()})
    frame = recording.frame
    known = ("joint", "type", *KEYS, "low", "high")
    for name in map(str, frame):
        if name not in known:
            raise InputError(f"{raw.name}, column {name}", "no parameter of a joint", nearest(name, known))
        if list(frame).count(name) > 1:
            raise InputError(f"{raw.name}, column {name}", "two columns of that name", "Write it once")
    if missing := [k for k in ("a", "alpha", "d") if k not in frame]:
        raise InputError(f"{raw.name}, header", f"no column '{missing[0]}'", "Write a, alpha, d and theta")
    units = {}
    for name in (*KEYS, "low", "high"):
        if name in frame and frame[name].dtype.kind != "f":
            cell = next((str(c) for c in frame[name] if str(c).strip()), "nothing")
            cure = "Write the constant part alone: the joint's position is added to theta, of a slide to d"
            raise InputError(f"{raw.name}, column {name}", f"'{cell}' is not a number", cure)
        unit = recording.units.get(name, "")
        kind = "length" if name in LENGTHS else "angle"
        if unit and quantity_of_unit(unit) not in ((kind,) if name in KEYS else ("length", "angle")):
            raise InputError(f"{raw.name}, column {name}", f"the unit '{unit}'", f"Write a unit of {kind}")
        units[name] = unit
    length = {k: factor(units.get(k) or "mm", "length") for k in LENGTHS}
    angle = {k: factor(units.get(k) or "deg", "angle") for k in KEYS if k not in LENGTHS}
    scale = length | angle
    rows = []
    for k, line in enumerate(recording.lines):
        where = f"{raw.name}, line {line}"
        kind = _type(where, str(frame["type"][k]) if "type" in frame else "rotary")
        values = {key: _number(frame, key, k) * scale[key] for key in KEYS}
        low, high = (_number(frame, key, k, math.nan) for key in ("low", "high"))
        own = length["d"] if kind == "prismatic" else angle["theta"]
        ends = [v * _of_end(raw.name, n, units.get(n, ""), kind, own) for n, v in (("low", low), ("high", high))]
        travel = None if math.isnan(low) or math.isnan(high) else (ends[0], ends[1])
        name = frame["joint"][k] if "joint" in frame else ""
        name = f"J{name:g}" if isinstance(name, float) and not math.isnan(name) else str(name)
        rows.append(Row("" if name == "nan" else name.strip(), kind, values, travel, where))
    return rows, "", {k for k in KEYS if units.get(k)}


def _check_all_rows(raw: RawFile, count: int) -> None:
    """Raise InputError where a line of the table was passed over, or a cell says that its value is none."""
    from errormodel.raw_formats.table_columns import table_of_text

    table = table_of_text(raw)
    if count > MOST_ROWS:
        raise InputError(raw.name, f"{count} rows", f"Give the table of one robot, of at most {MOST_ROWS} rows")
    if table.below:
        cells = f"'{raw.lines[table.below[0] - 1].strip()[:60]}'"
        found = f"{cells} below the table, which has {len(table.names)} cells a row"
        raise InputError(f"{raw.name}, line {table.below[0]}", found, "Give each row every cell, empty where it is 0")
    for line, row in zip(table.lines, table.rows, strict=True):
        for name, cell in zip(table.names, row, strict=True):
            if (cell and kind_of(cell) == "empty") or cell.lower() in ("nan", "-nan"):
                where = f"{raw.name}, line {line}, column {name}"
                raise InputError(
                    where, f"'{cell}' as a value", "Write the number, or leave the cell empty where it is 0"
                )


def _of_end(where: str, name: str, unit: str, kind: str, usual: float) -> float:
    """Size of the unit of a travel's end: its column's own, or that of the parameter that the joint changes."""
    from errormodel.units import is_unit

    quantity: Literal["length", "angle"] = "length" if kind == "prismatic" else "angle"
    if unit and not is_unit(unit, quantity):
        found = f"the unit '{unit}', and a joint whose travel is {'a length' if quantity == 'length' else 'an angle'}"
        raise InputError(f"{where}, column {name}", found, "Leave the unit out: travels are in those of d and theta")
    return factor(unit, quantity) if unit else usual


def _number(frame: Any, key: str, row: int, default: float = 0.0) -> float:
    """A cell; the default where it is empty or there is no such column."""
    value = float(frame[key][row]) if key in frame else math.nan
    return default if math.isnan(value) else value


def _type(where: str, word: str) -> str:
    if word.strip().lower() not in JOINT_TYPES:
        raise InputError(f"{where}, type", f"'{word}'", nearest(word, ("rotary", "prismatic", "fixed")))
    return JOINT_TYPES[word.strip().lower()]


def _described(where: str, rows: Sequence[Row], name: str, convention: Convention) -> Description:
    """The chain: joints about or along z, and members ``Z X`` between them, whichever way the rows are cut."""
    if all(row.type == "fixed" for row in rows):
        raise InputError(where, "no joint", "Write at least one row of type rotary or prismatic")
    said: list[str] = []
    numbered: list[Row] = []
    for row in rows:
        for key, value in (*row.values.items(), *(("travel", v) for v in row.travel or ())):
            if not abs(value) < LARGEST:  # nor infinite
                raise InputError(f"{row.where}, {key}", f"{value:g}", "Write a number of a robot's size")
        for key in (k for k in KEYS if k not in LENGTHS and abs(row.values[k]) > LARGEST_ANGLE):
            turns = row.values[key] / (2 * math.pi)
            raise InputError(f"{row.where}, {key}", f"{turns:.3g} turns", "Write the angle in the unit that is stated")
        own = row.name or ("" if row.type == "fixed" else f"J{sum(r.type != 'fixed' for r in numbered) + 1}")
        numbered.append(replace(row, name=own))
    moving = [row.name for row in numbered if row.type != "fixed"]
    if len({*moving}) < len(moving):
        again = next(n for k, n in enumerate(moving) if n in moving[:k])
        raise InputError(where, f"two joints '{again}'", "Give each a name of its own")
    joints = identifiers(moving)
    members = list(identifiers([f"L{k}" for k in range(len(moving) + 1)], joints.values()).values())
    said += [f"'{a}' is called {b} here" for a, b in joints.items() if a != b]
    elements: list[Shape | Joint] = []
    fixed = np.eye(4)
    for row in numbered:
        z, x = AlongZ(row.values["theta"], row.values["d"]), AlongX(*(row.values[k] for k in ("a", "alpha", "beta")))
        first, second = (z.matrix, x.matrix) if convention == "standard" else (x.matrix, z.matrix)
        if row.type == "fixed":
            fixed = fixed @ first @ second
            continue
        # the joint commutes with its own screw: it stands before Z, in either convention
        before, behind = (fixed, first @ second) if convention == "standard" else (fixed @ first, second)
        if elements or not np.array_equal(before, np.eye(4)):
            elements.append(shape_of(members[(len(elements) + 1) // 2], before))
        elements.append(_joint(row, joints[row.name], said))
        fixed = behind
    elements.append(shape_of(members[-1], fixed))
    return Description(name, tuple(elements), tuple(said))


def _joint(row: Row, name: str, notes: list[str]) -> Joint:
    travel = row.travel
    if travel is None and row.type == "prismatic":
        raise InputError(row.where, f"no travel of the slide {row.name}", "Write low and high (in YAML travel)")
    if travel is None:
        notes.append(f"{row.name}: no travel stated, taken as -180 to 180 degrees")
        travel = (math.radians(DEFAULT_TRAVEL[0]), math.radians(DEFAULT_TRAVEL[1]))
    if not travel[0] < travel[1]:
        raise InputError(row.where, f"a travel from {travel[0]:g} to {travel[1]:g}", "Write the lowest first")
    return Joint(name, "prismatic" if row.type == "prismatic" else "rotary", (0.0, 0.0, 1.0), travel)


def rows_of(machine: Machine, convention: Convention) -> list[Row]:
    """Rows of a machine's table; those of a base and a tool only where they are not the identity."""
    rows: list[Row] = []
    before = AlongX()
    for screw in screws(links_of(machine)):
        x = screw.x if convention == "standard" else before
        before = screw.x
        values = {"a": x.a, "alpha": x.alpha, "d": screw.z.d, "theta": screw.z.theta, "beta": x.beta}
        if screw.joint is not None:
            rows.append(Row(screw.joint.name, screw.joint.type, values, screw.joint.travel))
        elif any(values.values()):
            moving = any(row.travel for row in rows)
            rows.append(Row("tool" if moving else "base", "fixed", values))
    return rows


def table_text(machine: Machine, convention: Convention, suffix: str, heading: str) -> str:
    """The table as CSV, or as YAML for ``.yaml`` and ``.yml``; mm and degrees."""
    rows = rows_of(machine, convention)
    some_beta = any(row.values["beta"] for row in rows)
    keys = KEYS if some_beta else KEYS[:-1]
    formula = FORMULAS[convention] if some_beta else FORMULAS[convention].replace(" Ry(beta)", "")
    comments = [f"# {line}" for line in (heading, f"{formula}; of a slide q is added to d") if line]
    if suffix in (".yaml", ".yml"):
        return "\n".join([*comments, *_yaml_lines(machine, convention, rows, keys)]) + "\n"
    out = StringIO()
    out.write("\n".join([*comments, f"# convention: {convention}"]) + "\n")
    names = [f"{k} [{'mm' if k in LENGTHS else 'deg'}]" for k in keys]
    out.write(",".join(["joint", "type", *names, "low", "high"]) + "\n")
    for row in rows:
        cells = [_written(k, row.values[k]) for k in keys]
        out.write(",".join([row.name, row.type, *cells, *_travel(row)]) + "\n")
    return out.getvalue()


def _yaml_lines(machine: Machine, convention: str, rows: Sequence[Row], keys: Sequence[str]) -> list[str]:
    import json

    lines = [
        f"convention: {convention}",
        f"name: {json.dumps(machine.name)}",
        "units: {length: mm, angle: deg}",
        "rows:",
    ]
    for row in rows:
        cells = [f"{k}: {_written(k, row.values[k])}" for k in keys]
        travel = [f"travel: [{', '.join(_travel(row))}]"] if row.travel else []
        lines.append(f"  - {{{', '.join([f'joint: {row.name}', f'type: {row.type}', *cells, *travel])}}}")
    return lines


def _travel(row: Row) -> list[str]:
    if row.travel is None:
        return ["", ""]
    return [_written("d" if row.type == "prismatic" else "theta", v) for v in row.travel]


def _written(key: str, value: float) -> str:
    """A number in mm or degrees with all its digits, without an exponent that a YAML reader takes for text."""
    from errormodel.machine_file import in_degrees

    number = round(value, 12) if key in LENGTHS else in_degrees(value)  # beyond are roundings: a millionth of a pm
    return np.format_float_positional(number + 0.0, trim="-")
