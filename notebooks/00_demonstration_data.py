# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # How the demonstration's survey was made
#
# `machines/examples/five_axis_table_quill/` holds a survey that nobody measured. It is simulated from the machine of
# the library with the errors in `truth.yaml`, in exact (finite) kinematics. A laser tracker stands on the table: its
# frame is turned and moved, and its noise grows with the range. Because the truth is known, a fit can be judged.
#
# As a script, this notebook makes both files again and compares them with the committed ones, byte for byte. With
# `--write` it writes them there.

# %%
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
from ruamel.yaml import YAML

from errormodel import library, read_machine, read_survey, simulate

FOLDER = library()["five_axis_table_quill"].parent / "examples" / "five_axis_table_quill"
machine = read_machine("five_axis_table_quill")
frame = YAML(typ="safe").load(FOLDER / "truth.yaml")["frame"]  # translation in mm, rotation in degrees
tracker = read_survey(FOLDER / "survey.yaml", machine).instrument
joints = [joint.name for joint in machine.joints]
tracker

# %% [markdown]
# ## Poses
#
# Random poses over the travels, in whole millimetres and degrees as an NC program would have them. The target stays
# 400 mm away from the tracker's vertical axis and below 60 degrees of elevation.

# %%
SPEED = {"B": 15.0, "X": 200.0, "Z": 200.0, "Y": 150.0, "W": 80.0}  # deg/s, mm/s
PAUSE = 6.0  # s, to settle and to measure


def in_sight(points: pd.DataFrame) -> np.ndarray:
    seen = simulate(machine, points, **frame)
    across = np.hypot(seen["mx"], seen["my"])
    return ((across > 400.0) & (seen["mz"] < across * np.tan(np.radians(60.0)))).to_numpy()


def run(name: str, count: int, length: float, start: float, seed: int) -> pd.DataFrame:
    """Commands of one run in mm and degrees: a tool of this length (mm), beginning at this time (s)."""
    points = simulate(machine, 3 * count, seed=seed).drop(columns=["mx", "my", "mz"])
    points = points.round(dict.fromkeys(joints, 0)).assign(tool_z=-length)
    points = points[in_sight(points)].head(count).reset_index(drop=True)
    travel = points[joints].diff().abs() / pd.Series(SPEED)
    points.insert(0, "run", name)
    points.insert(1, "time", start + (travel.max(axis=1).fillna(0.0) + PAUSE).cumsum())
    return points


# %% [markdown]
# Two tools to identify with; a third one with other poses to check. Between the runs the target is remounted.

# %%
short = run("short", 102, 312.035, start=0.0, seed=11)
long = run("long", 102, 435.185, start=short["time"].iloc[-1] + 780.0, seed=12)
check = run("check", 60, 374.210, start=long["time"].iloc[-1] + 660.0, seed=13)
campaign = {"identification.csv": pd.concat([short, long], ignore_index=True), "check.csv": check}
{name: len(points) for name, points in campaign.items()}


# %% [markdown]
# ## What the tracker reads
#
# To 0.1 µm, as an instrument's export has it.


# %%
def make(folder: Path) -> None:
    for seed, (name, points) in enumerate(campaign.items(), start=10):
        seen = simulate(machine, points, FOLDER / "truth.yaml", noise=tracker, seed=seed)[["mx", "my", "mz"]]
        table = points.join(seen.round(4)).round({"time": 1, **dict.fromkeys(joints, 6)})
        table.to_csv(folder / name, index=False, lineterminator="\n")


if "--write" in sys.argv:
    make(FOLDER)
with tempfile.TemporaryDirectory() as temporary:
    make(Path(temporary))
    for name in campaign:
        same = (Path(temporary) / name).read_bytes() == (FOLDER / name).read_bytes()
        assert same, f"{name} is not what the committed file holds; --write replaces it"
print("the same as the committed files, byte for byte")
