"""A recording with a mistake in it is refused by `fit`, as `diagnose` names it; sound ones keep their numbers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from tests.helpers.commands import XYZ, done, run, write
from tests.helpers.nightly import first_of

MILL = """\
errormodel: 1
chain:
  - {joint: X, type: prismatic, axis: x, travel: [0, 800]}
  - {shape: saddle, offset: [0, 0, 100]}
  - {joint: Y, type: prismatic, axis: y, travel: [0, 500]}
  - {shape: column, offset: [0, 0, 200]}
  - {joint: Z, type: prismatic, axis: z, travel: [-400, 0]}
  - {shape: spindle, offset: [0, 0, -100]}
tool: [0, 0, -150]
"""
TRUTH = """\
parameters: {X.dx.1: 2.0e-5, saddle.ec: 3.0e-5, Y.dy.1: -1.5e-5}
frame: {translation: [2500, -1800, 400], rotation: [2, -3, 40]}
"""
DELTA = MILL.replace("axis: x", "axis: z").replace("axis: y", "axis: z")


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mill, and a survey of it by a tracker that stands 3 m away: ``m.yaml s.csv``."""
    folder = tmp_path_factory.mktemp("gate")
    write(folder / "m.yaml", MILL)
    write(folder / "truth.yaml", TRUTH)
    parameters = ("--parameters", folder / "truth.yaml", "--noise", 0.003)
    done("simulate", folder / "m.yaml", 120, *parameters, "--out", folder / "s.csv")
    return folder


def moved(table: pd.DataFrame) -> pd.DataFrame:
    """The last forty rows from another station."""
    turn = Rotation.from_euler("z", 25, degrees=True).as_matrix()
    table.loc[80:, XYZ] = table.loc[80:, XYZ].to_numpy() @ turn.T + [900, 300, -40]
    return table


def columns(table: pd.DataFrame, one: str, other: str) -> pd.DataFrame:
    table[[one, other]] = table[[other, one]].to_numpy()
    return table


def wild(table: pd.DataFrame) -> pd.DataFrame:
    table.loc[[4, 50], "mx"] += 320
    return table


def stopped(table: pd.DataFrame) -> pd.DataFrame:
    table.loc[20:30, XYZ] = table.loc[20, XYZ].to_numpy()
    return table


def shuffled(table: pd.DataFrame) -> pd.DataFrame:
    return table.assign(**table[XYZ].sample(frac=1, random_state=0).reset_index(drop=True))


def swapped_in_most(table: pd.DataFrame) -> pd.DataFrame:
    table["run"] = np.repeat(["1", "2"], [30, len(table) - 30])
    table.loc[30:, ["X", "Y"]] = table.loc[30:, ["Y", "X"]].to_numpy()
    return table


WRONG: dict[str, tuple[Callable[[pd.DataFrame], pd.DataFrame], tuple[str, ...]]] = {
    "sign": (lambda t: t.assign(X=-t["X"]), ("the sign of column X is wrong", "misses by", "Correct the table")),
    "unit": (lambda t: t.assign(Z=t["Z"] / 25.4), ("column Z is in another unit", "multiplied by 25.4")),
    "mirrored": (lambda t: t.assign(my=-t["my"]), ("mx my mz are left-handed", "wrong sign, or two are swapped")),
    "measured swapped": (lambda t: columns(t, "mx", "my"), ("mx my mz are left-handed",)),
    "commands swapped": (lambda t: columns(t, "X", "Y"), ("X and Y are swapped", "Write columns: {X: Y, Y: X}")),
    "two stations": (moved, ("rows 81 to 120 lie in another measuring frame", "frame: per-run")),
    "wild rows": (wild, ("rows 5, 51 lie up to 320 mm", "other 118 rows", "--robust")),
    "instrument stopped": (stopped, ("10 of 120 rows repeat", "rows 22, 23", "take the copies out")),
    "one row for all": (lambda t: t.loc[[7] * 60], ("59 of 60 rows repeat",)),
    "a stopped record": (lambda t: t.assign(Z=200.0), ("columns Z: the same in all rows", "the record had stopped")),
    "most rows swapped": (swapped_in_most, ("run 1 that fit their commands", "run 2 that do not", "swapped")),
    "another order": (shuffled, ("nothing to do with the commands", "serial chains", "delta")),
}


@pytest.mark.parametrize("kind", first_of(WRONG, 5))
def test_a_mistake_is_named_and_nothing_is_written(kind: str, sound: Path, tmp_path: Path) -> None:
    edit, expected = WRONG[kind]
    edit(pd.read_csv(sound / "s.csv")).to_csv(tmp_path / "s.csv", index=False)
    result = run("fit", sound / "m.yaml", tmp_path / "s.csv", "--out", tmp_path / "out", "--quiet")
    assert result.code == 2, result.out
    assert result.err.count("\n") == 1
    for words in expected:
        assert words.lower() in result.err.lower()
    assert not (tmp_path / "out").exists()


def test_no_axis_is_blamed_for_a_frame_that_may_be_mirrored(sound: Path, tmp_path: Path) -> None:
    """Y that reaches as far on either side of zero: which column is mirrored cannot be known, and both are named."""
    table = pd.read_csv(sound / "s.csv")
    write(tmp_path / "m.yaml", MILL.replace("[0, 500]", "[-250, 250]"))
    table.assign(Y=table["Y"] - 250, my=-table["my"]).to_csv(tmp_path / "s.csv", index=False)
    result = run("fit", tmp_path / "m.yaml", tmp_path / "s.csv", "--out", tmp_path / "out", "--quiet")
    assert result.code == 2
    for words in ("mx my mz are left-handed", "or the sign of column Y is wrong", "Move Y by hand", "squarenesses"):
        assert words in result.err
    assert "column X" not in result.err


def test_what_the_message_says_cures_swapped_columns(sound: Path, tmp_path: Path) -> None:
    columns(pd.read_csv(sound / "s.csv"), "X", "Y").to_csv(tmp_path / "s.csv", index=False)
    write(tmp_path / "s.yaml", "errormodel: 1\nfiles: [{path: s.csv}]\ncolumns: {X: Y, Y: X}\n")
    done("fit", sound / "m.yaml", tmp_path / "s.yaml", "--out", tmp_path / "cured")
    done("fit", sound / "m.yaml", sound / "s.csv", "--out", tmp_path / "sound")
    cured, right = (pd.read_csv(tmp_path / k / "parameters.csv") for k in ("cured", "sound"))
    np.testing.assert_allclose(cured["value"], right["value"], rtol=1e-9, atol=1e-15)


def test_a_robust_fit_names_wild_rows_itself(sound: Path, tmp_path: Path) -> None:
    wild(pd.read_csv(sound / "s.csv")).to_csv(tmp_path / "s.csv", index=False)
    done("fit", sound / "m.yaml", tmp_path / "s.csv", "--robust", "--out", tmp_path / "out")


def test_rows_that_draw_the_fit_to_them_are_named(sound: Path, tmp_path: Path) -> None:
    """Half a millimetre is what errors of a machine may make; but one row of 120 alone is not where they lead."""
    table = pd.read_csv(sound / "s.csv")
    table.loc[5, "mz"] += 0.5
    table.to_csv(tmp_path / "s.csv", index=False)
    notes = done("fit", sound / "m.yaml", tmp_path / "s.csv", "--out", tmp_path / "out").err
    assert "far beside the fit: s.csv row 6, up to 0.4" in notes
    assert "--robust" in notes
    plain, robust = (
        done("fit", sound / "m.yaml", file, *more, "--out", tmp_path / "f").err
        for file, more in ((sound / "s.csv", ()), (tmp_path / "s.csv", ("--robust",)))
    )
    assert "far beside" not in plain + robust


def test_another_tool_is_an_error_that_a_fit_may_find(sound: Path, tmp_path: Path) -> None:
    """A turning machine whose tool is 60 mm longer than its file says: far off, and told in full by the fit."""
    turning = MILL.replace("{joint: Z, type: prismatic, axis: z, travel: [-400, 0]}", "{joint: A, type: rotary, "
                           "axis: x, travel: [-90, 90]}")  # fmt: skip
    write(tmp_path / "m.yaml", turning)
    write(tmp_path / "t.yaml", turning.replace("-150]", "-210]"))
    done("simulate", tmp_path / "t.yaml", 150, "--noise", 0.002, "--out", tmp_path / "s.csv")
    table = pd.read_csv(tmp_path / "s.csv").drop(columns=["tool_x", "tool_y", "tool_z"])
    table.to_csv(tmp_path / "s.csv", index=False)
    result = done("fit", tmp_path / "m.yaml", tmp_path / "s.csv", "--out", tmp_path / "out")
    assert "beside the nominal machine" in result.err
    assert pd.read_csv(tmp_path / "out" / "residuals.csv").filter(like="residual_").abs().max().max() < 20


def five_bar(rows: int) -> pd.DataFrame:
    """Where the point of a five-bar linkage lies: two driven cranks 200 mm apart, links of 250 and 400 mm."""
    rng = np.random.default_rng(0)
    one, two = np.radians(rng.uniform(95, 150, rows)), np.radians(rng.uniform(30, 85, rows))
    left = np.column_stack([-100 + 250 * np.cos(one), 250 * np.sin(one)])
    right = np.column_stack([100 + 250 * np.cos(two), 250 * np.sin(two)])
    middle, half = (left + right) / 2, (right - left) / 2
    across = np.column_stack([-half[:, 1], half[:, 0]]) / np.linalg.norm(half, axis=1)[:, None]
    tip = middle + across * np.sqrt(400**2 - (half**2).sum(axis=1))[:, None]
    z = rng.uniform(-150, 0, rows)
    return pd.DataFrame({"A": np.degrees(one), "B": np.degrees(two), "Z": z, "mx": tip[:, 0], "my": tip[:, 1], "mz": z})


@pytest.mark.long
def test_a_parallel_robot_written_as_a_chain_is_not_fitted(tmp_path: Path) -> None:
    write(
        tmp_path / "m.yaml",
        "errormodel: 1\nchain:\n"
        "  - {joint: A, type: rotary, axis: z, travel: [0, 180]}\n  - {shape: crank, offset: [250, 0, 0]}\n"
        "  - {joint: B, type: rotary, axis: z, travel: [0, 180]}\n  - {shape: link, offset: [400, 0, 0]}\n"
        "  - {joint: Z, type: prismatic, axis: z, travel: [-200, 0]}\n",
    )
    five_bar(120).round(4).to_csv(tmp_path / "s.csv", index=False)
    result = run("fit", tmp_path / "m.yaml", tmp_path / "s.csv", "--out", tmp_path / "out", "--quiet")
    assert result.code == 2, result.out
    assert "serial chains" in result.err
    assert "five-bar" in result.err
    assert not (tmp_path / "out").exists()


def test_carriages_side_by_side_are_not_fitted(sound: Path, tmp_path: Path) -> None:
    write(tmp_path / "m.yaml", DELTA)
    result = run("fit", tmp_path / "m.yaml", sound / "s.csv", "--out", tmp_path / "out", "--quiet")
    assert result.code == 2
    for words in ("line 7, key chain[5]", "X, Y, Z all slide along one line", "serial chains", "delta"):
        assert words in result.err


ADDED = {
    "kinematics: delta": "key kinematics: 'delta'",
    "type: parallel": "key type: 'parallel'",
    "structure: Gough-Stewart platform": "key structure",
    "robot: 5-bar SCARA": "key robot",
    "legs: [{joint: A1}, {joint: A2}]": "key legs",
    "hexapod: {struts: 6}": "key hexapod",
}


@pytest.mark.parametrize("line", ADDED)
def test_a_parallel_machine_by_its_words(line: str, tmp_path: Path) -> None:
    write(tmp_path / "m.yaml", f"{MILL}{line}\n")
    result = run("describe", tmp_path / "m.yaml")
    assert result.code == 2
    for words in ("m.yaml, line 10", ADDED[line], "serial chains", "parallel machine", "three prismatic joints"):
        assert words in result.err


def test_a_ball_joint_is_none_of_a_chain(tmp_path: Path) -> None:
    write(tmp_path / "m.yaml", MILL.replace("X, type: prismatic", "X, type: spherical"))
    result = run("describe", tmp_path / "m.yaml")
    assert result.code == 2
    assert "line 3, key chain[1].type: a joint of type 'spherical'" in result.err
    assert "serial chains" in result.err


@pytest.mark.parametrize("name", ["Delta mill", "Hexapod's neighbour", "Parallel guide"])
def test_a_name_alone_is_no_reason(name: str, tmp_path: Path) -> None:
    write(tmp_path / "m.yaml", f'{MILL}name: "{name}"\n')
    done("describe", tmp_path / "m.yaml")


def test_a_zero_off_by_a_constant_is_said(sound: Path, tmp_path: Path) -> None:
    table = pd.read_csv(sound / "s.csv")
    table.assign(X=table["X"] + 1000).to_csv(tmp_path / "s.csv", index=False)
    result = done("fit", sound / "m.yaml", tmp_path / "s.csv", "--out", tmp_path / "out")
    assert "X counts from another zero: then add -1000 mm to its column" in result.err
    assert "travel: [1000, 1800]" in result.err
    assert "Levers and scales are wrong until this is mended" in result.err


TABLE = """\
errormodel: 1
chain:
  - {joint: C, type: rotary, axis: z, travel: [0, 360]}
  - {shape: table}
  - {joint: Y, type: prismatic, axis: y, travel: [-300, 300]}
  - {shape: saddle}
  - {joint: X, type: prismatic, axis: x, travel: [-300, 300]}
  - {shape: column}
  - {joint: A, type: rotary, axis: x, travel: [-60, 60]}
  - {shape: head}
  - {joint: Z, type: prismatic, axis: z, travel: [0, 500]}
  - {shape: spindle}
tool: [0, 0, -150]
errors: {shapes: all, joints: none}
"""
BALL = np.array([90.0, 20.0, 60.0])


def one_ball() -> pd.DataFrame:
    """A ball on a turning table, which the tool follows: the same point in all poses."""
    random = np.random.default_rng(4)
    c, a = np.radians(np.linspace(0, 350, 36)), np.radians(random.uniform(-50, 50, 36))
    tip = Rotation.from_euler("z", -c[:, None]).apply(BALL)  # Y and X turn with the table's commands undone
    z = (tip[:, 2]) / np.cos(a) + 150
    y = tip[:, 1] + np.sin(a) * (z - 150)
    table = pd.DataFrame({"X": tip[:, 0], "Y": y, "Z": z, "A": np.degrees(a), "C": np.degrees(c)})
    return table.assign(**dict(zip(XYZ, (BALL + random.normal(0, 0.003, (36, 3))).T, strict=True)))


ONE_BALL: dict[str, tuple[Callable[[pd.DataFrame], pd.DataFrame], str]] = {
    "sign": (lambda t: t.assign(C=-t["C"]), "the sign of column C is wrong:"),
    "zero": (lambda t: t.assign(X=t["X"] + 200), "column X has another zero than the machine's dimensions, -200.000"),
    "unit": (lambda t: t.assign(X=t["X"] / 25.4), "column X is in another unit: it must be multiplied by 25.4"),
    "two": (lambda t: t.assign(C=-t["C"], Z=t["Z"] / 2), "look at the sign, the zero and the unit of each joint"),
}


@pytest.mark.long
@pytest.mark.parametrize("frame", first_of(["shared", "fixed"]))
@pytest.mark.parametrize("kind", ONE_BALL)
def test_nominal_points_that_leave_the_one_ball(kind: str, frame: str, tmp_path: Path) -> None:
    edit, expected = ONE_BALL[kind]
    write(tmp_path / "m.yaml", TABLE)
    write(tmp_path / "s.yaml", f"errormodel: 1\nfiles: [{{path: s.csv}}]\nframe: {frame}\n")
    one_ball().to_csv(tmp_path / "s.csv", index=False)
    done("fit", tmp_path / "m.yaml", tmp_path / "s.yaml", "--out", tmp_path / "right")
    edit(one_ball()).to_csv(tmp_path / "s.csv", index=False)
    result = run("fit", tmp_path / "m.yaml", tmp_path / "s.yaml", "--out", tmp_path / "out", "--quiet")
    assert result.code == 2
    assert "the measured points stay at one place" in result.err
    assert expected in result.err
    assert "parallel" not in result.err


def test_a_fixed_frame_of_points_in_another_is_said(sound: Path, tmp_path: Path) -> None:
    survey = "errormodel: 1\nfiles: [{path: s.csv}]\nframe: fixed\n"
    write(tmp_path / "s.yaml", survey)
    table = pd.read_csv(sound / "s.csv")
    table.to_csv(tmp_path / "s.csv", index=False)
    result = run("fit", sound / "m.yaml", tmp_path / "s.yaml", "--out", tmp_path / "out", "--quiet")
    assert result.code == 2
    assert "must be in the machine's own reference, and in the mean they are off by (" in result.err
    assert "Write frame: shared" in result.err
    assert "parallel" not in result.err
    write(tmp_path / "s.yaml", survey.replace("fixed", "shared"))
    done("fit", sound / "m.yaml", tmp_path / "s.yaml", "--out", tmp_path / "cured")
    write(tmp_path / "s.yaml", survey)
    shuffled(table).to_csv(tmp_path / "s.csv", index=False)
    result = run("fit", sound / "m.yaml", tmp_path / "s.yaml", "--out", tmp_path / "out", "--quiet")
    assert result.code == 2
    assert "Write frame: shared" not in result.err
    assert "at its own command" in result.err


def test_deviations_of_one_ball_in_a_fixed_frame(tmp_path: Path) -> None:
    write(tmp_path / "m.yaml", TABLE)
    write(tmp_path / "s.yaml", "errormodel: 1\nfiles: [{path: s.csv}]\nframe: fixed\n")
    table = one_ball()
    table[XYZ] -= BALL
    table.to_csv(tmp_path / "s.csv", index=False)
    result = run("fit", tmp_path / "m.yaml", tmp_path / "s.yaml", "--out", tmp_path / "out", "--quiet")
    assert result.code == 2
    assert "off by (-90, -20, -60) mm" in result.err
    assert "If the columns hold deviations" in result.err


@pytest.mark.parametrize(("frame", "name"), [("fixed", "nominal "), ("shared", "nominal, best frame ")])
def test_the_nominal_machine_is_said_with_its_frame(frame: str, name: str, tmp_path: Path) -> None:
    write(tmp_path / "m.yaml", MILL)
    write(tmp_path / "s.yaml", f"errormodel: 1\nfiles: [{{path: s.csv}}]\nframe: {frame}\n")
    done("simulate", tmp_path / "m.yaml", 60, "--noise", 0.003, "--out", tmp_path / "s.csv")
    result = done("fit", tmp_path / "m.yaml", tmp_path / "s.yaml", "--out", tmp_path / "out")
    (line,) = [line for line in result.out.splitlines() if line.startswith("nominal")]
    assert line.startswith(name)
    assert ("best frame" in (tmp_path / "out" / "report.html").read_text()) == (frame == "shared")


def test_a_table_that_was_copied_below_itself_is_refused(sound: Path, tmp_path: Path) -> None:
    """Four times the same readings are no repeats: they would halve every uncertainty. Repeats with noise do count."""
    table = pd.read_csv(sound / "s.csv").round(dict.fromkeys(XYZ, 4))
    pd.concat([table] * 4).to_csv(tmp_path / "four.csv", index=False)
    refused = run("fit", sound / "m.yaml", tmp_path / "four.csv", "--out", tmp_path / "f")
    assert refused.code == 2
    assert "360 of 480 rows repeat what earlier rows measured to the last digit" in refused.err
    assert not (tmp_path / "f").exists()
    repeated = pd.concat([table] * 2)
    repeated[XYZ] += np.random.default_rng(3).normal(0, 0.003, (240, 3)).round(4)
    repeated.to_csv(tmp_path / "twice.csv", index=False)
    done("fit", sound / "m.yaml", tmp_path / "twice.csv", "--out", tmp_path / "t")


@pytest.mark.long
@pytest.mark.parametrize("two_stations", [False, True])
def test_error_motions_of_a_joint_between_positions_have_no_place(
    sound: Path, tmp_path: Path, two_stations: bool
) -> None:
    """What is read of one joint alone needs no commands of the others: only positions can be in a wrong frame."""
    positions = pd.read_csv(sound / "s.csv")
    positions = moved(positions) if two_stations else positions
    motions = pd.DataFrame({"joint": "X", "X": np.linspace(0, 800, 9), "dx": 0.0, "dy": 0.0, "ea": 0.0})
    both = pd.concat([positions[:50], motions, positions[50:]], ignore_index=True)
    both.to_csv(tmp_path / "s.csv", index=False)
    result = run("diagnose", sound / "m.yaml", tmp_path / "s.csv", "--out", tmp_path / "d", "--quiet")
    assert result.code == (2 if two_stations else 0), result.err
    if two_stations:
        assert "rows 90 to 129 lie in another measuring frame" in result.err
