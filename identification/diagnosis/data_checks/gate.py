"""The gate before a fit is signed: a recording that holds a mistake is refused with what is wrong and what to write.

A fit follows mistakes: it takes a wrong sign for a scale of -2 and two drives in series for a scale of -0.5. What lies
close to the nominal machine passes at once. Anything else is examined as `errormodel diagnose` examines it, but nothing
is put right here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from errormodel.chain import Chain
from errormodel.channels import root
from errormodel.conventions import ROTATIONS
from errormodel.effects.clock_offset import ClockOffset
from errormodel.exceptions import InputError
from errormodel.machine import Machine
from errormodel.survey import Survey
from errormodel.surveys.columns import MEASURED
from errormodel.surveys.diameters import said
from identification.diagnosis.data_checks.blunder import FEWEST, Blunder, Points, groups, listed, misses, sheet
from identification.diagnosis.data_checks.checks import find_blunders
from identification.diagnosis.data_checks.duplicates_and_clock import copied_rows
from identification.diagnosis.data_checks.hand import left_handed
from identification.diagnosis.data_checks.head_axes import refuse_turned_head
from identification.diagnosis.data_checks.opposite_readings import opposite_readings
from identification.diagnosis.data_checks.orientations import gross_notes, orientation_notes
from identification.diagnosis.data_checks.readings import (
    lengths_of,
    refuse_exchanged_names,
    refuse_minority,
    start_notes,
)
from identification.diagnosis.data_checks.readings import refuse_wild as refuse_wild_lengths
from identification.diagnosis.data_checks.runs_of_motions import refuse_unlike_runs
from identification.diagnosis.data_checks.steps import LARGEST_MM, refuse_steps
from identification.diagnosis.data_checks.tool_lengths import NOTED_MM, WRONG_MM, refuse_other_tools, tool_notes
from identification.diagnosis.data_checks.unrelated import refuse_unstated_rotation
from identification.estimation.checks import FOREIGN_MACHINE_SHARE, WILD, WILD_FROM, another, far_off, looked_over
from identification.estimation.result import Fit
from identification.observation.assembly import build
from identification.observation.frames import MACHINE_ERROR_SHARE
from identification.observation.readings import ReadingView

EXPLAINED = 0.01  # of the nominal error: a fit that leaves less has found it, if its errors are of a machine's size
ROBUST_SIZES = 1000.0  # of the machine, up to which a robust fit finds its way beside a wild row: tried
LARGE = 0.05  # rad or 1: error motions of a joint that a machine never has


def passed(machine: Machine, survey: Survey, fitted: Callable[[], Fit], robust: bool = False) -> Fit:
    """The fit, looked over; a recording with a mistake in it is refused.

    Parameters
    ----------
    fitted : makes the fit of the machine to the survey.
    robust : it weighs rows by how far they lie, and names those that it leaves out.

    Raises
    ------
    InputError
        The recording holds a mistake, or is of another machine, or its rows are too few.
    """
    refuse_unlike_runs(survey)
    try:
        fit = looked_over(fitted())
    except InputError:
        _refuse_copies(Chain(machine), survey)
        if not robust:  # which says itself that too many rows are wrong
            examine(machine, survey)  # a mistake is a better reason than what came of it
            _refuse_lengths(Chain(machine), survey)
        raise
    _refuse_copies(fit.chain, survey)
    lengths = lengths_of(fit.chain, fit.problem.views)
    if robust:
        refuse_minority(survey, fit)
    else:
        refuse_exchanged_names(fit.chain, fit.survey, lengths)
        refuse_wild_lengths(survey, lengths)
    refuse_turned_head(fit)
    oriented = orientation_notes(fit.survey, fit.problem)
    tools = tool_notes(fit.chain, fit.survey, NOTED_MM)
    gross = () if robust else gross_notes(fit)
    fit = replace(fit, notes=(*fit.notes, *start_notes(fit.survey, lengths), *oriented, *tools, *gross))
    refuse_unstated_rotation(fit)
    nominal = fit.nominal
    if nominal.n and 1e-3 * nominal.max_um >= MACHINE_ERROR_SHARE * fit.chain.size:
        examine(machine, survey, robust)
        refuse_another_machine(fit)
    elif (mirrored := left_handed(fit.chain, survey)) is not None:
        raise refused(survey, mirrored)
    elif nominal.n and 1e-3 * nominal.max_um >= LARGEST_MM / 4:  # the frame takes half of a step
        refuse_steps(machine, survey)
    if nominal.n and 1e-3 * nominal.max_um >= WRONG_MM / 4:  # and of what half of the rows have
        refuse_other_tools(fit.chain, survey)
    _refuse_opposite(survey, fit)
    return fit


def refuse_another_machine(fit: Fit, *, tried: bool = False) -> None:
    """InputError where what was measured lies further beside the nominal machine than errors that a machine has.

    Parameters
    ----------
    tried : whether mistakes in columns and rows would have been put right before.
    """
    if _whole(fit.survey) and another(fit.chain, fit.nominal) and not _known_by(fit):
        raise InputError(
            str(fit.survey.source), "this is not the machine that was measured", far_off(fit.nominal, tried=tried)
        )


def _refuse_opposite(survey: Survey, fit: Fit) -> None:
    """InputError about readings of the opposite sign, beside points with the weights that the fit gave them."""
    points = (v for v in fit.counted if not isinstance(v, ReadingView))
    if (found := opposite_readings(survey, fit.problem, (*points, *fit.problem.readings))) is not None:
        raise InputError(str(survey.source), found.text, _cure(found))


def _refuse_lengths(chain: Chain, survey: Survey) -> None:
    """InputError about lengths that stand under another's name or in another's row, in a survey that is not fitted."""
    if "length" in survey.fit.table:
        lengths = lengths_of(chain, build(chain, survey.fit).views)
        refuse_exchanged_names(chain, survey.fit, lengths)
        refuse_wild_lengths(survey.fit, lengths)


def _refuse_copies(chain: Chain, survey: Survey) -> None:
    if (copies := copied_rows(chain, survey)) is not None:  # they lie where they should, and count more than once
        raise InputError(str(survey.source), copies.text, _cure(copies))
    rows = survey.table.iloc[np.concatenate([np.zeros(0, np.intp), *groups(survey)])]
    if len(rows) >= FEWEST and bool((rows.drop(columns=["row"]).nunique(dropna=False) == 1).all()):
        raise InputError(str(survey.source), f"{len(rows)} rows that are all the same", "Measure all over the travels")


def examine(machine: Machine, survey: Survey, robust: bool = False) -> None:
    """Look for mistakes in the rows to fit; for wild rows not where a `robust` fit names them itself.

    Raises
    ------
    InputError
        There is one: what is wrong, and what to write instead.
    """
    if not _whole(survey):
        return
    chain = Chain(machine)
    for blunder in find_blunders(machine, survey):
        if blunder.effect != ClockOffset.effect or "time" in map(root, chain.channels):
            raise refused(survey, blunder)
    if not robust:
        _refuse_wild(chain, survey)


def _whole(survey: Survey) -> bool:
    """Whether enough rows have all three components, without which nobody knows where a point lies."""
    return bool(np.isfinite(survey.fit.measured).all(axis=1).sum() >= FEWEST)


def refused(survey: Survey, blunder: Blunder) -> InputError:
    """What a command says that does not put a mistake right."""
    return InputError(str(survey.source), f"{blunder.text}{misses(blunder)}{blunder.doubt}", _cure(blunder))


def _cure(blunder: Blunder) -> str:
    """What to write instead."""
    swaps = [c for c in blunder.changes if c.swap]
    cure = blunder.check[0].upper() + blunder.check[1:]
    if blunder.open:
        return cure
    if len(swaps) == len(blunder.changes) == 1 and swaps[0].factor == 1 and "left-handed" not in blunder.text:
        one, other = swaps[0].column, swaps[0].swap
        cure = f"Write columns: {{{one}: {other}, {other}: {one}}} in a survey.yaml, or {cure[0].lower()}{cure[1:]}"
    if blunder.in_diameters:
        cure = said(blunder.in_diameters)
    return f"{cure}. `errormodel diagnose` puts it right by itself and goes on"


def _refuse_wild(chain: Chain, survey: Survey) -> None:
    """InputError about rows that lie where no error motion takes them, while most lie where they should."""
    for rows in groups(survey):
        points = Points.of(chain, sheet(chain, survey.table.iloc[rows]), survey.frame == "fixed")
        if len(points) < FEWEST:
            continue
        distance = points.distances()
        usual = float(np.quantile(distance, 0.8))
        wild = np.flatnonzero(distance > max(WILD * usual, WILD_FROM * chain.size))
        if not len(wild):
            continue
        numbers = survey.table["row"].to_numpy()[rows[wild]].tolist()
        cure = "Leave mx my mz empty in these rows"
        if distance[wild].max() < ROBUST_SIZES * chain.size:
            cure += ", or fit with --robust, which weighs rows by how far they lie"
        some = f"rows {listed(numbers)} lie" if len(numbers) > 1 else f"row {numbers[0]} lies"
        raise InputError(
            f"{survey.table['file'].iloc[rows[0]]}, columns {' '.join(MEASURED)}",
            f"{some} up to {distance[wild].max():.3g} mm from where the other {len(points) - len(wild)} rows put "
            "the nominal machine",
            cure,
        )


def _known_by(fit: Fit) -> bool:
    """Whether the fit explains a large nominal error, such as another tool's, by errors that a machine can have."""
    if not fit.fitted.rms_um < EXPLAINED * fit.nominal.rms_um:
        return False
    chain, named = fit.chain, fit.solution.named()
    travels = {j.name: j.travel[1] - j.travel[0] for j in chain.machine.joints}
    for parameter in chain.parameters:
        travel = travels.get(parameter.element)
        limit = {"1": LARGE, "rad": LARGE, "rad/mm": LARGE / (travel or 1.0), "mm": FOREIGN_MACHINE_SHARE * chain.size}
        dimension = travel is None and parameter.motion not in ROTATIONS  # an offset or a tool may be another one
        if not dimension and abs(named.get(parameter.id, 0.0)) > limit.get(parameter.unit, np.inf):
            return False
    return True
