"""A real arm's calibration as a file of its maker, tried on the recording with matrices that are written out here."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from tests.helpers.commands import done

EVERY = 5  # rows of 11 911: enough for a figure to a percent


def turn(axis: int, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    i, k = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(3)
    out[i, i] = out[k, k] = c
    out[i, k], out[k, i] = -s, s
    return out


def points(members: dict[str, dict[str, float]], tip: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Positions (n, 3), mm, of a tool centre point by a calibration.yaml, as a URDF reads its angles."""
    out = []
    for row in q:
        place, turned = np.zeros(3), np.eye(3)
        for own, angle in zip(members.values(), row, strict=True):
            place = place + turned @ [1e3 * own[k] for k in "xyz"]
            turned = turned @ turn(2, own["yaw"]) @ turn(1, own["pitch"]) @ turn(0, own["roll"]) @ turn(2, angle)
        out.append(place + turned @ tip)
    return np.array(out)


def left_um(found: np.ndarray, measured: np.ndarray) -> float:
    """Root mean square distance after the best rigid motion (Kabsch), um."""
    a, b = found - found.mean(axis=0), measured - measured.mean(axis=0)
    u, _, v = np.linalg.svd(a.T @ b)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))])
    return float(1e3 * np.sqrt(np.mean(np.sum((a @ (u @ flip @ v) - b) ** 2, axis=1))))


@pytest.mark.long
def test_the_calibration_of_a_real_arm_moves_it_where_it_was_measured(ur10: Path, tmp_path: Path) -> None:
    """Of the nominal arm 0.85 mm are left, of the calibrated one 0.44: what the fit leaves, by another kinematics."""
    table = pd.read_csv(ur10 / "series_a.csv").iloc[::EVERY]
    table.to_csv(tmp_path / "s.csv", index=False)
    done("fit", ur10 / "machine.yaml", tmp_path / "s.csv", "--out", tmp_path / "fit", "--quiet")
    q = np.radians(table[[f"J{k}" for k in range(1, 7)]].to_numpy())
    measured = table[["mx", "my", "mz"]].to_numpy()
    left = {}
    for name, source in (("nominal", ur10 / "machine.yaml"), ("calibrated", tmp_path / "fit")):
        path = tmp_path / f"{name}.yaml"
        result = done("export", source, "--format", "ur-calibration", "--out", path)
        tcp = re.search(r"p\[(.*?)\]", result.err)
        assert tcp
        members = yaml.safe_load(path.read_text())["kinematics"]
        members.pop("hash")
        tip = 1e3 * np.array([float(v) for v in tcp[1].split(",")[:3]])
        left[name] = left_um(points(members, tip, q), measured)
    fitted = pd.read_json(tmp_path / "fit/fit.json", typ="series")
    assert abs(left["nominal"] - fitted["nominal"]["rms_um"]) < 1.0  # um; the same points, aligned by another method
    assert abs(left["calibrated"] - fitted["fitted"]["rms_um"]) < 5.0  # its frame and target are fitted together here
    assert left["calibrated"] < 0.55 * left["nominal"]
