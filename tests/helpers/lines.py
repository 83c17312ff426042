"""A survey along lines: a laser's lengths along the axes and face diagonals of a gantry, and straightness; in runs."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import pandas as pd

from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from tests.helpers.lengths import entry, survey, tips, truth

GANTRY = read_machine(
    {
        "errormodel": 1,
        "name": "Gantry",
        "units": {"length": "mm", "angle": "deg"},
        "chain": [
            {"joint": "Y", "type": "prismatic", "axis": "y", "travel": [0, 3000]},
            {"shape": "bridge", "offset": [0, 0, 1200]},
            {"joint": "X", "type": "prismatic", "axis": "x", "travel": [-1100, 1100]},
            {"shape": "carriage", "offset": [0, 0, -100]},
            {"joint": "Z", "type": "prismatic", "axis": "z", "travel": [-600, 0]},
            {"shape": "ram", "offset": [0, 0, -200]},
        ],
        "tool": [0, 0, -150],
        "errors": {"shapes": "all", "joints": {"Y": {"polynomial": 2}, "X": {"polynomial": 2}, "Z": "first-order"}},
    }
)
RUNS = 2
GROWTH = 2e-5  # of the scale of Y from run to run, which the model lacks: far beyond the declared uncertainties
# Line: first and last command (Y, X, Z), number of positions; the station of a length stands on its line
LINES = {
    "LX": ((1500, -1000, -300), (1500, 1000, -300), 11),
    "LY": ((100, 0, -300), (2900, 0, -300), 15),
    "LYo": ((100, 900, -300), (2900, 900, -300), 15),
    "LZ": ((1500, 0, -550), (1500, 0, -50), 6),
    "D1": ((200, -900, -550), (2800, 900, -50), 9),
    "D2": ((200, 900, -550), (2800, -900, -50), 9),
    "D3": ((200, -900, -50), (2800, 900, -550), 9),
    "D4": ((200, 900, -50), (2800, -900, -550), 9),
}
ACROSS = {"SXy": ("LX", 1), "SXz": ("LX", 2), "SYx": ("LY", 0), "SYz": ("LY", 2)}  # along the line, across axis
ERRORS = truth(GANTRY, np.random.default_rng(1))


def along_lines(station: Literal["known", "per-run"], beside: float = 0.0) -> Survey:
    """The survey; each run and line has a set-up of its own, and a station is known, or roughly (``near``).

    `beside`: how roughly, mm.
    """
    rng, rough, zero = np.random.default_rng(2), np.random.default_rng(3), dict.fromkeys(ERRORS, 0.0)
    parts, entries = [], {}
    for run in range(RUNS):
        errors = ERRORS | {"Y.dy.1": ERRORS["Y.dy.1"] + 3000 * GROWTH * run}
        for name, (first, last, n) in LINES.items():
            there = pd.DataFrame(np.linspace(first, last, n), columns=["Y", "X", "Z"])
            at = pd.concat([there, there[::-1]], ignore_index=True) if name.startswith("L") else there
            nominal, actual = tips(GANTRY, zero, at), tips(GANTRY, errors, at)
            way = nominal[n - 1] - nominal[0]
            stands = nominal[0] - 600 * way / np.linalg.norm(way)
            place: dict[str, Any] = {"station": stands.tolist()}
            if station == "per-run":
                place = {"near": (stands + rough.normal(0, beside, 3)).tolist(), "station": station}
            entries[name] = entry(type="station-distance", dead_path="per-run", sigma=[4e-4, 3e-7], **place)
            length = np.linalg.norm(actual - stands, axis=1)
            length += rng.normal(0, np.hypot(4e-4, 3e-7 * length)) - length[0]
            parts.append(at.assign(observation=name, run=f"{name}{run}", length=length))
        for name, (line, axis) in ACROSS.items():
            first, last, n = LINES[line]
            at = pd.DataFrame(np.linspace(first, last, n), columns=["Y", "X", "Z"])
            off, along = tips(GANTRY, errors, at)[:, axis], np.linspace(-1, 1, n)
            read = off - off[0] + rng.normal(0, 0.05) * (1 + along) + rng.normal(0, 8e-4, n)
            parts.append(at.assign(observation=name, run=f"{name}{run}", length=read))
            ways = {"along": np.eye(3)[0 if line == "LX" else 1].tolist(), "across": np.eye(3)[axis].tolist()}
            entries[name] = entry(type="line-straightness", slope="per-run", sigma=[8e-4, 0.0], **ways)
    return survey(GANTRY, pd.concat(parts, ignore_index=True), entries, "fixed" if station == "known" else "shared")
