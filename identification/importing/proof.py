"""Proof of a join: how well the nominal machine, in the best frame, meets what was measured; and what fits instead.

Mistakes are looked for as the diagnosis looks for them (columns of another sign, unit or place; rows that are late,
exchanged or of another frame). A join that holds one is refused, with what fits instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import Array, Index, Mask
from errormodel.chain import Chain
from errormodel.effects.clock_offset import ClockOffset
from errormodel.exceptions import InputError
from errormodel.machine import Machine
from errormodel.survey import Survey
from errormodel.surveys.columns import MEASURED, ORIENTATION, TOOL_COLUMNS
from errormodel.surveys.diameters import said
from identification.diagnosis.data_checks.blunder import FEWEST, Blunder, Points, groups, misses, sheet
from identification.diagnosis.data_checks.checks import find_blunders
from identification.diagnosis.data_checks.columns import NEAR, wrong_column
from identification.diagnosis.data_checks.orientations import orientation_notes
from identification.diagnosis.data_checks.steps import Step
from identification.diagnosis.data_checks.tool_lengths import NOTED_MM, refuse_other_tools, tool_notes
from identification.importing.axes_as_points import refuse_axes_as_points
from identification.importing.exchanged_rows import CURE, FEWEST_PROVED, refuse_exchanged, refuse_few_exchanged
from identification.importing.far_rows import far_rows
from identification.importing.one_place import OnePlace, at_one_place, prove_one_place
from identification.importing.other_orders import OtherOrder, in_a_plane, other_order
from identification.importing.repeat_shift import RepeatShift, displacement
from identification.importing.standing import Standing, standings
from identification.observation.assembly import build, frame_labels

FOREIGN = 0.02  # of the points' reach: a rigid alignment of points that belong together leaves less; by judgement
UNIT_FACTORS = {1.0: "mm", 25.4: "inch", 1e3: "m", 1e-3: "um", 10.0: "cm"}  # mm a unit
FEWEST_OF_UNIT = 4  # points, for their unit to be judged
LEAST_SPREAD = 1e-6  # mm: commands at one place
DEGREES = "multiplied by 57.29"  # of joints in a message: degrees a radian
TOO_GOOD_UM = 0.2  # rms of points over a machine's travels: less is below what instruments resolve; by judgement
BETTER = 10.0  # times nearer, with one sign turned
MIRROR_CURE = (
    "One coordinate has the other sign, or two are exchanged (a left-handed frame), in the measurements or in the "
    "commands. Turn it where it is wrong: --columns mz=-Z or mx=Y,my=X (mz=-mz, mx=my,my=mx of formats that name their "
    "columns), or --command-columns with the sign or exchange of a joint"
)
SPOKEN = 80  # characters of rows in a message
UNIT_SLACK = 0.02  # of a factor: errors of a machine are far smaller


@dataclass(frozen=True)
class Proof:
    """How measured points lie beside the nominal ones in the best frame.

    Attributes
    ----------
    rows : (n,) rows of the survey that it is about.
    nominal : (n, 3) mm in the measuring frame.
    measured : (n, 3) mm.
    rms_um : root mean square distance; median_um, max_um : of the distances.
    reach : root mean square distance of the measured points from their middle, mm.
    repeats : number of commands that were measured several times.
    repeat_um : pooled standard deviation of a coordinate at these; NaN without any.
    dwell_um : median standard uncertainty of a coordinate from the scatter within dwells; NaN without any.
    wild : (k,) survey rows that lie far from their commands.
    follows : for each joint that was also read back, a sentence on which position the measurements follow.
    flat : whether the commanded points lie in a plane, so that the hand of the axes does not show.
    steps : of each file whose points are displaced from a row on.
    other : another order that fits as well, where the join is by order; looked for by an import.
    one_place : what a fit says where all commands are at one place.
    standings : where the measuring frames lie beside the machine.
    probable : what is probably wrong with measured orientations, or with the tools.
    """

    rows: Index
    nominal: Array
    measured: Array
    rms_um: float
    median_um: float
    max_um: float
    reach: float
    repeats: int
    repeat_um: float
    dwell_um: float
    wild: Index
    follows: tuple[str, ...]
    flat: bool = False
    steps: tuple[Step | RepeatShift, ...] = ()
    other: OtherOrder | None = None
    one_place: OnePlace | None = None
    standings: tuple[Standing, ...] = ()
    probable: tuple[str, ...] = ()

    @property
    def too_good(self) -> str:
        """That no machine lies so near to its commands; empty where it may."""
        if len(self.rows) < FEWEST or not 0 < self.rms_um < TOO_GOOD_UM:
            return ""
        return (
            f"measured points that lie {self.rms_um:.2g} um rms from the nominal machine: none is so good. Look for a "
            "unit that is a thousand times too small, or for points that were computed"
        )

    @property
    def distance(self) -> Array:
        """From each measured point to its nominal one, (n,) mm."""
        return np.asarray(np.linalg.norm(self.measured - self.nominal, axis=1))


def prove(machine: Machine, survey: Survey, averaged: bool, points: bool) -> Proof:
    """Distances after alignment, scatter of repeats, and a search for mistakes of the join.

    Parameters
    ----------
    averaged : whether rows are means of several readings.
    points : whether points were measured, and not only error motions.

    Raises
    ------
    InputError
        What was measured does not follow the commands.
    """
    chain = Chain(machine)
    empty = np.zeros((0, 3))
    if not points:
        nothing = np.zeros(0, dtype=np.intp)
        return Proof(nothing, empty, empty, np.nan, np.nan, np.nan, 0.0, 0, np.nan, np.nan, nothing, ())
    parts = [(rows, Points.of(chain, sheet(chain, survey.table.iloc[rows]), False)) for rows in groups(survey)]
    for rows, part in parts:
        refuse_axes_as_points(machine, survey, rows, part)
    _refuse_mirror(parts, survey)
    _refuse_mistakes(machine, survey, parts)
    refuse_other_tools(chain, survey)
    one_place = None if survey.indicated else prove_one_place(chain, survey, parts)
    probable = tuple(tool_notes(chain, survey, NOTED_MM))
    if ORIENTATION[0] in survey.table:
        probable += orientation_notes(survey, build(chain, survey))
    rows = np.concatenate([r for r, _ in parts]) if parts else np.zeros(0, dtype=np.intp)
    nominal = np.vstack([p.pose().apply(p.nominal) for _, p in parts]) if parts else empty
    measured = np.vstack([p.measured for _, p in parts]) if parts else empty
    distance = np.linalg.norm(measured - nominal, axis=1)
    reach = max((p.reach for _, p in parts), default=0.0)
    if len(distance) and np.median(distance) > FOREIGN * reach and reach > 1.0 and len(distance) > 4:
        found = (
            f"measured points that lie {np.median(distance):.3g} mm (median) from the commanded ones in the best frame "
            f"and reach {reach:.0f} mm; no sign, unit, exchange or shift of rows makes them fit"
        )
        raise InputError(_place(survey), found, "See that these commands were measured, with this machine and tool")
    wild = far_rows(survey, rows, distance, FOREIGN * max(reach, chain.size))
    repeats, scatter = _repeats(machine, survey, rows)
    sigma = [c for c in ("sigma_x", "sigma_y", "sigma_z") if c in survey.table]
    dwell = 1e3 * float(np.nanmedian(survey.table[sigma])) if sigma and averaged else np.nan
    um = 1e3 * distance
    figures = (float(np.sqrt(np.mean(um**2))), float(np.median(um)), float(um.max())) if len(um) else (np.nan,) * 3
    flat = len(parts) > 0 and all(len(p) >= FEWEST_PROVED and in_a_plane(p.nominal) for _, p in parts)
    steps = [s for own, p in parts if (s := displacement(machine, survey, own, p)) is not None]
    return Proof(
        rows, nominal, measured, *figures, reach, repeats, 1e3 * scatter, dwell, wild, _follows(chain, survey), flat,
        tuple(steps), one_place=one_place,
        standings=() if one_place or survey.indicated else standings(chain, survey, parts), probable=probable,
    )  # fmt: skip


def refuse_instead_of_target(machine: Machine, survey: Survey) -> None:
    """InputError where columns of another sign or unit explain the points as well as a target beside the tool does."""
    chain = Chain(machine)
    table = survey.table.assign(**dict(zip(TOOL_COLUMNS, machine.tool, strict=True)))
    found = wrong_column(chain, replace(survey, table=table))
    if found is None or any(c.offset or c.column in TOOL_COLUMNS for c in found.changes):
        return  # another zero of a column is the same as another place of the target
    for rows in groups(survey):
        displaced, right = (
            Points.of(chain, sheet(chain, s.table.iloc[rows]), survey.frame == "fixed") for s in (survey, found.survey)
        )
        if right.misfit() / right.reach > NEAR * displaced.misfit() / displaced.reach:
            return
    raise InputError(_place(survey), f"{found.text}{misses(found)}{found.doubt}", _cure(found, machine))


def with_other_order(machine: Machine, survey: Survey, proof: Proof) -> Proof:
    """A proof that says whether another order of the readings fits as well, in any of the measuring frames."""
    chain, labels = Chain(machine), frame_labels(survey)
    frames: dict[object, list[Points]] = {}
    for rows in groups(survey):
        part = Points.of(chain, sheet(chain, survey.table.iloc[rows]), survey.frame == "fixed")
        if not at_one_place(part):
            frames.setdefault(labels[rows[0]], []).append(part)
    found = [other for files in frames.values() if (other := other_order(files)) is not None]
    return replace(proof, other=found[0] if found else None)


def _place(survey: Survey) -> str:
    return ", ".join(dict.fromkeys(survey.table["file"].astype(str)))


def refuse_unit(nominal: Array, measured: Array, name: str, read_as: float = 1.0) -> None:
    """InputError where measured points (n, 3) fit the nominal ones in another unit: their reaches say it.

    `read_as`: mm a unit as which the file's numbers were read.
    """
    good = np.isfinite(measured).all(axis=1)
    part = Points(nominal[good], measured[good])
    if len(part) < FEWEST_OF_UNIT or part.spread < LEAST_SPREAD:
        return
    ratio = part.spread / max(part.reach, 1e-12)
    for size, unit in UNIT_FACTORS.items():
        factor = size / read_as
        if factor == 1 or abs(ratio / factor - 1) > UNIT_SLACK:
            continue
        scaled = Points(part.nominal, part.measured * factor)
        if scaled.misfit() < FOREIGN * scaled.reach:
            found = (
                f"measured points that reach {part.reach:.4g} mm where the commanded ones reach {part.spread:.4g} mm: "
                f"in {unit} they fit to {1e3 * scaled.misfit():.0f} um"
            )
            raise InputError(name, found, unit_cure(unit))


def unit_cure(unit: str) -> str:
    """What to write where measured points fit in another unit."""
    return f"Say it with --units mx={unit},my={unit},mz={unit}, if that is their unit"


def _refuse_mirror(parts: list[tuple[Index, Points]], survey: Survey) -> None:
    """InputError where the measured points are the mirror image of the commanded ones."""
    for _, part in parts:
        if len(part) < FEWEST_PROVED:
            continue
        mirror = Points(part.nominal, part.measured * [1.0, 1.0, -1.0])
        before, after = part.misfit(), mirror.misfit()
        if before > FOREIGN * part.reach and after < before / BETTER and after < FOREIGN * part.reach:
            found = (
                f"measured points that are the mirror image of the commanded ones: they lie {before:.3g} mm from them, "
                f"with one sign turned {1e3 * after:.0f} um"
            )
            raise InputError(_place(survey), found, MIRROR_CURE)


def _refuse_mistakes(machine: Machine, survey: Survey, parts: list[tuple[Index, Points]]) -> None:
    """InputError about the mistake that explains best why points and commands do not belong together."""
    refuse_few_exchanged(parts, survey, FOREIGN)
    found: list[Blunder] = []
    if np.isfinite(survey.fit.measured).all(axis=1).sum() >= FEWEST:
        found = [b for b in find_blunders(machine, survey) if b.effect != ClockOffset.effect]
    if not found:
        refuse_exchanged(parts, survey, FOREIGN)
        return
    text = "; and ".join(f"{b.text}{misses(b)}{b.doubt}" for b in found)
    raise InputError(_place(survey), text, _cure(found[0], machine))


def _in_radians(blunder: Blunder, machine: Machine) -> str:
    """What says that the columns which a mistake is about are in radians."""
    named = {c.column for c in blunder.changes}
    every = {j.name for j in machine.joints if j.type == "rotary"} <= named or not named
    units = "angle=rad" if every else ",".join(f"{j.name}=rad" for j in machine.joints if j.name in named)
    what = "The angles are" if every else f"{' '.join(sorted(named))}: the angles are"
    return f"{what} in rad: say it with --command-units {units} (of one table, --units {units})"


def _cure(blunder: Blunder, machine: Machine) -> str:
    text = blunder.text
    if blunder.open:
        return f"{blunder.check[0].upper()}{blunder.check[1:]}"
    if blunder.driver and not blunder.changes:  # a column, in which rows are wrong that --columns does not reach
        return f"{blunder.cure[0].upper()}{blunder.cure[1:]}"
    if "too late" in text or "too early" in text or "another order" in text:
        return CURE
    if "frame" in text:
        return "Import the files of each station by themselves, or say --columns station=.."
    if "repeat what earlier rows measured" in text:
        rows = _stretches(blunder.rows or ())
        which = rows if len(rows) <= SPOKEN else "and its rows"
        return (
            "A copy is no reading: take it out of the table, or leave it out of an import: `errormodel import` "
            f"--leave-out {which}"
        )
    if blunder.rows:
        rows = _stretches(blunder.rows)
        rest = f"--leave-out {rows}" if len(rows) <= SPOKEN else "--leave-out and their numbers"
        return (
            "--columns is of all rows: correct these in a copy of the table, or leave them out: `errormodel import` "
            f"{rest}"
        )
    if blunder.in_diameters:
        return said(blunder.in_diameters)
    if DEGREES in text:
        return _in_radians(blunder, machine)
    return "Say it with --columns, such as my=-Y (other sign) or mx=Y,my=X, or with --units; or --command-columns"


def _stretches(rows: Sequence[int]) -> str:
    """Rows as --leave-out takes them: 8,20,51-80."""
    parts = np.split(np.array(rows), np.flatnonzero(np.diff(rows) != 1) + 1)
    return ",".join(f"{p[0]}-{p[-1]}" if len(p) > 1 else f"{p[0]}" for p in parts)


def _repeats(machine: Machine, survey: Survey, rows: Index) -> tuple[int, float]:
    """Number of commands that were measured several times in one frame, and the pooled scatter (mm) of a coordinate."""
    table = survey.table.iloc[rows]
    keys = [*(j.name for j in machine.joints), "tool_x", "tool_y", "tool_z", "file", "run"]
    group = table.groupby([table[k].round(6) if table[k].dtype.kind == "f" else table[k] for k in keys], sort=False)
    several = table[group[keys[0]].transform("size") > 1]
    if several.empty:
        return 0, np.nan
    inside = several.groupby([several[k].round(6) if several[k].dtype.kind == "f" else several[k] for k in keys])
    about = several[list(MEASURED)] - inside[list(MEASURED)].transform("mean")
    free = 3 * (len(several) - inside.ngroups)
    return int(inside.ngroups), float(np.sqrt(np.sum(about.to_numpy() ** 2) / free))


def _follows(chain: Chain, survey: Survey) -> tuple[str, ...]:
    """Which of a commanded and a read-back position the measurements follow, for each joint that has both."""
    out = []
    for joint in chain.machine.joints:
        name = next((c for c in survey.table if str(c).startswith(f"w_readback_{joint.name}_")), None)
        if name is None:
            continue
        rotary = joint.type == "rotary"
        difference = survey.table[name].to_numpy(dtype=np.float64)
        good: Mask = np.isfinite(difference)
        by_commands = _left(chain, survey, None, good)
        moved = survey.table[joint.name].to_numpy(dtype=np.float64) + (np.radians(difference) if rotary else difference)
        read = _left(chain, survey, (joint.name, moved), good)
        size = float(np.sqrt(np.mean(difference[good] ** 2))) if good.any() else 0.0
        unit = "deg" if rotary else "mm"
        text = f"{joint.name} was read back {size:.3g} {unit} rms from its command: "
        if min(by_commands, read) <= 0 or max(by_commands, read) < 1.02 * min(by_commands, read):
            out.append(text + "the measurements do not tell which of the two they follow; the commands are used")
        else:
            which = "commands" if by_commands < read else "positions read back"
            text += f"the measurements follow the {which} ({1e3 * min(by_commands, read):.1f} um rms, with the other "
            text += f"{1e3 * max(by_commands, read):.1f} um)"
            if read < by_commands:
                text += f"; to fit these, say --columns {joint.name}=.. the column that was read back"
            out.append(text)
    return tuple(out)


def _left(chain: Chain, survey: Survey, column: tuple[str, Array] | None, good: Mask) -> float:
    """Root mean square distance (mm) of the rows in the best frames, with another position of one joint."""
    squares, count = 0.0, 0
    for rows in groups(survey):
        own = rows[good[rows]]
        if len(own) < 4:
            continue
        columns = sheet(chain, survey.table.iloc[own])
        if column is not None:
            columns[column[0]] = np.ascontiguousarray(column[1][own])
        distance = Points.of(chain, columns, False).distances()
        squares, count = squares + float(distance @ distance), count + len(own)
    return float(np.sqrt(squares / count)) if count else 0.0
