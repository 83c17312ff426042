"""A column with another sign, unit or zero than it should have, or that stands in another's place.

Each hypothesis is a change of the table; the nominal machine is aligned to the changed table in closed form. Geometry
is small, so that the right table fits to a fraction of what a wrong one does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.effects.axis_blunder import DIAMETER, AxisBlunder, Table
from errormodel.exceptions import enumerated
from errormodel.machine import Joint, Machine
from errormodel.survey import Survey
from errormodel.surveys.columns import MEASURED, TOOL_COLUMNS
from identification.diagnosis.data_checks.blunder import FEWEST, Blunder, Points, Sheet, groups, sheet
from identification.diagnosis.data_checks.declared_errors import CLEAR, left_by_declared
from identification.diagnosis.data_checks.machine_entries import (
    all_lengths,
    entry_text,
    has_own_tool,
    of_machine,
    outside_travels,
)
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog
from identification.observation.frames import MACHINE_ERROR_SHARE

ALIKE = 1.05  # times: two changes that fit as well
NEAR = 3.0  # times: as near to the nominal machine may be the mirror image of one with errors; by judgement
BETTER = 4.0  # times: a mended table must fit the nominal machine this much better
RIGHT = 0.1  # of the points' spread: what fits worse has not been put right
ZERO = 1e-3  # of the machine's size: a nominal error below it needs no other zero of a column
TWO = 4e-3  # of the machine's size: a nominal error beyond it may be two mistakes at once
FIRST = 8  # of two mistakes, one is among so many that fit best alone
SAMPLE = 150  # rows tell as much as all
DEGREE = float(np.degrees(1.0))
UNITS = (25.4, 1 / 25.4, 1e3, 1e-3)  # inch, and metre or micrometre
UNIT_NAMES = {25.4: "inch", 1e3: "m", 1e-3: "um"}

Changes = tuple[AxisBlunder, ...]


def wrong_column(chain: Chain, survey: Survey, *, two: bool = False, log: DecisionLog = UNRECORDED) -> Blunder | None:
    """The most convincing mistake of whole columns, or None; a further one shows once the survey has been mended.

    `two` at once are looked for where each alone tells nothing, which takes seconds.
    """
    rows = max(groups(survey), key=len, default=np.zeros(0, dtype=np.intp))
    if len(rows) < FEWEST:
        return None
    fixed = survey.frame == "fixed"
    columns = sheet(chain, survey.table.iloc[rows[np.unique(np.linspace(0, len(rows) - 1, SAMPLE).astype(int))]])

    def misfit(changes: Changes) -> float:
        """Per spread of the measured points: another unit of theirs alone makes nothing fit better."""
        changed = mended(columns, changes)
        if all(np.array_equal(changed[name], values) for name, values in columns.items()):
            return before  # another unit of a tool that has no length
        points = Points.of(chain, changed, fixed)
        return points.misfit() / max(points.reach, 1e-9)

    table = Points.of(chain, columns, fixed)
    before = table.misfit() / max(table.reach, 1e-9)
    small, larger, largest = (part * chain.size / max(table.reach, 1e-9) for part in (MACHINE_ERROR_SHARE, ZERO, TWO))
    if before < small:
        if not two:
            log.add("nominal-misfit", "passed", "columns", before, small)
        return None
    enough = min(before / BETTER, RIGHT)
    own_tool = has_own_tool(chain.machine, columns)
    simple = [*single_changes(chain.machine), *changes_together(chain.machine, own_tool)]
    of_columns = [c for c in simple if own_tool or c[0].column not in TOOL_COLUMNS]
    tries = [(misfit(c), c) for c in of_columns]
    if _least(tries) > enough:
        zeros = [(_zero(chain, columns, joint, fixed),) for joint in chain.machine.joints if before > larger]
        tries += [(misfit(c), c) for c in (*zeros, *(c for c in simple if c not in of_columns))]
    if _least(tries) > enough and before > largest and two:
        tries = [(BETTER * misfit(c), c) for c in _pairs(chain, columns, fixed, simple)]
    if _least(tries) > enough:
        log.add("wrong-column", "passed", "columns", _least(tries), enough, beside=f"{before:.4g} as written")
        return None
    changes, *others = _likeliest(tries, columns, chain, survey)
    what = f"column {' '.join(dict.fromkeys(c.column for c in changes))}"
    log.add("wrong-column", "found", what, _least(tries), enough, beside=f"{before:.4g} as written")
    text = "; or ".join(dict.fromkeys(change_text(c, chain.machine, fixed, columns) for c in (changes, *others)))
    return Blunder(
        text=text,
        cure=AxisBlunder.separate + (", or the machine file" if "machine file" in text else ""),
        survey=replace(survey, table=mended(survey.table, changes)),
        where=changes[0].where,
        driver=tuple(dict.fromkeys(c.column for c in changes)),
        changes=changes,
        others=tuple({c[0].where: c for c in reversed(others) if c[0].where != changes[0].where}.values())[::-1],
        before_um=1e3 * table.misfit(),
        after_um=1e3 * Points.of(chain, mended(columns, changes), fixed).misfit(),
        of_machine=of_machine(chain.machine, columns, mended(columns, changes), changes),
    )


def mended(table: Table, changes: Changes) -> Table:
    """The table after some changes."""
    for change in changes:
        table = change.mend(table)
    return table


def change_text(changes: Changes, machine: Machine, fixed: bool, columns: Sheet) -> str:
    """What is wrong; one sentence for all columns that are wrong in the same way."""
    first, *more = changes
    if not more and first.column in MEASURED and not fixed and _reflects(first):
        # in a frame that may stand in any way, all reflections are one
        return (
            "mx my mz are left-handed: one of them has the wrong sign, or two are swapped; or a linear joint counts "
            "the other way than in machine.yaml, and then these parameters are of the mirrored machine"
        )
    names = [c.column for c in changes]
    if more and not any(c.swap or c.offset or c.factor != first.factor for c in changes):
        same = first.model_copy(update={"column": enumerated(names)})
        of_file = first.column in TOOL_COLUMNS and not has_own_tool(machine, columns)
        whose = "the machine file's" if of_file else "columns"
        text = same.text(machine).replace("column ", f"each of {whose} ", 1)
        if not all_lengths(changes):
            return text
        unit = (
            f" (units: {{length: {UNIT_NAMES[first.factor]}}} in a survey.yaml)" if first.factor in UNIT_NAMES else ""
        )
        return f"{text}{unit}, or the lengths of the machine file divided by it"
    if more:
        return " and ".join(c.text(machine) for c in changes)
    return entry_text(machine, columns, mended(columns, changes), first)


def _pairs(chain: Chain, columns: Sheet, fixed: bool, simple: list[Changes]) -> list[Changes]:
    """The two changes that a glance at some of the rows thinks best, in `FIRST` ways."""
    some = {name: values[::3] for name, values in columns.items()}

    def glance(changes: Changes) -> float:
        points = Points.of(chain, mended(some, changes), fixed)
        return points.misfit(points.pose(rounds=0)) / max(points.reach, 1e-9)

    first = sorted(simple, key=glance)[:FIRST]
    return sorted(((*one, *other) for one in first for other in simple), key=glance)[:FIRST]


def _least(tries: list[tuple[float, Changes]]) -> float:
    return min(t[0] for t in tries)


def single_changes(machine: Machine) -> Iterator[Changes]:
    """One column's sign or unit, or two that are swapped; those of joints first."""
    for joint in machine.joints:
        for factor in (-1.0, *UNITS, DEGREE, 1 / DEGREE, *(DIAMETER if joint.type == "prismatic" else ())):
            yield (AxisBlunder(column=joint.name, factor=factor),)
    for one, other in combinations(machine.joints, 2):
        # as they were read, each in its own unit
        factor = 1.0 if one.type == other.type else DEGREE if one.type == "prismatic" else 1 / DEGREE
        yield (AxisBlunder(column=one.name, swap=other.name, factor=factor),)
    for names in (MEASURED, TOOL_COLUMNS):
        for name in names:
            for factor in (-1.0, *UNITS):
                yield (AxisBlunder(column=name, factor=factor),)
        for one_, other_ in combinations(names, 2):
            yield (AxisBlunder(column=one_, swap=other_),)


def changes_together(machine: Machine, own_tool: bool) -> Iterator[Changes]:
    """All columns of a kind in another unit, and the tool's point given from the other end."""
    rotary, linear = ([j.name for j in machine.joints if j.type == kind] for kind in ("rotary", "prismatic"))
    # beside rotary axes the machine's dimensions say how long a mm is
    lengths = [*linear, *MEASURED, *(TOOL_COLUMNS if own_tool else ())] if rotary else []
    for names, factors in (
        (rotary, (DEGREE, 1 / DEGREE)), (TOOL_COLUMNS, (-1.0, *UNITS)), (lengths, UNITS),
    ):  # fmt: skip
        if len(names) > 1:
            yield from (tuple(AxisBlunder(column=name, factor=f) for name in names) for f in factors)


def _zero(chain: Chain, columns: Sheet, joint: Joint, fixed: bool) -> AxisBlunder:
    """The zero of a joint's column with which it fits best: Gauss-Newton beside the frame, from twelve directions."""
    step = 1e-4 if joint.type == "rotary" else 1.0

    def at(zero: float) -> Points:
        return Points.of(chain, columns | {joint.name: columns[joint.name] + zero}, fixed)

    starts = (np.arange(-6, 6) * np.pi / 6).tolist() if joint.type == "rotary" else [0.0]
    zero = float(min(starts, key=lambda s: at(s).misfit()))
    for _ in range(10):
        here, pose = at(zero), at(zero).pose()
        slope = (at(zero + step).nominal - at(zero - step).nominal) / (2 * step)
        gap = pose.invert(here.measured) - here.nominal
        weights = 1 / (1 + (np.linalg.norm(gap, axis=1) / max(3 * here.misfit(pose), 1e-9)) ** 2)
        free = np.zeros((len(here), 0, 3)) if fixed else _frame_columns(here.nominal)
        design = np.concatenate([slope[:, None, :], free], axis=1) * weights[:, None, None]
        design = design.transpose(0, 2, 1).reshape(3 * len(here), -1)
        norms = np.maximum(np.linalg.norm(design, axis=0), 1e-12)
        move = np.linalg.lstsq(design / norms, (gap * weights[:, None]).ravel(), rcond=1e-9)[0][0] / norms[0]
        zero += float(move)
        if abs(move) < 1e-3 * step:
            break
    if joint.type == "rotary":
        zero = float(np.angle(np.exp(1j * zero)))
    return AxisBlunder(column=joint.name, offset=float(f"{zero:.6g}"))


def _frame_columns(points: Array) -> Array:
    """What small motions of the frame do at points (n, 3): (n, 6, 3)."""
    middle = points - points.mean(axis=0)
    shifts = np.broadcast_to(np.eye(3), (len(points), 3, 3))
    return np.concatenate([shifts, np.cross(np.eye(3)[None], middle[:, None, :])], axis=1)


def _likeliest(tries: list[tuple[float, Changes]], columns: Sheet, chain: Chain, survey: Survey) -> list[Changes]:
    """Of the changes that fit as well as the best, those that keep the joints best within their travels.

    A mirrored joint and a mirrored column can be one and the same reflection. Then no joint is blamed for what a
    measured column explains: the measured ones come first. Joints of which each has a mirrored machine that lies as
    near are told by what the declared errors leave.
    """
    least = _least(tries)
    near = [(misfit, c) for misfit, c in tries if misfit <= NEAR * least + 1e-8]
    # of a measured column that is mirrored the text says itself that the machine file may be so
    mirrored = any(_mirrors_measured(c) for _, c in near)
    outside = [round(outside_after(columns, c, chain.machine, axes=not mirrored), 1) for _, c in near]
    inside = [t for t, out in zip(near, outside, strict=True) if out == min(outside)]
    alike = [c for misfit, c in inside if misfit <= ALIKE * _least(inside) + 1e-8]
    of_joints: list[Changes] = [
        c for _, c in inside if len(c) == 1 and c[0].factor == -1 and c[0].column not in MEASURED
    ]
    if len(of_joints) > 1 and all(c in of_joints for c in alike):
        alike = told_apart(chain, survey, of_joints) or alike
    return sorted(alike, key=lambda c: not _mirrors_measured(c))


def told_apart(chain: Chain, survey: Survey, ways: Sequence[Changes]) -> list[Changes]:
    """Those of some changes with which the machine's declared errors leave clearly less than with others."""
    left = [left_by_declared(chain, replace(survey, table=mended(survey.table, c))) for c in ways]
    known = [deviation for found in left if found is not None for deviation in found[:1]]
    if len(known) < len(ways):
        return []
    return [c for c, deviation in zip(ways, known, strict=True) if deviation <= CLEAR * min(known)]


def measured_reflections() -> Iterator[Changes]:
    """One measured column's sign, or two that are swapped."""
    yield from ((AxisBlunder(column=name, factor=-1.0),) for name in MEASURED)
    yield from ((AxisBlunder(column=one, swap=other),) for one, other in combinations(MEASURED, 2))


def _mirrors_measured(changes: Changes) -> bool:
    return all(change.column in MEASURED and _reflects(change) for change in changes)


def outside_after(columns: Sheet, changes: Changes, machine: Machine, *, axes: bool = True) -> float:
    """Part of the positions outside the travels after some changes.

    With `axes`, a joint that counts the other way may as well have the wrong sign of its axis in the machine file: then
    its positions are those that are written.
    """
    after = outside_travels(mended(columns, changes), machine)
    joints = {joint.name for joint in machine.joints} if axes else set()
    if len(changes) == 1 and changes[0].factor == -1 and changes[0].column in joints:
        return min(after, outside_travels(columns, machine))
    return after


def _reflects(change: AxisBlunder) -> bool:
    """Whether it makes a left-handed frame of a right-handed one."""
    return bool(change.swap) or change.factor == -1
