"""Expansion that a recording does not show: predictions at other temperatures state it in their uncertainty."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from identification.diagnosis.pipeline import diagnose
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit
from identification.results.predictions import predicted
from identification.results.store import load, save
from identification.uncertainty.prediction import notes
from tests.helpers.commands import MILL
from tests.helpers.diagnosed import empty_survey, showing

ROWS = 200
MACHINE = read_machine(MILL)
GROWTH = EffectSpec("scale-expansion", {"joint": "X", "sensor": "T_bed"})
COURSES = {
    "constant": np.full(ROWS, 20.0),
    "once along X": np.linspace(20, 24, ROWS),
    "to and fro": 22 + 2 * np.sin(np.linspace(0, 9, ROWS)),
}


def surveyed(course: str, expansion: float) -> Survey:
    survey = empty_survey(MACHINE, ROWS, 3, channels=False, grid=False)
    table = survey.table.sort_values("X", ignore_index=True) if "once" in course else survey.table
    table = table.assign(time=np.linspace(0, 3600, ROWS), T_bed=COURSES[course].round(2))
    return showing(replace(survey, table=table), MACHINE, [(GROWTH, [expansion])], 0.002, 3)


def stated(fit: Fit, folder: Path, expansion: float, kelvin: float) -> tuple[pd.DataFrame, str]:
    """Predictions (um) of rows warmer than the middle of the recording: ``x`` and ``ux`` along X, and the notes."""
    points = empty_survey(MACHINE, 100, 50, channels=False, grid=False)
    warm = points.table.assign(time=np.linspace(7200, 9000, 100), T_bed=22 + kelvin)
    points = showing(replace(points, table=warm), MACHINE, [(GROWTH, [expansion])], 0.0, 3)
    save(fit, folder)
    known = load(folder)
    table = predicted(known, points)
    wrong = table["mx"] - points.table["mx"]
    return 1e3 * pd.DataFrame({"wrong": wrong, "u": table["ux"]}), " ".join(notes(known, points))


@pytest.mark.parametrize("course", ["constant", "once along X"])
def test_a_recording_that_does_not_show_it(course: str, tmp_path: Path) -> None:
    """As much as steel expands is within two standard uncertainties, which grow with the distance in temperature."""
    survey = surveyed(course, 11e-6)
    found = diagnose(MACHINE, survey)
    assert not found.diagnosis.findings
    table, said = stated(found.final, tmp_path / "far", 11e-6, 8.0)
    assert np.abs(table["wrong"]).max() > 20  # um
    assert (np.abs(table["wrong"]) < 2 * table["u"]).mean() > 0.9
    assert "the expansion of X, Y, Z that it may cause is in the uncertainty" in said
    nearer, _ = stated(found.final, tmp_path / "near", 11e-6, 1.5)
    assert nearer["u"].max() < table["u"].max() / 2
    plain, _ = stated(fit_machine(MACHINE, survey), tmp_path / "plain", 11e-6, 8.0)
    assert plain["u"].max() == pytest.approx(table["u"].max(), rel=0.5)


def test_a_recording_that_shows_none(tmp_path: Path) -> None:
    """Along an axis that moved to and fro while the temperature did, hardly any is left possible."""
    found = diagnose(MACHINE, surveyed("to and fro", 0.0))
    assert not found.diagnosis.findings
    assert found.final.expansions is not None
    assert found.final.expansions["X"]["T_bed"] < 1e-6
    table, _ = stated(found.final, tmp_path, 0.0, 8.0)
    assert (np.abs(table["wrong"]) < 2 * table["u"]).all()
    assert table["u"].max() < 6  # um; 30 with what scales have at most


def test_what_was_found_is_not_open(tmp_path: Path) -> None:
    """A growth in the model is known as well as its parameter is; a row without a temperature states none."""
    found = diagnose(MACHINE, surveyed("to and fro", 11e-6))
    assert [f.effect for f in found.diagnosis.findings] == ["scale-expansion"]
    assert found.final.expansions is not None
    assert "X" not in found.final.expansions
    table, _ = stated(found.final, tmp_path / "warm", 11e-6, 8.0)
    assert (np.abs(table["wrong"]) < 2 * table["u"]).mean() > 0.9
    assert table["u"].max() < 8  # um
