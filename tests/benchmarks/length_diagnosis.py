"""Diagnosis of surveys of lengths by a simulation that shares no code with the product: false alarms, and names.

Twenty empty surveys and twenty with one hidden effect: four and three stations, ballbar circles, a tracker's points
with one interferometer. ``python -m tests.benchmarks.length_diagnosis`` prints the table (some minutes).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd

from errormodel.machine import Machine
from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from identification.diagnosis.pipeline import diagnose
from tests.benchmarks.length_coverage import STATIONS
from tests.helpers.circles import as_survey, circles
from tests.helpers.lengths import commands, entry, survey, tips, truth

MACHINE = read_machine("vertical_three_axis")
NOISE = 5e-4  # mm, of a length
POINTS = 5e-3  # mm, of a tracker's coordinate
POSES = 160
PACE = 30.0  # s a pose


class Hidden(NamedTuple):
    """One effect of one joint: its name, and the position where the joint truly is (mm), from a table of commands."""

    name: str
    joint: str
    actual: Callable[[pd.DataFrame], np.ndarray]


def hidden(rng: np.random.Generator, kinds: tuple[str, ...]) -> Hidden:
    """A random effect among `kinds`, of a size that machines have."""
    joint, name = str(rng.choice(["X", "Y", "Z"])), str(rng.choice(kinds))
    size, phase = float(rng.uniform(0.6, 1.6)), float(rng.uniform(0, 2 * np.pi))
    forms: dict[str, Callable[[pd.DataFrame], np.ndarray]] = {
        "backlash": lambda t: -0.004 * size * t[f"dir_{joint}"].to_numpy(),
        "pitch-cyclic": lambda t: 0.004 * size * np.sin(2 * np.pi * t[joint].to_numpy() / 20 + phase),
        "scale-expansion": lambda t: 11e-6 * size * (t["T_bed"].to_numpy() - 20) * t[joint].to_numpy(),
    }
    return Hidden(name, joint, lambda t: t[joint].to_numpy() + forms[name](t))


def poses(machine: Machine, rng: np.random.Generator) -> pd.DataFrame:
    """Random commands in order, with the side of arrival, time and the temperature of a bed that warms up."""
    at = commands(machine, POSES, rng)
    for j in machine.joints:
        step = np.sign(np.diff(at[j.name].to_numpy()))
        at[f"dir_{j.name}"] = np.concatenate([step[:1], step])
    at["time"] = PACE * np.arange(POSES)
    at["T_bed"] = 20 + 5 * (1 - np.exp(-at["time"] / 2000)) + 0.6 * np.sin(at["time"] / 500)
    return at


def truly(at: pd.DataFrame, effect: Hidden | None) -> pd.DataFrame:
    """Where the joints are, at commands."""
    return at if effect is None else at.assign(**{effect.joint: effect.actual(at)})


def stations(rng: np.random.Generator, effect: Hidden | None, count: int) -> Survey:
    """Lengths of all poses from several unknown places at a time."""
    at, values = poses(MACHINE, rng), truth(MACHINE, rng)
    actual = tips(MACHINE, values, truly(at, effect))
    labels = [*STATIONS][:count]
    parts = [
        at.assign(observation=k, length=np.linalg.norm(actual - STATIONS[k], axis=1) + rng.normal(0, NOISE, POSES))
        for k in labels
    ]
    table = pd.concat(parts).sort_index(kind="stable").reset_index(drop=True)
    return survey(MACHINE, table, {k: entry(type="station-distance") for k in labels})


def ballbar(rng: np.random.Generator, effect: Hidden | None) -> Survey:
    """Circles in three planes, both ways."""
    play: Mapping[str, float] = {}
    if effect is not None:  # circles show what repeats at reversals: the size is that of the form at a side
        one = pd.DataFrame({effect.joint: [0.0], f"dir_{effect.joint}": [1.0]})
        play = {effect.joint: -2 * float(effect.actual(one)[0])}
    return as_survey(MACHINE, circles(MACHINE, truth(MACHINE, rng), rng, play))


def mixed(rng: np.random.Generator, effect: Hidden | None) -> Survey:
    """A tracker's coarse points, and one interferometer at the same poses."""
    at, values = poses(MACHINE, rng), truth(MACHINE, rng)
    actual = tips(MACHINE, values, truly(at, effect))
    seen = actual + rng.normal(0, POINTS, actual.shape)
    length = np.linalg.norm(actual - STATIONS["A"], axis=1) + rng.normal(0, NOISE, POSES)
    points = at.assign(**dict(zip(("mx", "my", "mz"), seen.T, strict=True)))
    table = pd.concat([points, at.assign(observation="A", length=length)]).sort_index(kind="stable")
    return survey(MACHINE, table.reset_index(drop=True), {"A": entry(type="station-distance")})


ALL = ("backlash", "pitch-cyclic", "scale-expansion")
KINDS: dict[str, tuple[Callable[[np.random.Generator, Hidden | None], Survey], tuple[str, ...]]] = {
    "four stations": (lambda r, e: stations(r, e, 4), ALL),
    "three stations": (lambda r, e: stations(r, e, 3), ALL),
    "ballbar circles": (ballbar, ("backlash",)),
    "tracker and interferometer": (mixed, ALL),
}


def run(kind: str, seed: int, empty: bool) -> tuple[str, str, float]:
    """What was hidden, what was found, and the probability of its name."""
    make, kinds = KINDS[kind]
    rng = np.random.default_rng([seed, empty, [*KINDS].index(kind)])
    effect = None if empty else hidden(rng, kinds)
    found = diagnose(MACHINE, make(rng, effect)).diagnosis
    names = ", ".join(f"{f.effect} at {f.where}" for f in found.findings) or found.verdict
    sure = found.findings[0].probability if found.findings else float("nan")
    return "nothing" if effect is None else f"{effect.name} at {effect.joint}", names, sure


def main(each: int = 5) -> None:
    right: dict[tuple[str, bool], list[bool]] = {}
    for empty in (True, False):
        for kind in KINDS:
            for seed in range(each):
                true, names, sure = run(kind, seed, empty)
                good = names == ("adequate" if empty else true)
                right.setdefault((kind, empty), []).append(good)
                mark = "" if good else "   <-- another"
                print(f"{kind:28}{true:26}{names:40}{sure:6.2f}{mark}", flush=True)
    print(f"\n{'':28}{'empty: nothing found':>22}{'hidden: named':>16}")
    for kind in KINDS:
        cells = [f"{sum(right[kind, e])} of {len(right[kind, e])}" for e in (True, False)]
        print(f"{kind:28}{cells[0]:>22}{cells[1]:>16}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
