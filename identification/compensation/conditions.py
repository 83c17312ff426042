"""Conditions under which the tables reach their predicted residual error, and the residual where they do not hold.

Conditions are zero shifts, backlash parameters, temperature and time, and the size of corrections. Figures are RMS
errors in um over the volume, predicted by the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.controllers.base import Controller
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Tables
from errormodel.exceptions import InputError
from identification.compensation.assessment import Correct, emulated, fresh_rows, left
from identification.compensation.reversal import left_to_parameters, reversal_lines, with_backlash
from identification.compensation.volume import Volume, best_frame
from identification.observation.pose import Pose

if TYPE_CHECKING:
    import pandas as pd

PLAUSIBLE_MM = 1.0  # mm: a larger correction is taken for a mistake in the survey; by judgement
CHANNEL_UNITS = {"time": "s", "feed": "mm/min", "load": "kg"}  # display units of channels
REPORTED_SHARE = 0.05  # of the residual RMS: smaller differences are not reported; by judgement


@dataclass(frozen=True)
class Conditions:
    """Residual RMS errors of one set of tables over the volume, um, predicted by the model.

    Attributes
    ----------
    left_um : with the zero shifts made and the backlash parameters as they were during the survey.
    unshifted_um : without the zero shifts; None: there are none.
    parameters_um : with the backlash parameters set; None: there is nothing to set.
    largest_mm : largest correction of a linear joint, mm.
    """

    left_um: float
    unshifted_um: float | None
    parameters_um: float | None
    largest_mm: float

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def conditions_of(controller: Controller, setup: Setup, volume: Volume, tables: Tables, seed: int) -> Conditions:
    """Residual errors of a set of tables with and without each condition."""
    correct = emulated(controller, tables, setup, volume)
    promised = left(volume, correct, seed).rms_um
    kept = tuple(t for t in tables if t.term.inputs or t.term.factor)
    found = left_to_parameters(controller, setup, tables)
    bare = left(volume, emulated(controller, kept, setup, volume), seed).rms_um if len(kept) < len(tables) else None
    set_up = left(volume, with_backlash(correct, setup, found, volume.field), seed).rms_um if found else None
    return Conditions(promised, bare, set_up, largest(volume, correct, seed))


def largest(volume: Volume, correct: Correct, seed: int) -> float:
    """Largest correction of a linear joint over the volume, mm."""
    rows = fresh_rows(volume, seed)
    moved = np.abs(correct(rows.q, rows.direction, None) - rows.q)[:, np.logical_not(volume.field.rotary)]
    return float(moved.max(initial=0.0))


def check_size(size: float, allowed: bool) -> None:
    """Raise InputError where a correction (mm) is implausibly large, unless the user allows it."""
    if size > PLAUSIBLE_MM and not allowed:
        raise InputError(
            "compensate",
            f"corrections of up to {size:.3g} mm, which controls neither limit nor watch",
            f"Look for a wrong unit or sign in the survey; --allow-large writes corrections beyond {PLAUSIBLE_MM:g} mm",
        )


def shift_lines(label: str, tables: Tables, figures: Conditions) -> list[str]:
    """Checklist lines for constant offsets, which tables that are zero at the reference point cannot represent."""
    shifts = [t for t in tables if not t.term.inputs and not t.term.factor]
    words = ", ".join(f"{t.term.output} by {1e3 * float(t.values):+.1f} um" for t in shifts)
    if not shifts or figures.unshifted_um is None:
        return []
    reported = figures.unshifted_um > (1 + REPORTED_SHARE) * figures.left_um
    effect = (
        f"without it {figures.unshifted_um:.1f} um rms are left in place of {figures.left_um:.1f}"
        if reported
        else "of no effect on the errors within the volume: a work offset that is set anew takes it"
    )
    return [
        f"FIRST{f' (for {label})' if label else ''}: shift the zero (work offset or reference point): {words}; "
        f"these tables are zero at the reference point; {effect}"
    ]


def backlash_lines(controller: Controller, setup: Setup, tables: Tables, figures: Conditions) -> list[str]:
    """Checklist lines for backlash: the control's parameter, and the residual error without it."""
    lines = reversal_lines(controller, setup, tables)
    if lines and figures.parameters_um is not None:
        lines.append(
            f"backlash: {figures.left_um:.1f} um rms are left without these parameters, "
            f"{figures.parameters_um:.1f} with them"
        )
    return lines


def state_lines(
    volume: Volume, table: pd.DataFrame, loose: Sequence[str], correct: Correct, seed: int
) -> tuple[str, ...]:
    """State of each channel outside the tables (time, temperature, feed, load), and residuals at its extremes."""
    field, out = volume.field, list[str]()
    for name in loose:
        here = field.state.get(name, 0.0)
        line = f"errors change with {name}, which no table follows: these tables are for {quantity(name, here)}"
        ends = table[name].dropna().to_numpy(dtype=np.float64) if name in table else np.zeros(0)
        if len(ends) and np.ptp(ends) > 0:
            fixed = replace(volume, pose=_lies(volume, correct, seed))
            rms = [
                left(replace(fixed, field=field.at({name: float(v)})), correct, seed).rms_um
                for v in (here, ends.min(), ends.max())
            ]
            line += (
                f". Left there {rms[0]:.1f} um rms, {rms[1]:.1f} at {quantity(name, ends.min())} and "
                f"{rms[2]:.1f} at {quantity(name, ends.max())}, zero and workpiece as they were"
            )
        if name == "time":
            line += ". Load and use them on a machine that has warmed up as long as in the recording"
        elif name.startswith("T_"):
            line += ". Hold that temperature"
        out.append(line)
    return tuple(out)


def _lies(volume: Volume, correct: Correct, seed: int) -> Pose:
    """Pose of the workpiece's frame when it is set up with these tables in this state."""
    if volume.pose is not None or not volume.free:
        return volume.frame
    rows = fresh_rows(volume, seed)
    nominal = volume.field.nominal(rows.q, rows.tool)
    actual = volume.field.actual(correct(rows.q, rows.direction, rows.tool), rows.direction, rows.tool)
    return best_frame(actual - nominal, nominal)


def quantity(name: str, value: float) -> str:
    """A channel's value with its unit and meaning."""
    if name == "time":
        hours, minutes = divmod(round(value / 60), 60)
        clock = f" ({hours} h {minutes:02d} min)" if value >= 600 else ""
        return f"{name} = {value:.0f} s{clock} of the recording"
    if name.startswith("T_"):
        return f"{name} = {value:.1f} degC"
    return f"{name} = {value:g}{' ' + CHANNEL_UNITS[name] if name in CHANNEL_UNITS else ''}"
