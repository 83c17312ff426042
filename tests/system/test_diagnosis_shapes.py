"""One cause, one finding: members that move and tilt as a whole, bent guides, tables that act in some runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from errormodel.effects.travel import legendre, legendre_slope
from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from identification.diagnosis.pipeline import diagnose
from tests.helpers.diagnosed import empty_survey, showing
from tests.helpers.findings import made


@pytest.fixture(scope="module")
def machine() -> Machine:
    return read_machine("vertical_three_axis")


@pytest.fixture(scope="module")
def survey(machine: Machine) -> Survey:
    """Four runs, and a bed that warms up."""
    survey = empty_survey(machine, 320, 5, channels=False, grid=False)
    time = 40.0 * np.arange(320)
    bed = 20 + 6 * (1 - np.exp(-time / 3000)) + np.random.default_rng(2).normal(0, 0.03, 320)
    return replace(survey, table=survey.table.assign(time=time, T_bed=bed, run=np.repeat(list("1234"), 80)))


def test_a_member_that_moves_and_tilts(machine: Machine, survey: Survey) -> None:
    spec = EffectSpec("structure-drift", {"element": "column", "motion": "all", "sensor": "T_bed", "tau": 1500.0})
    shown = showing(survey, machine, [(spec, [0.003, -0.002, 0.001, 6e-6, -4e-6, 5e-6])], 0.003)
    (finding,) = diagnose(machine, shown).diagnosis.findings
    assert (finding.effect, len(finding.motion)) == ("structure-drift", 6)


def test_without_temperatures_it_warms_up(machine: Machine, survey: Survey) -> None:
    spec = EffectSpec("structure-drift", {"element": "column", "motion": "all", "sensor": "T_bed", "tau": 1500.0})
    shown = showing(survey, machine, [(spec, [0.003, -0.002, 0.001, 6e-6, -4e-6, 5e-6])], 0.003)
    (finding,) = diagnose(machine, replace(shown, table=shown.table.drop(columns="T_bed"))).diagnosis.findings
    assert (finding.effect, len(finding.motion)) == ("warm-up", 6)


def test_a_bent_guide(machine: Machine, survey: Survey) -> None:
    spec = EffectSpec("higher-order-geometry", {"joint": "X", "motion": "dz", "degrees": (3, 4), "slope": True})
    (finding,) = diagnose(machine, showing(survey, machine, [(spec, [0.012, 0.008])], 0.003)).diagnosis.findings
    assert (finding.effect, finding.where, set(finding.motion)) == ("higher-order-geometry", "X", {"dz", "eb"})


def test_a_table_that_is_on_in_some_runs(machine: Machine, survey: Survey) -> None:
    spec = EffectSpec("compensation-active", {"joint": "X", "points": 9, "run": ("2", "3")})
    values = [0.0, 0.008, 0.011, 0.003, -0.006, -0.01, -0.002, 0.007, 0.004]
    (finding,) = diagnose(machine, showing(survey, machine, [(spec, values)], 0.003)).diagnosis.findings
    assert (finding.effect, finding.where) == ("compensation-active", "X")
    assert finding.runs == ["2", "3"]


@pytest.mark.parametrize("degree", range(1, 9))
def test_slopes_of_polynomials(degree: int) -> None:
    u = np.linspace(-1, 1, 9)
    by_steps = (legendre(degree, u + 1e-6) - legendre(degree, u - 1e-6)) / 2e-6
    np.testing.assert_allclose(legendre_slope(degree, u), by_steps, atol=1e-7)


@pytest.mark.parametrize(
    ("word", "options", "said"),
    [
        ("higher-order-geometry", {"joint": "X", "motion": "ea", "slope": True}, "a slope is that of a straightness"),
        ("structure-drift", {"element": "T1", "motion": "all", "sensor": "T_bed", "order": 1}, "one motion"),
    ],
)
def test_what_has_no_meaning_is_refused(word: str, options: dict[str, object], said: str) -> None:
    with pytest.raises((InputError, ValueError), match=said):
        made(word, **options)
