"""Which column of a raw table is what: joints as commanded and as read back, measured coordinates, labels, sensors.

The names are those that laboratories use. What is found is written into ``survey.yaml``, where a user corrects it.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from errormodel.exceptions import InputError, nearest
from errormodel.machine import Machine
from errormodel.raw_formats.base import Recording
from errormodel.raw_formats.direction_words import HEADINGS
from errormodel.raw_formats.sensor_names import sensor_of
from errormodel.raw_formats.unit_words import without_tail
from errormodel.surveys.columns import MEASURED, OBSERVATION, is_survey_column
from errormodel.surveys.raw import LABELS, LEFT_OUT, READ_BACK

if TYPE_CHECKING:
    import pandas as pd

Kind = Literal["measured", "commands", "whole"]

_COMMANDED = (
    "cmd",
    "command",
    "commanded",
    "nom",
    "nominal",
    "set",
    "setpoint",
    "target",
    "ref",
    "demand",
    "soll",
    "programmed",
    "sollwert",
    "sollposition",
    "vorgabe",
    "consigne",
    "theorique",
    "th\u00e9orique",
    "teorico",
    "teorica",
    "theoretical",
    "nominale",
)
_READ = (
    "act",
    "actual",
    "enc",
    "encoder",
    "fb",
    "fbk",
    "feedback",
    "read",
    "readback",
    "ist",
    "istwert",
    "istposition",
    "axispos",
)
_AXIS = ("axis", "achse", "joint", "q", "pos", "position", "mcs", "machine", "abs")
_MEASURED = (
    "meas",
    "measured",
    "m",
    "tracker",
    "laser",
    "smr",
    "act",
    "actual",
    "point",
    "pt",
    "coord",
    "coordinate",
    "pos",
    "position",
    "mess",
    "gemessen",
    "trk",
    "ist",
    "istwert",
    "istposition",
    "messwert",
    "mesure",
    "mesur\u00e9",
    "mesur\u00e9e",
    "misurato",
    "misurata",
    "misura",
)
_BESIDE = (  # of a nominal value: measured, or read back where something else was measured
    "ist", "istwert", "istposition", "act", "actual", "meas", "measured", "messwert", "gemessen", "mesure",
    "mesur\u00e9", "mesur\u00e9e", "misurato", "misurata", "misura",
)  # fmt: skip
_LABELS = {
    "point": r"punkt(name|nr)?|name|point(name|id|no|number|nr)?|label|pt|id|pose(id|no|name)?|no|nr|number|feature",
    "target": r"(target|reflector|reflektor|smr)(name|id|no|nr)?|prism|ball|prisma|kugel|ziel(marke)?",
    "station": r"station(id|no|name)?|instrument(id|name)?|standpunkt|standort",
    "run": r"run|series|cycle|pass|lauf|zyklus|serie",
    "time": r"zeit|time(stamp)?(s|sec|seconds)?|t|seconds|elapsed(time)?|timestamp(s)?|uptime",
    "feed": r"feed(rate)?|f|speed|vorschub",
    "load": r"load|payload",
    "sigma": r"sigma|std|uncertainty|u",
}
_NOMINAL = r"nenn|nominal|soll|target|consigne|deviation|abweichung"
_POSITION = r"(target|nominal|soll|ziel|axis|achs)?(pos(ition|itionen)?)|target|nominal|soll(wert)?|consigne|posizione"
_LETTERS = "XYZUVWABC"  # of joints, in the order of a programme
_READING = (
    r"(meas(ured)?|raw|ist)?(length|distance|dist|range|displacement|deviation|reading|value|l(ae|\u00e4)nge|abstand|"
    r"distanz|messwert|anzeige|angle|winkel|inclination|neigung|tilt)|l|d|r|ist"
)


# the axes of a surveyor's frame: east, north, up
_SURVEYED = {
    "x": r"e|east(ing)?|ost|rechts(wert)?",
    "y": r"n|north(ing)?|nord|hoch(wert)?",
    "z": r"h|u|up|height|elev(ation)?|h(oe|\u00f6)he",
}


def channels(found: Mapping[str, str], given: Collection[str], machine: Machine) -> dict[str, str]:
    """Of the columns found: those given, and what stands beside readings of one joint: times, channels, positions."""
    joints = [name for j in machine.joints for name in j.columns]
    beside = ("time", "feed", "load", *joints)
    return {n: t for n, t in found.items() if n in given or n in beside or n.startswith(("T_", "w_"))}


def _bare(name: str) -> str:
    return re.sub(r"[\s_.\-/:]+", "", without_tail(name)).lower()


def roles(recording: Recording, machine: Machine, kind: Kind, given: Mapping[str, str]) -> dict[str, str]:
    """Columns of a recording by the toolkit's names, for ``columns:`` of its entry.

    Parameters
    ----------
    recording : under the names of its format.
    machine : names the joints.
    kind : "measured" (coordinates, the commands are elsewhere), "commands", or "whole" (both in one table).
    given : what the user said; the rest is found around it.
    """
    names = [str(n) for n in recording.frame]
    out = dict(given)
    used = {theirs.removeprefix("-") if theirs not in names else theirs for theirs in given.values()}
    numeric = {n for n in names if recording.frame[n].dtype.kind == "f"}

    def take(ours: str, theirs: str) -> None:
        if ours not in out and theirs not in used and (ours not in names or ours in used):
            out[ours] = theirs
            used.add(theirs)

    free = {_bare(n): n for n in reversed(names) if n not in used}
    for label, pattern in _LABELS.items():
        own = next((n for b, n in free.items() if re.fullmatch(pattern, b) and n not in used), None)
        numbers = label in ("time", "feed", "load", "sigma")
        single = own is not None and own in [j.name for j in machine.joints]
        if (
            own is not None
            and not single
            and (not numbers or own in numeric)
            and (own not in ("t", "T") or _runs_on(recording, own))
            and (numbers or label in LABELS or label == "run")
        ):
            take(label, own)
    for ours, theirs in _sensors(recording, names):
        if theirs not in used:
            take(ours, theirs)
    free = {b: n for b, n in free.items() if n not in used and n in numeric}
    measured = _measured(free, machine, kind, [*out, *names])
    for ours, theirs in measured.items():
        take(ours, theirs)
    free = {b: n for b, n in free.items() if n not in used}
    plain = kind != "measured" or not [m for m in MEASURED if m in out or m in names]
    for joint in machine.joints:
        bare = _bare(joint.name)
        command = next((free[b] for b in _around(bare, _COMMANDED) if b in free), None)
        read = next((free[b] for b in _around(bare, _READ) if b in free), None)
        own = free.get(bare) or next((free[b] for b in _around(bare, _AXIS) if b in free), None)
        if command or (own and (plain or read is None)):
            take(joint.name, command or own or "")
        if read and (joint.name in out or joint.name in names or kind == "commands"):
            take(f"{READ_BACK}{joint.name}" if joint.name in out or joint.name in names else joint.name, read)
    side = next((n for n in names if n not in used and re.fullmatch(HEADINGS, _bare(n))), None)
    moving = [j for j in machine.joints if _moves(recording, out.get(j.name, j.name))]
    if side is not None and len(moving) == 1:  # of several joints, no one knows whose direction it is
        take(f"dir_{moving[0].name}", side)
    return {ours: theirs for ours, theirs in out.items() if ours != theirs}


def reading_roles(
    recording: Recording, machine: Machine, found: Mapping[str, str], reading: Literal["length", "angle"]
) -> dict[str, str]:
    """`found` with the column of single readings, and those of their uncertainty and of what they are of.

    A column is known by its name, or as the only numbers that are nothing else. Where several may be it, or points
    were measured, nothing is added.
    """
    names = [str(n) for n in recording.frame]
    out = dict(found)
    if reading not in out and reading not in names:
        if any(m in out or m in names for m in MEASURED):
            return out
        taken = {t.removeprefix("-") for t in out.values()} | {j.name for j in machine.joints}
        free = [n for n in _unknown_numbers(recording, machine) if n not in taken]
        own = [n for n in free if re.fullmatch(_READING, _bare(n))] or [
            n for n in free if not counts(recording.frame[n])
        ]
        if len(own) != 1:
            return out
        out[reading] = own[0]
    if "sigma" in out:
        sigma = out.pop("sigma")
        out.setdefault(f"u_{reading}", sigma)
    if "station" in out and OBSERVATION not in out and OBSERVATION not in names:
        out[OBSERVATION] = out.pop("station")
    return out


def readings_beside(recording: Recording, machine: Machine) -> list[str]:
    """Columns of numbers that may be readings of several instruments: none that counts rows or is nominal."""
    own = [n for n in _unknown_numbers(recording, machine) if not re.search(_NOMINAL, n.lower())]
    return [n for n in own if not counts(recording.frame[n])]


def _unknown_numbers(recording: Recording, machine: Machine) -> list[str]:
    """Columns of numbers that have no name of a survey's."""
    names = [str(n) for n in recording.frame if recording.frame[n].dtype.kind == "f"]
    return [n for n in names if not is_survey_column(n, machine) and n not in LABELS]


def counts(column: pd.Series[Any]) -> bool:
    """Whether a column counts rows: 0, 1, 2 ... or 1, 2, 3 ..., as it goes on or begins again."""
    values = column.to_numpy(dtype=float)
    steps = values[1:] - values[:-1]
    return len(values) > 1 and bool(((steps == 1) | (steps < 0)).all()) and bool((values == values.round()).all())


def position_column(names: Sequence[str]) -> str:
    """The column of a joint's position in a table of its error motions; empty where none or several may be it."""
    own = [n for n in names if re.fullmatch(_POSITION, _bare(n))]
    return own[0] if len(own) == 1 else ""


def commands_by_place(recording: Recording, machine: Machine, named: bool) -> dict[str, str]:
    """Columns of commands without names, as many as there are joints, in the order in which people write these.

    That is X Y Z U V W A B C, or by the number in the joint's name; of columns with names only A1 to An, and the like.
    Nothing where the joints have other names.
    """
    order = [j.name for j in machine.joints]
    if all(name in _LETTERS for name in order):
        order.sort(key=_LETTERS.index)
    elif all(re.fullmatch(r"\D*\d+", name) for name in order):
        order.sort(key=lambda name: int(re.sub(r"\D", "", name)))
    else:
        return {}
    own = [str(n) for n in recording.frame if str(n) not in LABELS and recording.frame[n].dtype.kind == "f"]
    if len(own) == len(order) + 1 and counts(recording.frame[own[0]]):
        own = own[1:]
    theirs, ours = ([re.sub(r"\D", "", name) for name in names] for names in (own, order))
    if len(own) != len(order) or (named and (theirs != ours or not all(ours))):
        return {}
    return dict(zip(order, own, strict=True))


def _runs_on(recording: Recording, name: str) -> bool:
    """Whether a column of numbers is filled and goes on as times do; a temperature may have the same letter."""
    values = recording.frame[name].to_numpy(dtype=float)
    return bool((values[1:] >= values[:-1]).all()) and len(values) > 1 and values[-1] > values[0]


def _moves(recording: Recording, name: str) -> bool:
    """Whether a column of numbers has different ones."""
    column = recording.frame.get(name)
    return column is not None and column.dtype.kind == "f" and column.dropna().nunique() > 1


def _around(bare: str, words: tuple[str, ...]) -> Iterator[str]:
    """A joint's name with each word behind and before it."""
    for word in words:
        yield f"{bare}{word}"
        yield f"{word}{bare}"


def _measured(free: Mapping[str, str], machine: Machine, kind: Kind, there: list[str]) -> dict[str, str]:
    """Columns of the measured coordinates: named as such, or plain x y z where the joints are elsewhere."""
    if kind == "commands" or any(m in there for m in MEASURED):
        return {}
    joints = {_bare(j.name) for j in machine.joints}
    for word in _MEASURED:
        own = {f"m{k}": next((free[b] for b in (f"{word}{k}", f"{k}{word}") if b in free), "") for k in "xyz"}
        if all(own.values()):
            read = word in _READ and kind == "whole" and {"x", "y", "z"} <= joints
            if not read or not {"x", "y", "z"} <= {*free} - {*own.values()} or not _others(free, own):
                return own
    beside = all(any(b in free for b in _around(k, _COMMANDED)) for k in "xyz")  # Soll X and X
    if {"x", "y", "z"} <= {*free} and (kind == "measured" or beside or not {"x", "y", "z"} & joints):
        return {f"m{k}": free[k] for k in "xyz"}
    surveyed = {f"m{k}": next((n for b, n in free.items() if re.fullmatch(p, b)), "") for k, p in _SURVEYED.items()}
    if all(surveyed.values()) and not joints & {*map(_bare, surveyed.values())}:
        return surveyed
    one = {f"m{k}": free[k] for k in "xyz" if k in free and k not in joints}
    if kind == "whole":  # nominal and actual of one axis or two, and nothing else that was measured
        for word in _BESIDE:
            own = {f"m{k}": next((free[b] for b in (f"{word}{k}", f"{k}{word}") if b in free), "") for k in "xyz"}
            commanded = all(any(b in free for b in (k, *_around(k, _COMMANDED))) for k in joints if own.get(f"m{k}"))
            if any(own.values()) and commanded:
                return {ours: theirs for ours, theirs in own.items() if theirs}
    return one if kind == "measured" else {}


def nominal_and_actual(found: Mapping[str, str], machine: Machine) -> str:
    """What of a table is taken as commanded and what as measured, where words such as soll and ist say it; or empty."""
    words = {_bare(theirs): theirs for ours, theirs in found.items() if ours in MEASURED}
    beside = [t for b, t in words.items() if any(b in (f"{w}{k}", f"{k}{w}") for w in _BESIDE for k in "xyz")]
    if {*words} == {"x", "y", "z"} <= {_bare(j.name) for j in machine.joints}:
        beside = [*words.values()]
    joints = [found[j.name] for j in machine.joints if j.name in found]
    if not beside or not joints:
        return ""
    return (
        f"{', '.join(joints)}: commanded; {', '.join(beside)}: taken as measured. If the controller read them back, "
        "they are no measurements: import the measured file with this one as --commands"
    )


def _others(free: Mapping[str, str], own: Mapping[str, str]) -> bool:
    """Whether another set of columns may be the measured coordinates."""
    rest = {b: n for b, n in free.items() if n not in own.values()}
    return any(all(any(b in rest for b in (f"{w}{k}", f"{k}{w}")) for k in "xyz") for w in _MEASURED)


def _sensors(recording: Recording, names: list[str]) -> Iterator[tuple[str, str]]:
    for name in names:
        sensor = sensor_of(name, recording.units.get(name, ""))
        if sensor and not name.startswith("T_") and recording.frame[name].dtype.kind == "f":
            yield sensor, name


def refuse_nothing_left_out(given: Mapping[str, str], there: Collection[str], where: str) -> None:
    """InputError where a column is to be left out that is not `there`."""
    for ours, theirs in given.items():
        if theirs == LEFT_OUT and ours not in there:
            raise InputError(f"{where}, columns: {ours}", "no such column to leave out", nearest(ours, sorted(there)))


def unused(recording: Recording, columns: Mapping[str, str], machine: Machine) -> list[str]:
    """Columns of a file that a survey does not use."""
    taken = set(columns.values()) | {theirs.removeprefix("-") for theirs in columns.values()}
    known = (*LABELS, *(f"{READ_BACK}{j.name}" for j in machine.joints))
    names = [str(n) for n in recording.frame]
    out = {ours for ours, theirs in columns.items() if theirs == LEFT_OUT}
    return [n for n in names if n in out or (n not in taken and n not in known and not is_survey_column(n, machine))]
