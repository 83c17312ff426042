"""What the diagnosis tries: the same columns and scores on any number of cores."""

from __future__ import annotations

import os
from dataclasses import replace
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest

from errormodel.conventions import MOTIONS
from errormodel.effects import make
from errormodel.effects.base import EffectTerm
from errormodel.effects.cross_axis_compliance import CrossAxisCompliance
from errormodel.machine import EffectSpec, Joint
from errormodel.machine_file import read_machine
from errormodel.survey import read_survey
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.results.untestable import unconsidered, unseen
from identification.diagnosis.search import correlated_noise as coloured
from identification.diagnosis.search.candidates import MANY, Candidates
from identification.diagnosis.search.proposals import proposed
from identification.estimation.fit import fit_machine
from tests.helpers.diagnosed import empty_survey, showing

GANTRY = Path(__file__).parents[2] / "machines/examples/gantry"


@pytest.mark.long
def test_cores_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    machine = read_machine(GANTRY)
    linear = set_up(fit_machine(machine, read_survey(GANTRY / "survey.csv", machine)))
    found = []
    for count in (1, 2, 3):
        monkeypatch.setattr(os, "cpu_count", lambda count=count: count)
        found.append(Candidates.of(linear))
    one, *others = found
    assert len(one.effects) > MANY
    scores = one.scores(linear)
    for other in others:
        assert other.effects == one.effects
        for block, same in zip(one.blocks, other.blocks, strict=True):
            np.testing.assert_array_equal(block.numbers, same.numbers)
            np.testing.assert_array_equal(block.columns, same.columns)
            np.testing.assert_array_equal(block.sizes, same.sizes)
        for name in ("evidence", "delta_chi2", "absorbed", "expected_delta_chi2"):
            np.testing.assert_array_equal(getattr(other.scores(linear), name), getattr(scores, name))


def test_a_term_that_moves_nothing_is_a_column_of_zeros() -> None:
    machine = read_machine(GANTRY)
    linear = set_up(fit_machine(machine, read_survey(GANTRY / "survey.csv", machine)))
    out = np.full((1, 1, linear.size), np.nan)
    linear.fill([EffectTerm(machine.joints[0].name, "", "mm", {}, 1.0)], out)
    assert not out.any()


@pytest.mark.long
def test_candidates_are_columns_of_their_effects_at_their_usual_sizes() -> None:
    """As they are kept, phases of waves among them in single precision, beside each effect's own in double."""
    machine = read_machine(GANTRY)
    linear = set_up(fit_machine(machine, read_survey(GANTRY / "survey.csv", machine)))
    candidates = Candidates.of(linear)
    for block in candidates.blocks[::5]:
        for n, kept, usual in list(zip(block.numbers, block.observed(linear.size), block.sizes, strict=True))[::40]:
            columns, sizes = linear.columns(candidates.effects[n])
            np.testing.assert_array_equal(usual, sizes)
            exact = columns * sizes[:, None]
            np.testing.assert_allclose(kept, exact, rtol=0, atol=2e-5 * max(np.abs(exact).max(), 1e-300))


@pytest.mark.long
@pytest.mark.parametrize("name", ["trunnion_five_axis", "fork_head_five_axis", "five_axis_table_quill"])
@pytest.mark.parametrize("turned", [False, True])
def test_no_compliance_is_another_joints_geometry(name: str, turned: bool) -> None:
    """A translation that no turn between two joints changes is an error motion of either; one that is turned is not."""
    machine = read_machine(name)
    if turned:  # the members between the joints
        elements = [e if isinstance(e, Joint) else replace(e, rotation=(0.5, 0.3, -0.2)) for e in machine.elements]
        machine = replace(machine, elements=tuple(elements))
    linear = set_up(fit_machine(machine, empty_survey(machine, 300, 3, channels=False, grid=False)))
    said = {(e.joint, e.other, e.motion) for e in CrossAxisCompliance.proposals(linear.scene)}
    names = [j.name for j in machine.joints]
    for joint, other in ((a, b) for a in names for b in names if a != b):
        own = np.array(linear.levers[other][:3])
        for k in range(3):
            lever = np.asarray(linear.levers[joint][k])
            same = np.linalg.lstsq(own.T, lever, rcond=None)[0] @ own
            assert ((joint, other, MOTIONS[k]) in said) == (not np.allclose(same, lever, atol=1e-6))


def test_correlated_noise_that_is_not_there_costs_a_drift_little() -> None:
    """White noise is as likely beforehand as all noises that are not, which would make much of a drift as well."""
    machine = read_machine("vertical_three_axis")
    worth = []
    for seed in range(3):
        survey = empty_survey(machine, 365, seed, channels=True, grid=False)
        last = float(survey.table["time"].max())
        spec = EffectSpec("tracker-drift", {"start": 0.0, "duration": last, "tau": 3000.0})
        linear = set_up(fit_machine(machine, showing(survey, machine, [(spec, [0.008] * 3)], 0.005, seed)))
        [(white, any_noise)] = coloured.evidence(linear, [[make(spec)]])
        assert white > 50
        worth.append(any_noise)
    assert min(worth) > 13.5  # 11.8 where each side has the noise that suits it best


def test_what_was_found_was_large_enough_to_be_seen() -> None:
    """A scale of the instrument is hidden by the axes' own at its usual size; a finding says that this one was not."""
    machine = read_machine("vertical_three_axis")
    linear = set_up(fit_machine(machine, empty_survey(machine, 300, 3, channels=True, grid=False)))
    scores = Candidates.of(linear).scores(linear)
    scale = make(EffectSpec("scale-ppm", {}))
    said = {u.effect: u.reason for u in unseen(linear.scene, scores, [])}
    assert "at its usual size stays within the noise" in said[scale.effect]
    assert scale.effect not in {u.effect for u in unseen(linear.scene, scores, [scale])}


def test_a_sensor_that_cannot_be_used_may_be_the_cause() -> None:
    """Said of what it would drive, though others are tried in its place; of what a temperature does not drive, not."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 300, 3, channels=True, grid=False)
    dead = survey.table.assign(T_1=survey.table["T_1"].where(survey.table["row"] > 100))
    linear = set_up(fit_machine(machine, replace(survey, table=dead)))
    log = DecisionLog()
    said = {(u.effect, u.reason) for u in unseen(linear.scene, Candidates.of(linear).scores(linear), [], log)}
    assert ("scale-expansion", "by T_1, which cannot be used: no value in 100 of 300 rows") in said
    assert {e for e, reason in said if "T_1" in reason} >= {"structure-drift", "thermal-bending", "refraction"}
    assert not any("T_1" in reason for e, reason in said if e in ("warm-up", "backlash", "beam-sag"))
    untried = [d for d in log if d.rule == "sensor-not-tried" and d.effect == "scale-expansion"]
    assert {(d.where, d.driver) for d in untried} == {(j, "T_1") for j in "XYZ"}
    warm_up = make(EffectSpec("warm-up", {"joint": "X", "tau": 900.0}))
    one = "T_1 cannot be used (no value in 100 of 300 rows): it was not considered, and may be the cause."
    assert unconsidered(warm_up, linear.scene) == one
    assert unconsidered(make(EffectSpec("scale-expansion", {"joint": "X", "sensor": "T_0"})), linear.scene) == one
    assert not unconsidered(make(EffectSpec("backlash", {"joint": "X"})), linear.scene)
    sound = replace(linear.scene, unusable={})
    assert not unconsidered(warm_up, sound)
    none_left = {n: v for n, v in linear.scene.columns.items() if not n.startswith("T_")}
    two = replace(linear.scene, columns=none_left, unusable={"T_1": "stuck", "T_2": "torn off"})
    assert unconsidered(warm_up, two) == (
        "T_1 cannot be used (stuck) and T_2 cannot be used (torn off): they were not considered, and each may be the "
        "cause."
    )


def test_products_that_are_known_score_as_well_as_those_made_anew() -> None:
    """Beside any few accepted effects, curves and mere forms among them, whatever was looked at before."""
    machine = read_machine(GANTRY)
    linear = set_up(fit_machine(machine, read_survey(GANTRY / "survey.csv", machine)))
    candidates = Candidates.of(linear)
    rng = np.random.default_rng(3)
    curves = [k for k, e in enumerate(candidates.effects) if e.random]
    for _ in range(3):
        beside = linear
        for k in (*rng.choice(len(candidates.effects), 3), rng.choice(curves)):
            beside = beside.with_effect(candidates.effects[k])
        kept = candidates.scores(beside)
        for k in (*rng.choice(len(candidates.effects), 20), *rng.choice(curves, 3)):
            own = Candidates.of(linear, [candidates.effects[k]]).scores(beside)
            if len(own.evidence) and np.isfinite(own.evidence[0]):
                # columns are kept in single precision: of what is left of one some 1e-4 are not known
                assert kept.evidence[k] == pytest.approx(own.evidence[0], rel=5e-4, abs=0.05)
                assert kept.delta_chi2[k] == pytest.approx(own.delta_chi2[0], rel=5e-4, abs=0.05)


@pytest.mark.long
def test_what_an_effect_would_leave_is_what_it_leaves() -> None:
    machine = read_machine(GANTRY)
    linear = set_up(fit_machine(machine, read_survey(GANTRY / "survey.csv", machine)))
    for effect in Candidates.of(linear).effects[::97]:
        assert linear.square_with(effect) == pytest.approx(linear.with_effect(effect).square, rel=1e-7)


@pytest.mark.parametrize("name", ["pitch-cyclic", "structure-drift", "higher-order-geometry"])
def test_several_shapes_leave_what_each_leaves(name: str) -> None:
    """So do random effects beside one of them."""
    machine = read_machine(GANTRY)
    linear = set_up(fit_machine(machine, read_survey(GANTRY / "survey.csv", machine)))
    lists = ([*own] for _, own in groupby(proposed(linear), lambda e: e.key))
    effects = max((own for own in lists if own[0].effect == name), key=len)[:4]
    alone = [linear.with_effect(effect) for effect in effects]
    assert linear.squares_with(effects) == pytest.approx([model.square for model in alone], rel=1e-7)
    columns = np.random.default_rng(0).normal(size=(3, len(linear.index)))
    for effect, model in zip(effects, alone, strict=True):
        assert linear.random_beside(effect, columns).best() == pytest.approx(model.random(columns).best(), rel=1e-7)


def test_a_column_that_depends_on_others_takes_nothing_of_later_ones() -> None:
    machine = read_machine(GANTRY)
    linear = set_up(fit_machine(machine, read_survey(GANTRY / "survey.csv", machine)))
    a, b, c = np.random.default_rng(0).normal(size=(3, linear.size))
    both = linear.with_columns(np.array([a, 2 * a, b, a - b, c]))
    assert both.square == pytest.approx(linear.with_columns(np.array([a, b, c])).square, rel=1e-12)
    assert both.basis.shape[1] == linear.basis.shape[1] + 3


def test_a_sensor_far_from_20_degrees_shows_the_same() -> None:
    """What it shows over 20 degC all the time is the geometry's, and hides nothing of what changes."""
    machine = read_machine(GANTRY)
    survey = empty_survey(machine, 200, 5, channels=True, grid=False)
    spec = EffectSpec("scale-expansion", {"joint": machine.joints[0].name, "sensor": "T_0"})
    survey = showing(survey, machine, [(spec, [4e-5])], 0.003)
    effect, found = make(spec), []
    for over in (0.0, 40.0, 70.0):
        table = survey.table.assign(**{f"T_{k}": survey.table[f"T_{k}"] + over for k in range(3)})
        linear = set_up(fit_machine(machine, replace(survey, table=table)))
        candidates = Candidates.of(linear, [effect])
        scores = candidates.scores(linear)
        [(white, averaged)] = coloured.evidence(linear, [[effect]])
        found.append([white, averaged, float(scores.evidence[0]), float(scores.absorbed[0])])
    assert found[0][0] > 50
    exact, _, single, absorbed = np.transpose(found)
    np.testing.assert_allclose(exact, exact[0], rtol=1e-6)
    # single precision leaves less of a column that is nearly the geometry's: a hundredth of what is left, at 90 degC
    np.testing.assert_allclose(single, exact[0], rtol=1e-2)
    np.testing.assert_allclose(absorbed, absorbed[0], atol=1e-2)
