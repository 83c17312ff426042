"""A name beside which a function without a name explains as much is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from errormodel.arrays import Array
from errormodel.effects import make
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.results import nameless_alternative
from identification.diagnosis.results.findings import Finding, HeldOut
from identification.diagnosis.results.nameless_alternative import checked_alternative, refusal
from identification.diagnosis.results.recorded_functions import in_one_motion, recorded
from identification.diagnosis.search.model import of_groups
from identification.diagnosis.search.scoring import Step
from identification.estimation.fit import fit_machine
from tests.helpers.diagnosed import empty_survey, showing
from tests.helpers.findings import made

FIELDS: dict[str, object] = {"element": "column", "motion": "dy", "sensor": "T_0"}
DRIFT, LATER = made("structure-drift", **FIELDS), made("structure-drift", **FIELDS | {"tau": 2000.0})
SAID = Finding("structure-drift", "column", "It moves.", 0.98, 1e-9, HeldOut(10.0, 8.0), "again", driver=["T_0"])


def warm(time: Array) -> Array:
    return np.asarray(3 * np.sin(time / 900))


def wandering(time: Array) -> Array:
    """As the temperature does in half of what it is, and as an hour that nothing recorded else."""
    return np.asarray(1.5 * np.sin(time / 900) + np.cumsum(np.random.default_rng(4).normal(0, 0.4, len(time))))


@pytest.mark.parametrize(("cause", "named"), [(warm, True), (wandering, False)])
def test_a_name_stands_where_no_function_explains_as_much(cause: object, named: bool) -> None:
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 200, 7, channels=True, grid=False)
    time = survey.table["time"].to_numpy()
    assert callable(cause)
    caused = replace(survey, table=survey.table.assign(T_0=cause(time)))
    moved = showing(caused, machine, [(EffectSpec("structure-drift", FIELDS), [0.006])], 0.003)
    shown = replace(moved, table=moved.table.assign(T_0=warm(time)))
    linear = set_up(fit_machine(machine, shown))
    log = DecisionLog()
    model = of_groups(linear, [[Step(DRIFT, 100.0, 200.0, 0.0)]])
    found = checked_alternative(SAID, model, model.findings[0], recorded(linear, np.unique(linear.index)), log)
    assert (found.effect == "structure-drift") == named
    (*_, decision) = log
    assert (decision.rule, decision.outcome) == ("nameless-alternative", "kept" if named else "refused")
    if not named:
        assert "a function without a name explains as much (dy of " in found.statement
        assert SAID.statement in found.statement


@pytest.mark.parametrize("kept", [0.8, 0.95])
def test_noise_that_is_correlated_from_row_to_row_takes_no_name(kept: float) -> None:
    """It follows the clock, which explains more of the rows than a servo lag does, and nothing of the lag."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 400, 7, channels=True, grid=False)
    spec = EffectSpec("servo-lag", {"joint": "X"})
    shown = showing(survey, machine, [(spec, [4e-5])], 0.003)
    rng, steps = np.random.default_rng(2), np.sqrt(1 - kept**2) * 0.008
    slow = lfilter([steps], [1, -kept], rng.normal(size=(3, len(survey))))
    moved = shown.table.assign(**{c: shown.table[c] + d for c, d in zip(("mx", "my", "mz"), slow, strict=True)})
    linear = set_up(fit_machine(machine, replace(shown, table=moved)))
    model, log = of_groups(linear, [[Step(make(spec), 100.0, 200.0, 0.0)]]), DecisionLog()
    assert refusal(model, model.findings[0], recorded(linear, np.unique(linear.index)), log) is None
    assert [(d.rule, d.outcome) for d in log] == [("nameless-alternative", "kept")]


def test_a_second_lag_is_of_the_name() -> None:
    """What the air does at once and the bed later needs both lags to stand beside a function of the clock."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 200, 7, channels=True, grid=False)
    sizes = {0.0: 0.01, 2e3: -0.03}
    specs = [(EffectSpec("structure-drift", FIELDS | {"tau": tau}), [size]) for tau, size in sizes.items()]
    linear = set_up(fit_machine(machine, showing(survey, machine, specs, 0.003)))
    outcomes = []
    for steps in ([DRIFT], [DRIFT, LATER]):
        log, group = DecisionLog(), [Step(e, 100.0, 200.0, 0.0) for e in steps]
        model = of_groups(linear, [group])
        checked_alternative(SAID, model, model.findings[0], recorded(linear, np.unique(linear.index)), log)
        outcomes.append([(d.rule, d.outcome) for d in log])
    assert outcomes[0] == [("remainder-of-name", "refused")]
    assert outcomes[1] == [("nameless-alternative", "kept")]


def test_a_form_that_only_follows_the_clock_is_no_temperature() -> None:
    """Where the motion wanders by itself, a function of the clock has more evidence than any lag of a sensor."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 200, 7, channels=True, grid=False)
    moved = showing(survey, machine, [(EffectSpec("structure-drift", FIELDS), [0.01])], 0.003)
    linear = set_up(fit_machine(machine, moved))
    other = Step(made("structure-drift", **FIELDS | {"sensor": "T_1"}), 100.0, 200.0, 0.0)
    model = of_groups(linear, [[other]])
    found = checked_alternative(SAID, model, [other], recorded(linear, np.unique(linear.index)), log := DecisionLog())
    assert found.effect == "unnamed"
    assert {d.outcome for d in log} == {"refused"}


@pytest.mark.parametrize(("shift", "named"), [((0.02, -0.012, 0.015), True), ((0.02, 0.0, 0.0), False)])
def test_a_step_of_one_motion_is_no_station_that_moved(shift: tuple[float, ...], named: bool) -> None:
    """A station that is knocked moves in all directions; a member that sits otherwise from then on, in one."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 200, 7, channels=True, grid=False)
    fields = {"at": float(survey.table["time"].iloc[90]), "turned": False}
    linear = set_up(
        fit_machine(machine, showing(survey, machine, [(EffectSpec("station-shift", fields), shift)], 0.003))
    )
    model = of_groups(linear, [[Step(made("station-shift", **fields), 100.0, 200.0, 0.0)]])
    said, functions = replace(SAID, effect="station-shift", where="frame"), recorded(linear, np.unique(linear.index))
    found = checked_alternative(said, model, model.findings[0], functions, DecisionLog())
    assert (found.effect == "station-shift") == named
    assert ("explains as much (dx of " in found.statement) != named


def test_what_is_the_same_in_all_rows_follows_nothing() -> None:
    """A target that lies elsewhere in all rows moves in several directions alike, and has no course."""
    machine = read_machine("vertical_three_axis")
    linear = set_up(fit_machine(machine, empty_survey(machine, 60, 7, channels=True, grid=False)))
    assert in_one_motion(linear, [made("target-offset")]) == []
    assert in_one_motion(linear, [made("station-shift", at=1000.0, turned=False)])


def knee(motion: str, at: float) -> Step:
    return Step(made("contact-knee", joint="X", motion=motion, at=at), 100.0, 200.0, 0.0)


def test_a_contact_may_push_in_several_directions() -> None:
    """Where about it begins is found for each by itself."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 240, 9, channels=False, grid=False)
    fields = [("dy", 210.0), ("dz", 220.0)]
    specs = [(EffectSpec("contact-knee", {"joint": "X", "motion": m, "at": at}), [0.08]) for m, at in fields]
    linear = set_up(fit_machine(machine, showing(survey, machine, specs, 0.002)))
    model = of_groups(linear, [[knee(*own) for own in fields]])
    said = replace(SAID, effect="contact-knee", where="X", driver=["X"])
    found = checked_alternative(
        said, model, model.findings[0], recorded(linear, np.unique(linear.index)), DecisionLog()
    )
    assert found.effect == "contact-knee"


def test_a_name_that_is_less_likely_than_not_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(nameless_alternative, "probability_of", lambda step: 0.49)
    log, step = DecisionLog(), Step(DRIFT, 110.0, 200.0, 0.0)
    found = checked_alternative(SAID, None, [step], [], log)  # type: ignore[arg-type]  # the model is not asked
    assert (found.effect, [(d.rule, d.outcome) for d in log]) == ("unnamed", [("unlikely-name", "refused")])
    assert found.probability > 0.95  # that there is an effect; that of its name is the first alternative's
    assert found.alternatives[0].probability == SAID.probability
