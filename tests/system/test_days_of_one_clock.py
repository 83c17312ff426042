"""Recordings of several days whose clock ran on over the nights between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from errormodel.effects.shared import lags, settling_times
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.pipeline import diagnose
from identification.estimation.fit import fit_machine
from tests.helpers.diagnosed import empty_survey, showing

MACHINE = read_machine("vertical_three_axis")
DAY = 3 * 3600.0  # s of work
GAPS = [21 * 3600.0, 3 * 24 * 3600.0, 100 * 24 * 3600.0]  # s


@pytest.mark.parametrize("gap", GAPS)
def test_time_constants_are_tried_down_to_those_of_one_day(gap: float) -> None:
    survey = empty_survey(MACHINE, 180, 5, channels=True, grid=False)
    time = np.linspace(0, DAY, len(survey.table))
    days = replace(survey, table=survey.table.assign(time=np.where(time > DAY * 2 / 3, time + gap, time)))
    one, two = (
        set_up(fit_machine(MACHINE, s)).scene for s in (replace(survey, table=survey.table.assign(time=time)), days)
    )
    for times in (lags, settling_times):
        assert times(two)[-1] == pytest.approx(times(one)[-1], rel=0.3)
        assert max(times(two)) == pytest.approx(max(times(one)) * (DAY + gap) / DAY, rel=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("gap", GAPS)
def test_the_lag_of_a_spindle_is_found_over_nights(gap: float) -> None:
    survey = empty_survey(MACHINE, 180, 7, channels=True, grid=False)
    time = np.linspace(0, DAY, len(survey.table))
    second = time > DAY * 2 / 3
    since = np.where(second, time - DAY * 2 / 3, time)
    rng = np.random.default_rng(2)
    warm = 22 + 10 * (1 - np.exp(-since / 900)) * (since % 4000 < 2500) + rng.normal(0, 0.05, len(time))
    table = survey.table.assign(time=np.where(second, time + gap, time), T_spindle=warm)
    spec = EffectSpec("structure-drift", {"element": "head", "motion": "dy", "sensor": "T_spindle", "tau": 1500.0})
    shown = showing(replace(survey, table=table), MACHINE, [(spec, [0.004])], 0.002)
    (finding,) = diagnose(MACHINE, shown).diagnosis.findings
    assert finding.effect in ("structure-drift", "spindle-growth")
    (tau,) = finding.time_constants
    assert abs(tau.value - 1500) < 3 * tau.std
    (growth,) = finding.parameters
    assert abs(abs(growth.value) - 0.004) < 3 * growth.std
