"""A controller's own temperature compensation: a correction linear in the axis' position and in one temperature.

Of tables for several temperatures, those for the middle one go into the controller. The difference of the others is
fitted, axis by axis, by a linear function of position per kelvin, which the control (its PLC) evaluates.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Tables
from errormodel.controllers.text import printable

States = Sequence[tuple[Mapping[str, float], Tables]]
"""Temperatures, and the tables that were made for them; from cool to warm."""

Emulate = Callable[[Tables, Setup, Array, Array], Array]
COMPARISON_POSES = 512  # poses at which corrections are compared; a power of two, for Sobol points
MOST_SENSOR_NAME = 60  # characters of a sensor's name in a file
LEAST_GROWTH_MM_K = 1e-4  # mm per K: smaller growth is not written; by judgement
LAW_LINE = re.compile(
    r"^\W+correct (\w+) by ([-+.\deE]+) mm and ([-+.\deE]+) mm/mm a kelvin of (.+) above ([-+.\d]+)$", re.MULTILINE
)


@dataclass(frozen=True)
class Growth:
    """Correction of an axis' command: ``kelvin * (offset + slope * position)``, mm."""

    axis: str
    offset: float
    slope: float
    sensor: str
    zero: float  # degC, reference temperature of the correction

    def line(self) -> str:
        """The function as text, which `laws_of` reads."""
        where = f"{printable(self.sensor)[:MOST_SENSOR_NAME]} above {self.zero:.3f}"
        law = f"{self.offset:.6e} mm and {self.slope:.6e} mm/mm a kelvin of {where}"
        return f"{self.axis} by {law}"

    def at(self, state: Mapping[str, float], position: Array) -> Array:
        """Correction (n,), mm, in a state and at positions (n,) of the axis."""
        return np.asarray((state[self.sensor] - self.zero) * (self.offset + self.slope * position))


@dataclass(frozen=True)
class Thermal:
    """Files of a controller's own temperature compensation, their functions, and what no public source settles."""

    files: Mapping[str, str]
    laws: Sequence[Growth]
    doubt: str = ""


def laws_of(text: str) -> list[Growth]:
    """The functions stated in a file."""
    return [Growth(a, float(o), float(s), sensor, float(zero)) for a, o, s, sensor, zero in LAW_LINE.findall(text)]


def sign_program(axis: str, setting: str) -> dict[str, str]:
    """Steps that show the sign of the compensation on an indicator, without moving an axis."""
    steps = [
        "Check of the sign of the temperature compensation, before its laws are used. No axis is driven.",
        f"1. All its values zero. Put an indicator against the spindle nose, along {axis}, and set it to zero.",
        f"2. Then {setting}.",
        f"3. The axis {axis} must now stand 0.0500 mm further, towards minus: then the sign is right.",
        "   If it stands 0.0500 mm further towards plus, the control wants the other sign: turn that of every law.",
        "   If it did not move, the compensation is not active.",
        "4. Set the value back to zero.",
    ]
    return {"sign_test/temperature.txt": "\n".join(steps) + "\n"}


def growths(states: States, setup: Setup, emulate: Emulate) -> list[Growth]:
    """Growth of each linear axis per kelvin of the first sensor, by least squares over the measured region."""
    middle, tables = states[len(states) // 2]
    sensor = next(iter(middle))
    warmth = np.array([state[sensor] - middle[sensor] for state, _ in states])
    ends = np.array([a.measured for a in setup.axes])
    rng = np.random.default_rng(0)
    q = rng.uniform(ends[:, 0], ends[:, 1], (COMPARISON_POSES, len(ends)))
    came = rng.choice([-1.0, 1.0], q.shape)
    moved = np.array([emulate(t, setup, q, came) for _, t in states]) - emulate(tables, setup, q, came)
    gain = np.einsum("s,snm->nm", warmth, moved) / max(warmth @ warmth, 1e-9)
    out = []
    for axis in setup.linear:
        x = q[:, setup.place(axis)]
        column = gain[:, setup.movers.index(axis)]
        slope, offset = np.polyfit(x, column, 1) if axis in setup.moving else (0.0, column.mean())
        if np.abs(offset + slope * x).max() > LEAST_GROWTH_MM_K:
            out.append(Growth(axis, float(offset), float(slope), sensor, middle[sensor]))
    return out


def thermal(
    states: States, setup: Setup, emulate: Emulate, write: Callable[[list[Growth]], dict[str, str]], doubt: str
) -> Thermal | None:
    """Files of the functions, and the functions as read back; None if nothing grows."""
    found = growths(states, setup, emulate)
    if not found:
        return None
    files = write(found)
    back = [g for text in files.values() for g in laws_of(text)]
    return Thermal(files, [replace(g, sensor=found[0].sensor) for g in back], doubt)
