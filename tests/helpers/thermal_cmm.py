"""A moving-bridge CMM in a room that warms and cools, of physics of its own: nothing of the tool's code is used here.

Members are lumped masses that follow the air around them and their neighbours; scales, legs and beams grow with their
own temperatures, and thermocouples see them late, with noise and steps. mm, rad, s, K above 20 degC. Sizes and noise
are those of "Synthesization of Thermally Induced Errors in Coordinate Measuring Machines", where it prints them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

MOTIONS = ("dx", "dy", "dz", "ea", "eb", "ec")
AXES = {"Y": 1, "X": 0, "Z": 2}  # in the order of the chain
TRAVEL = {"Y": (0.0, 400.0), "X": (0.0, 350.0), "Z": (-300.0, 0.0)}
GLUED = {"Y": 190.0, "X": 180.0, "Z": -140.0}  # near its middle each scale is held, and expands from there
OFFSETS = {"Y": (-60.0, 0.0, 560.0), "X": (0.0, -110.0, 0.0), "Z": (0.0, 0.0, -80.0)}  # behind each carriage
TIP = np.array([0.0, 0.0, -120.0])
ARCSEC = np.pi / 648000
SQUARENESS = {"Y": (0.0, 0.0, 10.31 * ARCSEC), "X": (-185.64 * ARCSEC, 20.63 * ARCSEC, 0.0)}  # at 20 degC, constant
DRIFT = {"Y": (0.0, 75.0, 200.0, 300.0), "X": (0.0, 90.0, 190.0, 290.0), "Z": (-290.0, -200.0, -100.0, 0.0)}
UNSEEN = {"Y": (40.0, 140.0, 250.0), "X": (45.0, 140.0, 240.0), "Z": (-245.0, -150.0, -50.0)}
HALF = 3 * 3600 + 600  # s: 3 h 10 min up, as much down
READ = 120.0  # s between readings
# one reading, mm and rad: 0.074 um is the mean of five (Table 4); straightness within 1.5 um is three sigma
NOISE = {"positioning": 0.074e-3 * 5**0.5, "straightness": 0.5e-3, "angle": 0.1 * ARCSEC}
ALUMINIUM, STEEL, SCALE, GRANITE = 23e-6, 11.5e-6, 17e-6, 6e-6  # 1/K; a steel tape on aluminium stretches with it

# members: side (-1 left, 1 right), height (m), time constants of the skin behind the air and of the core behind the
# skin (min), air of the bearings (K). The core is what expands; a thermocouple sits on the skin.
MEMBERS = {
    "granite-left": (-0.9, 0.2, 60, 150, 0.0), "granite-right": (0.9, 0.2, 55, 140, 0.0),
    "granite-low": (0.0, 0.0, 80, 190, 0.0), "scale-y0": (0.9, 0.3, 16, 14, 0.0), "scale-y1": (0.9, 0.3, 19, 16, 0.0),
    "scale-y2": (0.9, 0.3, 20, 17, 0.0), "scale-y3": (0.9, 0.3, 17, 15, 0.0), "leg-left": (-0.8, 0.6, 22, 26, -0.15),
    "leg-right": (0.8, 0.6, 19, 24, -0.2), "leg-back": (0.8, 0.6, 25, 33, 0.0), "beam-top": (0.0, 1.0, 17, 22, 0.0),
    "beam-bottom": (0.0, 0.9, 20, 25, -0.1), "beam-back": (0.0, 0.95, 24, 30, 0.0),
    "scale-x0": (-0.5, 0.95, 12, 10, 0.0), "scale-x1": (0.0, 0.95, 14, 11, 0.0), "scale-x2": (0.5, 0.95, 13, 10, 0.0),
    "ram-front": (0.1, 1.0, 12, 13, -0.1),
    "ram-back": (0.1, 1.05, 15, 15, -0.1), "scale-z0": (0.1, 0.8, 9, 9, 0.0), "scale-z1": (0.1, 1.2, 10, 10, 0.0),
}  # fmt: skip
COUPLED = {  # neighbours, time constant of conduction in min
    ("granite-left", "granite-low"): 120, ("granite-right", "granite-low"): 120,
    ("leg-left", "beam-bottom"): 90, ("leg-right", "beam-bottom"): 90, ("leg-right", "leg-back"): 70,
    ("beam-top", "beam-bottom"): 80, ("beam-back", "beam-bottom"): 80, ("ram-front", "ram-back"): 60,
    ("scale-y0", "granite-right"): 90, ("scale-y1", "granite-right"): 70, ("scale-y2", "granite-right"): 70,
    ("scale-y3", "granite-right"): 90, ("scale-x0", "beam-top"): 50, ("scale-x1", "beam-top"): 40,
    ("scale-x2", "beam-top"): 50, ("scale-z0", "ram-front"): 45, ("scale-z1", "ram-front"): 40,
}  # fmt: skip
# thermocouples: member (None: a disc of aluminium on wood, in the air), side and height where there is none
SENSORS: tuple[str | tuple[float, float], ...] = (
    "scale-y0", "scale-y3", "granite-left", "granite-right", "granite-low", "leg-left", "leg-right", "leg-back",
    "beam-top", "beam-bottom", "beam-back", "scale-x0", "scale-x2", "ram-front", "ram-back", "scale-z1",
    (-0.9, 1.2), (0.9, 1.2),
)  # fmt: skip
NAMES = tuple(f"T_{k}" for k in range(1, len(SENSORS) + 1))
STEP = 20.0  # s, of the integration


@dataclass(frozen=True)
class Cycle:
    """A day in the room: temperatures of all members (time, members) and what the thermocouples show (time, 18)."""

    time: Array
    members: dict[str, Array]
    shown: Array

    def at(self, time: Array) -> dict[str, Array]:
        """Temperatures of all members, K above 20 degC."""
        return {name: np.interp(time, self.time, values) for name, values in self.members.items()}

    def sensors(self, time: Array, rng: np.random.Generator) -> Array:
        """Readings, degC: noise of 0.03 K, steps of a 12-bit converter over 100 K."""
        seen = np.column_stack([np.interp(time, self.time, column) for column in self.shown.T])
        return 20 + np.round((seen + rng.normal(0, 0.03, seen.shape)) * 40.96) / 40.96


def cycle(seed: int, levels: tuple[float, ...] = (6.0, 0.0), half: float = HALF) -> Cycle:
    """A room that goes from 20 degC to one level after another (K above 20), `half` seconds for each."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, half * len(levels) + STEP, STEP)
    goal = np.array(levels)[np.minimum((time / half).astype(int), len(levels) - 1)] * rng.uniform(0.93, 1.07)
    wanted = _late(goal, rng.uniform(20, 32) * 60)  # the heating takes its time
    period, phase = rng.uniform(14, 24) * 60, rng.uniform(0, 6)
    heater = rng.uniform(0.1, 0.25) * np.sin(2 * np.pi * time / period + phase) * np.clip(wanted / 3, 0, 1)
    slow = CubicSpline(np.linspace(0, time[-1], 7), rng.normal(0, 0.12, (7, 3)))(time)
    warm = wanted / 6
    right = (rng.uniform(0.5, 1.0) + slow[:, 0]) * warm  # K/m, as the paper has it on the right
    left = (-rng.uniform(1.2, 2.4) + slow[:, 1]) * warm  # and on the left, where the cold air comes in
    share = np.array([(side + 1) / 2 for side, *_ in MEMBERS.values()])
    height = np.array([h for _, h, *_ in MEMBERS.values()])
    slope = left[:, None] * (1 - share) + right[:, None] * share
    air = (wanted + heater + slow[:, 2] * warm)[:, None] + slope * (height - 0.6)
    draught = np.array([b for *_, b in MEMBERS.values()])
    someone = rng.uniform(0.4, 1.0) * _late((np.sin(2 * np.pi * time / rng.uniform(5e3, 9e3)) > 0.4) * 1.0, 300)
    air = air + draught * warm[:, None] + 0.6 * someone[:, None] * (share > 0.85) * warm[:, None]
    skin, core = _conducted(air)
    shown = np.column_stack([_seen(s, skin, air, wanted + heater, left, right, k) for k, s in enumerate(SENSORS)])
    return Cycle(time, dict(zip(MEMBERS, core.T, strict=True)), shown)


def _late(values: Array, tau: float) -> Array:
    out, keep = np.zeros(len(values)), np.exp(-STEP / tau)
    for k in range(1, len(values)):
        out[k] = keep * out[k - 1] + (1 - keep) * values[k]
    return out


def _conducted(air: Array) -> tuple[Array, Array]:
    """Temperatures of skins and cores (time, members): air warms the skin, the skin its core, cores one another."""
    names = list(MEMBERS)
    n = len(names)
    outer, inner = (1 / (60 * np.array([m[k] for m in MEMBERS.values()])) for k in (2, 3))
    rate = np.zeros((2 * n, 2 * n))  # skins, then cores
    rate[range(n), range(n)] = outer + 0.5 * inner
    rate[range(n), range(n, 2 * n)] = -0.5 * inner
    rate[range(n, 2 * n), range(n, 2 * n)] = inner
    rate[range(n, 2 * n), range(n)] = -inner
    for (one, other), tau in COUPLED.items():
        i, j = names.index(one), names.index(other)
        heavy = (MEMBERS[one][3] / MEMBERS[other][3]) ** 0.5
        for a, b, k in ((n + i, n + j, 1 / heavy), (n + j, n + i, heavy)):
            rate[a, a] += k / (60 * tau)
            rate[a, b] -= k / (60 * tau)
    out = np.zeros((len(air), 2 * n))
    forward = np.linalg.inv(np.eye(2 * n) + STEP * rate)
    drive = np.hstack([outer * air, np.zeros_like(air)])
    for k in range(1, len(air)):
        out[k] = forward @ (out[k - 1] + STEP * drive[k])
    return out[:, :n], out[:, n:]


def _seen(
    sensor: str | tuple[float, float], skin: Array, air: Array, room: Array, left: Array, right: Array, number: int
) -> Array:
    """What a thermocouple shows: its member's skin, a fifth of it air, behind a lag of its own."""
    lag = 60.0 + 25.0 * (number % 5)
    if isinstance(sensor, str):
        k = list(MEMBERS).index(sensor)
        return _late(0.8 * skin[:, k] + 0.2 * air[:, k], lag)
    side, height = sensor
    share = (side + 1) / 2
    return _late(room + (left * (1 - share) + right * share) * (height - 0.6), 2 * lag)


def thermal_motions(joint: str, position: Array, theta: dict[str, Array]) -> Array:
    """What heat adds to the six error motions of a joint, (n, 6) in mm and rad."""
    out = np.zeros((len(position), 6))
    axis = AXES[joint]
    parts = np.column_stack([v for k, v in theta.items() if k.startswith(f"scale-{joint.lower()}")])
    out[:, axis] = SCALE * _grown(joint, position, parts)
    t = theta
    if joint == "Y":
        tilt = (t["leg-right"] - t["leg-left"]) / 900
        out[:, 0] = ALUMINIUM * 300 * 0.5 * (t["leg-right"] - t["leg-left"]) + GRANITE * 450 * 0.2 * t["granite-left"]
        out[:, 2] = ALUMINIUM * 560 * (t["leg-left"] + t["leg-right"]) / 2 - GRANITE * 150 * t["granite-low"]
        out[:, 3] = ALUMINIUM * 560 * (t["leg-back"] - t["leg-right"]) / 500
        out[:, 4] = -ALUMINIUM * 560 * tilt
        out[:, 5] = ALUMINIUM * 260 * tilt + GRANITE * 0.6 * (t["granite-right"] - t["granite-left"])
        bow = GRANITE * (t["granite-right"] - t["granite-left"]) / 600
        out[:, 0] += bow * position * (400 - position) / 2
    elif joint == "X":
        u = position - 175
        bow = ALUMINIUM * (t["beam-top"] - t["beam-bottom"]) / 180
        out[:, 1] = ALUMINIUM * 90 * (t["beam-back"] - t["beam-bottom"])
        out[:, 2] = ALUMINIUM * 60 * t["beam-bottom"] + bow * (175**2 - u**2) / 2
        out[:, 3] = ALUMINIUM * 150 * (t["beam-back"] - t["beam-top"]) / 160
        out[:, 4] = bow * u + 0.3 * ALUMINIUM * (t["beam-top"] - t["beam-bottom"])
        out[:, 5] = ALUMINIUM * 120 * (t["beam-back"] - t["beam-bottom"]) / 200
    else:
        out[:, 0] = ALUMINIUM * 40 * t["ram-front"] - ALUMINIUM * 30 * t["ram-back"]
        out[:, 1] = ALUMINIUM * 70 * t["ram-front"] - ALUMINIUM * 35 * t["beam-back"]
        out[:, 3] = ALUMINIUM * (t["ram-front"] - t["ram-back"]) * 1.2
        out[:, 4] = ALUMINIUM * (t["ram-back"] - t["beam-back"]) * 0.3
        out[:, 5] = ALUMINIUM * (t["ram-front"] - t["beam-top"]) * 0.2
    return out


def _grown(joint: str, position: Array, parts: Array) -> Array:
    """Integral of a scale's temperature from where it is held to a position, K mm; straight between its segments."""
    low, high = TRAVEL[joint]
    edge = np.linspace(low, high, 401)
    place = np.linspace(low, high, parts.shape[1])
    shape = np.array([np.interp(edge, place, row) for row in np.eye(parts.shape[1])])
    step = edge[1] - edge[0]
    sums = np.concatenate([np.zeros((len(shape), 1)), np.cumsum((shape[:, 1:] + shape[:, :-1]) / 2 * step, axis=1)], 1)
    weight = np.array([np.interp(position, edge, s) - np.interp(GLUED[joint], edge, s) for s in sums])
    return np.asarray(np.einsum("kn,nk->n", weight, parts))


def geometry(joint: str, position: Array) -> Array:
    """Error motions at 20 degC, (n, 6): X about 10.79 um at 275 mm, the bridge's yaw 7 arcsec at 350 mm."""
    low, high = TRAVEL[joint]
    u, axis = position / max(abs(low), abs(high)), AXES[joint]
    rng = np.random.default_rng(100 + axis)
    out = np.zeros((len(position), 6))
    for k in range(6):
        size = (6e-3 if k == axis else 1.5e-3) if k < 3 else 12e-6
        a, b, c, phase = rng.uniform(-1, 1, 4)
        out[:, k] = size * (a * u + 0.4 * b * u**2 + 0.2 * c * u**3)
        out[:, k] += 0.01 * size * (np.sin(9 * u + phase) - np.sin(phase))
    if joint == "X":
        out[:, 0] += 10.79e-3 * u / (275 / 350)
    if joint == "Y":
        out[:, 1] += 24e-3 * u  # with X a ring reads about 10 um too small, as in Table 1
        out[:, 5] += 7 * ARCSEC * u / (350 / 400)
    return out


def motions(joint: str, position: Array, theta: dict[str, Array]) -> Array:
    return geometry(joint, position) + thermal_motions(joint, position, theta)


def tip(command: Array, theta: dict[str, Array]) -> Array:
    """Where the probe's tip really is for commands x, y, z (n, 3): exact, bridge, carriage and ram in turn."""
    point = np.zeros((len(command), 3)) + TIP
    for joint in ("Z", "X", "Y"):
        axis = AXES[joint]
        point = point + np.array(OFFSETS[joint]) if joint == "Z" else _square(joint).apply(point) + OFFSETS[joint]
        own = motions(joint, command[:, axis], theta)
        point = Rotation.from_euler("XYZ", own[:, 3:]).apply(point) + own[:, :3]
        point[:, axis] += command[:, axis]
    return point


def _square(joint: str) -> Rotation:
    return Rotation.from_euler("XYZ", SQUARENESS[joint])


def nominal(command: Array) -> Array:
    return np.asarray(command + sum(np.array(o) for o in OFFSETS.values()) + TIP)


def _noise(joint: str, rng: np.random.Generator, n: int) -> Array:
    size = [NOISE["positioning"] if k == AXES[joint] else NOISE["straightness"] for k in range(3)]
    return np.asarray(rng.normal(0, 1, (n, 6)) * np.array([*size, *[NOISE["angle"]] * 3]))


def _rows(joint: str, position: Array, time: Array, day: Cycle, run: str, rng: np.random.Generator) -> pd.DataFrame:
    values = motions(joint, position, day.at(time)) + _noise(joint, rng, len(time))
    table = pd.DataFrame(values, columns=list(MOTIONS)).assign(joint=joint, run=run, time=time)
    table[joint] = position
    return table.join(pd.DataFrame(day.sensors(time, rng), columns=list(NAMES)))


def drift_recordings(seed: int) -> pd.DataFrame:
    """The paper's: one warm-up and cool-down for each of four positions an axis, every reading from its own zero."""
    rng = np.random.default_rng(seed)
    parts, start = [], 0.0
    for joint, places in DRIFT.items():
        for place in places:
            day = cycle(int(rng.integers(1 << 30)))
            time = np.arange(0, 2 * HALF, READ)
            part = _rows(joint, np.full(len(time), place), time, day, f"{joint}{place:.0f}", rng)
            zero = part[list(MOTIONS)].iloc[0]  # the instrument is set to zero as the recording starts
            part[list(MOTIONS)] -= zero
            parts.append(part.assign(time=time + start))
            start += 86400.0
    return pd.concat(parts, ignore_index=True)


def other_cycle(seed: int, levels: tuple[float, ...] = (3.5, 6.5, 2.0)) -> pd.DataFrame:
    """Another thermal cycle: each axis goes to and fro between three places where no drift was recorded."""
    rng = np.random.default_rng(seed + 10_000)
    parts, start = [], 0.0
    for joint, places in UNSEEN.items():
        day = cycle(int(rng.integers(1 << 30)), levels, 2.2 * 3600)
        time = np.arange(0, day.time[-1] - READ, READ)
        parts.append(
            _rows(joint, np.resize(places, len(time)), time, day, f"other {joint}", rng).assign(time=time + start)
        )
        start += 86400.0
    return pd.concat(parts, ignore_index=True)


def calibration(seed: int) -> pd.DataFrame:
    """At 20 degC: each axis five times along its travel, and 60 poses in the volume against a reference frame."""
    rng = np.random.default_rng(seed + 20_000)
    day = cycle(0, (0.0,), 4 * 3600)
    parts, start = [], 0.0
    for joint, (low, high) in TRAVEL.items():
        position = np.tile(np.linspace(low, high, 17), 5)
        part = _rows(joint, position, np.linspace(0, 3000, len(position)), day, f"20 {joint}", rng)
        parts.append(part.assign(time=part["time"] + start))
        start += 3600.0
    command = np.column_stack([rng.uniform(*TRAVEL[j], 60) for j in "XYZ"])
    time = np.linspace(0, 3000, 60)
    measured = tip(command, day.at(time)) + rng.normal(0, 0.5e-3, command.shape)
    whole = pd.DataFrame(np.hstack([command, measured]), columns=["X", "Y", "Z", "mx", "my", "mz"])
    whole = whole.assign(joint="", run="20 volume", time=time + start)
    parts.append(whole.join(pd.DataFrame(day.sensors(time, rng), columns=list(NAMES))))
    return pd.concat(parts, ignore_index=True)


RING = 180.0124  # mm at 20 degC, as the paper prints it
PLACES = np.array(  # of the ring's centre in the axes of the tip, mm: four low and four high
    [[x, y, z] for z in (-285.0, -60.0) for x, y in ((100.0, 100.0), (240.0, 100.0), (100.0, 210.0), (240.0, 210.0))]
)


def ring(seed: int, level: float, places: Array = PLACES) -> pd.DataFrame:
    """Readings at 11 random points of a steel ring at each place, at 20 + `level` degC after 3 h: a day for each place.

    ``place`` is 0 in the log of temperatures that leads there. The ring has a thermocouple of its own, ``ring``, degC.
    """
    rng = np.random.default_rng(seed + 30_000)
    parts = []
    for number, centre in enumerate(places):
        day = cycle(int(rng.integers(1 << 30)), (level,), HALF)
        time = HALF - 600 + 15.0 * np.arange(11)
        warm = np.interp(time, day.time, _late(day.shown[:, -2], 2400.0))  # the ring follows the air in 40 minutes
        turn = rng.uniform(0, 2 * np.pi) + 2 * np.pi * (np.arange(11) + rng.uniform(-0.3, 0.3, 11)) / 11
        round_ = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(11)])
        wanted = centre + (RING * (1 + STEEL * warm) / 2)[:, None] * round_
        command = wanted
        for _ in range(4):  # the machine moves until its tip touches
            command = command - (tip(command, day.at(time)) - nominal(wanted))
        command = command + rng.normal(0, 0.3e-3, command.shape)
        log = np.arange(0, time[0], READ)
        whole, where = np.concatenate([log, time]), np.vstack([np.tile(centre, (len(log), 1)), command])
        part = pd.DataFrame(where, columns=["X", "Y", "Z"]).assign(place=0, time=whole + 86400.0 * number, ring=np.nan)
        part.loc[len(log) :, "place"] = number + 1
        part.loc[len(log) :, "ring"] = 20 + warm + rng.normal(0, 0.03, 11)
        parts.append(part.join(pd.DataFrame(day.sensors(whole, rng), columns=list(NAMES))))
    return pd.concat(parts, ignore_index=True)


def diameter(points: Array) -> float:
    """Of the least-squares circle through points (n, 3) of a plane z = constant, mm."""
    design = np.column_stack([2 * points[:, :2], np.ones(len(points))])
    x, y, rest = np.linalg.lstsq(design, np.square(points[:, :2]).sum(axis=1), rcond=None)[0]
    return float(2 * np.sqrt(rest + x**2 + y**2))
