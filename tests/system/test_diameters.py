"""Diameters that stand for radii in some rows, and a mistake that is none of the usual ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from errormodel.exceptions import InputError
from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from identification.diagnosis.pipeline import diagnose
from tests.helpers.diagnosed import empty_survey

HERE = slice(60, 130)


def with_scaled(factor: float) -> Survey:
    """A sound survey of a machine, in some rows of which X is written as so many times what it was."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 180, 5, channels=False, grid=False)
    table = survey.table.copy()
    table.loc[table.index[HERE], "X"] *= factor
    return replace(survey, table=table)


def test_a_program_that_wrote_diameters_is_put_right() -> None:
    machine = read_machine("vertical_three_axis")
    diagnosis = diagnose(machine, with_scaled(2.0)).diagnosis
    (found,) = diagnosis.findings
    assert (found.effect, found.where, found.driver) == ("axis-blunder", "X", [])
    assert "olumn X has diameters for radii: it must be multiplied by 0.5 in rows 61 to 130" in found.statement
    assert found.rows == list(range(61, 131))
    assert diagnosis.verdict == "explained"


@pytest.mark.long
def test_what_no_mistake_explains_is_not_called_physics() -> None:
    """A scale of 1.6 in some rows is no error of a machine, and no mistake that anyone makes: it is refused."""
    machine = read_machine("vertical_three_axis")
    with pytest.raises(InputError, match=r"this is not the machine that was measured.*do not put it right"):
        diagnose(machine, with_scaled(1.6))
    assert np.isfinite(diagnose(machine, with_scaled(1.0)).diagnosis.noise_um)
