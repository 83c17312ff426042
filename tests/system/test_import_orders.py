"""What the proof of a join says where points leave something open: other orders, the hand of a plane, a step."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from errormodel import InputError, read_machine, read_survey
from errormodel.chain import Chain
from errormodel.raw_formats.sensor_names import sensor_of
from identification import import_survey
from identification.diagnosis.data_checks.blunder import Points, sheet
from identification.diagnosis.data_checks.steps import find_step
from tests.helpers.chains import errors
from tests.helpers.commands import done
from tests.helpers.importing import FRAME, MILL, points, poses, programme, spatialanalyzer
from tests.helpers.surveys import FAR, TURNED, measured, positions


def serpentine(levels: tuple[float, ...] = (200.0, 300.0, 400.0)) -> pd.DataFrame:
    """Four lines of five poses a level, to and fro: turned by 180 degrees about X as it runs backwards."""
    rows = []
    for z in levels:
        for k, y in enumerate((-150.0, -50.0, 50.0, 150.0)):
            rows += [(x, y, z) for x in np.linspace(-200, 200, 5)[:: 1 if k % 2 == 0 else -1]]
    return pd.DataFrame(rows, columns=["X", "Y", "Z"])


def written(folder: Path, commands: pd.DataFrame, measured: np.ndarray) -> tuple[str, ...]:
    """A tracker's file and a programme, and the words of their import."""
    (folder / "tracker.txt").write_text(spatialanalyzer(measured))
    (folder / "survey.nc").write_text(programme(commands))
    return (
        "import", str(folder / "tracker.txt"), "--machine", MILL, "--commands", str(folder / "survey.nc"),
        "--out", str(folder / "s"),
    )  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("levels", [(200.0, 300.0, 400.0), (200.0,)])
def test_a_symmetric_plan_leaves_the_order_open_and_that_is_said(levels: tuple[float, ...], tmp_path: Path) -> None:
    """Readings in reverse order fit as well as in their own: import warns, and so does every command behind it."""
    commands = serpentine(levels)
    words = written(tmp_path, commands, points(commands)[::-1])
    result = done(*words)
    assert "the readings in reverse order fit as well" in result.out
    assert "note: the readings in reverse order fit as well" in result.err
    assert "confirm the order with --match order" in result.err
    assert "notes:" in (tmp_path / "s/survey.yaml").read_text()
    for command in ("check", "fit"):
        more = ("--out", tmp_path / "f") if command == "fit" else ()
        assert "reverse order fit as well" in done(command, MILL, tmp_path / "s", *more).err


def test_an_order_that_is_stated_is_no_warning(tmp_path: Path) -> None:
    commands = serpentine()
    result = done(*written(tmp_path, commands, points(commands)), "--match", "order")
    assert "in reverse order fit as well" in result.out
    assert "reverse order" not in result.err
    assert "notes:" not in (tmp_path / "s/survey.yaml").read_text()


def test_one_pose_off_the_pattern_proves_the_order(tmp_path: Path) -> None:
    commands = pd.concat([serpentine(), pd.DataFrame({"X": [37.0], "Y": [-110.0], "Z": [451.0]})], ignore_index=True)
    result = done(*written(tmp_path, commands, points(commands)))
    assert "as well" not in result.out + result.err


def test_a_plane_does_not_show_the_hand(tmp_path: Path) -> None:
    commands = poses(rows=30).assign(Z=300.0)
    result = done(*written(tmp_path, commands, points(commands) * [1, -1, 1]))
    assert "which hand the axes have does not show: points in a plane" in result.out
    assert "or hand fits better" not in result.out
    assert "reverse order" not in result.out


@pytest.mark.parametrize("commands", [poses(rows=60), serpentine()], ids=["random", "layers"])
def test_a_displaced_target_is_named_with_its_row(commands: pd.DataFrame, tmp_path: Path) -> None:
    measured = points(commands).copy()
    measured[34:] += [0.04, -0.025, 0.02]
    result = done(*written(tmp_path, commands, measured))
    assert "from row 35 on the points lie 5" in result.out  # of 51 um
    assert "from row 35 on" in done("check", MILL, tmp_path / "s").out


@pytest.mark.long
def test_no_step_is_seen_in_right_joins() -> None:
    """Of 200 surveys, in random order, layer by layer, or drifting over their rows: no false word."""
    machine = read_machine(MILL)
    chain, rng = Chain(machine), np.random.default_rng(11)
    for seed in range(200):
        commands = serpentine() if seed % 4 == 1 else poses(seed, int(rng.integers(24, 90)))
        if seed % 4 == 2:  # layer by layer
            commands = commands.sort_values("Z", ignore_index=True)
        drift = np.linspace(0, 0.03, len(commands))[:, None] * (seed % 4 == 3) * rng.normal(size=3)
        table = commands.copy()
        table[["mx", "my", "mz"]] = points(commands, seed, 10 ** rng.uniform(-3.5, -2)) + drift
        survey = read_survey(table, machine)
        part = Points.of(chain, sheet(chain, survey.table), fixed=False)
        assert find_step(machine, survey, np.arange(len(table)), part) is None, seed


def test_names_and_times_prove_an_order(tmp_path: Path) -> None:
    commands = serpentine()
    written(tmp_path, commands, points(commands))
    commands.insert(0, "name", [f"P{k}" for k in range(1, len(commands) + 1)])
    commands.to_csv(tmp_path / "plan.csv", index=False)
    result = import_survey(tmp_path / "tracker.txt", MILL, commands=tmp_path / "plan.csv")
    assert result.imported.proof.other is None
    assert not result.notes


def test_two_dwells_at_one_place_are_two_readings_where_the_numbers_say_so(tmp_path: Path) -> None:
    """12 poses on a line, one commanded and waited at again: 13 readings belong to all dwells, 14 to none."""
    commands = poses(rows=12).assign(Y=0.0, Z=300.0)
    lines = programme(commands).splitlines()
    x = commands["X"].iloc[5]
    at = next(k for k, line in enumerate(lines) if line.startswith(f"G1 X{x:.3f} "))
    lines[at + 2 : at + 2] = [lines[at], "G4 P3"]
    order = [*range(6), *range(5, 12)]
    measured = points(commands.iloc[order].reset_index(drop=True))
    written(tmp_path, commands, measured)
    (tmp_path / "survey.nc").write_text("\n".join(lines) + "\n")
    result = import_survey(tmp_path / "tracker.txt", MILL, commands=tmp_path / "survey.nc")
    np.testing.assert_array_equal(result.survey.commands(["X"])[:, 0], commands["X"].to_numpy()[order])
    assert "by order, 1 of them at a place that was waited at again" in result.summary()
    written(tmp_path, commands, measured[[*range(13), 0]])
    (tmp_path / "survey.nc").write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match="1 dwell at the place of the dwell before, counted as one pose with it"):
        import_survey(tmp_path / "tracker.txt", MILL, commands=tmp_path / "survey.nc")


def test_units_in_a_comment_of_spatialanalyzer(tmp_path: Path) -> None:
    commands = poses()
    words = written(tmp_path, commands, points(commands))
    text = (tmp_path / "tracker.txt").read_text().splitlines()
    head = ["// SpatialAnalyzer ASCII export", "// Frame: A::WORLD   Units: Millimeters"]
    (tmp_path / "tracker.txt").write_text("\n".join([*head, *text[2:]]) + "\n")
    assert "a point list of SpatialAnalyzer, 40 rows" in done(*words).out


def test_german_names_of_temperatures_and_of_positioning_tests(tmp_path: Path) -> None:
    assert sensor_of("Temperatur", "degC") == "T_air"
    assert sensor_of("Temperatur Bett", "degC") == "T_Bett"
    rows = [f"{x};{0.1 * x + k};{k};{side}" for k in (1, 2, 3) for x in (0, 50, 100) for side in "+-"]
    (tmp_path / "pos.csv").write_text("\n".join(["Ziel [mm];Abweichung [um];Lauf;Richtung", *rows]) + "\n")
    out = done("import", tmp_path / "pos.csv", "--machine", MILL, "--joint", "X", "--out", tmp_path / "s").out
    assert "18 rows of error motions" in out


def test_a_declared_uncertainty_that_is_too_large_beside_the_one_seen(tmp_path: Path) -> None:
    """Declared 5 um, seen 2 um: both are printed, and a note says which one the uncertainties follow."""
    table = poses(rows=80)
    table[["mx", "my", "mz"]] = points(table)
    table["sigma_x"] = table["sigma_y"] = table["sigma_z"] = 0.005
    table.to_csv(tmp_path / "data.csv", index=False)
    result = done("fit", MILL, tmp_path / "data.csv", "--out", tmp_path / "f")
    assert "note: declared 5 um, seen " in result.err
    assert "95 %, seen; standard uncertainties follow the declared one)" in result.out


def test_a_programme_that_was_cut_off_is_said_and_its_commands_find_their_readings(tmp_path: Path) -> None:
    """Two passes one after the other, of which the programme holds the first half: each command finds two readings."""
    commands = poses(11, 40)
    both = np.vstack([points(commands, seed) for seed in (1, 2)])
    words = written(tmp_path, commands, both)
    cut = (tmp_path / "survey.nc").read_text().splitlines()
    (tmp_path / "survey.nc").write_text("\n".join(cut[: 4 + 3 * 20]) + "\n")
    with pytest.raises(InputError) as error:
        import_survey(tmp_path / "tracker.txt", MILL, commands=tmp_path / "survey.nc")
    assert "survey.nc: the programme has no end" in error.value.found
    assert "with --match nearest 40 of 80 readings fit" in error.value.found
    assert "parallel" not in error.value.cure
    told = done(*words, "--match", "nearest").out
    assert "joined 40 of 80 readings with 20 commands by the nearest" in told
    assert "the programme has no end (M30, M2, END PGM): it may have been cut off" in told


def test_another_programme_is_named_as_one(tmp_path: Path) -> None:
    written(tmp_path, poses(12, 40), points(poses(11, 40)))
    with pytest.raises(InputError, match="they are of another test, cut off, or the machine file is of another"):
        import_survey(tmp_path / "tracker.txt", MILL, commands=tmp_path / "survey.nc")


PLACE = re.compile(
    r"stands at x=(\S+) y=(\S+) z=(\S+) mm in the machine's reference, its x along \[(\S+), (\S+), (\S+)\]"
)


def stands(text: str) -> np.ndarray:
    """Where the measuring frame stands and along what its x axis is, as it was said."""
    found = PLACE.search(text)
    assert found is not None, text
    return np.array(found.groups(), dtype=float)


def test_where_the_tracker_stands_is_what_tells_a_machine_turned_by_180_degrees(tmp_path: Path) -> None:
    commands = poses()
    turn = Rotation.from_euler("XYZ", FRAME["rotation"], degrees=True)
    place = -turn.inv().apply(FRAME["translation"])
    (tmp_path / "a").mkdir()
    result = done(*written(tmp_path / "a", commands, points(commands)))
    np.testing.assert_allclose(stands(result.out)[:3], place, atol=1.0)
    np.testing.assert_allclose(stands(result.out)[3:], turn.as_matrix()[0], atol=1e-3)
    assert "with both of X and Y, or X and Z, or Y and Z counted the other way round" in result.out
    assert stands(done("check", MILL, tmp_path / "a/s").out).tolist() == stands(result.out).tolist()
    (tmp_path / "b").mkdir()
    turned = done(*written(tmp_path / "b", commands * [-1, -1, 1], points(commands)))
    assert "no other sign, unit or hand fits better" in turned.out
    np.testing.assert_allclose(
        stands(turned.out), np.array([*place, *turn.as_matrix()[0]]) * [-1, -1, 1, -1, -1, 1], atol=1.0
    )


def test_frames_that_are_known_and_axes_that_do_tell_are_not_spoken_of(tmp_path: Path) -> None:
    commands = poses()
    still = dict.fromkeys(("translation", "rotation"), (0.0, 0.0, 0.0))
    commands.assign(**dict(zip(("mx", "my", "mz"), points(commands, **still).T, strict=True))).to_csv(
        tmp_path / "s.csv", index=False
    )
    (tmp_path / "s.yaml").write_text("errormodel: 1\nfiles: [{path: s.csv}]\nframe: fixed\n")
    assert "stands at" not in done("check", MILL, tmp_path / "s.yaml").out
    machine = read_machine("five_axis_table_quill")  # Z and W are parallel: neither turns round alone
    table = positions(measured(machine, errors(Chain(machine), 2), 60, 1, noise=2e-3))
    table.drop(columns=["file", "role", "row", "run"]).to_csv(tmp_path / "t.csv", index=False)
    names = [j.name for j in machine.joints if j.type == "rotary"]
    five = pd.read_csv(tmp_path / "t.csv")
    five[names] = np.degrees(five[names])
    five.to_csv(tmp_path / "t.csv", index=False)
    said = done("check", "five_axis_table_quill", tmp_path / "t.csv").out
    np.testing.assert_allclose(stands(said)[:3], -Rotation.from_euler("XYZ", TURNED).inv().apply(FAR), atol=1.0)
    assert "the other way round" not in said
