"""Assignment of a file's columns to those of a survey (``docs/file_formats.md``, section 2); notes on the others."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pandas as pd

from errormodel.conventions import MOTIONS
from errormodel.exceptions import InputError, alike, enumerated, nearest
from errormodel.formats.base import Table
from errormodel.machine import Joint, Machine
from errormodel.units import INTERNAL_UNITS, UNIT_EXAMPLES, Quantity, is_unit, of_diameters
from errormodel.yamlfile import Document, shown

if TYPE_CHECKING:
    from errormodel.surveys.file import SurveyUnits

MEASURED = ("mx", "my", "mz")  # measured point in the measuring frame, mm
ORIENTATION = ("mrx", "mry", "mrz")  # measured rotation vector in the measuring frame, rad
TOOL_COLUMNS = ("tool_x", "tool_y", "tool_z")  # functional point in the last frame of the chain, mm
SIGMA_COLUMNS = ("sigma_x", "sigma_y", "sigma_z")  # standard uncertainties of mx, my, mz, mm
MOTION_UNCERTAINTIES = tuple(f"u_{motion}" for motion in MOTIONS)  # standard uncertainties of a joint's error motions
OBSERVATION = "observation"  # the entry of observations: in survey.yaml that a row's reading is of
TEXT_COLUMNS = ("run", "joint", OBSERVATION)  # columns of labels
READINGS = ("length", "angle")  # what an instrument of one reading a row shows: mm, rad
READING_UNCERTAINTIES = tuple(f"u_{reading}" for reading in READINGS)  # their standard uncertainties
FIRST_POSE = "from_"  # prefix of the columns of the first pose, where a reading is between two

# columns of lengths
LENGTH_COLUMNS = frozenset(
    (*MEASURED, *TOOL_COLUMNS, *SIGMA_COLUMNS, "sigma", *MOTIONS[:3], *MOTION_UNCERTAINTIES[:3], "length", "u_length")
)
# columns of angles that are in rad by default, whatever the unit of the joints' angles
ANGLE_COLUMNS = frozenset((*ORIENTATION, *MOTIONS[3:], *MOTION_UNCERTAINTIES[3:], "angle", "u_angle"))
_RECORDED_QUANTITIES: Mapping[str, Quantity] = {"time": "time", "feed": "speed", "load": "mass"}
# the measured column that a standard uncertainty belongs to
_READING_OF = dict(
    zip(
        (*MOTION_UNCERTAINTIES, *SIGMA_COLUMNS, "sigma", *READING_UNCERTAINTIES),
        (*MOTIONS, *MEASURED, MEASURED[0], *READINGS),
        strict=True,
    )
)
_COLUMN_NAMES = (
    *MEASURED,
    *ORIENTATION,
    *TOOL_COLUMNS,
    "time",
    "feed",
    "load",
    "sigma",
    *SIGMA_COLUMNS,
    *MOTIONS,
    *MOTION_UNCERTAINTIES,
    *READINGS,
    *READING_UNCERTAINTIES,
    *TEXT_COLUMNS,
)

_SOME_DIRECTION = "dir_<joint>"
# Usual other names of columns, in lower case without blanks and underscores.
_COLUMN_ALIASES = (
    (r"(?:m|meas(?:ured)?|act(?:ual)?)([xyz])|([xyz])(?:m|meas(?:ured)?|act(?:ual)?)", "m{}"),
    (r"temp(?:erature)?", "T_<sensor>"),
    (r"temp(?:erature)?(.+)", "T_{}"),
    (r"dir(?:ection)?(.+)", "dir_{}"),
    (r"timestamp|datetime|seconds?", "time"),
    (r"tool([xyz])", "tool_{}"),
)


@dataclass(frozen=True)
class Plan:
    """The columns to read.

    Attributes
    ----------
    ours : dict
        Column name of the toolkit: name in the file, in the file's order.
    missing_joints : tuple of str
        Joints without a column, allowed only where every row is about another joint's error motions.
    notes : tuple of str
    """

    ours: dict[str, str]
    missing_joints: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def texts(self) -> list[str]:
        return [name for name in self.ours if name in TEXT_COLUMNS]

    @property
    def numbers(self) -> list[str]:
        return [name for name in self.ours if name not in TEXT_COLUMNS]


def check_map(document: Document, machine: Machine, columns: Mapping[str, str], headers: Iterable[Table]) -> None:
    """Raise InputError if ``columns:`` in a survey.yaml names an unknown column or one that no file has."""
    present = {name for table in headers for name in table.columns if name}
    for ours, theirs in columns.items():
        if not is_survey_column(ours, machine):
            known = (*(j.name for j in machine.joints), *_COLUMN_NAMES)
            cure = nearest(ours, known) + ", T_<sensor>, w_<name>, dir_<joint>"
            raise document.error(("columns", ours), f"'{ours}' is not a column of a survey", cure)
        if theirs not in present:
            raise document.error(("columns", ours), f"no file has a column '{theirs}'", nearest(theirs, present))


def first_pose(name: str) -> str:
    """Name of a column for the first pose of a reading between two: ``from_X`` of ``X``."""
    return FIRST_POSE + name


def quantity_of(name: str, machine: Machine) -> Quantity | None:
    """Quantity of a column; None for labels, directions and ``w_`` columns, whose names state their unit."""
    name = name if name in machine_columns(machine) else name.removeprefix(FIRST_POSE)
    joint = next((j for j in machine.joints if name in j.columns or (j.drives and name == j.difference)), None)
    if joint is not None:
        return "length" if joint.type == "prismatic" else "angle"
    if name.startswith("T_"):
        return "temperature"
    return "length" if name in LENGTH_COLUMNS else "angle" if name in ANGLE_COLUMNS else _RECORDED_QUANTITIES.get(name)


def unit_of_column(name: str, quantity: Quantity, units: SurveyUnits) -> str:
    """Unit of a column: as stated for it, or for the reading that it is the uncertainty of, else that of its kind."""
    for own in (name, _READING_OF.get(name)):
        if own in units.of_columns:
            return of_diameters(str(units.of_columns[own]), units.length)
    if name in ("angle", "u_angle"):
        return units.reading
    plain = name in ANGLE_COLUMNS or quantity in ("speed", "mass")
    return INTERNAL_UNITS[quantity] if plain else str(getattr(units, quantity))


def check_units(document: Document, machine: Machine, units: SurveyUnits, columns: Iterable[str]) -> None:
    """Raise InputError if ``units:`` names a column that no file has or that has no unit, or an unsuitable unit.

    `columns` are those of all files, under the toolkit's names.
    """
    kinds = {name: kind for name in columns if (kind := quantity_of(name, machine)) is not None}
    for name, unit in units.of_columns.items():
        at = ("units", name)
        if name.startswith("w_"):
            cure = f"Say it in the column's name, such as {name}_um, by columns: {{{name}_um: ...}}"
            raise document.error(at, f"'{name}' is a witness, whose unit its name says", cure)
        if name not in kinds:
            cure = nearest(name, (*type(units).model_fields, *kinds))
            raise document.error(at, f"'{name}' is neither a kind of unit nor a column that has one", cure)
        if not isinstance(unit, str) or not is_unit(unit, kinds[name]):
            cure = f"Write a unit of {kinds[name]}, such as {UNIT_EXAMPLES[kinds[name]]}"
            raise document.error(at, shown(unit), cure)


def plan_columns(table: Table, machine: Machine, columns: Mapping[str, str], measured: bool) -> Plan:
    """Match the header of a file with the columns of a survey.

    Parameters
    ----------
    table : Table
    machine : Machine
    columns : mapping
        Column name of the toolkit: name in the file, from survey.yaml.
    measured : bool
        Whether the file must have a measured column.

    Raises
    ------
    InputError
        A column appears twice, or a required one is missing.
    """
    where = f"{table.name}, header"
    named = [name for name in table.columns if name]
    for name in named:
        if named.count(name) > 1:
            places = [str(i) for i, other in enumerate(table.columns, start=1) if other == name]
            found = f"the name '{name}' stands above columns {' and '.join(places)}"
            raise InputError(where, found, "Give every column a name of its own")
    taken = {columns[ours]: ours for ours in columns if columns[ours] in named}
    candidates = {name: taken.get(name, name) for name in named}
    free = {our: name for name, our in candidates.items() if name in taken or our not in taken.values()}
    ours = {our: name for our, name in free.items() if is_survey_column(our, machine)}
    if "joint" not in ours:  # without it the joint of the error motions is unknown
        ours = {our: name for our, name in ours.items() if our not in (*MOTIONS, *MOTION_UNCERTAINTIES)}
    unused = [name for name in named if name not in ours.values()]

    lacking = [j for j in machine.joints if j.name not in ours]
    missing = tuple(j.name for j in lacking if not j.drives or not all(drive in ours for drive in j.drives))
    for joint in machine.joints:
        _check_drives(where, joint, ours)
    if missing and "joint" not in ours:
        raise missing_joints(table, missing, unused, ours)
    something = any(name in ours for name in (*MEASURED, *ORIENTATION, *MOTIONS, *READINGS))
    if measured and not something:
        hints = [f"'{theirs}' looks like '{our}'" for theirs in unused if (our := _near(theirs, machine)) in MEASURED]
        if not hints and any(name in MOTIONS for name in unused):
            hints = ["error motions need a column 'joint' with the joint's name"]
        found = "no measured column" + (f" ({', '.join(hints)})" if hints else "")
        raise InputError(where, found, f"Name what was measured mx my mz. Found: {', '.join(named)}")
    if measured and any(name in ours for name in MEASURED):
        _refuse_misspelt(table, unused, ours, machine)
    _all_or_none(where, ours, ORIENTATION)
    return Plan(ours, missing, tuple(_notes(unused, ours, machine)))


def _check_drives(where: str, joint: Joint, ours: Mapping[str, str]) -> None:
    """Raise InputError where one of two drives has no column, or their difference is given twice."""
    have = [drive for drive in joint.drives if drive in ours]
    if have and len(have) < len(joint.drives):
        found = (
            f"{have[0]}, and not {' '.join(d for d in joint.drives if d not in have)}, of the drives of {joint.name}"
        )
        raise InputError(where, found, f"Give {' and '.join(joint.drives)}, or {joint.name} alone")
    if have and joint.difference in ours:
        found = f"{joint.difference} beside {' and '.join(joint.drives)}, whose difference it is"
        raise InputError(where, found, "Give one of the two")


class MissingJointsError(InputError):
    """Joints without a column; `there`: columns of a survey that the file has."""

    there: tuple[str, ...] = ()


def missing_joints(
    table: Table, joints: Sequence[str], unused: Iterable[str], there: Iterable[str] = ()
) -> MissingJointsError:
    """Error for joints whose commanded positions have no columns, in a file with the columns `there`."""
    free = list(unused)
    near = {joint: name for joint in joints if (name := alike(joint, free))}
    many = len(joints) > 1
    found = f"no column{'s' * many} for the joint{'s' * many} {enumerated([repr(j) for j in joints])}"
    if near:
        found += (
            f"; the nearest {'are' if len(near) > 1 else 'is'} {enumerated([repr(name) for name in near.values()])}"
        )
    first = next(iter(near), joints[0])
    example = near.get(first, "the name in your file")
    cure = f"Name the column{'s' * many} {enumerated([repr(j) for j in joints])}, or write columns: "
    cure += f'{{{first}: "{example}"}} in a survey.yaml'
    listed = ", ".join(n for n in table.columns if n)
    error = MissingJointsError(f"{table.name}, header", found, f"{cure}. Found: {listed}")
    error.there = tuple(there)
    return error


def _all_or_none(where: str, ours: Mapping[str, str], names: tuple[str, ...]) -> None:
    lacking = [name for name in names if name not in ours]
    if lacking and len(lacking) < len(names):
        raise InputError(
            where, f"{' '.join(n for n in names if n in ours)} without {' '.join(lacking)}", "Give all of them or none"
        )


def _refuse_misspelt(table: Table, unused: list[str], ours: Mapping[str, str], machine: Machine) -> None:
    """InputError where a measured component is missing beside others, and a column that is not used may be it."""
    for our in (name for name in MEASURED if name not in ours):
        for theirs in unused:
            if _near(theirs, machine) == our or (_holds_name(theirs, our) and _holds_numbers(table, theirs)):
                seen = " ".join(name for name in MEASURED if name in ours)
                cure = f"Name it '{our}', or write columns: {{{our}: \"{theirs}\"}} in a survey.yaml"
                cure += f"; if {our} is left out on purpose, delete this column"
                raise InputError(f"{table.name}, header", f"'{theirs}' beside {seen}, and no {our}", cure)


def _holds_name(theirs: str, our: str) -> bool:
    """Whether a name begins with one of ours, or has it for a word: ``Mx_meas``, ``meas mx``, ``mxMeasured``."""
    words = re.split(r"[\W_]+", theirs.casefold())
    return our in words or words[0].startswith(our)


def _holds_numbers(table: Table, name: str) -> bool:
    """Whether most cells of a column are numbers: remarks (``my remarks``) measure nothing."""
    frame, _ = table.read([name], ())
    return bool(pd.to_numeric(frame[name], errors="coerce").notna().mean() > 0.5)


def machine_columns(machine: Machine) -> list[str]:
    """Columns of positions of a machine's joints and drives."""
    return [name for j in machine.joints for name in j.columns]


def is_survey_column(name: str, machine: Machine) -> bool:
    """Whether a name is that of a column of a survey (``docs/file_formats.md``, section 2)."""
    joints = machine_columns(machine)
    direction = name.startswith("dir_") and name[4:] in joints
    at_start = name.removeprefix(FIRST_POSE)
    first = at_start != name and (at_start in (*joints, *TOOL_COLUMNS) or at_start.removeprefix("dir_") in joints)
    known = name in joints or name in _COLUMN_NAMES or direction or first
    return known or re.fullmatch(r"[Tw]_.+", name) is not None


def _notes(unused: list[str], ours: Mapping[str, str], machine: Machine) -> Iterable[str]:
    plain = []
    for name in unused:
        if name.casefold() in ("target", "reflector"):
            yield (
                f"column '{name}' is not used: the point is the tool of machine.yaml. Of a reflector give its place in "
                "tool_x tool_y tool_z (targets: of the survey that was fitted)"
            )
            continue
        near = _near(name, machine)
        if near == _SOME_DIRECTION:
            joints = ", ".join(machine_columns(machine))
            yield f"column '{name}' is not used; did you mean '{near}' with one of {joints}?"
        elif near is None or near in ours:
            plain.append(name)
        else:
            yield f"column '{name}' is not used; did you mean '{near}'?"
    if plain:
        yield f"columns not used: {', '.join(plain)}"


def _near(name: str, machine: Machine) -> str | None:
    """Column of the toolkit that a user's name probably means, or None."""
    if name in MOTIONS or name in MOTION_UNCERTAINTIES:
        return None  # omitted on purpose
    joints = [j.name for j in machine.joints]
    bare = re.sub(r"[\s_]+", "", re.sub(r"[\[(].*?[\])]", "", name)).lower()  # without a unit in brackets
    for pattern, ours in _COLUMN_ALIASES:
        match = re.fullmatch(pattern, bare)
        if match:
            tail = next((group for group in match.groups() if group), "")
            if ours.startswith("dir"):
                return next((ours.format(j) for j in joints if j.lower() == tail), _SOME_DIRECTION)
            return ours.format(tail)
    known = {
        known.lower().replace("_", ""): known for known in (*joints, *_COLUMN_NAMES, *(f"dir_{j}" for j in joints))
    }
    close = difflib.get_close_matches(bare, known, n=1, cutoff=0.8)
    return known[close[0]] if close else None
