"""Two machines with poses and every channel, on which the effects of the library are tried."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd

from errormodel.approach import direction
from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.channels import POINT_CHANNELS, columns
from errormodel.conventions import MOTIONS, ROTATIONS
from errormodel.effects import make, registry
from errormodel.effects.base import Effect, EffectTerm
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.exceptions import InputError
from errormodel.machine import Basis, EffectSpec, Joint, Machine, Shape, Vector

ROWS = 300
NOISE = 0.001  # mm
WORDS = sorted(registry())
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def _machine(name: str, elements: list[Shape | Joint], tool: Vector) -> Machine:
    linear = {m: Basis("polynomial", 1) for m in MOTIONS}
    free = (replace(e, motions=MOTIONS) if isinstance(e, Shape) else replace(e, models=linear) for e in elements)
    return Machine(name, tuple(free), tool)


GANTRY = _machine(
    "gantry",
    [
        Joint("X", "prismatic", X, (0.0, 2000.0)),
        Shape("T1", (0.0, 0.0, 1400.0)),
        Joint("Y", "prismatic", Y, (0.0, 1500.0)),
        Shape("T2", (180.0, 0.0, 0.0)),
        Joint("Z", "prismatic", Z, (-800.0, 0.0)),
        Shape("T3", (0.0, 0.0, -250.0)),
    ],
    (40.0, 25.0, -180.0),
)
FIVE_AXIS = _machine(
    "five-axis",
    [
        Joint("B", "rotary", Y, (0.0, 2 * math.pi)),
        Shape("T1"),
        Joint("X", "prismatic", X, (-500.0, 500.0)),
        Shape("T2"),
        Joint("Z", "prismatic", Z, (600.0, 1200.0)),
        Shape("T3"),
        Joint("Y", "prismatic", Y, (200.0, 1000.0)),
        Shape("T4"),
        Joint("W", "prismatic", Z, (-400.0, -100.0)),
        Shape("T5"),
    ],
    (0.0, 0.0, -250.0),
)
MACHINES = (GANTRY, FIVE_AXIS)


@cache
def table(name: str) -> pd.DataFrame:
    """Random poses with every channel that a survey may have."""
    machine = next(m for m in MACHINES if m.name == name)
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(35, 55, ROWS))
    given: dict[str, object] = {j.name: rng.uniform(*j.travel, ROWS) for j in machine.joints}
    long = np.where(rng.random(ROWS) < 0.5, 0.0, -90.0)
    given |= dict(zip(("tool_x", "tool_y", "tool_z"), machine.tool, strict=True))
    given |= {"tool_z": machine.tool[2] + long, "time": time}
    given |= {"run": np.repeat(["1", "2"], ROWS // 2), "file": "s.csv", "role": "fit", "row": np.arange(1, ROWS + 1)}
    for k, sensor in enumerate(("T_amb", "T_bed", "T_top", "T_drive", "T_spindle")):
        day = np.sin(2 * math.pi * time / rng.uniform(4e3, 1.5e4) + k)
        given[sensor] = 21 + k + rng.uniform(1, 3) * day + 3 * (1 - np.exp(-time / (1000 + 700 * k)))
    given |= {"feed": rng.choice([1500.0, 3000.0, 6000.0], ROWS), "load": rng.choice([0.0, 350.0], ROWS)}
    given |= {"w_sync": rng.normal(0, 0.02, ROWS), "w_level": rng.normal(0, 1, ROWS)}
    frame = pd.DataFrame(given, index=range(ROWS))
    for joint in machine.joints:
        frame[f"dir_{joint.name}"] = direction(frame, joint.name)
    return frame


@cache
def scene(name: str) -> Scene:
    frame = table(name)
    numbers = frame.select_dtypes("number")
    machine = next(m for m in MACHINES if m.name == name)
    return Scene(machine, {str(c): numbers[c].to_numpy(dtype=float) for c in numbers if not str(c).startswith("tool")})


def example(word: str) -> tuple[Machine, Effect]:
    """A machine of the battery that has what the effect's example names, with it, and the effect."""
    spec = EffectSpec(word, registry()[word].example)
    for machine in MACHINES:
        whole = replace(machine, effects=(spec,))
        try:
            Chain(whole)
        except InputError:
            continue
        return whole, make(spec)
    raise AssertionError(f"the example of {word} fits no machine of the battery")


class Channels(dict[str, Array]):
    """Channels of a table as a chain has them, made when first asked for."""

    def __init__(self, name: str, source: pd.DataFrame) -> None:
        chain = Chain(next(m for m in MACHINES if m.name == name))
        super().__init__(
            zip(POINT_CHANNELS, chain.kernel("nominal", outputs=(0, 1, 2))(chain.columns(source)), strict=True)
        )
        self._source = source

    def __missing__(self, name: str) -> Array:
        (self[name],) = columns(self._source, [name])
        return self[name]


@cache
def arrays(name: str) -> Channels:
    return Channels(name, table(name))


def numeric(effect: Effect, machine: Machine, channels: dict[str, Array]) -> list[tuple[EffectTerm, Array]]:
    """Each parameter with its motion over the rows, (6, n), in the order in which a chain has them."""
    out = []
    places = ("frame", *(e.name for e in machine.elements), "tool")
    rows = len(channels[machine.joints[0].name])
    for term in sorted(effect.terms(channels.__getitem__, machine), key=lambda t: places.index(t.element)):
        motion = np.zeros((6, rows))
        for name, value in term.motion.items():
            motion[MOTIONS.index(name)] = value
        out.append((term, motion))
    return out


def numeric_many(effect: Effect, machine: Machine, channels: Channels) -> list[Array]:
    """Each parameter's motion, (6, shapes, n), of an effect whose shape is an array."""
    rows = len(channels[machine.joints[0].name])
    terms = effect.terms(channels.__getitem__, machine)
    kind = np.result_type(*(value for t in terms for value in t.motion.values()))
    zero = np.zeros((len(getattr(effect, type(effect).shape)), rows), kind)
    return [np.array([t.motion.get(name, 0.0) + zero for name in MOTIONS]) for t in terms]


def own_ids(machine: Machine) -> tuple[str, ...]:
    """The parameters that the machine's effects bring."""
    without = set(Chain(replace(machine, effects=())).ids)
    return tuple(i for i in Chain(machine).ids if i not in without)


@cache
def base_errors(name: str) -> dict[str, float]:
    """Errors of the geometry of some um and urad."""
    chain = Chain(next(m for m in MACHINES if m.name == name))
    rng = np.random.default_rng(8)
    return {
        i: float(rng.normal(0, 5e-6 if chain.parameters[chain.index[i]].motion in ROTATIONS else 5e-3))
        for i in chain.machine_ids
    }
