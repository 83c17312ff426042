"""What several effects share: kinds of field, temperatures and time as they act, directions, grids of shapes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from errormodel.conventions import ROTATIONS, TRANSLATIONS, Motion
from errormodel.effects.base import Channels
from errormodel.effects.ops import Value, atan2, cos, cubic, exp, fmax, fmin, sin
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.exceptions import InputError
from errormodel.machine import Joint, Machine, joint_of

Positive = Annotated[float, Field(gt=0)]
Lag = Annotated[float, Field(ge=0)]  # s; 0: none
Rotation = Literal["ea", "eb", "ec"]

REFERENCE_TEMPERATURE = 20.0  # degC, ISO 1
STEEL_EXPANSION = 12e-6  # expansion, 1/K
MOST_FREQUENCIES = 4000  # frequencies of one grid
POSITIONS_PER_PERIOD = 3  # positions that show a wave


def joint_as(machine: Machine, name: str, kind: Literal["prismatic", "rotary"], effect: str) -> Joint:
    """The joint of that name and kind.

    Raises
    ------
    InputError
        There is none.
    """
    joint = joint_of(machine, name)
    if joint.type != kind:
        names = ", ".join(j.name for j in machine.joints if j.type == kind) or "(none)"
        found = f"joint {name} is {joint.type}"
        raise InputError(f"effect {effect}, key joint", found, f"Write a {kind} joint: {names}")
    return joint


def warmth(channel: Channels, sensor: str, minus: str | None = None, tau: float = 0.0) -> Value:
    """Temperature of a sensor over 20 degC or over another sensor's, K; both behind a lag of `tau` s."""
    here, there = (
        channel(f"lag({s},{tau:.6g})" if tau else s) if s else REFERENCE_TEMPERATURE for s in (sensor, minus)
    )
    return here - there


def thermal(sensor: str, minus: str | None) -> tuple[str, ...]:
    """The drivers of :func:`warmth`."""
    return (sensor, minus) if minus else (sensor,)


def settling(channel: Channels, tau: float, start: float) -> Value:
    """``1 - exp(-(t - start)/tau)``; 0 before the start."""
    return 1 - exp(-fmax(channel("time") - start, 0) / tau)


def waves(q: Value, rate: float | NDArray[np.float64]) -> dict[str, Value]:
    """``sin(rate q)`` and ``cos(rate q)``, by label; many rates as (n, 1), to six digits."""
    if isinstance(rate, np.ndarray) and len(rate) > 1:
        turns = rate / (2 * np.pi) * q
        phase = (turns - np.rint(turns)).astype(np.float32) * np.float32(2 * np.pi)  # of which sines are quick
        return {"sin": np.sin(phase), "cos": np.cos(phase)}
    return {"sin": sin(rate * q), "cos": cos(rate * q)}


def splines(share: Value, n: int) -> Iterator[Value]:
    """The ``n + 3`` cubic B-splines of n pieces over a share of a range, 0 to 1; beyond it they hold."""
    u = fmin(fmax(share, 0), 1) * n
    for k in range(-1, n + 2):
        yield cubic(u - k)


def across(joint: Joint, kind: Literal["d", "e"]) -> tuple[Motion, ...]:
    """The two translations (``d``) or rotations (``e``) across the joint's axis."""
    size = np.abs(joint.axis)
    names = TRANSLATIONS if kind == "d" else ROTATIONS
    return tuple(name for k, name in enumerate(names) if k != int(np.argmax(size)))


def bending(joint: Joint, motion: Motion, deflection: Value, slope: Value) -> dict[Motion, Value]:
    """A deflection across the axis and the small rotation that comes with its slope, d deflection / d position."""
    side = np.array([float(m == motion) for m in TRANSLATIONS])
    turn = np.cross(joint.axis, side)
    return {motion: deflection} | {name: slope * float(a) for name, a in zip(ROTATIONS, turn, strict=True) if a}


def lags(scene: Scene) -> list[float]:
    """Time constants of a lag, s: none, and up to half the recording."""
    return [0.0, *(scene.duration / 2 / 1.6**k for k in range(7) if scene.duration)]


def settling_times(scene: Scene) -> list[float]:
    """Time constants of a warm-up, s: from a twentieth of the recording to one that looks like a straight line."""
    return [1.6 * scene.duration / 1.6**k for k in range(8) if scene.duration]


def start_of(scene: Scene) -> float:
    """Time of the first row, s."""
    return float(np.min(scene.columns["time"]))


def frequencies(span: float, low: float, high: float) -> list[float]:
    """Frequencies from low to high, neighbours alike to 0.9 over the span; per unit of the span."""
    step = 1 / (4 * span)
    if not low < high:
        return []
    return [low + k * step for k in range(min(int((high - low) / step) + 1, MOST_FREQUENCIES))]


def resolved(scene: Scene, joint: Joint, shortest: float) -> float:
    """Shortest period that positions tell from others; `shortest` where they are scattered, not on a grid.

    Of a wave with two positions a period, the size and the phase are one: between them it could be of any size.
    """
    gaps = np.diff(np.sort(scene.columns[joint.name]))
    gaps = gaps[gaps > shortest / 8]  # nearer ones are the same place
    return max(shortest, POSITIONS_PER_PERIOD * float(gaps.min())) if len(gaps) else np.inf


def periods(scene: Scene, joint: Joint, fewest: int, shortest: float, most: int) -> list[float]:
    """Periods along a travel, mm: from `fewest` of them in it to what positions tell apart.

    None is shorter than `shortest`, or in a short travel than its `most`-th part.
    """
    span = float(np.ptp(scene.span(joint)))
    least = resolved(scene, joint, min(shortest, span / most))
    return [1 / rate for rate in frequencies(span, fewest / span, 1 / least)]


def closed_splines(turn: Value, n: int) -> Iterator[Value]:
    """The ``n`` cubic B-splines of n pieces around a circle, of an angle in rad; n is 5 or more."""
    u = atan2(sin(turn), cos(turn)) * (n / (2 * np.pi))  # -n/2 to n/2, where the ends are one place
    for k in range(n):
        at = k - n / 2
        near = cubic(u - at)
        yield near + cubic(u - at - n) if k < 2 else near + cubic(u - at + n) if k == n - 1 else near


def members(machine: Machine) -> list[str]:
    """Places where the structure can give way: the shapes, and joints with no shape behind them."""
    shapes = {s.name for s in machine.shapes}
    after = dict(pairwise(e.name for e in machine.elements))
    return [e.name for e in machine.elements if e.name in shapes or after.get(e.name) not in shapes]


def own_axes(machine: Machine) -> Mapping[str, NDArray[np.float64]]:
    """Orientation (3, 3) of each element's own axes in the reference's, all joints at zero."""
    from scipy.spatial.transform import Rotation as Turn

    turn, out = np.eye(3), {}
    for element in machine.elements:
        out[element.name] = turn
        if not isinstance(element, Joint):
            turn = turn @ Turn.from_euler("XYZ", element.rotation).as_matrix()
    return out


def outward_words(machine: Machine) -> str:
    """What growth of the tool means for the motion that its parameter is named by: ``outward, dz falls``."""
    (motion, sign), *_ = outward(machine).items()
    return f"outward, {motion} {'rises' if float(sign) > 0 else 'falls'}"


def outward(machine: Machine) -> dict[Motion, float]:
    """Unit motion of the tool's growth: along the longest component of the tool, or of the last member that has any."""
    for vector in (machine.tool, *(s.offset for s in reversed(machine.shapes))):
        if any(vector):
            k = int(np.argmax(np.abs(vector)))
            return {TRANSLATIONS[k]: float(np.sign(vector[k]))}
    return {"dz": 1.0}
