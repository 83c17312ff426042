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
    linear = sorted(j.name for j in machine.joints if j.type == "prismatic")
    if len(linear) != 3 or len(rows) < 4 or all(j.type == "prismatic" for j in machine.joints):
        return
    beside = survey.measured[rows] - survey.commands(linear)[rows]
    beside = beside[np.isfinite(beside).all(axis=1)]
    if len(beside) < 4:
        return
    near = float(np.median(np.abs(beside - np.median(beside, axis=0)).max(axis=1)))
    misses = points.misfit()
    if near < NEAR_MM < misses and misses > FAR * near:
        names = ", ".join(linear)
        found = (
            f"mx my mz that follow {names} to {near:.3g} mm, and the functional point no nearer than "
            f"{misses:.3g} mm: positions of the axes, as a probing cycle prints them of a ball that it found"
        )
        columns = ",".join(f"{n}=.." for n in linear)
        cure = f"Give them as the commands (--columns {columns}), and the place of the ball as mx my mz in all rows"
        raise InputError(f"{survey.table['file'].iloc[rows[0]]}", found, cure)
