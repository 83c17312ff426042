"""Temperatures that jump between two rows and stay there, as after a reset of a logger or a move of a sensor.

A sensor has a thermal time constant: what warms or cools it shows in several rows, and comes to an end. A door that
opens, a spindle or a coolant that is switched on moves few sensors, none by the same as all others, and changes how it
goes on. So a step is named only where all sensors jump by the same amount at once, or where one jumps beside others
that it follows before and behind alike.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array
from errormodel.row_order import label_numbers, measured_order

if TYPE_CHECKING:
    import pandas as pd

# By judgement, of one step: K at least; times the largest other step of the sensor; s that it may take, and times the
# median time from row to row: behind a rest or a night anything may have another temperature
_LEAST, _TIMES, _LONGEST, _USUAL = 1.0, 8.0, 900.0, 3.0
_ROWS = 10  # before the step and behind it, in which a sensor shows how it moves
_SETTLES = 3  # rows behind a step, in which what has a time constant still moves on
_ALIVE = 0.5  # of the other steps are changes: constant temperatures, level by level, were written by hand
_FOLLOWS, _OFF = 0.5, 0.1  # what is left of a sensor that follows others, of what it moves by, and of its step


@dataclass(frozen=True)
class _Step:
    """A step behind row `at` of a series by `kelvin`, where other steps are `usual` at most."""

    at: int
    kelvin: float
    usual: float


def step_notes(table: pd.DataFrame) -> Iterator[str]:
    """Notes on temperatures that jump once and stay there, by files and runs, with the rows and what to write."""
    names = [str(c) for c in table.columns if str(c).startswith("T_")]
    if "time" not in table or len(names) < 2:
        return
    rows = table[[*(c for c in ("file", "run", "row", "time") if c in table), *names]].iloc[measured_order(table)]
    for _, own in rows.groupby(label_numbers(rows, ["file", "run"]), sort=False):
        if len(own) > 2 * _ROWS:
            yield from _of_series(
                own, {n: v for n in names if np.isfinite(v := own[n].to_numpy(dtype=np.float64)).all()}
            )


def _of_series(rows: pd.DataFrame, values: Mapping[str, Array]) -> Iterator[str]:
    """Notes on the temperatures `values` of rows in the order of time."""
    pace = np.diff(rows["time"].to_numpy(dtype=np.float64))
    values = {name: own for name, own in values.items() if _alive(own)}
    if not (pace >= 0).all() or len(values) < 2:
        return
    longest = min(_LONGEST, _USUAL * float(np.median(pace)))
    steps = {name: s for name, own in values.items() if (s := _step(own)) is not None and pace[s.at] <= longest}
    for at in dict.fromkeys(s.at for s in steps.values()):
        here = {name: s for name, s in steps.items() if s.at == at}
        still = {name: own for name, own in values.items() if name not in here}
        sizes = [s.kelvin for s in here.values()]
        if not still and np.ptp(sizes) <= 2 * max(s.usual for s in here.values()):
            why = "No sensors of a machine warm or cool by the same at once: a logger was reset"
            yield _words(rows, here, why)
        for name, step in here.items():
            if leader := _leader(values[name], still, step):
                moved = abs(float(np.diff(values[leader])[at]))
                why = f"{leader}, which it follows before and behind, moves by {moved:.2g} K there: if nothing was "
                why += "switched on, its sensor was moved or its channel of the logger reset"
                yield _words(rows, {name: step}, why)


def _alive(values: Array) -> bool:
    """Whether a sensor changes in most rows."""
    return len(values) > 1 and bool(np.mean(np.diff(values) != 0) > _ALIVE)


def _step(values: Array) -> _Step | None:
    """The one step of a sensor that is far beyond all others and that it neither goes on from nor takes back."""
    steps = np.diff(values)
    at = int(np.argmax(np.abs(steps)))
    usual = float(np.abs(np.delete(steps, at)).max())
    size = abs(float(steps[at]))
    if not _ROWS <= at + 1 <= len(values) - _ROWS or size < max(_LEAST, _TIMES * usual):
        return None
    settles = np.abs(values[_SETTLES:] - values[:-_SETTLES])  # of windows that begin in each row
    others = np.concatenate([settles[: at - _SETTLES + 1], settles[at + 2 :]])
    if settles[at + 1] > others.max(initial=0.0):
        return None
    return _Step(at, float(steps[at]), usual)


def _leader(values: Array, others: Mapping[str, Array], step: _Step) -> str:
    """The first of other sensors that this one follows before and behind its step by one straight line, or nothing."""
    behind = np.arange(len(values)) > step.at
    for name, other in others.items():
        design = np.column_stack([np.ones(len(values)), other - other.mean(), behind])
        left = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
        parts = [(left[part], values[part]) for part in (~behind, behind)]
        near = all(_rms(own) < _FOLLOWS * float(np.std(seen)) for own, seen in parts)
        if near and _rms(left) < _OFF * abs(step.kelvin):
            return name
    return ""


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _words(rows: pd.DataFrame, steps: Mapping[str, _Step], why: str) -> str:
    """A note on sensors that step between the same two rows."""
    at, names = next(iter(steps.values())).at, " ".join(steps)
    size = float(np.median([s.kelvin for s in steps.values()]))
    usual = max(s.usual for s in steps.values())
    before, behind = rows["row"].iloc[at], rows["row"].iloc[at + 1]
    time = float(np.diff(rows["time"].to_numpy(dtype=np.float64))[at])
    many, they = (True, "them") if len(steps) > 1 else (False, "it")
    return (
        f"{rows['file'].iloc[at]}: {names} jump{'s' * (not many)} by {size:+.3g} K from row {before} to row {behind} "
        f"({time:.3g} s) and stay{'s' * (not many)} there, with at most {usual:.2g} K from row to row otherwise. "
        f"{why}. Correct {they} by {-size:+.3g} K behind the jump, or leave {they} out: what is found of "
        "temperatures is wrong until then"
    )
