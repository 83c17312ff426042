"""Stations in one file, and units that a file states wrongly: what is taken in is right, or refused with what fits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import InputError
from identification import import_survey
from identification.importing.dwells import find_dwells
from tests.helpers.importing import MILL, NOISE, points, poses

COMMANDS = poses(rows=30)


def named(measured: np.ndarray) -> pd.DataFrame:
    table = pd.DataFrame(measured.round(6), columns=["X [mm]", "Y [mm]", "Z [mm]"])
    table.insert(0, "Name", [f"P{k}" for k in range(1, len(measured) + 1)])
    return table


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    table = COMMANDS.copy()
    table.insert(0, "Name", [f"P{k}" for k in range(1, len(table) + 1)])
    table.to_csv(tmp_path / "plan.csv", index=False)
    return tmp_path / "plan.csv"


def test_two_stations_one_below_the_other_in_a_file_are_no_two_dwells(plan: Path, tmp_path: Path) -> None:
    """The step from one station to the next is far longer than those between points: these are no noise."""
    second = points(COMMANDS, seed=4, translation=(-9000.0, 14000.0, 200.0), rotation=(0.0, 0.0, -100.0))
    table = pd.concat([named(points(COMMANDS)).assign(Station="S1"), named(second).assign(Station="S2")])
    table.to_csv(tmp_path / "both.csv", index=False)
    result = import_survey(tmp_path / "both.csv", MILL, commands=plan)
    assert len(result.imported.survey.table) == 2 * len(COMMANDS)
    assert result.imported.frame == "per-run"
    assert result.imported.proof.rms_um < 20  # errors of 20 um/m over half a metre, and the noise


def test_readings_at_places_far_apart_are_no_dwells() -> None:
    rng = np.random.default_rng(2)
    apart = np.repeat([[0.0, 0, 0], [5000.0, 0, 0]], 40, axis=0)
    assert find_dwells(apart + rng.uniform(-200, 200, apart.shape)) is None
    found = find_dwells(apart + rng.normal(0, NOISE, apart.shape))
    assert found is not None
    assert len(found) == 2


def test_a_unit_that_the_file_states_wrongly_is_named(plan: Path, tmp_path: Path) -> None:
    """Millimetres under a row of units that says metres: the cure is the unit of the numbers, not of what came out."""
    table = named(points(COMMANDS))
    table.columns = pd.Index(["Name", "X", "Y", "Z"])
    table = pd.concat([pd.DataFrame([["", "m", "m", "m"]], columns=table.columns), table])
    table.to_csv(tmp_path / "wrong.csv", index=False, sep=";")
    with pytest.raises(InputError) as error:
        import_survey(tmp_path / "wrong.csv", MILL, commands=plan)
    assert "--units mx=mm,my=mm,mz=mm" in error.value.cure
    right = import_survey(tmp_path / "wrong.csv", MILL, commands=plan, units={"mx": "mm", "my": "mm", "mz": "mm"})
    assert right.imported.proof.rms_um < 20
