"""Permutation test of whether measured points belong to their commands; a survey that fails it is refused."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.effects.axis_blunder import AxisBlunder
from errormodel.exceptions import InputError
from errormodel.machine import Joint, Machine
from errormodel.serial_chain import ONLY_SERIAL
from errormodel.survey import Survey
from errormodel.surveys.columns import MEASURED
from errormodel.surveys.touched_places import touched_again
from identification.diagnosis.data_checks.blunder import Points, Sheet, groups, length, sheet
from identification.diagnosis.data_checks.columns import (
    BETTER,
    TWO,
    Changes,
    change_text,
    changes_together,
    mended,
    outside_after,
    single_changes,
    told_apart,
    wrong_column,
)
from identification.diagnosis.data_checks.machine_entries import has_own_tool
from identification.diagnosis.data_checks.rows import FEWEST
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog
from identification.estimation.result import Fit
from identification.observation.frames import MACHINE_ERROR_SHARE
from identification.observation.models import PositionView

SHUFFLES = 20
RELATED = 0.5  # of the misfit of rows that have nothing to do with each other
STAYS = 0.1  # of the spread of the other points: points at one place
LEAVES = 0.05  # of the spread: most points so far from a plane are not in it
FALLS = 20.0  # times: nominal points that one change of a column brings together
LISTED_CHANGES = 3  # changes in a message
OWN_COMMAND = "See that each row holds what was measured at its own command"


def refuse_unstated_rotation(fit: Fit) -> None:
    """InputError where components are missing, and what is left of a frame's rotation makes errors that no machine has.

    A tilt that the measured components do not determine still shortens them, by its cosine.
    """
    nominal = 1e-3 * fit.nominal.rms_um
    if not fit.nominal.n or nominal < MACHINE_ERROR_SHARE * fit.chain.size:
        return
    for view in fit.problem.views:
        if isinstance(view, PositionView) and len(view.pose.undetermined) and view.components.any(axis=0).sum() == 2:
            raise InputError(
                f"{fit.survey.source}, columns {' '.join(MEASURED)}",
                f"measured components that lie {nominal:.3g} mm rms beside the nominal machine, and do not determine "
                "the rotation of the measuring frame",
                "Write frame_rotation in survey.yaml, turn what was measured into the machine's axes, or measure all "
                "three components",
            )


def refuse_still_joint(chain: Chain, survey: Survey) -> None:
    """InputError where a joint that never moves keeps the nominal points in a plane, and most measured are in none.

    Its log had stopped. Any change of a measured column that flattens the points would make such rows fit.
    """
    for rows in groups(survey):
        columns = sheet(chain, survey.table.iloc[rows])
        points = Points.of(chain, columns, survey.frame == "fixed").measured_whole
        still = [j.name for j in chain.machine.joints if np.ptp(columns[j.name]) == 0]
        if len(points) < FEWEST or not still or not points.spread > 0:
            continue
        nominal, measured = (np.median(_from_plane(p)) for p in (points.nominal, points.measured))
        if nominal < STAYS * LEAVES * points.spread and measured > max(LEAVES * points.spread, points.largest):
            raise InputError(
                f"{survey.table['file'].iloc[rows[0]]}, columns {' '.join(still)}",
                "the same in all rows, so that the nominal points lie in a plane, while half of the measured ones are "
                f"more than {measured:.3g} mm beside their own",
                f"Write to what {' and '.join(still)} was commanded in each row: the record had stopped",
            )


def _from_plane(points: Array) -> Array:
    """Distances (n,) of points (n, 3) from the plane that lies nearest to them."""
    centred = points - np.median(points, axis=0)
    return np.asarray(np.abs(centred @ np.linalg.svd(centred, full_matrices=False)[2][-1]))


def refuse_unrelated(chain: Chain, survey: Survey, log: DecisionLog = UNRECORDED) -> None:
    """InputError where measured points fit the commands no better than those of any other rows would."""
    for rows in groups(survey):
        columns = sheet(chain, survey.table.iloc[rows])
        points = Points.of(chain, columns, survey.frame == "fixed")
        found = points.misfit()
        if len(rows) < FEWEST or found < TWO * chain.size:
            continue
        rng = np.random.default_rng(0)
        any_order = [replace(points, measured=rng.permutation(points.measured)).misfit() for _ in range(SHUFFLES)]
        shuffled = float(np.median(any_order))
        if found <= RELATED * shuffled:
            log.add("unrelated-points", "passed", "rows", found / shuffled, RELATED, beside="rows in any order")
            continue
        if points.reach < STAYS * points.spread:
            own = replace(survey, table=survey.table.iloc[rows])
            what, cure = _one_place(chain, own, columns, points)
        elif points.fixed:
            what, cure = _fixed(chain, points, found)
        elif points.spread < STAYS * points.reach:
            what = (
                f"measured points that wander by {points.reach:.4g} mm, where the commands keep the tool at one place, "
                f"within {points.spread:.4g} mm"
            )
            cure = f"{OWN_COMMAND}, and that this is the machine"
        elif touched_again(survey.table, chain, survey.frame)[rows].all():
            places = len(np.unique(points.measured, axis=0))
            what = (
                f"the measured points are {places} places, read in {len(rows)} rows, and the nominal points of the "
                f"commands lie {found:.0f} mm beside them"
            )
            cure = (
                "If balls were probed, look at the sign, the zero and the unit of each joint's column, and see that "
                "each row holds one command and its own ball. If what was probed (a ball plate) was moved in between, "
                "give each place of it a run of its own, and write frame: per-run in a survey.yaml; else the "
                "instrument had stopped"
            )
        else:
            what = (
                f"measured points that have nothing to do with the commands: the best frame leaves {found:.0f} mm, "
                f"rows in any order would leave {shuffled:.0f} mm"
            )
            cure = f"{OWN_COMMAND}, and that this is the machine. {ONLY_SERIAL}"
            what, cure = (
                _in_some_runs(chain, survey, rows) or _other_chain(chain.machine, columns, points) or (what, cure)
            )
        raise InputError(f"{survey.table['file'].iloc[rows[0]]}, columns {' '.join(MEASURED)}", what, cure)


def _in_some_runs(chain: Chain, survey: Survey, rows: Index) -> tuple[str, str] | None:
    """What is wrong, and the cure, where the points of some runs fit their commands and those of others do not."""
    table = survey.table.iloc[rows].reset_index(drop=True)
    misfits = {}
    for run, own in table.groupby(table["run"].astype(str), sort=False):
        points = Points.of(chain, sheet(chain, own), survey.frame == "fixed").measured_whole
        if len(points) >= FEWEST:
            misfits[str(run)] = points.misfit()
    good = [run for run, misfit in misfits.items() if misfit < TWO * chain.size]
    bad = [run for run in misfits if run not in good]
    if not good or not bad:
        return None
    of_these = table[table["run"].astype(str).isin(bad)].reset_index(drop=True)
    mistake = wrong_column(chain, replace(survey, table=of_these))
    what = (
        f"points of run {', '.join(good)} that fit their commands, and of run {', '.join(bad)} that do not, by up to "
        f"{max(misfits[run] for run in bad):.0f} mm"
    )
    said = f"{what}: there {mistake.text}" if mistake else what
    return said, f"Put the columns of run {', '.join(bad)} right, or leave these rows out"


def _other_chain(machine: Machine, columns: Sheet, points: Points) -> tuple[str, str] | None:
    """What is wrong, and the cure, where the points fit a chain with two of the joints exchanged."""
    found = list[tuple[float, str]]()
    places = [k for k, element in enumerate(machine.elements) if isinstance(element, Joint)]
    for one, other in combinations(places, 2):
        elements = list(machine.elements)
        elements[one], elements[other] = elements[other], elements[one]
        changed = replace(machine, elements=tuple(elements), effects=())  # of the nominal points alone
        misfit = Points.of(Chain(changed), columns, points.fixed).misfit()
        if misfit < points.largest:
            found.append((misfit, f"{elements[other].name} and {elements[one].name}"))
    if not found:
        return None
    found.sort()
    pairs = " or ".join(names for _, names in found)
    return (
        f"measured points that lie {length(1e3 * points.misfit())} beside the machine, and {length(1e3 * found[0][0])} "
        f"beside one whose joints {pairs} are exchanged in the chain",
        "See in which order the joints carry each other, from the workpiece to the tool, and write them so in the "
        "machine file",
    )


def _one_place(chain: Chain, survey: Survey, columns: Sheet, points: Points) -> tuple[str, str]:
    """What is wrong, and the cure, where the measured points stay at one place and the nominal ones do not."""
    what = (
        f"the measured points stay at one place, within {points.reach:.4g} mm, and the nominal points of the commands "
        f"wander by {points.spread:.4g} mm"
    )
    found = _bring_together(chain, columns, points)
    if len(found) > 1:
        found = told_apart(chain, survey, [*found, *_with_measured(chain.machine, found)]) or found
    if 0 < len(found) <= LISTED_CHANGES:
        one = "; or ".join(change_text(c, chain.machine, points.fixed, columns) for c in found)
        return what, f"If one ball was measured, {one}: with that alone put right the nominal points coincide"
    return what, (
        "If one ball was measured, look at the sign, the zero and the unit of each joint's column. If the columns hold "
        "deviations from the commanded points, write the points that were measured. If neither, the instrument had "
        "stopped"
    )


def _bring_together(chain: Chain, columns: Sheet, points: Points) -> list[Changes]:
    """The changes of one joint's column that bring the nominal points together; a zero only if no other does.

    Of several, those that keep the joints within their travels: a mirrored joint and another can be one reflection.
    """

    def spread(changes: Changes) -> float:
        return Points.of(chain, mended(columns, changes), fixed=True).spread

    joints = {joint.name for joint in chain.machine.joints}
    every = (*single_changes(chain.machine), *changes_together(chain.machine, has_own_tool(chain.machine, columns)))
    simple = [c for c in every if c[0].column in joints]
    enough = points.spread / FALLS
    found = [c for c in simple if spread(c) < enough] or [c for c in _zeros(chain, columns) if spread(c) < enough]
    outside = [round(outside_after(columns, c, chain.machine), 1) for c in found]
    return [c for c, out in zip(found, outside, strict=True) if out == min(outside)]


def _with_measured(machine: Machine, found: list[Changes]) -> Iterator[Changes]:
    """Linear joints that count the other way together with a measured column: a recording of the mirrored machine."""
    linear = {joint.name for joint in machine.joints if joint.type == "prismatic"}
    for changes in found:
        if len(changes) == 1 and changes[0].column in linear and changes[0].factor == -1:
            yield from ((*changes, AxisBlunder(column=name, factor=-1.0)) for name in MEASURED)


def _zeros(chain: Chain, columns: Sheet) -> Iterator[Changes]:
    """For each joint the zero of its column that brings the nominal points nearest together."""
    for joint in chain.machine.joints:
        zero = _zero(chain, columns, joint)
        yield (AxisBlunder(column=joint.name, offset=float(f"{zero:.4g}")),)


def _zero(chain: Chain, columns: Sheet, joint: Joint) -> float:
    """Gauss-Newton on the distances of the nominal points from their middle; mm or rad."""
    turns = joint.type == "rotary"
    step = 1e-4 if turns else 1.0

    def about(zero: float) -> Array:
        nominal = Points.of(chain, columns | {joint.name: columns[joint.name] + zero}, fixed=True).nominal
        return np.asarray(nominal - nominal.mean(axis=0))

    starts = (np.arange(-6, 6) * np.pi / 6).tolist() if turns else [0.0]
    zero = float(min(starts, key=lambda start: float(np.sum(about(start) ** 2))))
    for _ in range(10):
        slope = (about(zero + step) - about(zero - step)) / (2 * step)
        move = float(np.sum(slope * about(zero)) / max(float(np.sum(slope**2)), 1e-12))
        zero -= move
        if abs(move) < 1e-3 * step:
            break
    return float(np.angle(np.exp(1j * zero))) if turns else zero


def _fixed(chain: Chain, points: Points, found: float) -> tuple[str, str]:
    """What is wrong, and the cure, where the frame is fixed and the measured points lie elsewhere."""
    off = ", ".join(f"{v:.4g}" for v in np.mean(points.measured - points.nominal, axis=0))
    what = (
        "with frame: fixed the measured points must be in the machine's own reference, and in the mean they are off by "
        f"({off}) mm"
    )
    shared = replace(points, fixed=False).misfit()
    if shared < found / BETTER and shared < TWO * chain.size:
        cure = f"Write frame: shared in the survey.yaml: a frame of their own leaves {shared:.3g} mm of {found:.4g} mm"
        if np.abs(points.measured).max() < TWO * chain.size:
            cure += ". If the columns hold deviations, add the commanded point to keep the frame fixed"
        return what, cure
    what += f"; a frame of their own leaves {shared:.0f} mm"
    return what, f"{OWN_COMMAND}, and that this is the machine. {ONLY_SERIAL}"
