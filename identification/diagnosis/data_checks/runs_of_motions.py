"""Runs of error motions that do not repeat each other: a zero lost half-way, another sign, another unit.

Each reading is compared with the mean of the other runs at the same target and side of arrival. A step in the
difference is a zero that was lost (an interrupted beam), unless a drift explains it as well; a factor of -1 or 1000
between a run and the others is a sign or a unit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from errormodel.approach import direction
from errormodel.arrays import MAD_STD, Array
from errormodel.conventions import FRAME, MOTIONS
from errormodel.effects.station_shift import StationShift
from errormodel.exceptions import InputError
from errormodel.survey import Survey
from identification.diagnosis.data_checks.blunder import Blunder
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog

FEWEST = 8  # readings of a run that others repeat
POLISHES = 20  # rounds of the median polish
FEWEST_ASIDE = 3  # readings on either side of a step
SAME_TARGET_SHARE = 1e-3  # of the range of positions: targets that are the same
CLEAR_STEP = 8.0  # standard uncertainties
LARGE_STEP = 5.0  # standard deviations of a reading
STEP_OVER_DRIFT = 0.25  # residual sum of squares of a step over that of a straight drift
CLEAR_FACTOR = 25.0  # residual sum of squares with the usual factor over that with another
UNITS = {1e3: "values 1000 times those of", 1e-3: "values a thousandth of"}


@dataclass(frozen=True)
class Run:
    """Readings of one motion in one run, in order, and the other runs' means at the same targets."""

    joint: str
    motion: str
    label: str
    rows: pd.DataFrame
    own: Array
    others: Array


def refuse_unlike_runs(survey: Survey) -> None:
    """InputError where a run of error motions lost its zero, or has another sign or unit than the others."""
    runs = compared_runs(survey)
    refuse_scaled_runs(runs)
    for text in opposite_runs(runs):
        raise InputError(str(survey.source), text, "See which is right, and write all runs with one sign")
    if (found := lost_zero(survey, runs)) is not None:
        raise InputError(str(survey.source), found.text, f"{found.cure}. `errormodel diagnose` does so and goes on")


def refuse_scaled_runs(runs: Sequence[Run]) -> None:
    """InputError where a run has another unit than the others at the same targets."""
    for run in runs:
        for factor, words in UNITS.items():
            if _is_scaled(run, factor):
                raise InputError(
                    f"{run.rows['file'].iloc[0]}, column {run.motion}",
                    f"run {run.label} about {run.joint} has {words} the other runs at the same targets",
                    "See which is right, and write all runs in one unit",
                )


def opposite_runs(runs: Sequence[Run], log: DecisionLog = UNRECORDED) -> Iterator[str]:
    """Remarks on runs that have the opposite sign of the others: a mistake, or a compensation that acts twice."""
    for run in runs:
        if _is_scaled(run, -1.0):
            log.add("run-opposite-sign", "found", f"column {run.motion}", beside=f"run {run.label} about {run.joint}")
            yield (
                f"column {run.motion}: run {run.label} about {run.joint} has the opposite sign of the other runs at "
                "the same targets, as with a wrong sign, or a compensation that acts twice in it"
            )


def lost_zero(survey: Survey, runs: Sequence[Run], log: DecisionLog = UNRECORDED) -> Blunder | None:
    """The clearest step of a run beside the others, and the survey with a run of its own from there on."""
    steps = [(found, run) for run in runs if (found := _step(run)) is not None]
    if not steps:
        if runs:
            log.add("run-lost-zero", "passed", "runs", threshold=CLEAR_STEP)
        return None
    (clear, size, at), run = max(steps, key=lambda step: step[0][0])  # the others are compared with it
    log.add("run-lost-zero", "found", f"column {run.motion}", clear, CLEAR_STEP, beside=f"run {run.label}")
    before, after = (int(r) for r in run.rows["row"].iloc[[at - 1, at]])
    size, unit = (1e3 * size, "um") if run.motion.startswith("d") else (1e6 * size, "urad")
    table = survey.table.copy()
    own = (table["role"] == "fit") & (table["run"] == run.label) & (table["joint"] == run.joint)
    later = own & (table.index >= run.rows.index[at])
    table.loc[later, "run"] = f"{run.label}b"
    rows = tuple(int(r) for r in table.loc[later, "row"])
    return Blunder(
        f"run {run.label} about {run.joint} changes by {size:.3g} {unit} in column {run.motion} between rows {before} "
        f"and {after} beside the other runs, and stays there: a zero that was lost, as of an interrupted beam",
        replace(survey, table=table),
        effect=StationShift.effect,
        where=FRAME,
        rows=rows,
        cure=f"Give the rows from {after} on a label of run of their own, or measure the run again",
        mended="; they are taken as a run of their own",
    )


def compared_runs(survey: Survey) -> list[Run]:
    """The runs to fit beside the others, motion by motion; their rows have the index of the survey's table."""
    return list(_compared(survey.table[survey.table["role"] == "fit"]))


def _compared(table: pd.DataFrame) -> Iterator[Run]:
    if "joint" not in table:
        return
    for joint in (j for j in table["joint"].unique() if j):
        about = table[table["joint"] == joint]
        target = about[joint].to_numpy(dtype=np.float64)
        step = SAME_TARGET_SHARE * max(float(np.ptp(target)), 1e-9)
        side = direction(about.reset_index(drop=True), joint)
        place = pd.Series([f"{round(q / step)} {s:+.0f}" for q, s in zip(target, side, strict=True)], about.index)
        for motion in (m for m in MOTIONS if m in about and about[m].notna().any()):
            beyond = about[motion] - _zeros(about[motion], about["run"], place)
            for label in about["run"].unique():
                mine = (about["run"] == label).to_numpy()
                known = beyond[~mine].groupby(place[~mine]).mean()
                others = place[mine].map(known).to_numpy(dtype=np.float64)
                own = about.loc[mine, motion].to_numpy(dtype=np.float64)
                seen = np.isfinite(own) & np.isfinite(others)
                if seen.sum() >= FEWEST:
                    yield Run(str(joint), motion, str(label), about[mine][seen], own[seen], others[seen])


def _zeros(values: pd.Series[float], run: pd.Series[str], place: pd.Series[str]) -> pd.Series[float]:
    """The zero of each reading's run: a sum of a target's value and a run's, by medians in turn (median polish)."""
    zero = values.groupby(run).transform("median")
    for _ in range(POLISHES):
        target = (values - zero).groupby(place).transform("median")
        zero = (values - target).groupby(run).transform("median")
    return zero


def _is_scaled(run: Run, factor: float) -> bool:
    """Whether a run is so many times what the others are."""
    own, others = run.own - run.own.mean(), run.others - run.others.mean()
    left = float(np.sum((own - factor * others) ** 2))
    return min(float(np.sum((own - others) ** 2)), float(np.sum(own**2))) > CLEAR_FACTOR * left


def _step(run: Run) -> tuple[float, float, int] | None:
    """Size over its uncertainty, size, and first reading of the clearest step beside the other runs; None if none."""
    left = run.own - run.others
    count = len(left)
    noise = MAD_STD / np.sqrt(2) * float(np.median(np.abs(np.diff(left))))
    best: tuple[float, float, int] | None = None
    for at in range(FEWEST_ASIDE, count - FEWEST_ASIDE + 1):
        size = float(left[at:].mean() - left[:at].mean())
        clear = abs(size) / max(noise * np.sqrt(1 / at + 1 / (count - at)), 1e-12)
        if best is None or clear > best[0]:
            best = clear, size, at
    if best is None or best[0] < CLEAR_STEP or abs(best[1]) < LARGE_STEP * noise:
        return None
    after = (np.arange(count) >= best[2]).astype(float)
    order = np.linspace(-1, 1, count)
    step, drift = (_unexplained(left, shape) for shape in (after, order))
    return best if step < STEP_OVER_DRIFT * drift else None


def _unexplained(values: Array, shape: Array) -> float:
    """Residual sum of squares of a constant and a shape."""
    design = np.column_stack([np.ones(len(values)), shape])
    return float(np.sum((values - design @ np.linalg.lstsq(design, values, rcond=None)[0]) ** 2))
