"""Functions that several effects share: temperatures and time as regressors, directions, grids of shape parameters.

Units: mm, rad, s, degC.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations, pairwise
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from errormodel.arrays import rotation_matrix
from errormodel.conventions import REFERENCE_TEMPERATURE, ROTATIONS, TRANSLATIONS, Motion, unit_of
from errormodel.effects.base import FIXED, Channels, EffectTerm, ShapeParameter
from errormodel.effects.ops import Value, atan2, cos, cubics, exp, fmax, fmin, sin
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.exceptions import EffectError, InputError
from errormodel.machine import Joint, Machine, joint_of

Positive = Annotated[float, Field(gt=0)]
Lag = Annotated[float, Field(ge=0), ShapeParameter("s", said=False)]  # 0: none
Initial = Annotated[float, FIXED]  # K; found with the lag that it belongs to
Rotation = Literal["ea", "eb", "ec"]

STEEL_EXPANSION = 12e-6  # coefficient of linear expansion of steel, 1/K
MOST_FREQUENCIES = 4000  # most frequencies of one grid: more exceed time and memory
SLOWEST = 1.6  # longest time constant tried, in lengths of the recording: slower shows no settling; by judgement
SHIFT_MOMENTS = 40  # candidate times of a change that are evenly spaced among the rows; by judgement
LONGEST_BREAKS = 10  # candidate times in the longest pauses between rows, where runs are separated; by judgement
FEW_RUNS = 4  # of which all combinations are tried
POSITIONS_PER_PERIOD = 3  # fewest positions per period from which its size and phase can be estimated


def reversal_size(joint: Joint) -> tuple[str, float]:
    """Unit and usual size of a reversal: 20 um, of a rotary joint 20 arcsec, between worm tables and geared arms."""
    return ("mm", 0.02) if joint.type == "prismatic" else ("rad", 1e-4)


def joint_as(machine: Machine, name: str, kind: Literal["prismatic", "rotary"], effect: str) -> Joint:
    """Return the joint of that name and kind.

    Raises
    ------
    InputError
        The machine has no such joint, or it is of the other kind.
    """
    joint = joint_of(machine, name)
    if joint.type != kind:
        names = ", ".join(j.name for j in machine.joints if j.type == kind) or "(none)"
        found = f"joint {name} is {joint.type}"
        raise InputError(f"effect {effect}, key joint", found, f"Write a {kind} joint: {names}")
    return joint


def warmth(channel: Channels, sensor: str, minus: str | None = None, tau: float = 0.0, initial: float = 0.0) -> Value:
    """Temperature of a sensor over 20 degC, or over the sensor `minus`, in K; both lagged by `tau` s (first order).

    Of a record that is no temperature (``w_spindle``), over zero.
    What follows the sensor was `initial` K warmer than it in the first row, which fades; 0: in equilibrium with it.
    """
    here, there = (
        channel(f"lag({s},{tau:.6g})" if tau else s) if s else REFERENCE_TEMPERATURE * (not sensor.startswith("w_"))
        for s in (sensor, minus)
    )
    return here - there + (initial * channel(f"initial({sensor},{tau:.6g})") if tau and initial else 0.0)


def thermal(sensor: str, minus: str | None) -> tuple[str, ...]:
    """Channels that :func:`warmth` depends on."""
    return (sensor, minus) if minus else (sensor,)


def settling(channel: Channels, tau: float, start: float) -> Value:
    """``1 - exp(-(t - start)/tau)``; 0 before the start."""
    return 1 - exp(-fmax(channel("time") - start, 0) / tau)


def warmed(time: Value, tau: float, sessions: Sequence[tuple[Value, Value]]) -> Value:
    """State of what settles to 1 in sessions of work, each from its begin to its end, and to 0 in the rests between."""
    return sum(exp(-(time - fmin(time, end)) / tau) - exp(-(time - fmin(time, begin)) / tau) for begin, end in sessions)


def waves(q: Value, rate: float | NDArray[np.float64]) -> dict[str, Value]:
    """``sin(rate q)`` and ``cos(rate q)`` by label; several rates, given as (n, 1), are computed to six digits."""
    if isinstance(rate, np.ndarray) and len(rate) > 1:
        turns = rate / (2 * np.pi) * q  # sines of the remainder are faster in single precision
        phase = (turns - np.rint(turns)).astype(np.float32) * np.float32(2 * np.pi)
        return {"sin": np.sin(phase), "cos": np.cos(phase)}
    return {"sin": sin(rate * q), "cos": cos(rate * q)}


def splines(share: Value, n: int) -> Iterator[Value]:
    """The ``n + 3`` cubic B-splines of n intervals over `share`, 0 to 1; constant beyond."""
    yield from cubics(fmin(fmax(share, 0), 1) * n, -1, n + 3)


def across(joint: Joint, kind: Literal["d", "e"]) -> tuple[Motion, ...]:
    """The two translations (``d``) or rotations (``e``) perpendicular to the joint's axis."""
    size = np.abs(joint.axis)
    names = TRANSLATIONS if kind == "d" else ROTATIONS
    return tuple(name for k, name in enumerate(names) if k != int(np.argmax(size)))


def bending(joint: Joint, motion: Motion, deflection: Value, slope: Value) -> dict[Motion, Value]:
    """A deflection across the axis (mm) and the small rotation (rad) of its slope d deflection / d position."""
    return {motion: deflection} | _rotation(joint, motion, slope)


def tilting(joint: Joint, motion: Motion, slope: Value) -> dict[Motion, Value]:
    """The small rotation (rad) alone that a slope of a deflection across the axis is.

    Raises
    ------
    EffectError
        The motion is no displacement across the axis.
    """
    if rotation := _rotation(joint, motion, slope):
        return rotation
    found, names = f"{motion}, which is no displacement across the axis of {joint.name}", ", ".join(across(joint, "d"))
    raise EffectError(f"effect at {joint.name}, key motion", found, f"Write one of {names}", "motion")


def _rotation(joint: Joint, motion: Motion, slope: Value) -> dict[Motion, Value]:
    turn = np.cross(joint.axis, [float(m == motion) for m in TRANSLATIONS])
    return {name: slope * float(a) for name, a in zip(ROTATIONS, turn, strict=True) if a}


def each_motion(
    element: str, motions: Sequence[Motion], value: Value, sizes: tuple[float, float], per: str = ""
) -> list[EffectTerm]:
    """A parameter of each motion of an element, all of which follow one `value`.

    Parameters
    ----------
    sizes : usual ones, of a translation (mm) and of a rotation (rad).
    per : unit of the value as a divisor, as in ``/K``.
    """
    return [EffectTerm(element, "", f"{unit_of(m)}{per}", {m: value}, sizes[m not in TRANSLATIONS]) for m in motions]


def since(channel: Channels, at: float, clock: str = "time") -> Value:
    """1 from the time `at` (s) on, 0 before, within one second; with the clock ``row``, from that row on."""
    return fmin(fmax(channel(clock) - at + 0.5, 0), 1)


def moments(scene: Scene, clock: str = "time") -> Iterator[float]:
    """Candidate times of a sudden change, s, or rows (``row``): between two rows; none where the survey has no such."""
    if not scene.varies(clock):
        return
    time = np.unique(scene.columns[clock])
    gaps = np.diff(time)
    spread = np.linspace(0, len(gaps) - 1, SHIFT_MOMENTS + 2)[1:-1].astype(int)
    for k in np.union1d(spread, np.argsort(gaps)[-LONGEST_BREAKS:]):
        yield round(float(time[k] + time[k + 1]) / 2, 3)


def run_channels(run: str | tuple[str, ...] | None) -> tuple[str, ...]:
    """Channels of one or several runs by their labels; their sum is 1 in these runs."""
    own = (run,) if isinstance(run, str) else run or ()
    return tuple(f"run({name})" for name in own)


def in_runs(channel: Channels, run: str | tuple[str, ...]) -> Value:
    """1 in the rows of one or several runs, else 0."""
    return sum(map(channel, run_channels(run)))


def only(channel: Channels, of: str | None) -> Value:
    """1 in the rows of an observation, or of ``points``, else 0; 1 in all rows without it."""
    return 1.0 if of is None else channel(f"of({of})")


def switched(runs: Sequence[str], *, constant: bool = False) -> Iterator[str | tuple[str, ...]]:
    """Labels of runs in which something may act, and in the others not: of few any, of many from one to another.

    Parameters
    ----------
    runs : their channels, ``run(<label>)``.
    constant : whether that it acts in some runs is that it does not in the others: of few runs, the fewer of each pair.
    """
    names = [name[4:-1] for name in runs]
    if len(names) <= FEW_RUNS:
        most = max(len(names) // 2 if constant else len(names) - 1, 1)
        sets = [own for count in range(1, most + 1) for own in combinations(names, count)]
    else:
        sets = [tuple(names[a:b]) for a, b in combinations(range(len(names) + 1), 2) if b - a < len(names)]
    yield from (own[0] if len(own) == 1 else own for own in sets)


def lags(scene: Scene) -> list[float]:
    """Candidate lags, s: 0, and from half the recording to a 34th of it without rests."""
    return [0.0, *_slower(scene, 0.5, 7)]


def settling_times(scene: Scene) -> list[float]:
    """Candidate time constants of a warm-up, s: from `SLOWEST` times the recording to 0.06 of it without rests."""
    return _slower(scene, SLOWEST, 8)


def _slower(scene: Scene, most: float, count: int) -> list[float]:
    """Times from `most` times the recording on, each 1.6 times the next: so many, and more as it has rests, s."""
    if not scene.duration:
        return []
    more = round(math.log(scene.duration / scene.worked) / math.log(1.6))
    return [most * scene.duration / 1.6**k for k in range(count + more)]


def start_of(scene: Scene) -> float:
    """Time of the first row, s."""
    return float(np.min(scene.columns["time"]))


def frequencies(span: float, low: float, high: float) -> list[float]:
    """Frequencies from low to high per unit of the span, in steps of 1/(4 span): neighbours correlate by 0.9."""
    step = 1 / (4 * span)
    if not low < high:
        return []
    return [low + k * step for k in range(min(int((high - low) / step) + 1, MOST_FREQUENCIES))]


def resolved(scene: Scene, joint: Joint, shortest: float) -> float:
    """Shortest period that the positions resolve, mm or rad; `shortest` where they are scattered and not on a grid."""
    gaps = np.diff(np.sort(scene.columns[joint.name]))
    gaps = gaps[gaps > shortest / 8]  # smaller gaps are repeats of one position
    return max(shortest, POSITIONS_PER_PERIOD * float(gaps.min())) if len(gaps) else np.inf


def periods(scene: Scene, joint: Joint, fewest: int, shortest: float, most: int) -> list[float]:
    """Candidate periods along a travel, mm: from a `fewest`-th of the span down to what the positions resolve.

    None is shorter than `shortest`, or than the `most`-th part of a short span.
    """
    span = float(np.ptp(scene.span(joint)))
    least = resolved(scene, joint, min(shortest, span / most))
    return [1 / rate for rate in frequencies(span, fewest / span, 1 / least)]


def closed_splines(turn: Value, n: int) -> Iterator[Value]:
    """The ``n`` periodic cubic B-splines of n intervals over a full revolution; `turn` in rad, n at least 5."""
    u = atan2(sin(turn), cos(turn)) * (n / (2 * np.pi)) + n / 2  # 0 to n, both ends the same angle
    *first, beyond, further = cubics(u, -1, n + 3)
    before, *own = first
    yield from (own[0] + beyond, own[1] + further, *own[2:-1], own[-1] + before)


def members(machine: Machine) -> list[str]:
    """Elements at which the structure can deform: the shapes, and joints without a shape after them."""
    shapes = {s.name for s in machine.shapes}
    after = dict(pairwise(e.name for e in machine.elements))
    return [e.name for e in machine.elements if e.name in shapes or after.get(e.name) not in shapes]


def own_axes(machine: Machine) -> Mapping[str, NDArray[np.float64]]:
    """Orientation (3, 3) of each element's own axes in the reference's, all joints at zero."""
    turn, out = np.eye(3), {}
    for element in machine.elements:
        out[element.name] = turn
        if not isinstance(element, Joint):
            turn = turn @ rotation_matrix(element.rotation)
    return out


def outward_words(machine: Machine) -> str:
    """Meaning of a positive growth of the tool in the motion that names its parameter: ``outward, dz falls``."""
    (motion, sign), *_ = outward(machine).items()
    return f"outward, {motion} {'rises' if float(sign) > 0 else 'falls'}"


def outward(machine: Machine) -> dict[Motion, float]:
    """Unit motion of the tool's growth: along the largest component of the tool, or of the last offset member."""
    for vector in (machine.tool, *(s.offset for s in reversed(machine.shapes))):
        if any(vector):
            k = int(np.argmax(np.abs(vector)))
            return {TRANSLATIONS[k]: float(np.sign(vector[k]))}
    return {"dz": 1.0}
