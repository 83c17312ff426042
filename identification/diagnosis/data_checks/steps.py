"""A step along the rows in what a join leaves: from some row on, station, target or machine stood elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.approach import direction
from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.machine import Machine
from errormodel.survey import Survey
from errormodel.surveys.columns import MEASURED
from identification.diagnosis.data_checks.blunder import Points, groups, sheet
from identification.diagnosis.data_checks.rows import OWN_RUN

FEWEST_BEHIND = 5  # rows on either side of a step: three fit any frame, four nearly
LARGEST_MM = 10.0  # of what an effect still describes beside rows that are no outliers; more is another set-up
FEWEST_BESIDE = 2.0  # rows a column of the smooth model: fewer let it follow a step; by judgement
GAIN = 4.0  # times less variance must a step leave than the smooth model: by chance, or a machine's errors, none does
SUDDEN = 2.0  # times less than a ramp over the rows leaves: a drift is no step
OWN = 0.2  # of a step's variance over the rows must not follow from positions and sides of arrival


@dataclass(frozen=True)
class Step:
    """From `row` of `file` on points lie `size_um` beside where those before them would let expect."""

    file: str
    row: int
    size_um: float

    @property
    def found(self) -> str:
        """What was found."""
        size = f"{self.size_um:.3g} um" if self.size_um < 1e3 else f"{self.size_um / 1e3:.3g} mm"
        return (
            f"from row {self.row} on the points lie {size} beside where those before it let expect: the station, "
            "the target, the probe or the machine was displaced there"
        )

    @property
    def text(self) -> str:
        """A sentence for the proof."""
        return f"{self.file}: {self.found}. {OWN_RUN}. Or measure again"

    @property
    def large(self) -> bool:
        """Whether it is more than an effect may describe."""
        return self.size_um > 1e3 * LARGEST_MM


def large_steps(machine: Machine, survey: Survey) -> list[Step]:
    """Of each file and measuring frame the step that is too large for an effect, if there is one."""
    chain, found = Chain(machine), list[Step]()
    for rows in groups(survey):
        part = Points.of(chain, sheet(chain, survey.table.iloc[rows]), survey.frame == "fixed")
        step = find_step(machine, survey, rows, part)
        if step is not None and step.large:
            found.append(step)
    return found


def refuse_steps(machine: Machine, survey: Survey) -> None:
    """InputError where the set-up was another from some row on, which parameters and effects would follow."""
    for step in large_steps(machine, survey):
        raise InputError(step.file, step.found, f"{OWN_RUN}. Or measure again")


def find_step(machine: Machine, survey: Survey, rows: Index, part: Points) -> Step | None:
    """The step of a file, if there is one; by two-sample comparison of what a smooth model of the machine leaves.

    Residuals of the aligned points are compared before and behind each row, beside a model of second degree in the
    joints' positions and their sides of arrival: errors of a machine that was measured layer by layer are no steps.
    A step is named where it leaves a quarter of that model's variance at most, and half of what a ramp leaves.

    Parameters
    ----------
    rows : (n,) rows of the survey, in their order.
    part : their points.
    """
    table = survey.table.iloc[rows]
    u = smooth_basis(machine, survey, rows)
    n = len(u)
    if n < FEWEST_BESIDE * u.shape[1] or n < 4 * FEWEST_BEHIND:
        return None
    residual = table[list(MEASURED)].to_numpy(dtype=np.float64) - part.pose().apply(part.nominal)
    residual = residual - u @ (u.T @ residual)
    smooth = float(np.sum(residual**2))
    behind = np.cumsum(residual[::-1], axis=0)[::-1]  # products of each step with the residuals, and with the model
    known = np.cumsum(u[::-1], axis=0)[::-1]
    count = np.arange(n, 0, -1)
    free = count - np.sum(known**2, axis=1)
    usable = free > OWN * count * (n - count) / n
    usable[:FEWEST_BEHIND] = usable[n - FEWEST_BEHIND + 1 :] = False
    if not usable.any() or smooth <= 0:
        return None
    gain = np.where(usable, np.sum(behind**2, axis=1) / np.where(usable, free, 1.0), 0.0)
    at = int(np.argmax(gain))
    left = smooth - float(gain[at])
    ramp = np.arange(n) - (n - 1) / 2
    ramp = ramp - u @ (u.T @ ramp)
    slow = smooth - float(np.sum((ramp @ residual) ** 2) / max(float(ramp @ ramp), 1e-12))
    if left * GAIN > smooth or left * SUDDEN > slow:
        return None
    size = float(np.linalg.norm(behind[at]) / free[at])
    return Step(str(table["file"].iloc[0]), int(table["row"].iloc[at]), 1e3 * size)


def smooth_basis(machine: Machine, survey: Survey, rows: Index) -> Array:
    """Orthonormal basis (n, k) of functions of second degree in the joints' positions and of their sides of arrival."""
    q = survey.table[[j.name for j in machine.joints]].to_numpy(dtype=np.float64)[rows]
    q = q[:, np.ptp(q, axis=0) > 0]
    q = (q - q.mean(axis=0)) / np.maximum(np.ptp(q, axis=0), 1e-12)
    side = np.column_stack([np.nan_to_num(direction(survey.table, j.name)[rows]) for j in machine.joints])
    products = [q[:, i] * q[:, j] for i in range(q.shape[1]) for j in range(i, q.shape[1])]
    u, s, _ = np.linalg.svd(np.column_stack([np.ones(len(q)), q, *products, side]), full_matrices=False)
    return np.asarray(u[:, s > 1e-9 * s[0]])
