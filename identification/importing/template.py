"""An empty table for a survey of a machine: its columns with their units, and one example."""

from __future__ import annotations

import math

import numpy as np

from errormodel.chain import Chain
from errormodel.machine import Machine

OTHERS = ("run", "time [s]")
EXAMPLE_SHARE = 0.25  # of the travel from its lower end: where the example stands
DIGITS = {"mm": 3, "deg": 4}


def template_text(machine: Machine, motions_of: str = "") -> str:
    """CSV with one line of names and units and one of an example, which is to be overwritten.

    Parameters
    ----------
    machine : Machine
    motions_of : a joint whose error motions are measured; empty: points are measured.
    """
    names: list[str] = []
    cells: list[str] = []
    columns = {c: np.zeros(1) for c in Chain(machine).channels}
    for joint in machine.joints:
        low, high = joint.travel
        place = low + EXAMPLE_SHARE * (high - low)
        columns[joint.name] = np.array([place])
        unit = "deg" if joint.type == "rotary" else "mm"
        if motions_of and joint.name != motions_of:
            continue
        names.append(f"{joint.name} [{unit}]")
        cells.append(f"{math.degrees(place) if unit == 'deg' else place:.{DIGITS[unit]}f}")
    if motions_of:
        names += ["joint", "dx [um]", "dy [um]", "dz [um]", "ea [urad]", "eb [urad]", "ec [urad]", f"dir_{motions_of}"]
        cells += [motions_of, "1.2", "", "", "", "-3.4", "", "1"]
    else:
        for name, value in zip(("tool_x", "tool_y", "tool_z"), machine.tool, strict=True):
            columns[name] = np.array([value])
        kernel = Chain(machine).kernel("nominal", outputs=(0, 1, 2))
        point = kernel([columns[c] for c in Chain(machine).channels])[:, 0]
        names += ["mx [mm]", "my [mm]", "mz [mm]"]
        cells += [f"{v:.4f}" for v in point]
    names += [*OTHERS, "T_air [degC]"]
    cells += ["1", "0", "20.0"]
    return f"{','.join(names)}\n{','.join(cells)}\n"
