"""Klipper's ``axis_twist_compensation``: correction of a probe's readings for the twist of the axes.

A probe beside the nozzle is displaced by the angular errors of the axes through its offset, so that its height relative
to the nozzle depends on X and Y; bed mesh and levelling then follow the twist. Equidistant values over X and over Y add
up; interpolation is linear and continues beyond the ends; only differences matter. Klipper means positions on the bed,
not of the carriage: versions before its pull request 7343 (August 2026) used the carriage's position.

Source: Klipper klippy/extras/axis_twist_compensation.py (a reading grows by the value: ``avg - (probe - nozzle)``).
"""

from __future__ import annotations

import configparser
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.grids import nodes
from errormodel.controllers.probing import Gap, Probing
from errormodel.controllers.setup import Setup
from errormodel.controllers.text import Comment
from errormodel.exceptions import InputError

TWIST_SECTION = "axis_twist_compensation"
TWIST_KEYS = {"X": "z_compensations", "Y": "zy_compensations"}
MOST_TWIST_VALUES = 33  # values of a list; by judgement


@dataclass(frozen=True)
class Twist:
    """Equidistant values (mm) over an axis, the first at `low` and the last at `high`."""

    low: float
    high: float
    values: Array

    def at(self, x: Array) -> Array:
        """Interpolate as the firmware does: linear, and continued beyond the ends."""
        step = (self.high - self.low) / (len(self.values) - 1)
        k = np.clip(np.floor((x - self.low) / step).astype(int), 0, len(self.values) - 2)
        share = (x - self.low) / step - k
        return np.asarray((1 - share) * self.values[k] + share * self.values[k + 1])


def probing(setup: Setup, gap: Gap) -> Probing:
    """Fit the two lists that remove most of a probe's error over the bed, write, read back and assess them.

    Raises
    ------
    InputError
        The probe reaches nothing of what was measured.
    """
    twists = _twists(setup, gap)
    files = {"axis_twist.cfg": write(twists, setup)}
    back = read(files["axis_twist.cfg"])
    rng = np.random.default_rng(1)
    bed = {a: rng.uniform(t.low, t.high, 400) for a, t in twists.items()}
    reading = -gap(_places(setup, bed))
    after = reading + sum(t.at(bed[a]) for a, t in back.items())
    return Probing(files, _size(reading), _size(after))


def _size(values: Array) -> tuple[float, float]:
    left = 1e3 * np.abs(values - values.mean())
    return float(np.sqrt(np.mean(left**2))), float(left.max())


def _reach(setup: Setup, axis: str, offset: float) -> tuple[float, float]:
    """Positions on the bed that both nozzle and probe reach within the measured region."""
    low, high = setup.axis(axis).measured
    low, high = np.ceil(max(low, low + offset)), np.floor(min(high, high + offset))
    if high - low < abs(offset) or high <= low:
        raise InputError(
            "--probe", f"an offset of {offset:g} mm along {axis}", f"The survey covers too little of {axis}"
        )
    return float(low), float(high)


def _places(setup: Setup, bed: Mapping[str, Array]) -> Array:
    """Positions (n, axes) of the nozzle over the bed; other axes as close to zero as possible."""
    out = np.array([[min(max(0.0, a.measured[0]), a.measured[1]) for a in setup.axes]] * len(bed["X"]))
    for axis, x in bed.items():
        out[:, setup.place(axis)] = x
    return out


def _twists(setup: Setup, gap: Gap) -> dict[str, Twist]:
    """Least-squares sum of functions of X and Y on an even grid: means over rows and columns."""
    ends = [_reach(setup, axis, offset) for axis, offset in zip("XY", setup.probe or (0.0, 0.0), strict=True)]
    counts = [min(max(setup.axis(a).intervals + 1, 3), MOST_TWIST_VALUES) for a in "XY"]
    grids = [tuple(np.linspace(*e, n).tolist()) for e, n in zip(ends, counts, strict=True)]
    mesh = nodes(grids)
    values = gap(_places(setup, {"X": mesh[:, 0], "Y": mesh[:, 1]})).reshape([len(g) for g in grids])
    means = [values.mean(axis=1 - k) - values.mean() for k in range(2)]
    return {a: Twist(*e, m) for a, e, m in zip("XY", ends, means, strict=True)}


def write(twists: Mapping[str, Twist], setup: Setup) -> str:
    """The section of printer.cfg."""
    x, y = twists["X"], twists["Y"]
    lines = [
        *map(
            Comment("# ").line,
            (
                f"machine: {setup.machine}",
                "what is added to the readings of a probe at x_offset, y_offset of [probe] = "
                + ", ".join(f"{v:g}" for v in setup.probe or ()),
                "(Klipper before pull request 7343, August 2026: take x_offset off the two x, y_offset off the two y)",
            ),
        ),
        f"[{TWIST_SECTION}]",
        f"calibrate_start_x: {x.low:g}",
        f"calibrate_end_x: {x.high:g}",
        f"calibrate_y: {(y.low + y.high) / 2:g}",
        f"calibrate_start_y: {y.low:g}",
        f"calibrate_end_y: {y.high:g}",
        f"calibrate_x: {(x.low + x.high) / 2:g}",
    ]
    for axis, twist in twists.items():
        lines += [
            f"{TWIST_KEYS[axis]}: {', '.join(f'{v:.6f}' for v in twist.values)}",
            f"compensation_start_{axis.lower()}: {twist.low:g}",
            f"compensation_end_{axis.lower()}: {twist.high:g}",
        ]
    return "\n".join(lines) + "\n"


def read(text: str) -> dict[str, Twist]:
    """Read the lists of a section.

    Raises
    ------
    InputError
        It is not a section of this kind.
    """
    parser = configparser.ConfigParser(delimiters=(":",), inline_comment_prefixes=("#",))
    try:
        parser.read_string(text)
        keys = parser[TWIST_SECTION]
        return {
            axis: Twist(
                float(keys[f"compensation_start_{axis.lower()}"]),
                float(keys[f"compensation_end_{axis.lower()}"]),
                np.array([float(v) for v in keys[key].split(",")]),
            )
            for axis, key in TWIST_KEYS.items()
        }
    except (configparser.Error, KeyError, ValueError) as error:
        raise InputError(TWIST_SECTION, f"not a section that was written here ({error})", "Write it again") from error
