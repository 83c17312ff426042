"""Positions of the axes in place of measured points: what a probing cycle prints of a ball that it found."""

from __future__ import annotations

import numpy as np

from errormodel.exceptions import InputError
from errormodel.machine import Machine
from errormodel.survey import Survey
from identification.diagnosis.data_checks.blunder import Points

NEAR_MM = 1.0  # of the axes' positions: what a cycle finds beside its commands
FAR = 20.0  # times as far from the functional point


def refuse_axes_as_points(machine: Machine, survey: Survey, rows: np.ndarray, points: Points) -> None:
    """InputError where ``mx my mz`` are the commanded positions of three linear axes and not the tool's place."""
    linear = [j.name for j in machine.joints if j.type == "prismatic"]
    if len(linear) != 3 or len(rows) < 4 or all(j.type == "prismatic" for j in machine.joints):
        return
    seen, told = survey.measured[rows], survey.commands(sorted(linear))[rows]
    whole = np.isfinite(seen).all(axis=1)
    if whole.sum() < 4:
        return
    gap = np.abs((seen - told)[whole] - np.median((seen - told)[whole], axis=0)).max(axis=1)
    near = float(np.median(gap))
    misses = 1e3 * points.misfit()
    if near < NEAR_MM and misses > 1e3 * FAR * max(near, NEAR_MM / FAR):
        names = ", ".join(sorted(linear))
        found = (
            f"mx my mz that follow {names} to {near:.3g} mm, and the functional point no nearer than "
            f"{1e-3 * misses:.3g} mm: positions of the axes, as a probing cycle prints them of a ball that it found"
        )
        columns = ",".join(f"{n}=.." for n in sorted(linear))
        cure = f"Give them as the commands (--columns {columns}), and the place of the ball as mx my mz in all rows"
        raise InputError(f"{survey.table['file'].iloc[rows[0]]}", found, cure)
