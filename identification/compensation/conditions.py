"""Conditions under which the tables reach their predicted residual error, and the residual where they do not hold.

Conditions are zero shifts, backlash parameters, temperature and time, and the size of corrections. Figures are RMS
errors in um over the volume, predicted by the model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.arrays import Array, Mask
from errormodel.controllers.base import Controller, registry
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import LONGER, Table, Tables
from errormodel.exceptions import InputError
from identification.compensation.assessment import Correct, emulated, fresh_rows, left, nothing, remaining
from identification.compensation.field import Field
from identification.compensation.reversal import (
    left_to_parameters,
    reversal_lines,
    settings_of,
    to_add,
    with_backlash,
)
from identification.compensation.rows import Rows
from identification.compensation.volume import Volume, best_frame
from identification.observation.pose import Pose

if TYPE_CHECKING:
    import pandas as pd

PLAUSIBLE_MM = 1.0  # mm: a larger correction is taken for a mistake in the survey; by judgement
# mm/mm: a steeper correction is taken for one, too; ten times the squareness of a poor machine; by judgement
PLAUSIBLE_SLOPE = 0.01
PLAUSIBLE_TURN = 50.0  # mm of travel that count as one degree in that; by judgement
# of a correction: where the error is smaller, the correcting joints hardly move the tip that way; by judgement
LEAST_ERROR_SHARE = 0.1
SLOPE_STEP_SHARE = 0.01  # of the measured travel, over which slopes are taken; by judgement
# Tables that take away less of the rms error, or make more of the poses worse by WORSE_UM and WORSE_SHARE of their
# error, do more harm than good; by judgement
LEAST_REMOVED_SHARE, MOST_WORSE_SHARE = 0.2, 0.1
WORSE_UM, WORSE_SHARE = 1.0, 0.1
CHANNEL_UNITS = {"time": "s", "feed": "mm/min", "load": "kg"}  # display units of channels
REPORTED_SHARE = 0.05  # of the residual RMS: smaller differences are not reported; by judgement


@dataclass(frozen=True)
class Largest:
    """Largest correction of a linear joint over the volume (mm), its largest slope (mm per mm or deg), and where.

    `steep`: the joint whose correction is the steepest, `along` which other, and at which place. `error_mm`: the error
    of the uncorrected machine at the place of the largest correction; None: not known.
    """

    mm: float
    joint: str
    place: str
    slope: float
    along: str
    steep: str = ""
    steep_place: str = ""
    error_mm: float | None = None

    @property
    def singular(self) -> bool:
        """Whether the correction is large for the joints' directions there, not for the errors."""
        return self.error_mm is not None and self.error_mm < LEAST_ERROR_SHARE * self.mm


@dataclass(frozen=True)
class Conditions:
    """Residual RMS errors of one set of tables over the volume, um, predicted by the model.

    Attributes
    ----------
    left_um : with the zero shifts made and the backlash parameters as they were during the survey.
    unshifted_um : without the zero shifts; None: there are none.
    parameters_um : with the backlash parameters set; None: there is nothing to set.
    before_um : without tables.
    worse_share : share of the poses that the tables make worse.
    largest : largest correction and slope of a linear joint, and where.
    together_um, together_share : `left_um` and `worse_share` with those backlash parameters set that the checklist says
        to set; None: there are none.
    """

    left_um: float
    unshifted_um: float | None
    parameters_um: float | None
    before_um: float
    worse_share: float
    largest: Largest
    together_um: float | None = None
    together_share: float | None = None

    def as_json(self) -> dict[str, Any]:
        return asdict(self)

    def against(self, instead: str) -> str:
        """Why these tables should not be loaded, and what to use; empty: nothing speaks against them.

        They are judged with the backlash parameters set that the checklist says to set.
        """
        if self.together_um is None or self.together_share is None:
            why, how = self._harm(self.left_um, self.worse_share), ""
        else:
            why = self._harm(self.together_um, self.together_share) if self.alone else ""
            how = "with the backlash parameters of the checklist set, "
        return f"{how}{why}; {instead} can take away more" if why else ""

    @property
    def alone(self) -> str:
        """What speaks against these tables without any backlash parameter set; empty: nothing."""
        return self._harm(self.left_um, self.worse_share)

    def _harm(self, left_um: float, worse_share: float) -> str:
        removed = 1 - left_um / self.before_um if self.before_um > 0 else 0.0
        little = self.before_um <= 0 or left_um > (1 - LEAST_REMOVED_SHARE) * self.before_um
        why = list[str]()
        if little:
            taken = _percent(removed, LEAST_REMOVED_SHARE) if removed > 0 else "nothing"
            why.append(
                f"this format takes away {taken} of the rms error ({self.before_um:.1f} um before, {left_um:.1f} "
                f"after), less than {100 * LEAST_REMOVED_SHARE:g} %"
            )
        if worse_share > MOST_WORSE_SHARE:
            share = _percent(worse_share, MOST_WORSE_SHARE)
            why.append(f"it makes {share} of the poses worse, more than {100 * MOST_WORSE_SHARE:g} %")
        return ", and ".join(why)


def _percent(share: float, limit: float) -> str:
    """A share in per cent, with as many digits as tell it from a limit."""
    digits = next((d for d in range(6) if f"{100 * share:.{d}f}" != f"{100 * limit:.{d}f}"), 6)
    return f"{100 * share:.{digits}f} %"


def richer(controller: Controller, setup: Setup) -> list[str]:
    """Targets that take away more of this machine's errors, the control's own first (those with the same first word).

    They are formats whose tables depend on more axes at once, and commands that are corrected themselves.
    """

    def reach(kind: Controller) -> tuple[int, int]:
        """Most axes that a table depends on, without the one that it corrects and with it."""
        try:
            kind.suits(setup)
            terms = kind.structures(setup)[-1]
        except InputError:
            return 0, 0
        drivers = ((t.output, {*t.inputs, t.factor.rpartition(" ")[2]} - {"", LONGER}) for t in terms if t.inputs)
        return max(((len(axes), len(axes | {output})) for output, axes in drivers), default=(0, 0))

    family, own = controller.name.partition("-")[0], reach(controller)
    known = [k() for n, k in registry().items() if k.general or n.partition("-")[0] == family]
    better = [k for k in known if not isinstance(k, Controller) or reach(k) > own]
    return [k.name for k in sorted(better, key=lambda k: k.general)]


def conditions_of(controller: Controller, setup: Setup, volume: Volume, tables: Tables, seed: int) -> Conditions:
    """Residual errors of a set of tables with and without each condition."""
    correct = emulated(controller, tables, setup, volume)

    def acts(q: Array) -> Mask:
        return controller.acts(tables, setup, volume.field.outward(q))

    promised = left(volume, correct, seed).rms_um
    kept = tuple(t for t in tables if t.term.inputs or t.term.factor)
    found = left_to_parameters(controller, setup, tables)
    bare = left(volume, emulated(controller, kept, setup, volume), seed).rms_um if len(kept) < len(tables) else None
    set_up = left(volume, with_backlash(correct, setup, found, volume.field), seed).rms_um if found else None
    plain = Conditions(
        promised, bare, set_up, left(volume, nothing, seed).rms_um, _worse(volume, correct, seed),
        largest(volume, setup, correct, acts, seed),
    )  # fmt: skip
    added = to_add(controller, setup, tables)
    if not added:
        return plain
    both = with_backlash(correct, setup, added, volume.field)
    together_um = set_up if len(added) == len(found) else left(volume, both, seed).rms_um
    return replace(plain, together_um=together_um, together_share=_worse(volume, both, seed))


def _worse(volume: Volume, correct: Correct, seed: int) -> float:
    """Share of the poses whose error grows by more than `WORSE_UM` and `WORSE_SHARE` of it."""
    rows = fresh_rows(volume, seed)
    before, after = (1e3 * np.linalg.norm(remaining(volume, c, rows), axis=1) for c in (nothing, correct))
    return float(np.mean(after > (1 + WORSE_SHARE) * before + WORSE_UM))


def largest(volume: Volume, setup: Setup, correct: Correct, acts: Callable[[Array], Mask], seed: int) -> Largest:
    """Largest correction of a linear joint over the volume, and its largest slope along any joint.

    `acts`: where the control corrects at all; a step to where it does not is no slope of its tables.
    """
    rows, field = fresh_rows(volume, seed), volume.field
    here = _moved(volume, correct, rows)
    size = _size(volume, setup, here, rows)
    slope, along, steep, steepest = 0.0, field.joints[0].name, 0, 0
    for k, other in enumerate(field.joints):
        step = SLOPE_STEP_SHARE * (volume.high[k] - volume.low[k])
        if step > 0:
            q = rows.q.copy()
            q[:, k] += np.where(q[:, k] + step <= volume.high[k], step, -step)
            scale = PLAUSIBLE_TURN if field.rotary[k] else 1.0
            steps = np.abs(_moved(volume, correct, replace(rows, q=q)) - here) * (acts(q) & acts(rows.q))[:, None]
            row, column = np.unravel_index(int(np.argmax(steps)), steps.shape)
            found = float(steps[row, column]) / float(np.degrees(step) if field.rotary[k] else step) / scale
            if found > slope:
                slope, along, steep, steepest = found, other.name, int(column), int(row)
    steep_place = _place(volume, setup, rows.q[steepest])
    return replace(size, slope=slope, along=along, steep=field.joints[steep].name, steep_place=steep_place)


def _moved(volume: Volume, correct: Correct, rows: Rows) -> Array:
    """Corrections (n, joints) of linear joints at rows, mm; zero for rotary ones."""
    return np.where(np.logical_not(volume.field.rotary), correct(rows.q, rows.direction, None) - rows.q, 0.0)


def _size(volume: Volume, setup: Setup, moved: Array, rows: Rows) -> Largest:
    """Largest of corrections (n, joints) at rows, its joint, where, and the error there without it; no slopes."""
    pose, joint = np.unravel_index(int(np.argmax(np.abs(moved))), moved.shape)
    name, error = volume.field.joints[joint].name, np.linalg.norm(remaining(volume, nothing, rows)[pose])
    place = _place(volume, setup, rows.q[pose])
    return Largest(float(np.abs(moved[pose, joint])), name, place, 0.0, name, error_mm=float(error))


def _place(volume: Volume, setup: Setup, q: Array) -> str:
    where = volume.field.outward(q[None])[0]
    return " ".join(f"{a.joint}={v:.1f}" for a, v in zip(setup.axes, where, strict=True))


def check_size(found: Largest, allowed: bool, what: str, model: str = "") -> None:
    """Raise InputError where a correction is implausibly large or steep, unless the user allows it.

    `model`: what speaks against the model itself, which is then the likely cause.
    """
    because = f", and {model}" if model else ""
    if found.mm > PLAUSIBLE_MM and not allowed and found.singular:
        raise InputError(
            f"compensate, {what}, joint {found.joint} at {found.place}",
            f"corrections of up to {found.mm:.3g} mm for an error of {1e3 * (found.error_mm or 0.0):.3g} um: the "
            "correcting joints hardly move the tip in its direction there",
            "Survey the part of the travels that is worked in; --allow-large writes such corrections, too",
        )
    if found.mm > PLAUSIBLE_MM and not allowed:
        raise InputError(
            f"compensate, {what}, joint {found.joint} at {found.place}",
            f"corrections of up to {found.mm:.3g} mm, which controls neither limit nor watch{because}",
            f"Look for a wrong unit or sign in the survey; --allow-large writes corrections beyond {PLAUSIBLE_MM:g} mm",
        )
    if found.slope > PLAUSIBLE_SLOPE and not allowed:
        raise InputError(
            f"compensate, {what}, joint {found.steep} along {found.along} at {found.steep_place}",
            f"corrections that change by up to {1e3 * found.slope:.3g} mm in a metre, which is no machine's geometry"
            f"{because}",
            f"Look for a blunder in the survey; --allow-large writes slopes beyond {1e3 * PLAUSIBLE_SLOPE:g} mm/m, too",
        )


def check_errors(volume: Volume, setup: Setup, allowed: bool, what: str, seed: int, model: Callable[[], str]) -> None:
    """Raise InputError where errors and exact corrections are implausible: no table of any format mends such a machine.

    Poses where a small error takes a large correction (`Largest.singular`) are left to what the tables do there.

    `model`: says what speaks against the model itself.
    """
    if not allowed:
        rows = fresh_rows(volume, seed)
        moved = _moved(volume, volume.ideal, rows)
        errors = np.linalg.norm(remaining(volume, nothing, rows), axis=1)
        found = _size(volume, setup, moved * (errors >= LEAST_ERROR_SHARE * np.abs(moved).max(axis=1))[:, None], rows)
        if found.mm > PLAUSIBLE_MM:
            check_size(found, allowed, what, model())


def shift_lines(label: str, setup: Setup, tables: Tables, figures: Conditions) -> list[str]:
    """Checklist lines for constant offsets, which tables that are zero at the reference point cannot represent."""
    shifts = [t for t in tables if not t.term.inputs and not t.term.factor]
    words = ", ".join(f"{t.term.output} {_shift(setup, t)}" for t in shifts)
    if not shifts or figures.unshifted_um is None:
        return []
    reported = figures.unshifted_um > (1 + REPORTED_SHARE) * figures.left_um
    effect = (
        f"without it {figures.unshifted_um:.1f} um rms are left in place of {figures.left_um:.1f}"
        if reported
        else "of no effect on the errors within the volume: a work offset that is set anew takes it"
    )
    return [
        f"FIRST{f' (for {label})' if label else ''}: these tables are zero at the reference point. Add to every work "
        f"offset: {words} (or take it off the coordinate that the reference point is given: what is commanded must lie "
        f"that much further towards plus); {effect}"
    ]


def _shift(setup: Setup, table: Table) -> str:
    """A constant of an axis with its unit."""
    value = float(table.values)
    return f"{value:+.5f} deg" if setup.axis(table.term.output).rotary else f"{value:+.4f} mm"


def backlash_lines(controller: Controller, setup: Setup, tables: Tables, figures: Conditions) -> list[str]:
    """Checklist lines for backlash: the control's parameter, and the residual error without it."""
    lines = reversal_lines(controller, setup, tables)
    if lines and figures.parameters_um is not None:
        lines.append(
            f"backlash: {figures.left_um:.1f} um rms are left without these parameters, "
            f"{figures.parameters_um:.1f} with them"
        )
    return lines


def together_line(controller: Controller, setup: Setup, tables: Tables, figures: Conditions) -> str:
    """What comes first of tables that do harm without the control's backlash parameters; empty: they do none."""
    if figures.together_um is None or figures.together_share is None or not figures.alone or figures.against("-"):
        return ""
    settings = " and ".join(
        f"{parameter} {value}" for parameter, value in settings_of(controller, setup, to_add(controller, setup, tables))
    )
    return (
        f"load these tables together with {settings} (added to what was set during the survey, see below), never "
        f"alone: without that {figures.alone}; together {figures.together_um:.1f} um rms are left and "
        f"{100 * figures.together_share:.0f} % of the poses become worse"
    )


def state_lines(
    volume: Volume, table: pd.DataFrame, loose: Sequence[str], correct: Correct, seed: int
) -> tuple[str, ...]:
    """State of each channel outside the tables (time, temperature, feed, load), and residuals at its extremes."""
    field, out = volume.field, list[str]()
    for name in loose:
        line = f"errors change with {name}, which no table follows: these tables are for {held_at(field, name)}"
        if ends := _ends(field, table, name):
            fixed = replace(volume, pose=_lies(volume, correct, seed))
            rms = [left(replace(fixed, field=f), correct, seed).rms_um for f in (field, *ends.values())]
            elsewhere = " and ".join(f"{um:.1f} {where}" for um, where in zip(rms[1:], ends, strict=True))
            line += f". Left there {rms[0]:.1f} um rms, {elsewhere}, zero and workpiece as they were"
        if name == "time":
            line += ". Load and use them on a machine that has warmed up as long as in the recording"
        elif name.startswith("T_"):
            line += ". Hold that temperature"
        elif name == "load":
            line += ". Write others for each load that is worked with (--load)"
        out.append(line)
    return tuple(out)


def _ends(field: Field, table: pd.DataFrame, name: str) -> dict[str, Field]:
    """The machine where a channel is at the ends that it had in the survey, or had beside its mean by position."""
    if name in field.means:
        low, high = field.means[name].beside[:2]
        return {f"where it is {abs(v):.2g} {s}": field.beside(name, v) for v, s in ((low, "less"), (high, "more"))}
    recorded = table[name].dropna().to_numpy(dtype=np.float64) if name in table else np.zeros(0)
    if not len(recorded) or np.ptp(recorded) == 0:
        return {}
    return {f"at {quantity(name, v)}": field.at({name: v}) for v in (float(recorded.min()), float(recorded.max()))}


def held_at(field: Field, name: str) -> str:
    """What tables take a channel for that they do not follow."""
    if name in field.means:
        return f"{name} at its {field.means[name].words}"
    return quantity(name, field.state.get(name, 0.0))


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


def state_words(state: Mapping[str, float]) -> str:
    """A state of the machine: its channels' values with their units."""
    return ", ".join(quantity(name, value) for name, value in state.items())
