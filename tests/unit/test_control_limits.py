"""The normal range of each monitored quantity, of all together, and of what drifts: their rates of alarm."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from identification.monitoring.alarms import alarm_text
from identification.monitoring.control_limits import Judged, judge
from identification.monitoring.quantities import Cycle
from tests.helpers.nightly import first_of

# the statistics


def cycles(values: np.ndarray, covariance: np.ndarray) -> list[Cycle]:
    return [Cycle(v, covariance) for v in values]


def judged_of(values: np.ndarray, covariance: np.ndarray, rate: float = 0.01) -> Judged:
    *normal, new = cycles(values, covariance)
    return judge(normal, new, rate)


def test_the_range_is_students_prediction_interval():
    values = np.random.default_rng(1).normal(size=(9, 4))
    result = judged_of(values, 1e-6 * np.eye(4))
    past = values[:-1]
    half = stats.t.isf(0.005 / 8, 7) * past.std(axis=0, ddof=1) * np.sqrt(1 + 1 / 8)
    assert np.allclose(result.mean, past.mean(axis=0))
    assert np.allclose(result.high - result.mean, half)
    t = np.abs(values[-1] - past.mean(axis=0)) / (past.std(axis=0, ddof=1) * np.sqrt(1 + 1 / 8))
    assert np.allclose(result.p, np.minimum(8 * stats.t.sf(t, 7), 1))


def test_a_cycle_known_less_well_has_a_wider_range():
    values = np.random.default_rng(2).normal(size=(9, 3))
    normal = cycles(values[:-1], np.eye(3))
    sharp, vague = (judge(normal, Cycle(values[-1], c * np.eye(3))) for c in (1.0, 9.0))
    factor = stats.t.isf(0.005 / 6, 7)
    more = ((vague.high - vague.mean) / factor) ** 2 - ((sharp.high - sharp.mean) / factor) ** 2
    assert np.allclose(more, 8.0)


def test_correlated_quantities_alarm_together_where_none_does_alone():
    shape = np.array([[1.0, 0.999], [0.999, 1.0]])
    rng = np.random.default_rng(3)
    values = rng.multivariate_normal([0, 0], shape, 41)
    values[-1] = [1.2, -1.2]  # each usual; their difference is not
    result = judged_of(values, shape)
    assert not result.beyond.any()
    assert result.together_beyond
    assert result.alarm
    assert result.share == pytest.approx([0.5, 0.5], abs=0.1)


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.integers(1, 9))
def test_shares_of_a_distance_are_shares(seed, quantities, rank):
    """Whatever hangs together: none is negative, and all of them are the whole."""
    rng = np.random.default_rng(seed)
    mix = rng.normal(size=(quantities, rank)) * 10.0 ** rng.uniform(-6, 3, quantities)[:, None]
    shape = mix @ mix.T + 1e-14 * np.diag(np.square(mix).sum(axis=1))
    result = judged_of(rng.normal(size=(6, rank)) @ mix.T, shape)
    assert (result.share >= 0).all()
    assert result.share.sum() == pytest.approx(1)


def test_an_alarm_of_all_together_names_no_quantity_as_out_of_its_range():
    far = {"kind": "together", "ids": ["a", "b"], "statement": "..."}
    one = {"kind": "range", "ids": ["a"], "name": "EXX (a)", "statement": "..."}
    assert alarm_text([far]) == "no quantity by itself, but all of them together"
    assert alarm_text([one, far]) == "EXX (a) left its range"
    assert alarm_text([one, one | {"kind": "drift"}]) == "EXX (a) left its range, EXX (a) drifts"
    assert alarm_text([one] * 5).endswith(" left its range and 2 more")


@pytest.mark.parametrize("scatter", [0.0, 5.0])
@pytest.mark.parametrize("count", first_of([3, 5, 20], 2))
def test_quiet_cycles_keep_the_rate(count, scatter):
    k, draws, rate = 12, 400, 0.05
    mix = np.random.default_rng(4).normal(size=(k, k))
    shape = mix @ mix.T / k
    own = scatter * np.sqrt(np.diag(shape)) * np.linspace(0, 1, k)
    rng = np.random.default_rng(100 * count)
    root = np.linalg.cholesky(shape)
    alarms = 0
    for _ in range(draws):
        values = rng.normal(size=(count + 1, k)) @ root.T + own * rng.normal(size=(count + 1, k))
        alarms += judged_of(values, shape, rate).alarm
    assert alarms <= stats.binom.isf(0.01, draws, rate)


def test_a_clear_change_is_seen_after_ten_cycles():
    found = [
        judged_of(np.vstack([rng.normal(size=(10, 12)), np.eye(12)[3] * 10]), 1e-4 * np.eye(12)).beyond[3]
        for rng in map(np.random.default_rng, range(100))
    ]
    assert np.mean(found) > 0.9


def test_missing_and_constant_values_do_no_harm():
    values = np.random.default_rng(6).normal(size=(8, 3))
    values[:6, 1] = np.nan  # only one earlier cycle shows it
    values[:, 2] = 1.0  # without any scatter
    result = judged_of(values, np.diag([1.0, 1.0, 1e-8]))
    assert np.isnan(result.p[1])
    assert not result.beyond[2]
    assert result.count.tolist() == [7, 1, 7]
