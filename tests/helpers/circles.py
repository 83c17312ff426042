"""Circles of a telescoping ballbar on three linear axes by a simulation that shares no code with the product."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from errormodel.arrays import Array
from errormodel.machine import Machine
from errormodel.survey import Survey
from tests.helpers.lengths import entry, survey, tips

PLANES = ("XY", "YZ", "ZX")
RADIUS = 150.0


def middle(machine: Machine) -> dict[str, float]:
    """The centre of the circles: the middle of all travels."""
    return {j.name: sum(j.travel) / 2 for j in machine.joints}


def circles(
    machine: Machine,
    values: Mapping[str, float],
    rng: np.random.Generator,
    backlash: Mapping[str, float] | None = None,
    noise: float = 3e-4,
    each: int = 180,
    ball: Array | None = None,
) -> pd.DataFrame:
    """Deviations of a bar of `RADIUS` mm in the three planes, counter-clockwise and then clockwise, `each` readings.

    Columns: joints, the side of arrival of those of the plane, ``angle`` (deg), ``plane``, ``length`` (mm).

    Parameters
    ----------
    values : errors of the machine by parameter.
    backlash : of joints, mm: from below they stop so much short of where they stop from above.
    noise : standard deviation of a reading, mm.
    ball : (3,) mm from the centre, of all planes; None: set up anew for each.
    """
    centre, parts = middle(machine), []
    for plane in PLANES:
        # a magnet cup is set up within some 0.02 mm
        place = tips(machine, {}, pd.DataFrame({k: [v] for k, v in centre.items()}))[0]
        place = place + (rng.normal(0, 0.02, 3) if ball is None else ball)
        for way in (1, -1):
            angle = way * 2 * np.pi * np.arange(each) / each
            at = pd.DataFrame({name: np.full(each, value) for name, value in centre.items()})
            before = angle - way * 1e-6  # where an axis reverses it has the side that it arrives from
            for axis, part, slope in zip(plane, (np.cos, np.sin), (-np.sin(before), np.cos(before)), strict=True):
                at[axis] += RADIUS * part(angle)
                at[f"dir_{axis}"] = np.sign(way * slope)
            actual = at.copy()
            for name, play in (backlash or {}).items():
                if name in plane:
                    actual[name] -= play / 2 * at[f"dir_{name}"]
            length = np.linalg.norm(tips(machine, values, actual) - place, axis=1) - RADIUS
            at["length"] = length + rng.normal(0, noise, each)
            parts.append(at.assign(angle=np.degrees(angle) % 360, plane=plane))
    return pd.concat(parts, ignore_index=True)


def as_survey(machine: Machine, table: pd.DataFrame) -> Survey:
    """The survey of these circles, the ball of each plane unknown."""
    entries = {p: entry(type="ballbar-circle", calibrated=RADIUS) for p in PLANES}
    return survey(machine, table.drop(columns=["angle", "plane"]).assign(observation=table["plane"]), entries)


def trace(part: pd.DataFrame, plane: str) -> str:
    """A plane's readings as a laboratory exports them."""
    lines = [f"Radius: {RADIUS:g} mm", "Feed rate: 1000", f"Plane {plane}", "Angle [deg],Deviation [um]"]
    lines += [f"{a:.4f},{1e3 * d:.4f}" for a, d in zip(part["angle"], part["length"], strict=True)]
    return "\n".join(lines) + "\n"
