"""Machines and surveys of which nothing can be computed: a sentence, never a traceback or a warning of a library."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.helpers.commands import XYZ, Done, done, run, write

PLAIN = """\
errormodel: 1
chain:
  - {joint: X, type: prismatic, axis: x, travel: [0, 500]}
  - {joint: Y, type: prismatic, axis: y, travel: [0, 400]}
  - {joint: Z, type: prismatic, axis: z, travel: [-300, 0]}
tool: [0, 0, -50]
errors: {shapes: none, joints: MODEL}
"""
NONE = PLAIN.replace("MODEL", "none")


def recorded(
    folder: Path, machine: str, frame: str, rows: int = 40, *, alike: bool = False, noise: float = 0.0
) -> Done:
    """A fit of random poses, or of one pose so often; its files lie in the folder."""
    rng = np.random.default_rng(1)
    table = pd.DataFrame(rng.uniform([0, 0, -300], [500, 400, 0], (rows, 3)).round(3), columns=list("XYZ"))
    if alike:
        table.loc[:] = table.iloc[0].to_numpy()
    table[XYZ] = (table.to_numpy() + np.array([0.0, 0.0, -50.0]) + rng.normal(0, noise, (rows, 3))).round(5)
    table.to_csv(folder / "s.csv", index=False)
    write(folder / "m.yaml", machine)
    write(folder / "s.yaml", f"errormodel: 1\nfiles: [{{path: s.csv}}]\nframe: {frame}\n")
    return run("fit", folder / "m.yaml", folder / "s.yaml", "--out", folder / "fit")


@pytest.mark.parametrize("alike", [False, True])
def test_a_fixed_frame_without_errors_leaves_nothing_to_fit(tmp_path: Path, alike: bool) -> None:
    found = recorded(tmp_path, NONE, "fixed", alike=alike, noise=0.002)
    assert found.code == 2
    assert "declares no errors and the measuring frame is fixed" in found.err
    assert "unit" not in found.err  # what was measured lies where it should


def test_a_diagnosis_without_parameters_is_read_again(tmp_path: Path) -> None:
    recorded(tmp_path, NONE, "fixed", alike=True, noise=0.002)
    done("diagnose", tmp_path / "m.yaml", tmp_path / "s.yaml", "--out", tmp_path / "d")
    done("predict", tmp_path / "d", tmp_path / "s.csv", "--out", tmp_path / "p.csv")
    assert (pd.read_csv(tmp_path / "p.csv")[["ux", "uy", "uz"]] == 0).all(axis=None)  # nothing is uncertain


@pytest.mark.parametrize("frame", ["fixed", "shared"])
@pytest.mark.filterwarnings("error")
def test_readings_that_fit_exactly_hold_no_effect(tmp_path: Path, frame: str) -> None:
    recorded(tmp_path, NONE, frame, alike=True)
    found = done("diagnose", tmp_path / "m.yaml", tmp_path / "s.yaml", "--out", tmp_path / "d")
    assert "verdict: adequate" in found.out


def test_nothing_is_corrected_where_no_joint_moved(tmp_path: Path) -> None:
    assert recorded(tmp_path, NONE, "shared", alike=True, noise=0.002).code == 0
    found = run("compensate", tmp_path / "fit", "--controller", "csv", "--out", tmp_path / "t")
    assert found.code == 2
    assert "no joint moved" in found.err
    assert not (tmp_path / "t").exists()


def test_error_motions_alone_are_predicted_at_points(tmp_path: Path) -> None:
    """A machine without parameters, of which one joint's error motions were read: no error, and no traceback."""
    write(tmp_path / "m.yaml", NONE)
    table = pd.DataFrame(
        {"joint": "X", "X": np.linspace(0, 400, 30), "dx": np.random.default_rng(1).normal(0, 2e-3, 30)}
    )
    table.to_csv(tmp_path / "s.csv", index=False)
    done("fit", tmp_path / "m.yaml", tmp_path / "s.csv", "--out", tmp_path / "fit")
    write(tmp_path / "p.csv", "X,Y,Z\n10,20,-30\n")
    done("predict", tmp_path / "fit", tmp_path / "p.csv", "--out", tmp_path / "o.csv")
    assert pd.read_csv(tmp_path / "o.csv")[["ex", "ey", "ez"]].abs().to_numpy().max() == 0.0


@pytest.mark.parametrize("shift", [0.0, 0.4])
def test_an_offset_in_a_fixed_frame_is_named(tmp_path: Path, shift: float) -> None:
    """Scales and angular rates take a part of a constant, in values that no machine has."""
    recorded(tmp_path, PLAIN.replace("MODEL", "first-order"), "fixed", noise=0.002)
    table = pd.read_csv(tmp_path / "s.csv")
    table["my"] += shift
    table.to_csv(tmp_path / "s.csv", index=False)
    said = done("fit", tmp_path / "m.yaml", tmp_path / "s.yaml", "--out", tmp_path / "fit").err
    assert (", 0.400, " in said and "offset alone leaves" in said) == bool(shift)
