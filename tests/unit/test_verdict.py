"""Whether a model is adequate: by repeats, by declared uncertainty, and where most is left over."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from errormodel.chain import Chain
from errormodel.instruments.laser_tracker import LaserTracker
from errormodel.machine import Machine
from errormodel.machine_file import read_machine
from errormodel.simulation import random_points
from errormodel.survey import Survey
from identification.diagnosis.results.pure_error import repeats_of
from identification.diagnosis.results.verdict import judge
from identification.estimation.checks import looked_over
from identification.estimation.fit import fit_machine
from tests.helpers.findings import NOISE, known, made, survey_of, walked


def waves(bumps: float) -> tuple[Machine, Survey]:
    """A recording that a machine's own model explains, or not: a narrow dent that nothing is made for."""
    machine = read_machine("vertical_three_axis")
    effects = [made("pitch-cyclic", joint=j, period=p) for j, p in (("X", 9.1), ("Y", 7.3), ("Z", 8.7))]
    extended = known(machine, *effects)
    ids = [i for own in Chain(extended).effect_ids for i in own]
    return machine, survey_of(extended, walked(), dict.fromkeys(ids, bumps))


def test_repeats_show_what_a_model_lacks() -> None:
    ((clean,), (rough,)) = (repeats_of(fit_machine(*waves(bumps))) for bumps in (0.0, 0.006))
    assert (clean.poses, clean.count) == (30, 30)
    assert clean.sigma_um == pytest.approx(1e3 * NOISE, rel=0.25)
    assert clean.ratio == pytest.approx(1, abs=0.4)
    assert not clean.misfit
    assert rough.sigma_um == pytest.approx(1e3 * NOISE, rel=0.25)
    assert rough.misfit
    assert rough.ratio > 2


def test_readings_in_a_row_are_one_visit() -> None:
    machine = read_machine("vertical_three_axis")
    table = random_points(machine, 60, 8).iloc[np.repeat(np.arange(60), 3)].reset_index(drop=True)
    assert repeats_of(fit_machine(machine, survey_of(machine, table, {}))) == ()


@pytest.mark.parametrize(("found", "word"), [(False, "unexplained"), (True, "partly-explained")])
def test_verdict_by_repeats(found: bool, word: str) -> None:
    verdict = judge(fit_machine(*waves(0.006)), found)
    assert verdict.word == word
    assert verdict.unexplained is not None
    assert "um rms where repeated poses let expect" in verdict.unexplained
    assert "30 poses were visited again (30 rows)" in verdict.notes[0]
    quiet = judge(fit_machine(*waves(0.0)), found)
    assert (quiet.word, quiet.unexplained) == ("explained" if found else "adequate", None)


def test_verdict_by_declared_uncertainty() -> None:
    machine = read_machine("vertical_three_axis")
    points = random_points(machine, 150, 4)
    for declared, word in ((NOISE, "adequate"), (NOISE / 1.5, "unexplained")):
        sigma = {f"sigma_{a}": declared for a in "xyz"}
        verdict = judge(fit_machine(machine, survey_of(machine, points.assign(**sigma), {})), False)
        assert verdict.word == word
        assert (verdict.unexplained is None) == (word == "adequate")
    assert verdict.unexplained is not None
    expected = 1e3 * NOISE / 1.5 * 3**0.5
    assert f"the declared uncertainty lets expect {expected:.1f}" in verdict.unexplained
    assert verdict.unexplained.endswith("spread evenly over positions and time")


def test_noise_that_is_declared_by_direction_lets_expect_its_length() -> None:
    """In one direction it is a tenth: its length is not what residuals weighed by it let expect."""
    machine = read_machine("vertical_three_axis")
    table = random_points(machine, 150, 4).assign(sigma_x=NOISE / 10, sigma_y=NOISE, sigma_z=NOISE)
    verdict = judge(fit_machine(machine, survey_of(machine, table, {})), False)
    assert verdict.unexplained is not None
    assert f"lets expect {1e3 * NOISE * 2.01**0.5:.1f};" in verdict.unexplained


def test_repeats_overrule_a_declared_uncertainty() -> None:
    machine = read_machine("vertical_three_axis")
    sigma = {f"sigma_{a}": NOISE / 1.5 for a in "xyz"}
    verdict = judge(fit_machine(machine, survey_of(machine, walked().assign(**sigma), {})), False)
    assert verdict.word == "adequate"
    assert "the declared uncertainty is too small by a factor of 1." in verdict.notes[1]


def test_where_most_is_left_over() -> None:
    machine = read_machine("vertical_three_axis")
    table = walked().assign(**{f"sigma_{a}": NOISE for a in "xyz"})
    survey = survey_of(machine, table, {})
    x = table["X"].to_numpy()
    wild = x > np.quantile(x, 7 / 8)
    survey.table.loc[wild, "mz"] += np.random.default_rng(1).normal(0, 0.02, wild.sum())
    survey.table.loc[:, [f"sigma_{a}" for a in "xyz"]] = NOISE
    found = judge(
        fit_machine(machine, replace(survey, table=survey.table[~survey.table.index.isin(range(120, 150))])), False
    )
    assert found.word == "unexplained"
    assert found.unexplained is not None
    assert "it is largest where X is from" in found.unexplained


def test_few_rows_that_hold_what_is_left_are_named() -> None:
    """Four rows at 20 standard uncertainties are not "spread evenly"."""
    machine = read_machine("vertical_three_axis")
    survey = survey_of(machine, random_points(machine, 300, 4).assign(**{f"sigma_{a}": NOISE for a in "xyz"}), {})
    survey.table.loc[[0, 90, 180, 270], "mz"] += 20 * NOISE
    found = judge(fit_machine(machine, survey), False)
    assert found.unexplained is not None
    assert "rows 1, 91, 181, 271 hold" in found.unexplained
    assert "evenly" not in found.unexplained


@pytest.mark.parametrize(("size", "word"), [(0.010, "unexplained"), (0.002, "adequate")])
def test_residuals_that_wander_more_than_instruments_are_unexplained(size: float, word: str) -> None:
    """One coordinate after the other follows a slow process; as much as a good tracker does is noise."""
    machine = read_machine("vertical_three_axis")
    survey = survey_of(machine, random_points(machine, 200, 8), {}, size / 4)
    rng, kept = np.random.default_rng(3), np.exp(-1 / 15)
    wander = np.zeros((200, 3))
    for k in range(1, 200):
        wander[k] = kept * wander[k - 1] + rng.normal(0, size * np.sqrt(1 - kept**2), 3)
    table = survey.table.assign(**{f"m{a}": survey.table[f"m{a}"] + wander[:, k] for k, a in enumerate("xyz")})
    verdict = judge(fit_machine(machine, replace(survey, table=table)), found=False)
    assert verdict.word == word
    if word == "unexplained":
        assert verdict.unexplained is not None
        found = re.search(r"what is left wanders: ([\d.]+) um", verdict.unexplained)
        assert found is not None
        assert 4 < float(found[1]) < 12  # of 10 um, of which the fit takes a part


@pytest.mark.parametrize(("noise", "word"), [(0.0, "adequate"), (0.1, "unexplained")])
def test_noise_far_beyond_what_such_an_instrument_makes_is_unexplained(noise: float, word: str) -> None:
    machine = read_machine("vertical_three_axis")
    survey = survey_of(machine, random_points(machine, 80, 3), {})
    table = survey.table.copy()
    table[["mx", "my", "mz"]] += noise * np.random.default_rng(1).standard_normal((len(table), 3))
    fit = fit_machine(machine, replace(survey, table=table, instrument=LaserTracker(station=[2000.0, 0.0, 0.0])))
    verdict = judge(fit, found=False)
    said = any("what a laser-tracker makes at most" in note for note in looked_over(fit).notes)
    assert (verdict.word, said) == (word, noise > 0)
    if noise:
        assert "what a laser-tracker makes at most" in str(verdict.unexplained)


def test_noise_of_an_instrument_that_is_not_named_is_not_doubted() -> None:
    machine = read_machine("vertical_three_axis")
    survey = survey_of(machine, random_points(machine, 80, 3), {})
    table = survey.table.copy()
    table[["mx", "my", "mz"]] += 0.1 * np.random.default_rng(1).standard_normal((len(table), 3))
    assert judge(fit_machine(machine, replace(survey, table=table)), found=False).word == "adequate"
