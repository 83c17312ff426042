"""Monitoring of one cycle: fit its survey, compare it with the machine's history, and store it there."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from errormodel.arrays import Array
from errormodel.exceptions import InputError
from errormodel.survey import Survey
from errormodel.surveys.record import RecordForm
from identification.diagnosis.data_checks.checks import find_blunders
from identification.diagnosis.data_checks.duplicates_and_clock import RESETS
from identification.estimation.fit import fit_machine
from identification.monitoring.alarms import alarms
from identification.monitoring.control_limits import Judged, judge
from identification.monitoring.history import SCHEMA, Record, opened
from identification.monitoring.quantities import NOISE_ID, Cycle, Watched, measured, watched
from identification.results.stored_fit import StoredFit

DATABASE_NAME = "monitor.sqlite"  # file of the history in the folder of the fit
# An RMS nominal error beyond both is taken for another machine; by judgement.
OTHER_MACHINE_RATIO = 30.0  # times the RMS nominal error of the fit
OTHER_MACHINE_UM = 1000.0  # um
# A step of time beyond both is a clock that was set, not a pause; by judgement.
CLOCK_JUMP_STEPS = 1000.0  # times the median step
CLOCK_JUMP_S = 86400.0  # s, one day


@dataclass(frozen=True)
class Monitored:
    """A monitored cycle with its charts, alarms and history.

    Attributes
    ----------
    stored : the fit that the history belongs to.
    what : monitored quantities (k).
    record : the cycle as stored; `judged` : its control charts.
    alarms : kind, ids and statement of each alarm.
    records : all cycles of the history, this one included.
    before : whether the history contained the cycle already.
    test : the block ``test:`` of the cycle's survey.
    """

    stored: StoredFit
    what: tuple[Watched, ...]
    record: Record
    judged: Judged
    alarms: list[dict[str, object]]
    records: tuple[Record, ...]
    before: bool
    test: RecordForm | None = None

    @property
    def unseen(self) -> list[Watched]:
        """Monitored quantities that this cycle does not determine."""
        return [w for w, v in zip(self.what, self.record.cycle.values, strict=True) if not np.isfinite(v)]

    @property
    def learned(self) -> int:
        """Number of earlier cycles in the normal range."""
        return sum(r.normal and r.number < self.record.number for r in self.records)

    def as_json(self) -> dict[str, Any]:
        """Content of ``monitor.json``: values in mm, rad and their ratios; the noise as its natural logarithm."""
        cycle, j = self.record.cycle, self.judged
        names = ("value", "std", "cycles", "mean", "low", "high", "p_value", "drift", "share")
        columns = (cycle.values, cycle.std, j.count, j.mean, j.low, j.high, j.p, j.drift, j.share)
        numbers = [dict(zip(names, map(float, row), strict=True)) for row in zip(*columns, strict=True)]
        return {
            "schema": SCHEMA,
            "machine": self.stored.chain.machine.name,
            "cycle": self.record.number,
            "survey": self.record.source,
            "status": self.record.status,
            "accepted": self.record.accepted,
            "false_alarm_rate": j.rate,
            "normal_cycles": self.learned,
            "alarms": self.alarms,
            "together_p_value": j.together,
            "p_limit": j.p_limit,
            "together_limit": j.together_limit,
            "drift_limit": j.drift_limit,
            "unseen": [w.id for w in self.unseen],
            "parameters": [
                {"id": w.id, "group": w.group, "symbol": w.symbol, "unit": w.unit} | own
                for w, own in zip(self.what, numbers, strict=True)
            ],
            "history": [
                {"cycle": r.number, "survey": r.source, "status": r.status, "accepted": r.accepted,
                 "flagged": list(r.flagged)}
                for r in self.records
            ],
        }  # fmt: skip


def monitored(
    folder: Path,
    stored: StoredFit,
    survey: Survey,
    rate: float,
    accept: bool,
    shown: Callable[[Monitored], AbstractContextManager[object]] = nullcontext,
) -> Monitored:
    """Fit a survey as a cycle, compare it with the history in `folder`, and store it there.

    A cycle in alarm is stored, but belongs to the normal range only if it is accepted, now or later.

    Parameters
    ----------
    folder : output folder of the fit `stored`; the history lies in it.
    survey : rows of the new cycle.
    rate : false alarms per cycle, all charts together.
    accept : whether a cycle in alarm is taken into the normal range.
    shown : writes pages of the cycle beside their places; the cycle is stored in its context, which puts them in place.

    Raises
    ------
    InputError
        The recording or the history is wrong, too small, or of another machine.
    """
    what = watched(stored)
    cycle = _measure(stored, what, survey)
    digest, model = _digest(survey), _fingerprint(folder, what)
    with opened(folder / DATABASE_NAME, model) as history:
        known = history.find(digest)
        earlier = [r.cycle for r in history.records if r.normal and (known is None or r.number < known.number)]
        if known is not None:
            cycle = known.cycle
        judged = judge(earlier, cycle, rate)
        said = alarms(stored.chain, what, cycle, judged)
        record = known or history.add(_record(digest, survey, judged, what, cycle))
        if accept and not record.normal:
            record = history.accept(record)
        made = Monitored(stored, what, record, judged, said, tuple(history.records), known is not None, survey.record)
        with shown(made):
            history.commit()
    return made


def _record(digest: str, survey: Survey, judged: Judged, what: tuple[Watched, ...], cycle: Cycle) -> Record:
    status = "alarm" if judged.alarm else "learning" if judged.learning else "normal"
    flagged = tuple(w.id for w, out in zip(what, judged.flagged, strict=True) if out)
    return Record(0, digest, survey.name, status, False, flagged, cycle)


def _measure(stored: StoredFit, what: tuple[Watched, ...], survey: Survey) -> Cycle:
    machine = stored.chain.machine
    survey = survey.fit
    check_clock(survey)
    if np.isfinite(survey.measured).any() and (blunders := find_blunders(machine, survey)):
        raise InputError(
            str(survey.source), blunders[0].text, f"A history learns from sound recordings only: {blunders[0].cure}"
        )
    # a cycle has runs of its own: what was in one run of the fit only is not in them
    fit = fit_machine(machine, survey, robust=bool(stored.data.get("robust")), other_runs=True)
    usual, here = stored.data["nominal"]["rms_um"], fit.nominal.rms_um
    if usual is not None and here > max(OTHER_MACHINE_UM, OTHER_MACHINE_RATIO * usual):
        raise InputError(
            str(survey.source),
            f"its points lie {here / 1000:.3g} mm from where this machine goes, those of the fit {usual:.3g} um",
            "Give a survey of the machine that was fitted, with commands and measured points in the same units",
        )
    cycle = measured(what, fit)
    if not np.isfinite(cycle.values[[w.id != NOISE_ID for w in what]]).any():
        raise InputError(
            str(survey.source),
            f"it shows none of the {len(what) - 1} quantities that are watched",
            "Measure a cycle as the fit's survey was measured: same joints, columns and kind of frame",
        )
    return cycle


def check_clock(survey: Survey) -> None:
    """Raise InputError at a time stamp that jumps back into a recorded span, or by a day or more either way.

    Rows in no order of time, or in contiguous pieces of another order, are accepted.
    """
    if "time" not in survey.table:
        return
    keys = [name for name in ("file", "run", "joint") if name in survey.table]
    for _, part in survey.table.groupby(keys, sort=False):
        time: Array = part["time"].to_numpy(dtype=float)
        steps = np.diff(time)
        far = max(CLOCK_JUMP_S, CLOCK_JUMP_STEPS * float(np.median(np.abs(steps)))) if len(steps) else CLOCK_JUMP_S
        falls = np.flatnonzero(steps < 0)
        wrong = np.abs(steps) > far
        spans = sorted((float(p.min()), float(p.max())) for p in np.split(time, falls + 1))
        if len(falls) <= RESETS and any(after[0] <= before[1] for before, after in pairwise(spans)):
            wrong[falls] = True
        if wrong.any():
            at = int(wrong.argmax())
            raise InputError(
                f"{part['file'].iloc[0]}, row {part['row'].iloc[at + 1]}, column time",
                f"the clock jumps {'back' if steps[at] < 0 else 'ahead'} by {abs(steps[at]):.6g} s",
                "Correct the times, or give what follows a run of its own",
            )


def _digest(survey: Survey) -> str:
    """SHA-256 of the commanded and measured values, independent of the file's name."""
    table = survey.table.drop(columns=["file", "row"])
    return hashlib.sha256(table.to_csv(index=False, lineterminator="\n").encode()).hexdigest()


def _fingerprint(folder: Path, what: tuple[Watched, ...]) -> str:
    """SHA-256 of the machine model and the monitored groups: ranges of another model are not comparable."""
    text = (folder / "machine.yaml").read_bytes() + "\n".join(w.group for w in what).encode()
    return hashlib.sha256(text).hexdigest()
