"""Each criterion of the search by itself: what it measures, and a case that it and no other decides."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import subspace_angles

from errormodel.effects import make
from errormodel.machine import EffectSpec
from identification.diagnosis.decisions.constants import CLEARLY
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search import scoring
from identification.diagnosis.search.criteria import (
    base_channels,
    canonical_correlation,
    cross_validation_residuals,
    heldout_rms,
    one_sensor,
    predictive_deviation,
)
from identification.diagnosis.search.scoring import DETECT, Step, accepted, choose
from tests.helpers.chains import Array

ROWS = 48


def bench_of(design: Array, data: Array, rows: Array | None = None) -> LinearModel:
    """The linear model of a geometry (N, r) fitted to data (N,)."""
    q = np.linalg.qr(design)[0]
    index = np.arange(len(data)) if rows is None else rows
    return LinearModel(None, data - q @ (q.T @ data), q, {}, {}, index, None)  # type: ignore[arg-type]


@pytest.mark.parametrize("columns", [4, 60])  # fewer than a block has observations, and more
def test_rows_left_out_are_predicted_by_refits_without_them(columns: int) -> None:
    rng = np.random.default_rng(1)
    rows = np.tile(np.arange(ROWS), 3)  # three components
    design, data = rng.normal(size=(3 * ROWS, columns)), rng.normal(size=3 * ROWS)
    linear = bench_of(design, data, rows)
    found = cross_validation_residuals(linear, 6)
    for block in range(6):
        own = rows // 8 == block
        values = np.linalg.lstsq(design[~own], data[~own], rcond=None)[0]
        np.testing.assert_allclose(found[own], data[own] - design[own] @ values, atol=1e-6)
    twelve = cross_validation_residuals(linear)
    assert heldout_rms(linear) == pytest.approx(np.sqrt(np.mean(twelve**2)))


@pytest.mark.parametrize("columns", [4, 40])
def test_rows_left_out_have_the_density_that_refits_without_them_give(columns: int) -> None:
    """The likeliest noise of all blocks, each a normal distribution with the covariance of its prediction."""
    rng = np.random.default_rng(3)
    rows = np.tile(np.arange(ROWS), 3)
    design, data = rng.normal(size=(3 * ROWS, columns)), rng.normal(size=3 * ROWS)
    square, spread = 0.0, 0.0
    for block in range(12):
        own = rows // 4 == block
        values, *_ = np.linalg.lstsq(design[~own], data[~own], rcond=None)
        covariance = np.eye(own.sum()) + design[own] @ np.linalg.inv(design[~own].T @ design[~own]) @ design[own].T
        off = data[own] - design[own] @ values
        square += off @ np.linalg.solve(covariance, off)
        spread += np.linalg.slogdet(covariance)[1]
    expected = np.sqrt(square / len(data) * np.exp(spread / len(data)))
    assert predictive_deviation(bench_of(design, data, rows)) == pytest.approx(expected)


def test_a_weak_direction_of_the_geometry_does_not_hide_what_an_effect_explains() -> None:
    """One block alone shows the geometry's second parameter well: without it the others are predicted anyhow."""
    rng = np.random.default_rng(4)
    weak = np.where(np.arange(ROWS) < 4, 1.0, 1e-3 * rng.normal(size=ROWS))
    design, effect = np.column_stack([np.ones(ROWS), weak]), rng.choice([-1.0, 1.0], ROWS)
    data = 2.0 * effect + rng.normal(size=ROWS)
    without, beside = bench_of(design, data), bench_of(np.column_stack([design, effect]), data)
    assert predictive_deviation(beside) < 0.7 * predictive_deviation(without)
    assert heldout_rms(beside) > 10 * predictive_deviation(beside)


def test_a_geometry_that_only_fits_noise_fits_better_and_predicts_worse() -> None:
    """The residual would take the richer geometry; the rows left out do not."""
    rng = np.random.default_rng(2)
    design, data = rng.normal(size=(ROWS, 24)), rng.normal(size=ROWS)
    few, many = bench_of(design[:, :2], data), bench_of(design, data)
    assert many.square < few.square
    assert heldout_rms(many) > 1.02 * heldout_rms(few)
    assert predictive_deviation(many) > 1.02 * predictive_deviation(few)


def test_heat_is_one_cause_and_an_event_is_none() -> None:
    """What a knock leaves is no form of what a sensor drives; a drift by the clock may be."""
    knock, drift = make(EffectSpec("station-shift", {"at": 1800.0})), make(EffectSpec("tracker-drift", {}))
    growth = make(EffectSpec("spindle-growth", {"sensor": "T_spindle"}))
    assert base_channels(growth) == base_channels(drift) == {"temperature"}
    assert base_channels(knock) == {"time"}


def test_canonical_correlation_is_the_largest_canonical_correlation_without_the_geometry() -> None:
    rng = np.random.default_rng(3)
    design = rng.normal(size=(ROWS, 3))
    linear = bench_of(design, rng.normal(size=ROWS))
    one, other = rng.normal(size=(2, ROWS)), rng.normal(size=(3, ROWS))
    angle = subspace_angles(linear.project(one).T, linear.project(other).T).min()
    assert canonical_correlation(linear, one, other) == pytest.approx(np.cos(angle), abs=1e-9)
    assert canonical_correlation(linear, one, one[:1] * -3e-5) == pytest.approx(1)
    # alike only in what the geometry takes up: then not alike, and what it takes up whole is like nothing
    big = 50 * design.T
    assert canonical_correlation(linear, one[:1] + big[:1], one[1:] + big[:1]) == pytest.approx(
        canonical_correlation(linear, one[:1], one[1:]), abs=1e-9
    )
    assert canonical_correlation(linear, big, one) == 0


def drift(sensor: str, **more: object) -> object:
    return make(EffectSpec("structure-drift", {"element": "head", "motion": "dz", "sensor": sensor, **more}))


def test_warmth_is_one_cause_by_whatever_sensor_or_clock() -> None:
    warm_up = make(EffectSpec("warm-up", {"element": "head", "motion": "dz", "tau": 900.0}))
    play = make(EffectSpec("backlash", {"joint": "X"}))
    assert (
        base_channels(drift("T_bed"))
        == base_channels(drift("T_air", tau=600.0))
        == base_channels(warm_up)
        == {"temperature"}
    )  # type: ignore[arg-type]
    assert "temperature" not in base_channels(play)
    assert base_channels(play)


def test_one_sensor_is_the_same_sensor_at_whatever_lag() -> None:
    warm_up = make(EffectSpec("warm-up", {"element": "head", "motion": "dz", "tau": 900.0}))
    play = make(EffectSpec("backlash", {"joint": "X"}))
    lost = make(EffectSpec("lost-motion", {"joint": "X"}))
    bed, late = drift("T_bed"), drift("T_bed", tau=600.0)
    assert one_sensor(bed, late)  # type: ignore[arg-type]
    assert not one_sensor(bed, drift("T_air"))  # type: ignore[arg-type]
    assert not one_sensor(warm_up, warm_up)  # a clock is no sensor
    assert not one_sensor(play, lost)  # nor is an axis that drives both


def step(
    evidence: float, drop: float, *, form: bool = False, drivers: tuple[str, ...] = ("X",), **more: object
) -> Step:
    effect = SimpleNamespace(empirical=form, flexible=False, drivers=drivers, random=False, key=(form, *drivers))
    return Step(effect, evidence, drop, 0.0, **more)  # type: ignore[arg-type]


def chosen(name: Step, form: Step) -> bool:
    """Whether the name is chosen beside a form; of one name there is no order to be found."""
    return choose([form, name]) is name


def test_a_form_must_have_clearly_more_evidence_than_a_name() -> None:
    form = step(50.0, 100.0, form=True)
    assert chosen(step(50.0 - CLEARLY, 1.0), form)
    assert not chosen(step(49.9 - CLEARLY, 1.0), form)


def test_all_effects_are_equally_likely_beforehand_wherever_they_may_be() -> None:
    """Of two names that fit as well, that with fewer places is chosen; with as many times the evidence, the other."""
    few = step(50.0, 100.0, places=2)
    for lead, first in ((0.0, few), (np.log(10.0) - 1e-6, few), (np.log(10.0) + 1e-6, None)):
        many = step(50.0 + float(lead), 100.0, places=20)
        assert choose([many, few]) is (first or many)


def test_evidence_must_outweigh_the_places_that_were_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scoring, "explained_by_noise", lambda linear, step: 0.0)
    for trials in (0, 1, 1000):
        least = float(np.log(max(trials, 1))) + DETECT
        assert accepted(None, step(least + 1e-6, 1.0, trials=trials))  # type: ignore[arg-type]
        assert not accepted(None, step(least - 1e-6, 1.0, trials=trials))  # type: ignore[arg-type]
    assert np.exp(DETECT) == pytest.approx(100, rel=0.01)  # a hundred to one for a single place


def test_evidence_must_outweigh_what_correlated_noise_would_make_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scoring, "explained_by_noise", lambda linear, step: 3.0)
    assert accepted(None, step(DETECT + 3.1, 1.0))  # type: ignore[arg-type]
    assert not accepted(None, step(DETECT + 2.9, 1.0))  # type: ignore[arg-type]
    # what a bend brings detects nothing: it does not count against correlated noise
    assert not accepted(None, step(DETECT + 3.1, 1.0, evidence_of_form=0.2))  # type: ignore[arg-type]
    assert accepted(None, step(DETECT + 3.3, 1.0, evidence_of_form=0.2))  # type: ignore[arg-type]
