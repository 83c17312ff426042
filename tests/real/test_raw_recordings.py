"""Excerpts of real files of instruments and laboratories: what is read of them, and the surveys they make."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.exceptions import InputError
from errormodel.machine import Basis, Joint, Machine, Shape
from errormodel.raw_formats.base import Asked, Recording, format_of, open_raw
from identification import fit, import_survey

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
AXES = tuple(Joint(n, "prismatic", a, (-4000.0, 4000.0)) for n, a in (("X", X), ("Y", Y), ("Z", Z)))
CUBE = Machine("three linear joints", AXES)  # that a point itself is the position of
AXIS = Machine("one axis", (Joint("X", "prismatic", X, (-20.0, 20.0), {"dx": Basis("polynomial", 2)}),))


@pytest.fixture
def files(real_data: Path) -> Path:
    folder = real_data / "files"
    if not folder.is_dir():
        pytest.skip("the excerpts of raw files are not there")
    return folder


def read(path: Path) -> tuple[str, Recording]:
    raw = open_raw(path, path.name)
    kind = format_of(raw)
    return kind.name, kind.read(raw, Asked(AXIS))


@pytest.mark.parametrize(
    ("name", "kind", "rows"),
    [
        ("spatialanalyzer_log.txt", "spatialanalyzer-points", 37),
        ("points_plain.txt", "tracker-points", 12),
        ("leica.csv", "leica-tracker", 8),
        ("robot_three_smr.txt", "robot-targets", 36),
        ("iso230_2_x.csv", "positioning-test", 90),
    ],
)
def test_it_is_read_as_it_is(name: str, kind: str, rows: int, files: Path) -> None:
    own, recording = ("robot-targets", _robot(files)) if kind == "robot-targets" else read(files / name)
    assert own == kind
    assert len(recording.frame) == rows


def _robot(files: Path) -> Recording:
    raw = open_raw(files / "robot_three_smr.txt", "robot_three_smr.txt")
    assert format_of(raw).name == "robot-targets"
    return format_of(raw).read(raw, Asked())


def test_three_reflectors_stay_at_their_distances(files: Path) -> None:
    points = _robot(files).frame[["mx", "my", "mz"]].to_numpy().reshape(-1, 3, 3)
    apart = np.linalg.norm(points - np.roll(points, 1, axis=1), axis=2)
    assert np.ptp(apart, axis=0).max() < 0.5  # mm, of distances of 100 mm and more: a rigid flange
    assert apart.min() > 100


def test_an_arm_whose_joint_columns_are_named(files: Path) -> None:
    """Two joints move; three reflectors find their places on the flange, which the forearm (J3 = -J2) keeps level."""
    turn = {"travel": (-np.pi, np.pi)}
    arm = Machine("two joints of an arm", (
        Joint("J1", "rotary", Z, **turn), Shape("S1", (312.0, 0.0, 0.0)), Joint("J2", "rotary", Y, **turn),
    ), (1280.0, 0.0, 1300.0))  # fmt: skip
    result = import_survey(files / "robot_three_smr.txt", arm, columns={"J1": "16", "J2": "17"})
    assert len(result.survey) == 36
    assert result.imported.proof.rms_um < 1000  # of an arm that nobody calibrated, over 2 m
    assert len(result.imported.pairs[0].targets) == 3  # type: ignore[union-attr]


def test_leica_without_commands_says_what_is_missing(files: Path) -> None:
    with pytest.raises(InputError, match="no command of X, Y, Z"):
        import_survey(files / "leica.csv", CUBE)


def test_leica_with_commands(files: Path, tmp_path: Path) -> None:
    """Commands are what a machine would have had that stood at the points, to a millimetre; its target was turned."""
    table = pd.read_csv(files / "leica.csv", encoding="cp1252")
    commands = table.iloc[:, :3].round(0).set_axis(["X", "Y", "Z"], axis=1)
    commands.to_csv(tmp_path / "plan.csv", index=False)
    with pytest.raises(InputError, match="measured orientations that lie"):
        import_survey(files / "leica.csv", CUBE, commands=tmp_path / "plan.csv")
    turned = dict.fromkeys(("mrx", "mry", "mrz"), "-")
    result = import_survey(files / "leica.csv", CUBE, commands=tmp_path / "plan.csv", columns=turned)
    np.testing.assert_array_equal(result.survey.measured, table.iloc[:, :3].to_numpy())
    np.testing.assert_allclose(result.survey.table["sigma_x"], table.iloc[:, 4] / 2)
    assert result.imported.proof.rms_um < 900  # half a millimetre of rounding in three coordinates, at most


def test_readings_in_one_dwell(files: Path, tmp_path: Path) -> None:
    pd.DataFrame({"X": [2296.0], "Y": [-2416.0], "Z": [-443.0]}).to_csv(tmp_path / "plan.csv", index=False)
    result = import_survey(files / "spatialanalyzer_log.txt", CUBE, commands=tmp_path / "plan.csv")
    assert "1 dwell of 37 readings" in result.summary()
    assert len(result.survey) == 1


def test_repeats_by_name(files: Path, tmp_path: Path) -> None:
    plan = pd.read_csv(files / "points_plain.txt", header=None, skipinitialspace=True).iloc[:3].round(0)
    plan.set_axis(["name", "X", "Y", "Z"], axis=1).to_csv(tmp_path / "plan.csv", index=False)
    result = import_survey(files / "points_plain.txt", CUBE, commands=tmp_path / "plan.csv")
    proof = result.imported.proof
    assert proof.repeats == 3
    assert "too few places (3) to prove the join" in result.summary()
    assert 1 < proof.repeat_um < 10  # four passes of a tracker over three points, 2.5 m away


def test_an_arm_in_any_order_without_names(real_data: Path, tmp_path: Path) -> None:
    """280 of 300 poses of a UR10, shuffled, in m with decimal commas; commands in rad: each finds its own."""
    folder = real_data / "ur10"
    if not folder.is_dir():
        pytest.skip("the recording of a UR10 is not there")
    table = pd.read_csv(folder / "series_c.csv").iloc[:300]
    order = np.random.default_rng(0).permutation(300)[:280]
    measured = table[["mx", "my", "mz"]].iloc[order] / 1e3
    measured.set_axis(["X [m]", "Y [m]", "Z [m]"], axis=1).to_csv(tmp_path / "m.csv", index=False, sep=";", decimal=",")
    joints = [f"J{k}" for k in range(1, 7)]
    np.radians(table[joints]).rename(columns=lambda n: f"{n} [rad]").to_csv(tmp_path / "c.csv", index=False)
    result = import_survey(tmp_path / "m.csv", folder / "machine.yaml", commands=tmp_path / "c.csv")
    (pairs, _) = result.imported.pairs
    assert pairs is not None
    assert len(pairs) > 270  # errors of the nominal arm reach 2 mm; what lies farther has no command
    np.testing.assert_array_equal(pairs.command, order[pairs.first])


def test_a_positioning_test_and_its_reversal_value(files: Path) -> None:
    """The mean reversal value of the rows is the one that was published (ISO 230-2: forward minus backward)."""
    result = import_survey(files / "iso230_2_x.csv", AXIS, joint="X")
    table = result.survey.table
    means = table.groupby(["X", "dir_X"])["dx"].mean().unstack()
    published = json.loads((files / "iso230_2_x_published.json").read_text())
    assert abs((means[1.0] - means[-1.0]).mean()) == pytest.approx(published["B_mean"], abs=5e-6)  # as printed
    assert len(fit(AXIS, result.survey).residuals) == 90
