"""One cause, one finding: members that move and tilt as a whole, bent guides, tables that act in some runs."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from errormodel.effects.travel import legendre, legendre_slope
from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from identification.diagnosis.pipeline import diagnose
from identification.observation.pose import Pose
from tests.helpers.diagnosed import FRAME, empty_survey, likely, showing
from tests.helpers.findings import made
from tests.helpers.nightly import first_of


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


@pytest.mark.long
def test_a_member_that_moves_and_tilts(machine: Machine, survey: Survey) -> None:
    spec = EffectSpec("structure-drift", {"element": "column", "motion": "all", "sensor": "T_bed", "tau": 1500.0})
    shown = showing(survey, machine, [(spec, [0.003, -0.002, 0.001, 6e-6, -4e-6, 5e-6])], 0.003)
    (finding,) = diagnose(machine, shown).diagnosis.findings
    assert (finding.effect, len(finding.motion)) == ("structure-drift", 6)


@pytest.mark.long
def test_a_member_that_was_colder_than_its_sensor_at_first(machine: Machine, survey: Survey) -> None:
    """A machine that was warming before the first row: the lag does not begin in equilibrium."""
    options = {"element": "head", "motion": "dy", "sensor": "T_bed", "tau": 2500.0, "initial": -4.0}
    shown = showing(survey, machine, [(EffectSpec("structure-drift", options), [0.009])], 0.003)
    result = diagnose(machine, shown).diagnosis
    (finding,) = result.findings
    assert (finding.effect, finding.where) == ("structure-drift", "head")
    assert "colder than T_bed in the first row" in finding.statement
    (parameter,) = finding.parameters
    assert parameter.value == pytest.approx(0.009, abs=0.0015)


def test_without_temperatures_it_warms_up(machine: Machine, survey: Survey) -> None:
    spec = EffectSpec("structure-drift", {"element": "column", "motion": "all", "sensor": "T_bed", "tau": 1500.0})
    shown = showing(survey, machine, [(spec, [0.003, -0.002, 0.001, 6e-6, -4e-6, 5e-6])], 0.003)
    (finding,) = diagnose(machine, replace(shown, table=shown.table.drop(columns="T_bed"))).diagnosis.findings
    assert (finding.effect, len(finding.motion)) == ("warm-up", 6)


@pytest.mark.long
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


@pytest.mark.long
def test_an_instrument_whose_scale_changed(machine: Machine, survey: Survey) -> None:
    station = Pose(Rotation.from_rotvec(FRAME[1]).as_matrix(), np.array(FRAME[0])).invert(np.zeros((1, 3)))[0]
    spec = EffectSpec("scale-ppm", {"run": ("3", "4"), "station": station.tolist()})
    (finding,) = diagnose(machine, showing(survey, machine, [(spec, [2e-5])], 0.003)).diagnosis.findings
    assert (finding.effect, finding.runs) == ("scale-ppm", ["3", "4"])


@pytest.mark.long
def test_a_carriage_that_leaves_a_pad_in_all_motions(machine: Machine, survey: Survey) -> None:
    spec = EffectSpec("contact-knee", {"joint": "X", "motion": "all", "at": 120.0})
    shown = showing(survey, machine, [(spec, [0.02, 0.06, -0.05, 9e-5, 0.0, -6e-5])], 0.003)
    (finding,) = diagnose(machine, shown).diagnosis.findings
    assert (finding.effect, finding.where, len(finding.motion)) == ("contact-knee", "X", 6)
    at = re.search(r", at (\d+) mm", finding.statement)
    assert at is not None
    assert float(at[1]) == pytest.approx(120, abs=25)  # mm: of 1000 mm of travel


@pytest.mark.long
@pytest.mark.parametrize(
    ("word", "place", "name"),
    first_of(
        [
            ("station-shift", "frame", "vertical_three_axis"),
            ("target-offset", "tool", "five_axis_table_quill"),  # only its tables turn
            ("target-offset", "tool", "fork_head_five_axis"),
        ],
        2,
    ),
)
def test_runs_without_a_clock(word: str, place: str, name: str) -> None:
    """What was knocked before the third run, and nothing tells the time: it acts in the third and the fourth."""
    machine = read_machine(name)
    survey = empty_survey(machine, 320, 5, channels=False, grid=False)
    survey = replace(survey, table=survey.table.assign(run=np.repeat(list("1234"), 80)))
    shown = showing(survey, machine, [(EffectSpec(word, {"run": ("3", "4")}), [0.02, -0.015, 0.01])], 0.003)
    (finding,) = diagnose(machine, shown).diagnosis.findings
    assert word in likely(finding)  # a moved instrument turns nothing here: where no axis turns, a target put back
    assert (finding.effect, finding.where) == (word, place) or name == "vertical_three_axis"
    assert finding.runs in (["3", "4"], ["1", "2"])  # of which one is the reference


@pytest.mark.long
def test_a_table_whose_bearing_face_is_not_flat() -> None:
    machine = read_machine("five_axis_table_quill")
    survey = empty_survey(machine, 300, 5, channels=False, grid=False)
    spec = EffectSpec("wobble", {"joint": "B", "harmonic": 2, "axial": True})
    values = [2e-5, -1e-5, 1.5e-5, 1e-5, 0.006, -0.004]
    (finding,) = diagnose(machine, showing(survey, machine, [(spec, values)], 0.003)).diagnosis.findings
    assert (finding.effect, finding.where, set(finding.motion)) == ("wobble", "B", {"ea", "ec", "dy"})


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
        ("contact-knee", {"joint": "X", "motion": "all", "at": 120.0, "tilt": True}, "moves aside in one motion"),
    ],
)
def test_what_has_no_meaning_is_refused(word: str, options: dict[str, object], said: str) -> None:
    with pytest.raises((InputError, ValueError), match=said):
        made(word, **options)


@pytest.mark.long
@pytest.mark.parametrize("motion", [None, "all"])
def test_a_spindle_that_grows_by_its_speed(machine: Machine, survey: Survey, motion: str | None) -> None:
    """No temperature shows how warm it is; its speed was recorded, in steps, and the heat follows it."""
    speed = 1000.0 * np.repeat([0, 6, 2, 9, 0, 7, 12, 3], 40)
    recorded = replace(survey, table=survey.table.drop(columns="T_bed").assign(w_spindle=speed))
    options = {"element": "head", "sensor": "w_spindle", "tau": 900.0} | ({"motion": motion} if motion else {})
    values = [2.5e-6] if motion is None else [1e-6, -1.5e-6, 2.5e-6, 1e-9, -2e-9, 1e-9]
    shown = showing(recorded, machine, [(EffectSpec("spindle-growth", options), values)], 0.003)
    (finding,) = diagnose(machine, shown).diagnosis.findings
    assert (finding.effect, finding.driver) == ("spindle-growth", ["w_spindle"])
    assert len(finding.motion) == (1 if motion is None else 6)
    assert "lag of 1" in finding.statement  # min
    assert " K " not in finding.statement
