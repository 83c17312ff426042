"""R-tests of two rotary axes: points that hardly spread determine no rotation, and all commands say so."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from identification.command_line.main import main
from identification.diagnosis.search.instrument_noise import seen_in
from tests.helpers.chains import Array
from tests.helpers.commands import XYZ, run

MILL = """
errormodel: 1
name: A and C under the workpiece
units: {length: mm, angle: deg}
chain:
  - {joint: C, type: rotary, axis: z, travel: [0, 360]}
  - {shape: table, offset: [0, 0, 50]}
  - {joint: A, type: rotary, axis: x, travel: [-110, 30]}
  - {shape: cradle}
  - {joint: Y, type: prismatic, axis: y, travel: [-280, 280]}
  - {joint: X, type: prismatic, axis: x, travel: [-300, 300]}
  - {joint: Z, type: prismatic, axis: z, travel: [-600, 600]}
tool: [0, 0, 0]
errors: {shapes: {table: all, cradle: all}, joints: none}
"""
TRUTH = {  # mm and rad, of the groups that positions of one ball identify
    "table.dx": 5e-3, "table.dy": -8e-3, "cradle.dy": 15e-3, "cradle.dz": -4e-3,
    "table.eb": 40e-6, "cradle.eb": -25e-6, "cradle.ec": 60e-6,
}  # fmt: skip


def shifted(shift: tuple[float, float, float], angles: tuple[float, float, float] = (0, 0, 0)) -> Array:
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("XYZ", angles).as_matrix()
    out[:3, 3] = shift
    return out


def turned(axis: tuple[int, int, int], angle: float) -> Array:
    out = np.eye(4)
    out[:3, :3] = Rotation.from_rotvec(np.array(axis) * angle).as_matrix()
    return out


def r_test(
    balls: list[tuple[float, float, float]], seed: int = 0, frame: Array | None = None, rows: int = 48
) -> pd.DataFrame:
    """A ball on the table, followed by the tool at many A and C, X Y Z rounded to a micrometre; noise of a micrometre.

    Measured is the tool relative to the table, by this file's own kinematics.
    """
    rng, out = np.random.default_rng(seed), []
    for k in range(rows):
        ball = (*balls[k % len(balls)], 1.0)
        c, a = np.radians(np.round(rng.uniform((0, -100), (360, 30)), 3))
        up = turned((0, 0, 1), c) @ shifted((0, 0, 50)) @ turned((1, 0, 0), a)
        x, y, z = np.round(np.linalg.solve(up, ball)[:3], 3)
        actual = (
            turned((0, 0, 1), c)
            @ shifted((0, 0, 50))
            @ shifted((5e-3, -8e-3, 0), (0, 40e-6, 0))
            @ turned((1, 0, 0), a)
            @ shifted((0, 15e-3, -4e-3), (0, -25e-6, 60e-6))
            @ (x, y, z, 1.0)
        )
        seen = (np.eye(4) if frame is None else frame) @ (*actual[:3] + rng.normal(0, 1e-3, 3), 1.0)
        out.append((np.degrees(c), np.degrees(a), x, y, z, *seen[:3]))
    return pd.DataFrame(out, columns=["C", "A", "X", "Y", "Z", "mx", "my", "mz"])


def fitted(folder: Path, table: pd.DataFrame, survey: str = "") -> tuple[dict[str, tuple[float, float]], dict]:
    (folder / "mill.yaml").write_text(MILL)
    table.to_csv(folder / "data.csv", index=False)
    (folder / "survey.yaml").write_text(f"errormodel: 1\nfiles: [{{path: data.csv}}]\n{survey}")
    main(["fit", str(folder / "mill.yaml"), str(folder / "survey.yaml"), "--out", str(folder / "fit")])
    fit = json.loads((folder / "fit/fit.json").read_text())
    return {p["id"]: (p["value"], p["std"]) for p in fit["parameters"]}, fit


def assert_true(found: dict[str, tuple[float, float]]) -> None:
    for identity, truth in TRUTH.items():
        value, std = found[identity]
        assert abs(value - truth) < 4 * std, f"{identity}: {value} +- {std}, truth {truth}"


@pytest.mark.long
@pytest.mark.parametrize("balls", [[(50, 20, 100)], [(50, 20, 100), (50, 20, 101)]], ids=["one ball", "two"])
@pytest.mark.parametrize("seed", range(3))
def test_an_r_test_finds_the_rotary_axes(tmp_path: Path, balls: list[tuple[float, float, float]], seed: int) -> None:
    found, fit = fitted(tmp_path, r_test(balls, seed))
    assert_true(found)
    assert fit["sigma_um"] == pytest.approx(1, abs=0.25)
    assert any("do not determine its rotation" in note and "frame_rotation" in note for note in fit["notes"])
    assert len(fit["frame"][0]["alignment"]["undetermined"]) == (3 if len(balls) == 1 else 1)


def test_what_the_survey_says_of_the_rotation_is_used(tmp_path: Path) -> None:
    frame = shifted((10, 20, 30), (0, 0, np.radians(40)))
    found, fit = fitted(tmp_path, r_test([(50, 20, 100)], frame=frame), "frame_rotation: [0, 0, 40]\n")
    assert_true(found)
    assert fit["sigma_um"] == pytest.approx(1, abs=0.25)


def test_a_frame_a_run(tmp_path: Path) -> None:
    """Each run has its own ball and its own zero of the measuring head."""
    tables = [r_test([ball], k) for k, ball in enumerate([(50, 20, 100), (-40, 10, 90)])]
    tables[1][["mx", "my", "mz"]] += [3.0, -2.0, 1.0]
    table = pd.concat([t.assign(run=k) for k, t in enumerate(tables)])
    found, fit = fitted(tmp_path, table, "frame: per-run\n")
    assert_true(found)
    assert all(len(f["alignment"]["undetermined"]) == 3 for f in fit["frame"])


def test_diagnose_predict_and_monitor_say_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fitted(tmp_path, r_test([(50, 20, 100)]))
    machine, data, out = (str(tmp_path / name) for name in ("mill.yaml", "data.csv", "found"))
    for command in (
        ["diagnose", machine, data, "--out", out],
        ["predict", out, data, "--out", str(tmp_path / "p.csv")],
        ["monitor", str(tmp_path / "fit"), data],
    ):
        capsys.readouterr()
        main(command)
        said = capsys.readouterr()
        assert "frame_rotation" in said.err + said.out
        assert "whether all signs of what was measured are turned cannot be known" in said.err + said.out
    diagnosis = json.loads((tmp_path / "found/diagnosis.json").read_text())
    assert diagnosis["findings"] == []


@pytest.mark.long
@pytest.mark.parametrize(("order", "signs"), [((1, 0, 2), (1, 1, 1)), ((0, 1, 2), (1, 1, -1)), ((2, 0, 1), (1, 1, 1))])
@pytest.mark.parametrize("command", ["fit", "diagnose"])
def test_a_head_with_other_axes_is_refused(
    tmp_path: Path, command: str, order: tuple[int, ...], signs: tuple[int, ...]
) -> None:
    """Its readings are deviations from the ball's place, which any assignment of axes aligns."""
    table = r_test([(50, 20, 100)])
    place = np.array([50, 20, 100])
    table[XYZ] = place + (table[XYZ].to_numpy() - place)[:, list(order)] * signs
    (tmp_path / "mill.yaml").write_text(MILL)
    table.to_csv(tmp_path / "data.csv", index=False)
    result = run(command, tmp_path / "mill.yaml", tmp_path / "data.csv", "--out", tmp_path / "out")
    back = [("-" if signs[order.index(k)] < 0 else "") + XYZ[order.index(k)] for k in range(3)]
    assert result.code == 2
    assert f"taken as {', '.join(back)} (or all three with the opposite sign)" in result.err
    assert not (tmp_path / "out").exists()


@pytest.mark.long
@pytest.mark.parametrize("motion", [[1, 0, 0], [0, 0, 1]])
def test_an_effect_is_not_taken_for_turned_axes(tmp_path: Path, motion: list[float]) -> None:
    """A cradle that sags with A, in one direction and by 20 um: another direction would suit the constants better."""
    table = r_test([(50, 20, 100), (50, 20, 160)])
    table[XYZ] += 0.02 * np.cos(np.radians(table[["A"]].to_numpy())) * motion
    (tmp_path / "mill.yaml").write_text(MILL)
    table.to_csv(tmp_path / "data.csv", index=False)
    assert run("diagnose", tmp_path / "mill.yaml", tmp_path / "data.csv", "--out", tmp_path / "out").code == 0


@pytest.mark.parametrize("seed", range(3))
def test_noise_about_one_point_is_no_trackers(seed: int) -> None:
    """A station among the points would see each row's noise along its own line of sight."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(0, 5e-4, (200, 3))
    assert seen_in(np.array([50, 20, 100]) + noise, noise) is None


def test_readings_in_the_tools_axes_are_refused(tmp_path: Path) -> None:
    """A head in the spindle, whose readings nobody turned into the table's axes."""
    table, place = r_test([(50, 20, 100)], rows=90), np.array([50, 20, 100])
    angles = np.radians(table[["C", "A"]].to_numpy())
    for k, (c, a) in enumerate(angles):
        tool = (turned((0, 0, 1), c) @ turned((1, 0, 0), a))[:3, :3]
        table.loc[k, XYZ] = place + tool.T @ (table.loc[k, XYZ].to_numpy(dtype=float) - place)
    (tmp_path / "mill.yaml").write_text(MILL)
    table.to_csv(tmp_path / "data.csv", index=False)
    result = run("fit", tmp_path / "mill.yaml", tmp_path / "data.csv", "--out", tmp_path / "out")
    assert result.code == 2
    assert "mx, my, mz in axes that turn with the tool" in result.err
