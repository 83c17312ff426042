"""A gauge of the opposite sign beside an interferometer's error motions: the scale may differ, and a bend may not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.exceptions import InputError
from errormodel.machine_file import read_machine
from errormodel.survey import Survey, read_survey
from identification.diagnosis.data_checks.gate import passed
from identification.diagnosis.results.verdict import judge
from identification.estimation.checks import contradictions
from identification.estimation.fit import fit_machine

MACHINE = read_machine("vertical_three_axis")
NOISE = 3e-4  # mm


def recorded(folder: Path, sign: float, bend: float) -> Survey:
    """Positions of Y by an interferometer, its pitch, and a gauge along it; of a scale and a bend (mm at the end)."""
    rng = np.random.default_rng(3)

    def error(y: np.ndarray) -> np.ndarray:
        return 12e-6 * y + bend * (y / 200.0) ** 2

    at = np.tile(np.linspace(-200, 200, 21), 4)
    dy = error(at) + rng.normal(0, NOISE, len(at))
    line = pd.DataFrame({"Y": at, "joint": "Y", "dy": dy, "ea": rng.normal(0, 2e-7, len(at))})
    start, end = np.full(40, -200.0), np.tile(np.linspace(-180, 200, 20), 2)
    away = sign * (error(end) - error(start))
    gauge = pd.DataFrame({"X": 0.0, "Y": end, "Z": 300.0, "from_X": 0.0, "from_Y": start, "from_Z": 300.0})
    gauge["length"] = end - start + away + rng.normal(0, NOISE, len(end))
    line.to_csv(folder / "line.csv", index=False)
    gauge.assign(observation="gauge").to_csv(folder / "gauge.csv", index=False)
    (folder / "survey.yaml").write_text(
        "errormodel: 1\nfiles: [{path: line.csv}, {path: gauge.csv}]\nobservations: {gauge: {type: pose-distance}}\n"
    )
    return read_survey(folder, MACHINE)


def test_a_scale_of_the_opposite_sign_is_a_note_and_not_adequate(tmp_path: Path) -> None:
    """The machine may have been warmer, so that the sign is not known to be wrong: that both disagree is."""
    survey = recorded(tmp_path, -1.0, 0.0)
    fit = passed(MACHINE, survey, lambda: fit_machine(MACHINE, survey))
    (note,) = (n for n in fit.notes if "fit the machine without errors better" in n)
    assert note.startswith("readings of EAY ")  # the pitch, read as 0 all along, has to make up for the scale
    verdict = judge(fit, False)
    assert verdict.word == "unexplained"
    assert note in (verdict.unexplained or "")


@pytest.mark.parametrize("bend", [0.0, 0.004])
def test_a_right_gauge_has_no_note(tmp_path: Path, bend: float) -> None:
    survey = recorded(tmp_path, 1.0, bend)
    fit = passed(MACHINE, survey, lambda: fit_machine(MACHINE, survey))
    assert list(contradictions(fit)) == []
    assert judge(fit, False).word == "adequate"


def test_a_bend_of_the_opposite_sign_is_refused(tmp_path: Path) -> None:
    survey = recorded(tmp_path, -1.0, 0.004)
    with pytest.raises(InputError, match="readings of observation gauge contradict the rest of the survey"):
        passed(MACHINE, survey, lambda: fit_machine(MACHINE, survey))
