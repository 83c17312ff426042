"""Raw files that are imported, each read and with its columns found: measurements, commands, logs."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from errormodel.conventions import MOTIONS
from errormodel.exceptions import InputError
from errormodel.machine import Machine
from errormodel.observations import registry
from errormodel.observations.base import Observation
from errormodel.raw_formats.base import Asked, RawFile, Recording, format_of, open_raw, raw_formats
from errormodel.raw_formats.commanded_circle import CommandedCircle
from errormodel.raw_formats.programme_poses import NO_END
from errormodel.raw_formats.unit_words import unit_word
from errormodel.surveys.columns import MEASURED, quantity_of
from errormodel.surveys.file import Axes, Frame, RawEntry
from errormodel.surveys.raw import LEFT_OUT, READ_BACK, is_column, read_raw, with_map
from errormodel.units import factor, is_unit
from identification.importing.end_points import calibrated, end_points
from identification.importing.motion_roles import with_motions
from identification.importing.roles import (
    Kind,
    channels,
    commands_by_place,
    nominal_and_actual,
    position_column,
    reading_roles,
    readings_beside,
    refuse_nothing_left_out,
    roles,
    unused,
)
from identification.importing.words_among_numbers import refuse_words, spelt_out

SHOWN = 6  # words of a format for its columns, in a message
FOLDER = "raw"  # of a survey, for the files as they came

What = Literal["points", "motions", "readings", "single", "log", "commands"]


@dataclass(frozen=True)
class Wishes:
    """What the user says about the files.

    Attributes
    ----------
    columns, command_columns : our column by the file's own, or names in the order of the columns under "".
    units, command_units : unit by kind or column.
    format, command_format : names of raw formats; empty: recognised.
    dates, joint, offsets, at, dialect : as in survey.yaml.
    match : "auto", "name", "order", "nearest" or "time".
    dwell : whether dwells are looked for in a continuous log.
    log_offset : s to add to the times of a log.
    circle : the circle that was commanded, of traces without coordinates.
    observations : what single readings (lengths, angles) are of, by the label of their entry; under "" all others.
    sheet : of workbooks that have it.
    leave_out : rows that count for nothing, from 1, by the name of their file; under "" those of the only one.
    axes : of measured coordinates: "reference", or "tool" of a nest in the spindle.
    frame : which rows share a measuring frame, as in survey.yaml; empty: found.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    command_columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    command_units: Mapping[str, str] = field(default_factory=dict)
    format: str = ""
    command_format: str = ""
    dates: Literal["", "day-first", "month-first"] = ""
    joint: str = ""
    offsets: tuple[str, ...] = ()
    at: tuple[str, ...] = ()
    dialect: str = "auto"
    match: str = "auto"
    dwell: bool = True
    log_offset: float = 0.0
    circle: CommandedCircle | None = None
    observations: Mapping[str, Observation] = field(default_factory=dict)
    axes: Axes = "reference"
    sheet: str = ""
    leave_out: Mapping[str, Sequence[int]] = field(default_factory=dict)
    frame: Frame | Literal[""] = ""

    @property
    def observation(self) -> Observation | None:
        """One of the observations, which are all of one type; None: there are no single readings."""
        return next(iter(self.observations.values()), None)

    def observation_of(self, label: str) -> Observation:
        """What readings with a label are of.

        Raises
        ------
        InputError
            Observations are named, and none for this label or all others.
        """
        found = self.observations.get(label, self.observations.get(""))
        if found is None:
            said = next(iter(self.observations.values())).type
            raise InputError("--observation", f"nothing of '{label}'", f"Add --observation {said} for all others")
        return found


@dataclass(frozen=True)
class SourceFile:
    """A raw file with its map.

    Attributes
    ----------
    raw : RawFile
    entry : as it will stand in survey.yaml.
    recording : under the toolkit's names, in the units of a survey.
    title : what it is, in words.
    what : what it holds.
    left : columns that a survey does not use.
    uses : words of what the user says that apply to it: ``joint``, ``circle``, ``unit length`` ...
    """

    raw: RawFile
    entry: RawEntry
    recording: Recording
    title: str
    what: What
    left: tuple[str, ...]
    uses: frozenset[str] = frozenset()

    @property
    def rows(self) -> int:
        return len(self.recording.frame)

    @property
    def mm_a_unit(self) -> float:
        """Size in mm of the unit as which the measured coordinates were read: the one asked for, the file's, or mm."""
        name, table = self.entry.columns.get("mx", "mx").removeprefix("-"), self.raw.clear_layout
        own = self.entry.units.get("mx", "")
        if not own and table is not None and name in table.names:
            own = table.units[table.names.index(name)] or table.length_unit
        own = unit_word(own or self.entry.units.get("length", "mm"))
        return factor(own, "length") if is_unit(own, "length") else 1.0

    @property
    def broken_off(self) -> str:
        """That a programme has no end, in brackets behind its name or number; empty where it has one."""
        note = next((n for n in self.recording.notes if n.startswith(NO_END)), "")
        return f" ({self.raw.path.name}: {note})" if note else ""

    def without(self, name: str) -> SourceFile:
        """The file without one of its columns, as its map then says."""
        columns = {ours: theirs for ours, theirs in self.entry.columns.items() if ours != name}
        columns |= {} if name in self.entry.columns else {name: LEFT_OUT}
        recording = replace(self.recording, frame=self.recording.frame.drop(columns=name))
        return replace(self, entry=self.entry.model_copy(update={"columns": columns}), recording=recording)

    def column(self, name: str) -> np.ndarray:
        return self.recording.frame[name].to_numpy(dtype=np.float64)


def parse_columns(texts: Sequence[str], option: str) -> dict[str, str]:
    """Options such as ``mx=East,my=North``, or ``point,mx,my,mz`` by position (``-`` passes a column over).

    Raises
    ------
    InputError
        A part is neither, or both kinds are mixed.
    """
    out: dict[str, str] = {}
    for text in texts:
        parts = [part.strip() for part in text.split(",")]
        named = ["=" in part for part in parts]
        if any(named) and not all(named):
            raise InputError(option, f"'{text}'", "Write mx=East,my=North by name, or point,mx,my,mz by position")
        for place, part in enumerate(parts, start=1):
            ours, _, theirs = part.partition("=") if all(named) else (part, "", f"#{place}")
            if not all(named) and ours in ("-", ""):
                continue
            if not ours.strip() or not theirs.strip() or ours.strip() in out:
                raise InputError(option, f"'{part}'", "Write each of our columns once, such as mx=East")
            out[ours.strip()] = theirs.strip()
    return out


def open_source(
    path: Path, machine: Machine, kind: Kind, wishes: Wishes, several: bool = False,
    counts: Callable[[int], bool] | None = None,
) -> SourceFile:  # fmt: skip
    """Read a raw file, find its columns, and say what it holds.

    Parameters
    ----------
    kind : what it may hold: see `identification.importing.roles`.
    several : whether there are others of its kind: a log that has none of the columns named is not meant.
    counts : whether a row of its table, from 0, counts for anything; None: all do.

    Raises
    ------
    InputError
        The file cannot be read, or a column or unit that was named is not there.
    """
    raw = replace(open_raw(path, str(path)), counts=counts)
    of_commands = kind == "commands"
    asked = wishes.command_format if of_commands else wishes.format
    given = wishes.command_columns if of_commands else wishes.columns
    units = wishes.command_units if of_commands else wishes.units
    form = format_of(raw, asked or _named_by(given, machine))
    if not asked and form.of_pairs and _no_test(raw, machine, kind, wishes):
        form = format_of(raw, plain=True)
    words = {ours: theirs for ours, theirs in given.items() if ours in form.columns}
    given = {ours: theirs for ours, theirs in given.items() if ours not in words}
    table = raw.clear_layout
    words = {ours: _placed(path, theirs, [*table.names] if table else []) for ours, theirs in words.items()}
    plain = RawEntry(
        path=str(path), format=form.name, columns=words, units=dict(units), dates=wishes.dates, joint=wishes.joint,
        offsets=list(wishes.offsets), at=list(wishes.at), dialect=wishes.dialect, sheet=wishes.sheet,
        circle=None if of_commands else wishes.circle,
    )  # fmt: skip
    recording = read_raw(raw, plain, machine)
    if not recording.trace:
        plain = plain.model_copy(update={"circle": None})
    has_sheet = any(n.startswith(f"sheet {wishes.sheet} of") for n in recording.notes)
    if wishes.sheet and not has_sheet:
        plain = plain.model_copy(update={"sheet": ""})
    names = [str(n) for n in recording.frame]
    spelt = spelt_out(recording)
    if several and not any(theirs.startswith("#") or theirs.removeprefix("-") in names for theirs in given.values()):
        alone = {*names, *roles(spelt, machine, kind, {})}
        if "time" in alone and not alone & {*MEASURED, *(n for j in machine.joints for n in j.columns)}:
            given = {}  # a log beside the measured file
    own = {ours: _placed(path, theirs, names) for ours, theirs in given.items()}
    if wishes.joint and {*own} & {*MOTIONS} and wishes.joint not in own and (place := position_column(names)):
        own[wishes.joint] = place
    if kind == "whole" and wishes.observation is None and not (form.of_pairs or recording.trace):
        plain, recording, own = with_motions(raw, plain, recording, own, machine)
    if of_commands and form.bare and not own and not any(j.name in names for j in machine.joints):
        own = commands_by_place(spelt, machine, table is None or table.named)
    single = None if of_commands or recording.trace else wishes.observation
    if single is not None and single.poses > 1:
        own = {**end_points(names, machine), **own} if kind == "whole" else own
        if single.reading not in own and (bar := calibrated([n for n in names if n not in own.values()])):
            own[single.reading] = bar

    def found_beside(given: Mapping[str, str]) -> dict[str, str]:
        found = roles(spelt, machine, kind, given)
        found = channels(found, given, machine) if form.of_pairs else found
        return found if single is None else reading_roles(spelt, machine, found, single.reading)

    found = found_beside(own)
    if LEFT_OUT in own.values():
        there = found_beside({ours: theirs for ours, theirs in own.items() if theirs != LEFT_OUT})
        if several:  # each file does without those that it has
            own = {ours: t for ours, t in own.items() if t != LEFT_OUT or ours in names or ours in there}
            found, given = found_beside(own), own
        refuse_nothing_left_out(own, {*names, *there}, str(path))
    refuse_words(recording, found, machine, str(path), of_commands)
    entry = plain.model_copy(
        update={
            "path": f"{FOLDER}/{path.name}", "sha256": hashlib.sha256(raw.data).hexdigest(),
            "columns": {**words, **found},
        }
    )  # fmt: skip
    if kind == "whole" and (note := nominal_and_actual(found, machine)):
        recording = replace(recording, notes=(*recording.notes, note))
    mapped = with_map(recording, entry.model_copy(update={"path": str(path)}), machine)
    known = {*MEASURED, *(j.name for j in machine.joints if several)} & {*mapped.frame}
    if wishes.circle is not None and not of_commands and not recording.trace and not known:
        text = f"a circle is stated, and no angles are among its columns {', '.join(names[:12])}"
        cure = "A trace needs the angle of each reading: say its column, --columns angle=.., or export it with angles"
        raise InputError(str(path), text, cure)
    what = _what(path, mapped, machine, kind, single)
    if what == "single" and single is not None:
        _check_unit(path, entry, recording, single)
    uses = {*form.uses, *(f"unit {u}" for u in units if u in form.columns or _has_unit(u, entry, recording, machine))}
    uses |= {word for word, own in (("circle", bool(recording.trace)), ("dates", recording.dated)) if own}
    uses |= {"columns"} if given or words else set()
    uses |= {"joint"} if what == "motions" and entry.joint else set()
    uses -= set() if has_sheet else {"sheet"}
    left = tuple(unused(recording, found, machine))
    return SourceFile(raw, entry, mapped, form.title, what, left, frozenset(uses))


def _named_by(given: Mapping[str, str], machine: Machine) -> str:
    """The format that has most of the names given, where one is a column of no survey; empty where that is open."""
    foreign = {ours for ours in given if not is_column(ours, machine)}
    shared = {n: len({*given} & {*form.columns}) for n, form in raw_formats().items() if foreign <= {*form.columns}}
    best = [n for n, count in shared.items() if count == max(shared.values())] if foreign else []
    return best[0] if len(best) == 1 else ""


def _no_test(raw: RawFile, machine: Machine, kind: Kind, wishes: Wishes) -> bool:
    """Whether a table of nominal and actual is of lengths, or of commands and what was read back of them."""
    if kind != "commands":
        return wishes.observation is not None
    own = format_of(raw, plain=True).read(raw, Asked(machine))
    return {j.name for j in machine.joints} <= {*map(str, own.frame), *roles(own, machine, kind, {})}


def _placed(path: Path, theirs: str, names: list[str]) -> str:
    """A column by its place, ``#2``, as its name."""
    if theirs in names or not theirs.startswith("#"):
        return theirs
    place = int(theirs[1:])
    if place > len(names):
        raise InputError(f"{path}, --columns", f"a column {place}, and the file has {len(names)}", "Name fewer columns")
    return names[place - 1]


def _has_unit(word: str, entry: RawEntry, recording: Recording, machine: Machine) -> bool:
    """Whether a unit by column or by kind is the one in which a column of the file is read."""
    names = {theirs: ours for ours, theirs in entry.columns.items()}
    ours = {str(n): names.get(str(n), names.get(f"-{n}", str(n))) for n in recording.frame}
    if word in ours.values():
        return True
    said = entry.units.get(word, "")  # which the file may say as well
    bare = [n for own, n in ours.items() if recording.units.get(own, "") in ("", said) and n not in entry.units]
    return any(quantity_of(n.removeprefix(READ_BACK), machine) == word for n in bare)


def _check_unit(path: Path, entry: RawEntry, recording: Recording, single: Observation) -> None:
    """InputError where nobody knows the unit of angles: those of a joint are degrees, those of a level none of them."""
    reading = single.reading
    if reading == "angle" and reading not in entry.units:
        own = entry.columns.get(reading, reading).removeprefix("-")
        if not recording.units.get(own):
            cure = f"Say it with --units {reading}=arcsec, or what it is"
            raise InputError(f"{path}, column {own}", "angles without a unit", cure)


def _what(path: Path, recording: Recording, machine: Machine, kind: Kind, single: Observation | None = None) -> What:
    frame = recording.frame
    names = [str(n) for n in frame]
    joints = [j.name for j in machine.joints if j.name in names or (j.drives and {*j.drives} <= {*names})]
    if kind == "commands":
        missing = [j.name for j in machine.joints if j.name not in joints]
        if missing:
            found = f"no command of {', '.join(missing)} among its columns {', '.join(names)}"
            cure = f"Say which column it is: --command-columns {missing[0]}=.."
            raise InputError(str(path), found, cure)
        return "commands"
    if "joint" in names and any(m in names for m in MOTIONS):
        return "motions"
    if single is not None and single.reading in names and frame[single.reading].dtype.kind == "f":
        return "single"
    if any(m in names for m in MEASURED):
        return "points"
    if recording.trace and len(joints) == len(machine.joints):
        return "readings"
    if recording.trace:
        found = f"{len(frame)} lengths of a bar over its angle, and no coordinates"
        centre = ",".join(f"{j.name}=.." for j in machine.joints)
        raise InputError(
            str(path), found, f"Say where the machine stood at the centre of the circle: --centre {centre}"
        )
    if "deviation" in names:
        found = "deviations of which it does not say what they are of"
        raise InputError(str(path), found, "Say it with --columns, such as --columns dy=deviation, and --units dy=um")
    if "time" in names and any(n.startswith(("T_", "w_")) or n in ("feed", "load") for n in names):
        return "log"
    if len(joints) == len(machine.joints):
        raise InputError(
            str(path), "commands, and nothing measured", "Give it as --commands, and the measured file first"
        )
    sheets = next((f"; this is {n}" for n in recording.notes if n.startswith("sheet ")), "")
    found = f"no measured coordinates among its columns {', '.join(names[:12])}{' ...' if len(names) > 12 else ''}"
    if single is not None:
        found = f"no column of a single {single.reading} among {', '.join(names[:12])}"
        beside = readings_beside(recording, machine)
        cure = f"Say which it is: --columns {single.reading}=.."
        if len(beside) > 1:
            named = ",".join(f"{single.reading}:{'AB'[k]}={name}" for k, name in enumerate(beside[:2]))
            cure += f"; of several instruments side by side --columns '{named}' and so on, the label of each before ="
        raise InputError(str(path), found, cure)
    first = next((n for n in names if frame[n].dtype.kind == "f"), names[0])
    others = "; ".join(
        f"of {form.title} by {', '.join(form.columns[:SHOWN])}{' ...' if len(form.columns) > SHOWN else ''}"
        for form in raw_formats().values()
        if form.columns
    )
    joint = machine.joints[0].name
    motions = f"of error motions of a joint --joint {joint} --columns {joint}={position_column(names) or '..'},eb=.. "
    motions += f"(any of {' '.join(MOTIONS)})"
    cure = f"Say which they are: --columns mx={first},my=..,mz=..; {motions}; {others}"
    raise InputError(
        str(path), found, f"{cure}{sheets}; of single readings --observation, one of {', '.join(registry())}"
    )
