"""Surveys of points and readings of each kind, of a mill with random errors."""

from __future__ import annotations

import numpy as np
import pandas as pd

from errormodel.chain import Chain
from errormodel.machine_file import read_machine
from errormodel.simulation_readings import readings_at
from errormodel.survey import Survey
from errormodel.truth import Truth
from tests.helpers.lengths import commands, entry, survey, truth

MACHINE = read_machine("vertical_three_axis")
CHAIN = Chain(MACHINE)
JOINTS = [j.name for j in MACHINE.joints]
NOISE = {"length": 5e-4, "angle": 5e-7}  # mm, rad
POINTS = 3e-3  # mm, of a coordinate
KINDS: dict[str, tuple[dict[str, object], dict[str, float]]] = {
    "pose-distance": ({}, {}),
    "station-distance": ({"near": [900.0, -700.0, -200.0]}, {"x": 900.0, "y": -700.0, "z": -200.0}),
    "line-angle": ({"axis": [0.0, 1.0, 0.0]}, {"zero": 1e-5}),
    "precision-level": ({"axis": [1.0, 0.0, 0.0]}, {"zero": 1e-5}),
    "ballbar-circle": ({"calibrated": 150.0}, {}),
    "touched-plane": ({"normal": [0.0, 0.0, 1.0]}, {"tilt_1": 1e-4, "tilt_2": -1e-4, "zero": 0.0}),
}


def at(word: str, rng: np.random.Generator) -> pd.DataFrame:
    """Commands of an observation: all over the travels, or bound to a circle or a plane."""
    table = commands(MACHINE, 90, rng)
    middle = {j.name: sum(j.travel) / 2 for j in MACHINE.joints}
    if word == "pose-distance":
        table = table.join(commands(MACHINE, 90, rng).add_prefix("from_"))
    elif word == "ballbar-circle":
        angle = np.linspace(0, 2 * np.pi, 90)
        table = table.assign(**middle).assign(X=middle["X"] + 150 * np.cos(angle), Y=middle["Y"] + 150 * np.sin(angle))
    elif word == "touched-plane":
        table["Z"] = middle["Z"]
    return table


def mixed(
    words: dict[str, str], turned: str = "", hidden: float = 0.0, seed: int = 1, points: int = 150, **keys: object
) -> Survey:
    """Points of a machine with random errors, and observations by label; those of `turned` have the opposite sign.

    `hidden` (mm) is the amplitude of a cyclic error of X that the machine's file lacks.
    """
    rng = np.random.default_rng(seed)
    values = truth(MACHINE, rng)
    parts, entries = [], {}
    for label, word in {"": "", **words}.items():
        table = at(word, rng) if word else commands(MACHINE, points, rng)
        table = table.assign(observation=label, run="1")
        table = table.assign(**{f"tool_{a}": v for a, v in zip("xyz", MACHINE.tool, strict=True)})
        true = table.assign(X=table["X"] + hidden * np.sin(2 * np.pi * table["X"] / 37))
        if not word:  # targets of two lengths show rotations
            table["tool_z"] = true["tool_z"] = table["tool_z"] - 200.0 * (np.arange(points) % 2)
            rows = CHAIN.columns(true)
            place = CHAIN.kernel("actual", outputs=(0, 1, 2))(rows, CHAIN.vector(values)).T
            place += rng.normal(0, POINTS, place.shape)
            parts.append(table.assign(**dict(zip(("mx", "my", "mz"), place.T, strict=True))))
            continue
        options, set_up = KINDS[word]
        nominal = CHAIN.kernel("nominal", outputs=(0, 1, 2))(CHAIN.columns(table))
        if word == "ballbar-circle":
            middle = (nominal.max(axis=1) + nominal.min(axis=1)) / 2
            set_up = dict(zip("xyz", (middle + rng.normal(0, 0.02, 3)).tolist(), strict=True))
        if word == "touched-plane":
            set_up = {**set_up, "zero": float(nominal[2].mean())}
        model = entries[label] = entry(type=word, **options, **keys)
        read, right = (
            readings_at(CHAIN, t, {label: model}, Truth(v, set_ups={label: set_up}))[model.reading]
            for t, v in ((true, values), (table, {}))
        )
        read = read + rng.normal(0, NOISE[model.reading], len(read))
        parts.append(table.assign(**{model.reading: 2 * right - read if label in turned else read}))
    return survey(MACHINE, pd.concat(parts if points else parts[1:], ignore_index=True), entries)
