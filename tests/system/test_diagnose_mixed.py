"""Diagnosis of positions beside rows about one joint's error motions, which do not say where the others stood."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd

from tests.helpers.commands import MILL, XYZ, done, write

EFFECTS = "[{effect: backlash, joint: X}]"


def test_a_joint_without_a_position_in_rows_about_another_still_moved(tmp_path: Path) -> None:
    """As a file with an interferometer's line has it: the cells of all other joints are empty."""
    text = (Path(__file__).resolve().parents[2] / "machines" / f"{MILL}.yaml").read_text(encoding="utf-8")
    machine = write(tmp_path / "machine.yaml", f"{text}\neffects: {EFFECTS}\n")
    done("simulate", MILL, 150, "--out", tmp_path / "p.csv")
    truth = write(tmp_path / "truth.yaml", "parameters: {X.dx.backlash: 0.02}\n")
    done("simulate", machine, tmp_path / "p.csv", "--parameters", truth, "--noise", 0.002, "--out", tmp_path / "s.csv")
    points = pd.read_csv(tmp_path / "s.csv")
    noise = np.random.default_rng(1).normal(0.0, 5e-4, 19)
    line = pd.DataFrame({"run": "laser", "joint": "Z", "Z": np.linspace(20.0, 380.0, 19), "dz": noise})
    pd.concat([points, line], ignore_index=True).to_csv(tmp_path / "mixed.csv", index=False)
    assert points[["X", "Y", *XYZ]].notna().all().all()
    done("diagnose", MILL, tmp_path / "mixed.csv", "--out", tmp_path / "d")
    diagnosis = json.loads((tmp_path / "d/diagnosis.json").read_text())
    assert [(f["effect"], f["where"]) for f in diagnosis["findings"]] == [("backlash", "X")]
    assert diagnosis["verdict"] == "explained"
