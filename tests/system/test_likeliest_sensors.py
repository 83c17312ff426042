"""Of sensors that warmed alike a finding follows the likeliest, also from another state in the first row."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from errormodel.effects import make
from errormodel.effects.base import Effect
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.pipeline import diagnose
from identification.diagnosis.search import likeliest_sensors
from identification.diagnosis.search.candidates import Candidates
from identification.diagnosis.search.model import EffectModel, of_groups
from identification.diagnosis.search.other_lags import SELDOM
from identification.diagnosis.search.scoring import Step
from identification.estimation.fit import fit_machine
from tests.helpers.diagnosed import empty_survey, showing
from tests.helpers.nightly import first_of

ROWS = 360


@pytest.fixture(scope="module")
def survey() -> Survey:
    """Two hours in which three members warm alike, which had been warming before."""
    time = 20.0 * np.arange(ROWS)
    rng = np.random.default_rng(4)
    courses = {
        "T_scale": 21 + 3.2 * (1 - np.exp(-(time + 1800) / 3600)) + 0.3 * np.sin(time / 1100),
        "T_beam": 22 + 2.6 * (1 - np.exp(-(time + 1500) / 2700)),
        "T_motor": 26 + 4.0 * (1 - np.exp(-(time + 1200) / 1500)),
    }
    survey = empty_survey(read_machine("vertical_three_axis"), ROWS, 5, channels=False, grid=False)
    noisy = {name: values + rng.normal(0, 0.03, ROWS) for name, values in courses.items()}
    return replace(survey, table=survey.table.assign(time=time, **noisy))


@pytest.mark.long
@pytest.mark.parametrize("initial", first_of([-1.5, 0.0, -3.0]))
def test_no_other_sensor_is_likelier(survey: Survey, initial: float) -> None:
    """Which of them it is these data hardly tell: the true one is taken, or said to be as likely."""
    machine = read_machine("vertical_three_axis")
    options = {"joint": "X", "sensor": "T_scale", "tau": 1500.0, "initial": initial}
    shown = showing(survey, machine, [(EffectSpec("scale-expansion", options), [2.5e-5])], 0.003)
    found = diagnose(machine, shown)
    (finding,) = found.diagnosis.findings
    assert (finding.effect, finding.where, len(finding.driver)) == ("scale-expansion", "X", 1)
    others = dict[str, float]()
    for other in found.final.others:
        for sensor in other.sensors:
            others[sensor] = others.get(sensor, 0.0) + other.weight
    assert max(others.values()) <= 1 - sum(others.values()) + SELDOM * len(found.final.others)
    assert finding.driver == ["T_scale"] or others["T_scale"] > 0.05


def test_a_finding_is_judged_in_the_model_that_the_one_before_it_left(
    survey: Survey, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first of two gives up its second sensor, and the steps of the other one are numbered anew."""
    machine = read_machine("vertical_three_axis")
    linear = set_up(fit_machine(machine, showing(survey, machine, [], 0.003)))

    def step(joint: str, sensor: str) -> Step:
        spec = EffectSpec("scale-expansion", {"joint": joint, "sensor": sensor, "tau": 900.0})
        return Step(make(spec), 0.0, 0.0, 0.0)

    model = of_groups(linear, [[step(joint, sensor) for sensor in ("T_scale", "T_motor")] for joint in ("X", "Y")])
    judged = []

    def own_sensor(model: EffectModel, main: Step, further: list[Step], *_: object) -> Effect:
        judged.append([step in model.steps for step in (main, *further)])
        return main.effect

    monkeypatch.setattr(likeliest_sensors, "_likeliest", own_sensor)
    monkeypatch.setattr(likeliest_sensors, "NO_WORSE", np.inf)
    monkeypatch.setattr(likeliest_sensors, "conditional_scores", lambda model, *_: model)
    out = likeliest_sensors.with_likeliest_sensors(model, Candidates.of(linear, []))
    assert judged == [[True, True], [True, True]]
    assert [s.effect for s in out.steps] == [model.steps[0].effect, model.steps[2].effect]


@pytest.mark.long
@pytest.mark.parametrize("initial", [-3.0, 3.0])
def test_a_member_on_its_way_elsewhere_follows_its_sensor(initial: float) -> None:
    """In equilibrium no lag fits where a member was much colder or warmer than its sensor at first."""
    time = 20.0 * np.arange(ROWS)
    rng = np.random.default_rng(7)
    bed = 17.6 - 0.5 * np.sin(time / 1400) + 4.0 * (time / time.max()) ** 2
    coolant = 23 + 1.5 * np.sin(time / 800) + 2 * time / time.max()
    noisy = {"T_bed": bed, "T_coolant": coolant}
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, ROWS, 5, channels=False, grid=False)
    table = survey.table.assign(time=time, **{n: v + rng.normal(0, 0.03, ROWS) for n, v in noisy.items()})
    options = {"joint": "X", "sensor": "T_bed", "tau": 3000.0, "initial": initial}
    shown = showing(replace(survey, table=table), machine, [(EffectSpec("scale-expansion", options), [2.5e-5])], 0.003)
    (finding,) = diagnose(machine, shown).diagnosis.findings
    assert (finding.effect, finding.where, finding.driver) == ("scale-expansion", "X", ["T_bed"])
    (expansion,) = finding.parameters
    assert expansion.value == pytest.approx(2.5e-5, abs=3 * expansion.std)
