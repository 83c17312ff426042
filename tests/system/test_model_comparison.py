"""Whole explanations weighed beside each other, and surfaces over two joints that turn."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import casadi as ca
import numpy as np
import pytest

from errormodel.effects import make
from errormodel.effects.unnamed import Unnamed, switch
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.diagnosis.decisions.constants import LEAST_EVIDENCE
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.pipeline import diagnose
from identification.diagnosis.results.findings import probability_of
from identification.diagnosis.search.candidates import Candidates
from identification.diagnosis.search.conditional_evidence import conditional_scores
from identification.diagnosis.search.forward_selection import forward_select, reselect
from identification.diagnosis.search.model import EffectModel, replayed
from identification.diagnosis.search.model_comparison import compare_alternatives, empirical_evidence
from identification.diagnosis.search.scoring import DECIMALS, DETECT, Step, posterior
from identification.diagnosis.search.shape_fit import optimise_shapes, scored
from identification.diagnosis.search.whole_models import Whole, weighed_as_whole, with_likelier_names
from identification.estimation.fit import fit_machine
from tests.helpers.diagnosed import empty_survey, showing
from tests.helpers.nightly import first_of


def test_a_story_gains_by_what_is_there_and_loses_by_what_is_not() -> None:
    """Warmth moves the carriage; a play that it does not have is one place more that was looked at."""
    machine = read_machine("bridge_cmm")
    survey = empty_survey(machine, 400, 11, channels=True, grid=False)
    truth = EffectSpec("structure-drift", {"element": "carriage", "motion": "dx", "sensor": "T_0"})
    linear = set_up(fit_machine(machine, showing(survey, machine, [(truth, [0.005])], 0.003)))

    def told(*specs: EffectSpec) -> float:
        return replayed(linear, [Step(make(s), 0.0, 0.0, 0.0, names=1000) for s in specs]).log_posterior

    play = EffectSpec("backlash", {"joint": "X"})
    assert told() == 0
    assert told(truth) > 50
    assert told(play) < 0
    assert told(truth, play) < told(truth)


def test_of_two_models_alike_the_one_whose_effect_has_fewer_places_is_likelier() -> None:
    machine = read_machine("bridge_cmm")
    linear = set_up(fit_machine(machine, empty_survey(machine, 200, 3, channels=False, grid=False)))
    play = make(EffectSpec("backlash", {"joint": "X"}))
    few, many = (replayed(linear, [Step(play, 0.0, 0.0, 0.0, names=40, places=n)]).log_posterior for n in (3, 60))
    assert few - many == pytest.approx(np.log(20), abs=10.0**-DECIMALS)  # to which both are rounded


def test_two_axes_that_one_temperature_expands_differently_are_both_named() -> None:
    """One by one a drift of the frame and a scale of the tracker explain more than either axis."""
    machine = read_machine("bridge_cmm")
    survey = empty_survey(machine, 160, 7, channels=True, grid=False)
    axes = [EffectSpec("scale-expansion", {"joint": j, "sensor": "T_0"}) for j in "XY"]
    found = diagnose(machine, showing(survey, machine, list(zip(axes, ([1.1e-5], [9e-6]), strict=True)), 8e-4))
    assert {(f.effect, f.where) for f in found.diagnosis.findings} == {("scale-expansion", j) for j in "XY"}


@pytest.mark.long
def test_a_spindle_that_also_moves_aside_is_one_finding() -> None:
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 400, 5, channels=True, grid=False)
    survey = replace(survey, table=survey.table.rename(columns={"T_0": "T_spindle"}))
    both = [EffectSpec("spindle-growth", {"sensor": "T_spindle", **more}) for more in ({}, {"motion": "dx"})]
    shown = list(zip(both, ([0.012], [0.005]), strict=True))
    result = diagnose(machine, showing(survey, machine, shown, 0.003))
    (finding,) = result.diagnosis.findings
    assert finding.effect == "spindle-growth"
    assert {"dx", "dz"} <= {*finding.motion}


def test_a_refinement_that_is_what_the_finding_should_be_called() -> None:
    """A head that drifts, first taken for air that bends the beam: of the two only the one remains."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 400, 5, channels=True, grid=False)
    spec = EffectSpec("structure-drift", {"element": "head", "motion": "dz", "sensor": "T_0"})
    linear = set_up(fit_machine(machine, showing(survey, machine, [(spec, [0.02])], 0.003)))
    candidates = Candidates.of(linear)
    ranked = candidates.scores(linear).by_key()
    air = next(e for _, n in ranked if (e := candidates.effects[n]).effect == "refraction")
    places, drift = candidates.places, make(spec)  # each effect with its prior probability, as a search has them
    first = Step(air, 50.0, 100.0, 0.5, names=len(places), places=places[air.effect])
    taken = [first, replace(first, effect=drift, places=places[drift.effect], parent=0)]
    looked = reselect(replayed(linear, taken), candidates)
    assert [s.effect.effect for s in looked.steps] == ["structure-drift"]
    assert reselect(looked, candidates).steps[0].effect.key == looked.steps[0].effect.key


def test_findings_are_weighed_beside_each_other() -> None:
    """What one was worth before the other was known, and its rivals then, are forgotten."""
    machine = read_machine("bridge_cmm")
    survey = empty_survey(machine, 400, 11, channels=True, grid=False)
    specs = (
        EffectSpec("structure-drift", {"element": "carriage", "motion": "dx", "sensor": "T_0"}),
        EffectSpec("backlash", {"joint": "X"}),
    )
    effects = list(zip(specs, ([0.006], [0.004]), strict=True))
    linear = set_up(fit_machine(machine, showing(survey, machine, effects, 0.003)))
    candidates = Candidates.of(linear)
    drift, play = map(make, specs)
    stale = Step(play, 1e4, 100.0, 0.1, evidence_of_form=300.0, alternatives=(Step(drift, 1e5, 1.0, 0.1),))
    weighed = conditional_scores(replayed(linear, [Step(drift, 1e4, 100.0, 0.1), stale]), candidates)
    for step, other in zip(weighed.steps, (play, drift), strict=True):
        beside = linear.with_effect(other)
        [alone] = Candidates.of(beside, [step.effect]).scores(beside).evidence
        assert alone - 5 < step.evidence < alone + 25  # less for its shapes, more for a bend
        assert step.evidence_of_form < 25
        assert 0 < max(r.evidence for r in step.alternatives) < 1e3
        assert step.effect.key not in {r.effect.key for r in step.alternatives}
    [lone] = conditional_scores(replayed(linear, [stale]), candidates).steps
    assert 0 < lone.evidence < 1e3
    form = Unnamed(element="carriage", motion="dx", driver="T_0", center=21.0, half_range=2.0)
    named_after_its_form = [Step(form, 1.0, 1.0, 0.1), Step(play, 1.0, 1.0, 0.1, parent=0)]
    [main, _] = conditional_scores(replayed(linear, named_after_its_form), candidates).steps
    [alone] = Candidates.of(linear, [form]).scores(linear).evidence
    assert main.evidence > alone + 30  # with the play, which is part of it
    assert probability_of(main) > 0.9


@pytest.mark.long
def test_what_looked_like_a_findings_own_form_is_a_second_cause() -> None:
    """A screw that grows and a head that drifts: the drift had been taken for what the growth is in other sensors."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 400, 5, channels=True, grid=False)
    specs = (
        EffectSpec("scale-expansion", {"joint": "X", "sensor": "T_0"}),
        EffectSpec("structure-drift", {"element": "head", "motion": "dz", "sensor": "T_1"}),
    )
    effects = list(zip(specs, ([2e-5], [0.01]), strict=True))
    linear = set_up(fit_machine(machine, showing(survey, machine, effects, 0.003)))
    candidates = Candidates.of(linear)
    form = Unnamed(element="X", motion="dx", driver="T_1", center=21.0, half_range=2.0)
    taken = [Step(make(specs[0]), 100.0, 100.0, 0.5), Step(form, 50.0, 50.0, 0.5, parent=0)]
    chosen, _ = compare_alternatives(replayed(linear, taken), candidates)
    assert {(main.effect.effect, main.effect.where) for main, *_ in chosen.findings} >= {
        ("scale-expansion", "X"),
        ("structure-drift", "head"),
    }


def test_two_names_before_a_form_that_does_for_both() -> None:
    """Play and lag of one joint: what both do goes with the product of direction and feed, and a little beside it."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 400, 5, channels=True, grid=False)
    table = survey.table.copy()
    table["feed"] = np.random.default_rng(4).choice([500.0, 1500.0, 4000.0], len(table))
    play, lag = EffectSpec("backlash", {"joint": "Z"}), EffectSpec("servo-lag", {"joint": "Z"})
    shown = showing(replace(survey, table=table), machine, [(play, [0.01]), (lag, [1e-4])], 0.003)
    linear = set_up(fit_machine(machine, shown))
    candidates = Candidates.of(linear)
    chosen, _ = compare_alternatives(forward_select(linear, candidates), candidates)
    assert {main.effect.effect for main, *_ in chosen.findings} == {"backlash", "servo-lag"}
    assert empirical_evidence(chosen) == 0


def test_two_effects_of_one_joint_hide_in_each_other() -> None:
    """A table along a carriage that meets a knee: one after the other, each is taken for a form of the first."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 400, 5, channels=False, grid=False)
    low, high = machine.joints[0].travel
    name = machine.joints[0].name
    table = EffectSpec("compensation-active", {"joint": name, "points": 6})
    knee = EffectSpec("contact-knee", {"joint": name, "motion": "dz", "at": low + 0.4 * (high - low)})
    effects = [(table, [0.012, 0.014, -0.006, 0.006]), (knee, [0.2])]
    linear = set_up(fit_machine(machine, showing(survey, machine, effects, 0.003)))
    compared, _ = compare_alternatives(*mistaken_model(linear, name))
    assert {(main.effect.effect, main.effect.where) for main, *_ in compared.findings} == {
        ("compensation-active", name),
        ("contact-knee", name),
    }


def test_two_names_are_found_together_that_a_curve_explains_at_once() -> None:
    """A wave of a rail and a dent in it: the wave that alone explains most is another one, which leaves no dent."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 400, 5, channels=False, grid=False)
    wave = EffectSpec("rail-waviness", {"joint": "X", "motion": "dz", "period": 260.0})
    dent = EffectSpec("local-defect", {"joint": "X", "motion": "dz", "at": 150.0, "width": 60.0})
    shown = showing(survey, machine, [(wave, [0.01, 0.003]), (dent, [0.02])], 0.003)
    linear = set_up(fit_machine(machine, shown))
    candidates = Candidates.of(linear)
    selected = forward_select(linear, candidates)
    assert [main.effect.effect for main, *_ in selected.findings] == ["higher-order-geometry"]
    log = DecisionLog()
    compared, _ = compare_alternatives(selected, candidates, log=log)
    found = {main.effect.effect: main.effect for main, *_ in compared.findings}
    assert set(found) == {"rail-waviness", "local-defect"}
    assert compared.log_posterior > selected.log_posterior
    assert abs(vars(found["rail-waviness"])["period"] - 260) < 10
    assert abs(vars(found["local-defect"])["at"] - 150) < 10
    first, *_ = (d for d in log if d.rule == "second-cause")
    assert {first.effect, first.compared_with.split("@")[0]} == set(found)
    # each is as likely beforehand as among all candidates
    names, places = len(candidates.places), [candidates.places[e] for e in sorted(found)]
    assert sorted(s.log_prior for s in compared.steps) == sorted(-np.log(names * n) for n in places)


def test_another_name_is_as_likely_as_a_whole_model_with_it() -> None:
    """Play that grows along the travel: equal play departs from it, by what a search would have to find."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 400, 5, channels=False, grid=False)
    grows, equal = (make(EffectSpec(name, {"joint": "X"})) for name in ("lost-motion", "backlash"))
    linear = set_up(fit_machine(machine, showing(survey, machine, [(grows.spec, [0.01, 0.03])], 0.003)))
    candidates = Candidates.of(linear)
    names = len(candidates.places)
    first, other = (Step(e, 0.0, 0.0, 0.0, names=names, places=candidates.places[e.effect]) for e in (grows, equal))
    model = conditional_scores(replayed(linear, [first]), candidates)

    def lead(model: EffectModel) -> float:
        [main] = model.steps
        [other] = (s for s in main.alternatives if s.effect == equal)
        return posterior(other) - posterior(main)

    bent = Unnamed(element="X", motion="dx", driver="dir_X", by="X")
    refined = replayed(linear, [other, Step(bent, 0.0, 0.0, 0.0, parent=0)])
    assert lead(model) > -LEAST_EVIDENCE  # by what its departure could explain
    for found, whole in (([], replayed(linear, [other])), ([model, refined], refined)):
        weighed = weighed_as_whole(model, [*map(Whole.of, found)])
        assert lead(weighed) == pytest.approx(whole.log_posterior - model.log_posterior, abs=1e-3)
    assert lead(weighed_as_whole(model, [])) < -LEAST_EVIDENCE


def test_the_name_that_makes_the_whole_model_likelier_is_taken() -> None:
    """Play that grows along the travel, called equal play first; a curve of the joint, which fits anything, is not."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 400, 5, channels=False, grid=False)
    specs = [EffectSpec(name, {"joint": "X"}) for name in ("lost-motion", "backlash")]
    specs.append(EffectSpec("cross-axis-compliance", {"joint": "X", "other": "Y", "motion": "dx"}))
    linear = set_up(fit_machine(machine, showing(survey, machine, [(specs[0], [0.01, 0.03])], 0.003)))
    grows, equal, curve = (Step(make(s), 0.0, 0.0, 0.0, names=40, places=3) for s in specs)
    log = DecisionLog()
    told = with_likelier_names(
        replayed(linear, [replace(equal, alternatives=(curve, replace(grows, evidence=50.0)))]), log
    )
    [main] = told.steps
    assert (main.effect, [s.effect for s in main.alternatives]) == (grows.effect, [equal.effect, curve.effect])
    assert [(d.rule, d.outcome, d.effect) for d in log] == [("whole-model", "preferred", "lost-motion")]
    for other in (replace(curve, evidence=50.0), replace(grows, evidence=-1.0)):  # flexible, or less likely by itself
        same = replayed(linear, [replace(equal, alternatives=(other,))])
        assert with_likelier_names(same) is same


def test_a_further_finding_is_detected_beyond_the_trials_factor() -> None:
    """Play of 2.5 um makes a model likelier by odds of 500, fewer than there are places; of 3.2 um by far more."""
    machine = read_machine("bridge_cmm")
    survey = empty_survey(machine, 400, 11, channels=True, grid=False)
    drift = EffectSpec("structure-drift", {"element": "carriage", "motion": "dx", "sensor": "T_0"})
    play = EffectSpec("backlash", {"joint": "X"})
    found = []
    for size in (0.0025, 0.0032):
        linear = set_up(fit_machine(machine, showing(survey, machine, [(drift, [0.02]), (play, [size])], 0.003)))
        candidates = Candidates.of(linear)
        steps = [Step(make(s), 0.0, 0.0, 0.0, names=40, places=5) for s in (drift, play)]
        alone, both = conditional_scores(replayed(linear, steps[:1]), candidates), replayed(linear, steps)
        assert both.log_posterior > alone.log_posterior + DETECT
        chosen, _ = compare_alternatives(alone, candidates, others=[list(both.steps)])
        found.append(len(chosen.findings))
    assert found == [1, 2]


def mistaken_model(linear: LinearModel, joint: str) -> tuple[EffectModel, Candidates]:
    """A model in which one finding of a joint, by a name that it has not, has all others of the joint for its form."""
    candidates = Candidates.of(linear)
    wrong = make(EffectSpec("higher-order-geometry", {"joint": joint, "motion": "dz"}))
    first = replace(scored(linear, wrong, 1) or Step(wrong, 0.0, 0.0, 0.0), names=40, places=10)
    rest = [s for s in optimise_shapes(linear.with_effect(wrong), candidates, 12) if s.effect.where == joint]
    taken = replayed(linear, [first, *(replace(s, parent=0) for s in rest[:2])])
    return conditional_scores(taken, candidates), candidates


@pytest.mark.long
def test_a_surface_over_two_joints_that_turn_is_found() -> None:
    """A chequer board over two joints of an arm: no curve of one joint, and no product of straight lines."""
    machine = read_machine("six_axis_arm")
    survey = empty_survey(machine, 500, 5, channels=False, grid=False)
    one, two, *_ = machine.joints
    moved = survey.table.copy()
    waves = [np.sin(2.5 * np.pi * (moved[j.name] - j.travel[0]) / (j.travel[1] - j.travel[0])) for j in (one, two)]
    moved["mz"] += 0.03 * np.sign(waves[0]) * np.sign(waves[1])
    found = diagnose(machine, replace(survey, table=moved)).diagnosis.findings
    assert {f.effect for f in found} == {"unnamed"}  # a little of it may show as a tilt at the other of the two
    assert all(set(f.driver) == {one.name, two.name} for f in found)
    assert found[0].heldout_rms_um.after < 0.8 * found[0].heldout_rms_um.before


@pytest.mark.long
def test_pulses_become_a_curve_over_their_period() -> None:
    """Oil lifts a carriage every quarter of an hour and it sinks again: no sine, and no second finding."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 450, 7, channels=True, grid=False)
    moved = survey.table.copy()
    moved["mz"] += 0.03 * np.exp(-np.mod(moved["time"], 900.0) / 300.0)
    told = diagnose(machine, replace(survey, table=moved))
    [found] = told.diagnosis.findings
    assert (found.effect, found.driver) == ("unnamed", ["time"])
    assert found.period is not None
    assert abs(found.period - 900) < 5
    assert "with a period of 15 min" in found.statement
    assert [(s.parent, s.effect.random) for s in told.model.steps] == [(None, False), (0, True)]


@pytest.mark.long
@pytest.mark.parametrize("steps", first_of(product((True, False), repeat=2), whole=True))
def test_what_switches_over_two_joints_gets_its_edges(steps: tuple[bool, bool]) -> None:
    """A table whose plates lie higher and lower in turn, at once or gently, along one joint or the other."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 450, 7, channels=True, grid=False)
    moved = survey.table.copy()
    joints = machine.joints[:2]
    waves = {
        j.name: np.sin(3 * np.pi * (moved[j.name] - j.travel[0]) / (j.travel[1] - j.travel[0]) + 0.4) for j in joints
    }
    made = [np.sign(w) if step else w for w, step in zip(waves.values(), steps, strict=True)]
    moved["mz"] += 0.015 * made[0] * made[1]
    told = diagnose(machine, replace(survey, table=moved))
    [found] = told.diagnosis.findings
    assert found.effect == "unnamed"
    assert set(found.driver) == set(waves)
    assert found.heldout_rms_um.after < 9.4  # 9 of them noise; waves leave 12
    main = told.model.findings[0][0].effect
    assert isinstance(main, Unnamed)
    edges = dict(zip(main.drivers, (main.edge, main.by_edge), strict=True))
    assert [edges[j.name] is not None for j in joints] == list(steps)
    for joint in joints:
        if (edge := edges[joint.name]) is None:
            continue
        low, high = joint.travel
        assert abs(np.sin(3 * np.pi * (edge - low) / (high - low) + 0.4)) < 0.15  # there it crosses zero
        assert f"switching where {joint.name} passes {edge:.4g} mm" in found.statement


def test_a_switch_is_a_wave_of_two_values() -> None:
    """Up at the edge, down half a period later; the symbols agree."""
    x = np.array([10.0, 29.0, 31.0, 34.0, 36.0, 50.1])
    np.testing.assert_allclose(switch(x, 10.0, 30.0), [0, -1, 1, 1, -1, 0.9], atol=0.1)
    symbol = ca.SX.sym("x")
    assert float(ca.Function("f", [symbol], [switch(symbol, 10.0, 30.0)])(31.0)) == pytest.approx(switch(31.0, 10, 30))


@pytest.mark.long
def test_a_frame_that_drifts_is_no_refinement_of_a_scale_that_grows() -> None:
    """Six motions together are like almost anything: what counts is which of them there are."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 450, 7, channels=True, grid=False)
    names = [c for c in survey.table.columns if str(c).startswith("T_")]
    joint = machine.joints[-1].name
    specs = (
        EffectSpec("scale-expansion", {"joint": joint, "sensor": names[0]}),
        EffectSpec("tracker-drift", {"start": 0.0, "duration": float(survey.table["time"].max()), "tau": 3000.0}),
    )
    effects = list(zip(specs, ([1.5e-5], [0.03] * 3), strict=True))
    told = diagnose(machine, showing(survey, machine, effects, 0.003)).diagnosis.findings
    assert {f.effect for f in told} == {"scale-expansion", "tracker-drift"}
