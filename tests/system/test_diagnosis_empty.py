"""Surveys with nothing in them but geometry and white noise: the diagnosis stays quiet, whatever channels there are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import identification
from errormodel import simulate
from errormodel.exceptions import InputError
from errormodel.machine_file import read_machine
from identification.diagnosis.pipeline import diagnose
from tests.helpers.diagnosed import empty_survey
from tests.helpers.nightly import first_of


def test_rows_without_any_reading_are_refused() -> None:
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 20, 1, channels=False, grid=False)
    table = survey.table.assign(joint="X", dx=np.nan, mx=np.nan, my=np.nan, mz=np.nan)
    with pytest.raises(InputError, match="no row to fit has a measured position, reading or error motion"):
        diagnose(machine, replace(survey, table=table))
    with pytest.raises(InputError, match="no row to fit has a measured position, reading or error motion"):
        diagnose(machine, replace(survey, table=table.assign(dx=0.0)))  # what never changes


MACHINES = ("vertical_three_axis", "bridge_cmm", "horizontal_three_axis", "h_gantry_dual_drive")
SURVEYS = ((True, False), (False, False), (True, True))  # with channels, on a grid


@pytest.mark.parametrize(
    ("name", "channels", "grid", "few"),
    first_of([(name, *kind, (i + j) % 2 == 0) for i, name in enumerate(MACHINES) for j, kind in enumerate(SURVEYS)], 3),
)
def test_nothing_is_found_where_nothing_is(name: str, channels: bool, grid: bool, few: bool) -> None:
    """Few rows and many in turn: each machine and each kind of survey has both."""
    machine = read_machine(name)
    seed, rows = (1, 150) if few else (2, 400)
    diagnosis = diagnose(machine, empty_survey(machine, rows, seed, channels=channels, grid=grid)).diagnosis
    assert diagnosis.verdict == "adequate", [f.statement for f in diagnosis.findings]
    assert not diagnosis.findings
    assert diagnosis.noise_um == pytest.approx(5.0, rel=0.12)


@pytest.mark.parametrize("repeats", first_of([1, 5]))
def test_a_simulation_without_noise_has_nothing_in_it(repeats: int) -> None:
    """Rounding errors are neither a tracker's noise nor effects, of which there would be no end."""
    once = simulate("vertical_three_axis", 120 // repeats)
    result = identification.diagnose("vertical_three_axis", pd.concat([once] * repeats, ignore_index=True))
    assert result.verdict == "adequate"
    assert result.findings.empty
