"""Rows that are copies of others, and a clock that was set while measuring."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Index, Mask
from errormodel.chain import Chain
from errormodel.effects.clock_offset import ClockOffset
from errormodel.exceptions import InputError
from errormodel.survey import Survey
from errormodel.surveys.columns import MEASURED, TOOL_COLUMNS
from errormodel.surveys.touched_places import touched_again
from identification.diagnosis.data_checks.blunder import Blunder, groups, listed
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog
from identification.observation.assembly import frame_labels
from identification.observation.frames import MACHINE_ERROR_SHARE

if TYPE_CHECKING:
    import pandas as pd

CHANCE = 1e-4  # that so many repeats agree to the last digit of a coarse reading
DIGITS = 9  # behind the decimal point, mm
FINEST_DIGITS = 6  # behind the decimal point, mm: no instrument repeats a point of a machine to a nanometre
REPEATS = 3  # that differ: fewer do not tell what repeats look like
RESETS = 3  # of a clock in one file; more, and the rows are simply not in the order of time


def copied_rows(chain: Chain, survey: Survey, log: DecisionLog = UNRECORDED) -> Blunder | None:
    """Rows whose measured point is an earlier row's to the last digit, though noise would not have it so; left out.

    Whole rows with a time of their own are copies in any case, and so is a point read again at another place (the
    instrument had stopped); in another frame it is another point. Places of what was touched stand in many rows, which
    differ by their commands (`touched_again`): a mistake there makes no copies, and of them only rows whose commands
    agree as well are copies, where the readings of scales would not have it so by chance. Repeats of a pose may agree
    by chance where readings are coarse, and without noise do: where hardly any differ, by the noise that a fit without
    them finds.
    """
    table, rows = survey.table, np.sort(np.concatenate([np.zeros(0, np.intp), *groups(survey)]))
    if len(rows) < 2:
        return None
    part = table.iloc[rows].reset_index(drop=True)
    frame = frame_labels(survey)[rows]
    first = part.assign(frame=frame).groupby([*MEASURED, "frame"], sort=False).ngroup().to_numpy()
    _, start = np.unique(first, return_index=True)
    earlier = start[first]  # the first row with that measured point in its frame
    again = earlier < np.arange(len(part))
    if not again.any():
        log.add("copied-rows", "passed", "rows", 0)
        return None
    points = chain.kernel("nominal", outputs=(0, 1, 2))(chain.columns(part)).T
    elsewhere = np.linalg.norm(points - points[earlier], axis=1) > MACHINE_ERROR_SHARE * chain.size
    timed = "time" in part and part["time"].nunique() > len(part) / 4
    whole = part.drop(columns=["row", "file"]).duplicated().to_numpy() & timed
    touched = touched_again(table, chain, survey.frame)[rows]
    bad = again & (elsewhere & ~touched | whole)
    repeats = again & ~bad & ~touched
    if repeats.any():
        rest = replace(survey, table=_without(table, rows[bad | repeats]))
        pose = part.groupby(_commands(chain), sort=False).ngroup().to_numpy()
        at_pose = repeats & (pose == pose[earlier])
        for some, by_chance in ((at_pose, _agree_at_poses), (repeats & ~at_pose, _agree_anywhere)):
            if some.any() and not by_chance(part, chain, int(some.sum()), rest):
                bad |= some
    bad |= _copied_touches(part.assign(frame=frame), chain, touched & again)
    if not bad.any():
        log.add("copied-rows", "passed", "rows", int(again.sum()), beside="they agree by chance")
        return None
    log.add("copied-rows", "found", "rows", int(bad.sum()))
    numbers = tuple(int(r) for r in part["row"].to_numpy()[bad])
    new = _without(table, rows[bad])
    return Blunder(
        f"{len(numbers)} of {len(part)} rows repeat what earlier rows measured to the last digit: copies, or an "
        f"instrument that had stopped (row{'s' * (len(numbers) > 1)} {listed(numbers)})",
        replace(survey, table=new),
        effect="outliers",
        rows=numbers,
        mended="; left out",
        cure="take the copies out of the table, or measure these rows again",
    )


def _without(table: pd.DataFrame, rows: Index) -> pd.DataFrame:
    new = table.copy()
    new.loc[table.index[rows], list(MEASURED)] = np.nan
    return new


def _agreeing(chain: Chain, rest: Survey) -> float:
    """Probability that a repeat agrees in all components to the last digit, by the noise that the other rows show.

    Two normal readings of standard deviation s, rounded to steps d, are alike with d / (2 sqrt(pi) s). Rows too few for
    a fit leave nothing; then no instrument agrees with itself to the last of so many digits.
    """
    from identification.estimation.fit import fit_machine

    values = rest.measured[np.isfinite(rest.measured)]
    digits = next((d for d in range(DIGITS) if np.allclose(values, values.round(d), rtol=0.0, atol=1e-12)), DIGITS)
    unknown = 0.0 if digits > FINEST_DIGITS else 1.0
    try:
        fit = fit_machine(chain.machine, rest)
    except (InputError, np.linalg.LinAlgError):
        return unknown
    dof, count = fit.solution.dof, sum(v.count for v in fit.problem.views)
    if dof <= 0:
        return unknown
    noise = 1e-3 * fit.fitted.rms_um * np.sqrt(count / dof / 3)  # of a coordinate
    return float(min(10.0**-digits / (2 * np.sqrt(np.pi) * max(noise, 1e-12)), 1.0) ** 3)


def _commands(chain: Chain) -> list[str]:
    return [*(j.name for j in chain.machine.joints), *TOOL_COLUMNS]


def _agree_at_poses(table: pd.DataFrame, chain: Chain, count: int, rest: Survey) -> bool:
    """Whether so many of the repeated poses could agree in all components, by how often they agree in one.

    `rest` is the survey without the repeats.
    """
    from scipy.stats import poisson

    pose = table.groupby(_commands(chain), sort=False)
    steps = table[list(MEASURED)].groupby(pose.ngroup()).diff().dropna().to_numpy()
    expected = _expected(steps == 0)
    if expected is None:
        return _agree_anywhere(table, chain, count, rest)
    return bool(poisson.sf(count - 1, expected) > CHANCE)


def _copied_touches(table: pd.DataFrame, chain: Chain, again: Mask) -> Mask:
    """Of rows that touch a place again, those whose commands are an earlier row's too, if they agree not by chance.

    What was read there are the positions of the linear joints.
    """
    from scipy.stats import poisson

    linear = [j.name for j in chain.machine.joints if j.type == "prismatic"]
    place = [*MEASURED, "frame", *(c for c in _commands(chain) if c not in linear)]
    alike: Mask = again & table.duplicated(subset=[*place, *linear]).to_numpy(dtype=bool)
    steps = table.groupby(place, sort=False)[linear].diff().to_numpy()[again]
    expected = _expected(steps[np.isfinite(steps).all(axis=1)] == 0) if linear else None
    if not alike.any() or expected is None or poisson.sf(alike.sum() - 1, expected) > CHANCE:
        return np.zeros(len(table), dtype=bool)
    return alike


def _expected(same: Mask) -> float | None:
    """How many repeats agree in all components by chance, by how often (n, k) one does; None: too few differ."""
    if (~same.all(axis=1)).sum() < REPEATS:
        return None
    rate = 1.0
    for k in range(same.shape[1]):  # how often a component agrees where another one differs
        free = same[~np.delete(same, k, axis=1).all(axis=1), k]
        rate *= (free.sum() + 1) / (len(free) + 2)
    return rate * len(same)


def _agree_anywhere(table: pd.DataFrame, chain: Chain, count: int, rest: Survey) -> bool:
    """Whether so many rows could agree, as those of other poses do in a large table of nearly equal ones."""
    from scipy.stats import poisson

    return bool(poisson.sf(count - 1, _coincidences(table)) > CHANCE) or bool(
        poisson.sf(count - 1, count * _agreeing(chain, rest)) > CHANCE
    )


def _coincidences(table: pd.DataFrame) -> float:
    """How many pairs of rows agree in all components by chance, if these are independent of each other.

    How often two rows agree in one component is counted in rows that differ.
    """
    measured = table[list(MEASURED)]
    different, pairs = measured.drop_duplicates(), len(table) * (len(table) - 1) / 2
    if len(different) < 2:
        return 0.0
    rate = 1.0
    for name in MEASURED:
        counts = different[name].value_counts().to_numpy(dtype=np.float64)
        rate *= float(counts @ (counts - 1)) / (len(different) * (len(different) - 1))
    return pairs * rate


def set_clock(survey: Survey, log: DecisionLog = UNRECORDED) -> Blunder | None:
    """A clock that was set back within a run: its rows claim the same hours twice. Time goes on from where it was."""
    table = survey.table
    if "time" not in table:
        return None
    new, found = table["time"].to_numpy(dtype=np.float64, copy=True), list[int]()
    for _, part in table[np.isfinite(survey.measured).any(axis=1)].groupby(["file", "run"], sort=False):
        rows = part.index.to_numpy()
        time = new[rows]
        steps = np.diff(time)
        usual = float(np.median(np.abs(steps))) if len(steps) else 0.0
        falls = np.flatnonzero(steps < -2 * usual) + 1
        if not 0 < len(falls) <= RESETS or np.isnan(time).any():
            continue
        pieces = np.split(time, falls)
        spans = sorted((float(p.min()), float(p.max())) for p in pieces)
        if all(after[0] > before[1] for before, after in pairwise(spans)):
            continue  # hours of their own: the rows have been put together in another order
        for fall in falls:
            time[fall:] += time[fall - 1] + usual - time[fall]
        new[rows] = time
        found += part["row"].to_numpy()[falls].tolist()
    log.add("clock-set-back", "found" if found else "passed", "column time", len(found))
    if not found:
        return None
    listed = " and ".join(f"row {row}" for row in found)
    return Blunder(
        f"the clock was set back at {listed}",
        replace(survey, table=table.assign(time=new)),
        effect=ClockOffset.effect,
        driver=("time",),
        rows=tuple(found),
        mended=": the time of what follows was taken to go on without a pause",
        cure="give every stretch between two settings of the clock a run of its own, or correct the times",
    )
