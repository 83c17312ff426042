"""What the column `time` makes of the rows of a prediction: a course of temperatures, or states of their own.

What follows a temperature at once takes the one of its row; where the rows of a sensor are no more than noise off a
course, it takes the course, as the fit did. What acts late, or may, takes the rows as a course in any case.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from errormodel.channels import AT_ONCE_KELVIN
from errormodel.path_speed import RATE_CHANNEL
from errormodel.survey import Survey
from errormodel.temperature_courses import by_label, clocks, noise_name, noise_of, settled
from identification.uncertainty.recording_end import complete, lags

if TYPE_CHECKING:
    import pandas as pd

MUCH_SHORTER = 0.1  # of a time constant: in a step so short hardly anything of a change is seen; by judgement
ONE_TIME = "If each row is a case of its own, in which the machine has settled, give all of them one time"


def temperature_noise(models: Iterable[Iterable[str]], table: pd.DataFrame) -> dict[str, float]:
    """Standard deviation of a recording's noise, K, of each temperature that acts at once in a model.

    Parameters
    ----------
    models : the channels of each.
    """
    return noise_of(table, dict.fromkeys(name for model in models for name in model if name.startswith("T_")))


def with_noise(points: Survey, recorded: Mapping[str, float]) -> Survey:
    """The commands with the noise of their temperatures that was recorded, K; where none was, these are exact."""
    names = [str(name) for name in points.table if str(name).startswith("T_")]
    return replace(points, table=points.table.assign(**{noise_name(n): recorded.get(n, 0.0) for n in names}))


def timed(channels: Sequence[str], table: pd.DataFrame, *, at_rest: bool = True) -> pd.DataFrame:
    """The table; for channels that follow from its times with one time in all rows, where these are not known.

    What follows the clock itself needs the times, and so do speeds where it is not to be taken that the machine is
    `at_rest`.
    """
    speeds = any(map(RATE_CHANNEL.fullmatch, channels))
    if complete(table) or "time" in channels or not (any(lags(channels)) or speeds) or (speeds and not at_rest):
        return table
    return table.assign(time=0.0)


def smoothed(channels: Sequence[str], points: Survey, recorded: Mapping[str, float]) -> Iterator[str]:
    """A note on temperatures that are taken as a course, from which rows depart by more than one standard deviation.

    Parameters
    ----------
    channels : of the model.
    recorded : noise of the recorded temperatures, K.
    """
    table = with_noise(points, recorded).table
    names = [name for name in channels if name.startswith("T_")]
    course = settled(table, names)
    changes = {n: float(np.abs(course[n] - table[n]).max()) for n in names if n in table}
    if found := [f"{n} (by up to {k:.2g} K)" for n, k in changes.items() if k > recorded.get(n, 0.0)]:
        yield (
            f"{', '.join(found)}: what this departs by from a course in the column time is no more than it did as "
            f"noise in the recording, and is smoothed. {ONE_TIME}"
        )


def as_course(own: Sequence[str], others: Iterable[Sequence[str]], table: pd.DataFrame) -> Iterator[str]:
    """Notes on temperatures that act late, or may, and change in steps that are much shorter than the time constant.

    Parameters
    ----------
    own : channels of the model; `others`: of models that the recording leaves open.
    """
    if not complete(table):
        return
    sure, longest = {base for _, _, base, _ in lags(own)}, dict[str, float]()
    for channels in (own, *others):
        for _, _, base, tau in lags(channels):
            if base in table and table[base].notna().all():
                longest[base] = max(longest.get(base, 0.0), tau)
    for base, tau in longest.items():
        kelvin, step = _sudden(table, base, MUCH_SHORTER * tau)
        if kelvin > AT_ONCE_KELVIN:
            yield (
                f"{base} {'acts' if base in sure else 'may act'} up to {tau:.3g} s late, and changes by {kelvin:.3g} K "
                f"in {step:.3g} s from one row to another: what it does late follows the rows as a course in the "
                f"column time. {ONE_TIME}"
            )


def _sudden(table: pd.DataFrame, base: str, shortest: float) -> tuple[float, float]:
    """Largest change of a temperature, K, in a step that is shorter than `shortest`, s, and that step."""
    time, values = (table[name].to_numpy(dtype=np.float64) for name in ("time", base))
    most = 0.0, 0.0
    for rows in by_label(clocks(table, base)):
        order = rows[np.argsort(time[rows], kind="stable")]
        steps, changes = np.diff(time[order]), np.abs(np.diff(values[order]))
        changes = np.where((steps > 0) & (steps < shortest), changes, 0.0)
        if changes.any():
            k = int(np.argmax(changes))
            most = max(most, (float(changes[k]), float(steps[k])))
    return most
