"""Readings at one place (an R-test): what their points do not prove is said, and what a fit shows is refused."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import InputError, read_machine, read_survey, simulate
from errormodel.chain import Chain
from errormodel.nominal import Nominal
from identification.importing.check import check_survey
from tests.helpers.commands import done, run

FORK = """errormodel: 1
name: Fork head
units: {length: mm, angle: deg}
chain:
  - {joint: X, type: prismatic, axis: x, travel: [-500, 500]}
  - {shape: S1}
  - {joint: Y, type: prismatic, axis: y, travel: [-500, 500]}
  - {shape: S2}
  - {joint: Z, type: prismatic, axis: z, travel: [-100, 600]}
  - {shape: S3}
  - {joint: C, type: rotary, axis: z, travel: [-180, 180]}
  - {shape: S4}
  - {joint: A, type: rotary, axis: x, travel: [-100, 100]}
  - {shape: S5}
tool: [0, 0, -200]
errors:
  shapes: all
  joints: {X: none, Y: none, Z: none, C: none, A: none}
"""
TRUTH = {"S4.dy": 0.035, "S4.dx": -0.012, "S4.eb": 80e-6, "S3.ea": -60e-6, "S3.eb": 45e-6, "S5.dy": 0.022}
BALL = (20.0, -30.0, 100.0)
SEEN = ["mx", "my", "mz"]


@pytest.fixture(scope="module")
def fork(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fork") / "fork.yaml"
    path.write_text(FORK)
    return path


@pytest.fixture(scope="module")
def table(fork: Path) -> pd.DataFrame:
    """Commands that keep the tool's point on a ball while A and C turn, and its deviations, zeroed at one pose."""
    turns = [(c, a) for a in (-80, -45, 0, 30, 60, 90) for c in range(-180, 181, 30)]
    commands = pd.DataFrame(np.zeros((len(turns), 3)), columns=["X", "Y", "Z"])
    commands[["C", "A"]] = np.array(turns, dtype=float)
    chain = Chain(read_machine(fork))
    commands[["X", "Y", "Z"]] = (BALL - Nominal(chain, commands).points(np.array([0.0, 0.0, -200.0]))).round(3)
    seen = simulate(fork, commands, TRUTH, noise=0.0005, seed=2)[SEEN].to_numpy()
    return commands.assign(**dict(zip(SEEN, (seen - seen[30]).T, strict=True)))


def test_what_points_at_one_place_do_not_prove_is_said_and_stays(
    fork: Path, table: pd.DataFrame, tmp_path: Path
) -> None:
    table.to_csv(tmp_path / "rtest.csv", index=False)
    result = done("import", tmp_path / "rtest.csv", "--machine", fork, "--out", tmp_path / "s")
    assert "fits better" not in result.out
    assert "the points prove neither the order of the rows nor signs, hand or axes" in result.out
    assert "excludes nothing" not in result.out
    for text in (result.err, (tmp_path / "s/survey.yaml").read_text().replace("\n", " ")):
        assert "positive where it stands too far along an axis" in " ".join(text.split())


def exchanged(seen: np.ndarray) -> np.ndarray:
    out = seen.copy()
    out[[20, 50]] = seen[[50, 20]]
    return out


@pytest.mark.parametrize(
    ("spoiled", "words"),
    [
        (lambda seen: np.roll(seen, 1, axis=0), "stand 1 row too late: a fit of the declared errors leaves"),
        (lambda seen: np.roll(seen, -2, axis=0), "stand 2 rows too early"),
        (exchanged, "rows 21, 51 are exchanged"),
        (lambda seen: seen * [1, 1, -1], "with mz=-mz"),
        (lambda seen: seen[:, [1, 0, 2]], "with mx=my,my=mx"),
    ],
)
def test_a_mistake_at_one_place_is_found_by_a_fit(
    fork: Path, table: pd.DataFrame, tmp_path: Path, spoiled: Callable[[np.ndarray], np.ndarray], words: str
) -> None:
    wrong = table.copy()
    wrong[SEEN] = spoiled(table[SEEN].to_numpy())
    wrong.to_csv(tmp_path / "rtest.csv", index=False)
    machine = read_machine(fork)
    with pytest.raises(InputError, match=words):
        check_survey(machine, read_survey(tmp_path / "rtest.csv", machine))


def test_few_readings_at_one_place_are_not_called_proved(fork: Path, table: pd.DataFrame, tmp_path: Path) -> None:
    table.iloc[:7].to_csv(tmp_path / "rtest.csv", index=False)
    machine = read_machine(fork)
    proof = check_survey(machine, read_survey(tmp_path / "rtest.csv", machine)).proof
    assert proof.one_place is not None
    assert "too few for a fit" in proof.one_place.text


@pytest.mark.parametrize("lacks", ["a row", "a column"])
def test_what_an_r_test_lacks_is_named(lacks: str, fork: Path, table: pd.DataFrame, tmp_path: Path) -> None:
    """Where nothing but the order joins, the nearest command is no help, and no frame is to be spoken of."""
    commands = table[["X", "Y", "Z", "C", "A"]]
    commands = commands.drop(columns="A") if lacks == "a column" else commands.drop(index=7)
    commands.to_csv(tmp_path / "plan.csv", index=False)
    table[SEEN].to_csv(tmp_path / "rtest.csv", index=False)
    seen, plan = tmp_path / "rtest.csv", tmp_path / "plan.csv"
    result = run("import", seen, "--machine", fork, "--commands", plan, "--out", tmp_path / "s")
    assert result.code == 2
    said = {
        "a row": "78 readings and 77 commands of.*all at one place.*which rows plan.csv lacks.*--match name",
        "a column": "plan.csv: no command of A among its columns X, Y, Z, C. .*--command-columns A=",
    }[lacks]
    assert re.search(said, " ".join(result.err.split()))


def along_the_tool(fork: Path, table: pd.DataFrame) -> pd.DataFrame:
    """The same readings by a nest in the spindle, which turns with C and A."""
    turns, _ = Nominal(Chain(read_machine(fork)), table).flanges()
    own = np.einsum("nji,nj->ni", turns, table[SEEN].to_numpy())
    return table.assign(**dict(zip(SEEN, own.T, strict=True)))


def test_readings_of_a_nest_in_the_spindle_are_turned_into_the_reference(
    fork: Path, table: pd.DataFrame, tmp_path: Path
) -> None:
    along_the_tool(fork, table).to_csv(tmp_path / "nest.csv", index=False)
    done("import", tmp_path / "nest.csv", "--machine", fork, "--axes", "tool", "--out", tmp_path / "s")
    machine = read_machine(fork)
    survey = read_survey(tmp_path / "s", machine)
    assert np.abs(survey.measured - table[SEEN].to_numpy()).max() < 1e-12
    proof = check_survey(machine, survey).proof
    assert proof.one_place is not None
    assert proof.one_place.axes == "tool"


@pytest.mark.parametrize("stated", ["reference", "tool"])
def test_readings_along_other_axes_than_stated_are_found_by_a_fit(
    fork: Path, table: pd.DataFrame, tmp_path: Path, stated: str
) -> None:
    (along_the_tool(fork, table) if stated == "reference" else table).to_csv(tmp_path / "nest.csv", index=False)
    result = run("import", tmp_path / "nest.csv", "--machine", fork, "--axes", stated, "--out", tmp_path / "s")
    assert result.code == 2
    other = "tool" if stated == "reference" else "reference"
    assert f"say --axes {other}" in " ".join(result.err.split())
    assert not (tmp_path / "s").exists()
