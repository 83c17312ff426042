"""A pulley that two joints turn together: it is found without a name, with both periods, and predicted."""

from __future__ import annotations

import math

import pytest

from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.diagnosis.pipeline import diagnose
from tests.helpers.diagnosed import empty_survey, showing

PERIOD = 47.0  # mm


@pytest.mark.long
def test_crossed_belts_are_predicted() -> None:
    """``cos(X - Y) = cos X cos Y + sin X sin Y``: two of the four terms of a wave in both."""
    machine = read_machine("bridge_cmm")
    x, y = (j.name for j in machine.joints[:2])
    fields = {"element": x, "motion": "dx", "driver": x, "by": y, "period": PERIOD, "by_period": PERIOD}
    spec = EffectSpec("unnamed", fields)
    survey = empty_survey(machine, 400, 8, channels=False, grid=False)
    found = diagnose(machine, showing(survey, machine, [(spec, [0.004, 0.0, 0.0, 0.004])], 0.005)).diagnosis
    (finding,) = found.findings
    assert finding.effect == "unnamed"
    assert set(finding.driver) == {x, y}
    assert math.isclose(finding.period or 0.0, PERIOD, rel_tol=0.01)
    assert all(math.isclose(p, PERIOD, rel_tol=0.02) for p in finding.periods)
    assert len(finding.periods) == 2
    assert f"of {x} and" in finding.statement
    assert finding.heldout_rms_um.after < finding.heldout_rms_um.before
    assert found.verdict == "explained"


@pytest.mark.long
def test_a_wave_along_a_diagonal_is_no_line_of_sight() -> None:
    """It looks like an instrument that is worse along its sight, but this does not turn from point to point."""
    machine = read_machine("bridge_cmm")
    x, y = (j.name for j in machine.joints[:2])
    fields = {"element": x, "driver": x, "by": y, "period": PERIOD, "by_period": PERIOD}
    waves = [(EffectSpec("unnamed", {**fields, "motion": m}), [0.006, 0.0, 0.0, 0.006]) for m in ("dx", "dz")]
    survey = empty_survey(machine, 400, 8, channels=False, grid=False)
    diagnosed = diagnose(machine, showing(survey, machine, waves, 0.005))
    found = diagnosed.diagnosis
    sights = [(d.rule, d.outcome) for d in diagnosed.log if d.rule in ("line-of-sight", "one-direction-instead")]
    assert sights[:2] == [("line-of-sight", "found"), ("one-direction-instead", "refused")]
    assert not [n for n in found.notes if "line of sight" in n]
    low, high = found.noise_interval_um
    assert low < 5.0 < high
    (finding,) = found.findings
    assert f"one wave in {finding.driver[0]} - {finding.driver[1]}" in finding.statement
    assert "further term" not in finding.statement  # the second direction refines nothing
