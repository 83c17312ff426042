"""A displacement that repeats of commands show: of two measurements of a pose, no error of geometry tells them apart.

Measurements of one command, from the same side, differ by noise alone; behind a displacement all of them differ by it
(analysis of variance: a constant for each command, and a step). It is far smaller than a step that shows beside the
machine's errors. Noise that drifts makes means differ as well, so that readings count as if none averaged out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.approach import direction
from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.machine import Machine
from errormodel.survey import Survey
from errormodel.surveys.columns import MEASURED
from identification.diagnosis.data_checks.blunder import Points, groups, sheet
from identification.diagnosis.data_checks.steps import Step, find_step

FEWEST = 2.0  # of the sum of squares of a step: four commands measured once on either side
LOCATED = 5  # rows between which a displacement is known to lie; beyond, twice as many repeats are asked for
MOST_ROWS = 20_000  # of a survey whose fit looks for it: sorting the commands of more takes longer than the fit
FREE = 9  # degrees of freedom of the scatter
LARGE = 7.0  # times the scatter of a reading: 1 false one in 4000 random surveys of white and drifting noise
CHANCE = 2.0  # standard uncertainties of a correlation
ALIKE = 27.0  # mean squares of the noise: three components at three standard deviations


@dataclass(frozen=True)
class RepeatShift:
    """Repeats of `count` commands lie `size_um` (standard uncertainty `u_um`) apart, between two rows of `file`."""

    file: str
    after: int
    before: int
    size_um: float
    noise_um: float
    u_um: float
    count: int

    @property
    def text(self) -> str:
        """A sentence for the proof."""
        where = (
            f"at row {self.before}" if self.before == self.after + 1 else f"between rows {self.after} and {self.before}"
        )
        return (
            f"repeats of {self.count} commands lie {self.size_um:.3g} um (u = {self.u_um:.2g} um) apart, all in one "
            f"direction, and scatter by {self.noise_um:.3g} um ({self.file}): {where} the station, the target or the "
            "machine was displaced, or drifted. To give the part behind it a set-up of its own, give its rows a run of "
            "their own and write frame: per-run in survey.yaml; or measure again"
        )


def displacement_notes(machine: Machine, survey: Survey) -> list[str]:
    """Displacements as notes of a fit; none looked for in large surveys."""
    if len(survey.table) > MOST_ROWS:
        return []
    chain, found = Chain(machine), list[RepeatShift | Step | None]()
    for rows in groups(survey):
        part = Points.of(chain, sheet(chain, survey.table.iloc[rows]), survey.frame == "fixed")
        found.append(displacement(machine, survey, rows, part))
    return [shift.text for shift in found if shift is not None]


def displacement(machine: Machine, survey: Survey, rows: Index, part: Points) -> RepeatShift | Step | None:
    """A displacement among some rows: by repeats of commands, or by a step of the points (`part`) beside the machine's.

    Of a step repeats say the size best, if they say where it is, too.
    """
    repeated, step = repeat_shift_of(machine, survey, rows), find_step(machine, survey, rows, part)
    return repeated if repeated is not None and (step is None or repeated.before - repeated.after <= LOCATED) else step


def repeat_shift_of(machine: Machine, survey: Survey, rows: Index) -> RepeatShift | None:
    """A displacement that repeats of commands show among some rows, which were reached from the same side."""
    table = survey.table.iloc[rows]
    names = [*(j.name for j in machine.joints), "tool_x", "tool_y", "tool_z"]
    sides = [np.nan_to_num(direction(survey.table, j.name)[rows]) for j in machine.joints]
    keys = np.column_stack([*(table[n].to_numpy(dtype=np.float64).round(6) for n in names), *sides])
    labels = np.unique(keys, axis=0, return_inverse=True)[1].ravel()
    file = str(table["file"].iloc[0])
    return repeat_shift(labels, table[list(MEASURED)].to_numpy(dtype=np.float64), table["row"].to_numpy(), file)


def repeat_shift(labels: Index, measured: Array, rows: Index, file: str) -> RepeatShift | None:
    """The displacement that repeats show; by the border that explains most of their differences.

    Parameters
    ----------
    labels : (n,) number of the command of each row, in the order of measuring.
    measured : (n, 3) mm.
    rows : (n,) of the file, for the sentence.
    """
    seen = np.flatnonzero(np.isfinite(measured).all(axis=1))
    number, count = np.unique(labels[seen], return_inverse=True, return_counts=True)[1:]
    kept = count[number] > 1
    again = seen[kept]
    number = np.unique(number[kept], return_inverse=True)[1]
    free = 3 * (len(again) - int(number.max(initial=-1)) - 1) - 3
    if free < FREE:
        return None

    def about(values: Array) -> Array:
        """Values (n, m) about the means of their commands."""
        total = np.stack([np.bincount(number, v) for v in values.T], axis=-1)
        return np.asarray(values - (total / np.bincount(number)[:, None])[number])

    apart = about(measured[again])
    each = np.bincount(number)
    order = np.argsort(number, kind="stable")
    passed = np.empty(len(again), dtype=np.intp)  # of a row's command, rows before it
    passed[order] = np.arange(len(again)) - np.repeat(np.cumsum(each) - each, each)
    # a row that comes before the border, with `still` of its command behind it so far, changes the sum of squares
    still = each[number] - passed
    weight = np.cumsum((2 * still - 1) / each[number] - 1)[:-1]
    behind = np.cumsum(apart[::-1], axis=0)[::-1][1:]  # sums behind the border
    shift = behind / np.maximum(weight, FEWEST)[:, None]
    gain = np.where(weight >= FEWEST, np.sum(np.square(shift), axis=1) * weight, 0.0)
    total = float(np.sum(np.square(apart)))
    if not gain.any():
        return None
    alike = gain >= gain.max() - ALIKE * (total - gain.max()) / free  # of these the one with most on either side
    best = int(np.lexsort((gain, np.where(alike, weight, -1)))[-1])
    left = apart - about((np.arange(len(again)) > best).astype(float)[:, None]) * shift[best]
    noise = float(np.sqrt(np.sum(np.square(left)) / free))
    linked = float(np.sum(left[1:] * left[:-1]) / max(np.sum(np.square(left)), 1e-300))
    linked = float(np.clip(linked - CHANCE / np.sqrt(left.size), 0.0, 0.9))  # by chance it is so large of white noise
    size = float(np.linalg.norm(shift[best]))
    if size < LARGE * noise * np.sqrt((1 + linked) / (1 - linked)):
        return None
    near = np.flatnonzero(alike & (weight >= FEWEST))
    low, high = int(near.min()), int(near.max()) + 1
    if rows[again[high]] - rows[again[low]] > LOCATED and weight[best] < 2 * FEWEST:
        return None  # few readings at either end of a long time: whatever drifts does that
    return RepeatShift(
        file, int(rows[again[low]]), int(rows[again[high]]), 1e3 * size, 1e3 * noise,
        1e3 * noise / float(np.sqrt(weight[best])), len(count[count > 1]),
    )  # fmt: skip
