"""What a prediction lacks is said at once: positions of joints, and the columns that effects need."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import InputError, read_machine, read_survey, simulate
from errormodel.machine import EffectSpec, Machine
from identification import fit, predict
from identification.results.fit_result import FitResult

MILL = read_machine("vertical_three_axis")
LATE = EffectSpec("scale-expansion", {"joint": "X", "sensor": "T_bed", "tau": 600.0})
STATES = pd.DataFrame({"X": [0.0, 100.0], "Y": 0.0, "Z": 300.0, "T_bed": 21.0, "time": 0.0})


@pytest.fixture(scope="module")
def machine() -> Machine:
    return replace(MILL, effects=(LATE,))


@pytest.fixture(scope="module")
def fitted(machine: Machine) -> FitResult:
    rng = np.random.default_rng(3)
    table = pd.DataFrame({
        "X": rng.uniform(-300, 300, 60), "Y": rng.uniform(-150, 150, 60), "Z": rng.uniform(100, 500, 60),
        "T_bed": 20 + 3 * np.sin(np.arange(60) / 9), "time": 60.0 * np.arange(60),
    })  # fmt: skip
    return fit(machine, simulate(machine, table, {}, noise=1e-3, seed=1))


@pytest.mark.parametrize(
    ("lacking", "found"),
    [
        (["Y", "Z"], "no columns for the joints 'Y' and 'Z'. "),
        (["Y"], "no column for the joint 'Y'. "),
        (["X", "Y", "Z", "T_bed"], "joints 'X', 'Y' and 'Z'; and no column 'T_bed', which an effect of"),
        (["Y", "T_bed", "time"], "the joint 'Y'; and no column"),
        (["T_bed"], "no column 'T_bed', which an effect of this machine needs. Add it"),
    ],
)  # fmt: skip
def test_a_prediction_names_all_that_it_lacks(fitted: FitResult, lacking: list[str], found: str) -> None:
    with pytest.raises(InputError) as error:
        predict(fitted, STATES.drop(columns=lacking))
    assert found in str(error.value)
    assert len(predict(fitted, STATES)) == 2


def test_without_times_each_row_is_settled(fitted: FitResult) -> None:
    """What acts late is then as in rows that all have one time; what follows the clock itself needs it."""
    untimed = predict(fitted, STATES.drop(columns="time"))
    assert untimed[["mx", "my", "mz"]].to_numpy() == pytest.approx(
        predict(fitted, STATES)[["mx", "my", "mz"]].to_numpy()
    )
    assert "time" not in untimed


@pytest.mark.parametrize("lacking", [["time"], []])
def test_a_mistyped_column_is_pointed_at(fitted: FitResult, lacking: list[str]) -> None:
    """Also where another sensor is there, which is not meant."""
    typed = STATES.rename(columns={"T_bed": "T_Bed"}).assign(T_table=20.0).drop(columns=lacking)
    with pytest.raises(InputError, match="Did you mean 'T_Bed'") as error:
        predict(fitted, typed)
    assert "noise(" not in str(error.value)


def test_a_survey_names_all_joints_that_it_lacks(tmp_path: Path) -> None:
    (tmp_path / "s.csv").write_text("x,mx,my,mz\n1,2,3,4\n")
    with pytest.raises(InputError, match=r"joints 'X', 'Y' and 'Z'; the nearest is 'x'. .*columns: {X: \"x\"}"):
        read_survey(tmp_path / "s.csv", MILL)
