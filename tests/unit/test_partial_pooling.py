"""Random effects over machines: published meta-analysis, invariance, false alarms, and the gain of pooling."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import betaincinv

from errormodel.arrays import Array
from identification.fleets.comparison import quantity
from identification.fleets.false_alarms import adjusted, selected, surely
from identification.fleets.partial_pooling import Surveys, normal, per_machine, q_profile, reml
from identification.monitoring.quantities import Watched
from tests.helpers.fleets import drawn_fleet, kinds, with_fault
from tests.helpers.nightly import first_of

# 13 trials of the BCG vaccine (Colditz et al., 1994): cases and others, vaccinated and not. The results are those that
# Viechtbauer's R package metafor prints of them (dat.bcg, log risk ratios, REML, Q profile), in four digits.
BCG = (
    (4, 119, 11, 128), (6, 300, 29, 274), (3, 228, 11, 209), (62, 13536, 248, 12619), (33, 5036, 47, 5761),
    (180, 1361, 372, 1079), (8, 2537, 10, 619), (505, 87886, 499, 87892), (29, 7470, 45, 7232), (17, 1699, 65, 1600),
    (186, 50448, 141, 27197), (5, 2493, 3, 2338), (27, 16886, 29, 17825),
)  # fmt: skip

Q = Watched("q", "q", "", "mm", {"q": 1.0})


def risk_ratios() -> tuple[Array, Array]:
    a, b, c, d = np.array(BCG, dtype=float).T
    return np.log(a / (a + b) * (c + d) / c), 1 / a - 1 / (a + b) + 1 / c - 1 / (c + d)


def test_a_published_meta_analysis() -> None:
    y, v = risk_ratios()
    assert reml(y, v) == pytest.approx(0.3132, abs=5e-5)
    low, high = q_profile(y, v)
    assert (low**2, high**2) == pytest.approx((0.1197, 1.1115), abs=5e-5)
    result = normal(y, v)
    assert result.kept.all()
    assert (result.mean, result.mean_std) == pytest.approx((-0.7145, 0.1798), abs=5e-5)


def test_equal_variances_have_a_closed_form() -> None:
    """Then REML is the sample variance less that of the estimates, and the deleted residual Student's t exactly."""
    rng = np.random.default_rng(2)
    y, v = rng.normal(3, 2, 12), np.full(12, 0.5)
    assert reml(y, v) == pytest.approx(np.var(y, ddof=1) - 0.5, rel=1e-9)
    result = normal(y, v)
    others = np.delete(y, 4)
    t = (y[4] - others.mean()) / (np.std(others, ddof=1) * np.sqrt(1 + 1 / 11))
    assert result.t[4] == pytest.approx(t, rel=1e-9)


def test_machines_that_scatter_less_than_their_uncertainty_are_all_alike() -> None:
    result = normal(np.array([1.0, 1.1, 0.9, 1.05, 0.95, 1.0]), np.full(6, 1.0))
    assert result.spread == 0
    np.testing.assert_allclose(result.pooled, result.mean)


@given(
    st.lists(st.floats(-10, 10), min_size=5, max_size=30, unique_by=lambda x: round(x, 2)),
    st.floats(-100, 100), st.floats(0.01, 100),
)  # fmt: skip
def test_units_and_zero_do_not_matter(values: list[float], shift: float, scale: float) -> None:
    y = np.array(values)
    v = 0.1 + 0.05 * np.arange(len(y))
    one, other = normal(y, v), normal(scale * y + shift, scale**2 * v)
    assert (one.kept == other.kept).all()
    assert other.spread == pytest.approx(scale * one.spread, rel=1e-5, abs=1e-5 * scale)
    assert other.mean == pytest.approx(scale * one.mean + shift, rel=1e-5, abs=1e-4 * max(scale, 1))
    np.testing.assert_allclose(other.t, one.t, rtol=1e-4, atol=1e-4)


def test_machines_that_are_out_do_not_widen_what_is_normal() -> None:
    rng = np.random.default_rng(4)
    y, v = rng.normal(0, 2, 100), np.full(100, 1.0)
    alone = normal(y[30:], v[30:])
    y[:30] += 40.0
    result = normal(y, v)
    assert not result.kept[:30].any()
    assert result.spread == pytest.approx(alone.spread, rel=1e-9)
    assert (result.p[:30] < 1e-12).all()


@pytest.mark.long
@pytest.mark.parametrize("machines", first_of([20, 6, 200]))
def test_false_alarms_of_one_machine_are_as_many_as_said(machines: int) -> None:
    """Of 6000 normal machines, at a probability of 1 %.

    Limits: three binomial standard deviations (0.0039) about 0.01, and half as much again for fleets of twenty, in
    which a machine that is left out by mistake narrows what is normal. Of six there are fewer: five others now and then
    scatter less than their uncertainty, and are not taken to be more alike than that.
    """
    rng = np.random.default_rng(machines)
    below = [
        (normal(rng.normal(0, 2, machines), np.full(machines, 1.0)).p < 0.01).mean() for _ in range(6000 // machines)
    ]
    assert (0.0061 if machines > 6 else 0.0) < np.mean(below) < (0.0139 if machines > 100 else 0.0189)


def test_scatter_between_surveys_of_one_machine() -> None:
    """Found beside the known uncertainty of each survey, though a third of the machines wear.

    The limit is three standard deviations of a standard deviation of 2 * 400 degrees of freedom, of which two thirds
    are used, plus as much for the machines whose wear is too small to be seen.
    """
    rng = np.random.default_rng(6)
    n, k = 400, 4
    machine, date = np.repeat(np.arange(n), k), np.tile(np.arange(k) / 4, n)
    wear = np.where(np.arange(n) < n // 3, 20.0, 0.0)
    y = rng.normal(0, 5, n)[machine] + wear[machine] * date + rng.normal(0, np.hypot(1.0, 1.5), n * k)
    surveys = Surveys(y, np.full(n * k, 1.0), machine, date)
    result = per_machine(surveys)
    assert result.within == pytest.approx(1.5, rel=0.15)
    np.testing.assert_allclose(
        result.trends[: n // 3].mean(), 20.0, atol=4 * result.trend_variances[0] ** 0.5 / np.sqrt(n / 3)
    )


@pytest.mark.parametrize("repeated", [1, 2, 4])
def test_one_machine_does_not_spoil_what_its_type_scatters(repeated: int) -> None:
    """Of eight machines few have two surveys, and one survey is in another unit: the others stay what they are."""
    rng = np.random.default_rng(3)
    machine = np.concatenate([np.repeat(np.arange(repeated), 2), np.arange(repeated, 8)])
    truth = rng.normal(0, 5, 8)
    y = truth[machine] + rng.standard_normal(len(machine))
    y[1] += 200.0
    got = quantity(Q, np.arange(8), Surveys(y, np.ones(len(y)), machine, np.full(len(y), np.nan)), 1.0)
    assert not got.each.within > 3.0  # NaN where no other machine tells
    assert 2 < got.level.spread < 10
    assert got.each.variances[7] < 4
    assert np.flatnonzero(got.level.p < 1e-3).tolist() == [0]


def test_a_pooled_value_is_as_uncertain_as_it_says() -> None:
    """Squared errors over their variances, of thirty machines that are much alike: the spread is an estimate, too.

    Without its uncertainty they are 1.65 in the mean. The limit is three standard deviations of 1800 such squares of
    which each thirty share a spread, as 60 repeats show.
    """
    rng = np.random.default_rng(8)
    squares = []
    for _ in range(60):
        truth = rng.normal(0, 0.3, 30)
        result = normal(truth + rng.standard_normal(30), np.ones(30))
        squares.append(np.mean(np.square((result.pooled - truth) / result.pooled_std)))
    assert np.mean(squares) < 1 + 3 * np.std(squares) / np.sqrt(len(squares))


def test_a_single_survey_of_each_machine_says_nothing_of_scatter_and_trend() -> None:
    result = per_machine(Surveys(np.arange(5.0), np.ones(5), np.arange(5), np.full(5, np.nan)))
    assert np.isnan(result.within)
    assert np.isnan(result.trends).all()
    np.testing.assert_allclose(result.values, np.arange(5.0))


def test_benjamini_and_hochberg_s_own_example() -> None:
    """Table 1 of their paper: at 0.05 the four smallest of 15 are rejected."""
    p = np.array(
        [1e-4, 4e-4, 0.0019, 0.0095, 0.0201, 0.0278, 0.0298, 0.0344, 0.0459, 0.324, 0.4262, 0.5719, 0.6528, 0.759, 1.0]
    )
    assert (adjusted(p) <= 0.05).tolist() == [True] * 4 + [False] * 11
    assert adjusted(p[::-1])[::-1].tolist() == adjusted(p).tolist()
    assert np.isnan(adjusted(np.array([0.01, np.nan]))[1])


def test_false_ones_are_few_in_nearly_every_fleet_and_not_in_the_mean_only() -> None:
    """In 300 fleets of 3000 machines, 300 of them ailing, more than 1 % of those found are false in at most 5 %.

    The limit is three binomial standard deviations (0.038) above. Benjamini and Hochberg alone, whose mean is 0.9 %,
    let 28 % of fleets have more. Of ailing machines that stand as far apart as here all are found.
    """
    rng = np.random.default_rng(2)
    p = rng.random((300, 3000))
    p[:, :300] = 1e-12
    group = np.arange(3000)
    found = np.array([selected(row, group, 3000, 0.01).found for row in p])
    false = found[:, 300:].sum(axis=1)
    assert found[:, :300].all()
    assert (false > 0.01 * found.sum(axis=1)).mean() < 0.05 + 0.038
    alone = np.array([adjusted(row) <= 0.01 for row in p])
    assert 0.2 < (alone[:, 300:].sum(axis=1) > 0.01 * alone.sum(axis=1)).mean() < 0.4


def test_the_bound_is_that_of_guo_and_romano() -> None:
    """Without anything to find: the least of m uniform p-values is below it in 5 %, 1 - 0.95^(1/m)."""
    assert surely(np.full(40, 0.5), 0.01) == pytest.approx(1 - 0.95 ** (1 / 40))
    found = surely(np.concatenate([np.zeros(200), np.full(800, 0.5)]), 0.01)  # of 200 two may be false
    assert found == pytest.approx(betaincinv(3, 998, 0.05))
    assert surely(np.array([np.nan]), 0.01) == 0.0


def test_tests_of_groups_that_are_not_found_do_not_count() -> None:
    p = np.array([1e-6, 0.9, 1e-3, 0.8, np.nan])
    result = selected(p, np.array([0, 0, 1, 1, 2]), 3, 0.01)
    assert result.found.tolist() == [True, True, False]
    assert result.tests.tolist() == [True, False, True, False, False]
    assert result.p[0] == pytest.approx(2e-6)
    assert np.isnan(result.p[2])


@pytest.mark.parametrize("spread", first_of([0.5, 2.0]))
def test_pooled_estimates_beat_single_ones_by_the_theoretical_factor(spread: float) -> None:
    """Mean squared error, spread^2 / (spread^2 + v): 0.44 and 0.93 here.

    Limit: three standard deviations of 10 800 errors, plus one part in a hundred for a mean and a spread that are
    estimated from 90 machines.
    """
    drawn = drawn_fleet(kinds(2, 60, spread=spread), 100, seed=3)
    seen, theory, std = drawn.ratio()
    assert seen == pytest.approx(theory, rel=3 * std + 0.01)
    assert 0.9 < theory < 0.95 if spread == 2 else 0.4 < theory < 0.5


def test_a_fleet_of_five_types() -> None:
    """10 % ailing and one type with a fault of its design: found, at most 1 % false alarms."""
    types = kinds(5, 20)
    types[2] = with_fault(types[2], 4, 3.0)
    drawn = drawn_fleet(types, 60, seed=1)
    assert len(drawn.ailing) > 20
    # of those that stay within 5 standard deviations some are missed: no more than 1 % false ones surely has that price
    assert len(drawn.ailing - drawn.found) <= 0.05 * len(drawn.ailing)
    assert len(drawn.found - drawn.ailing) <= 0.01 * 300
    common = drawn.result.common[drawn.result.common["common"]]
    assert [(r["type"], r["name"]) for _, r in common.iterrows()] == [("type 3", "q4")]


@pytest.mark.long
def test_a_healthy_fleet_has_no_machine_to_visit() -> None:
    """At a rate of 1 %, in 20 fleets: at most two by the binomial distribution (P of three or more below 0.002)."""
    alarms = sum(bool(drawn_fleet(kinds(1, 10), 40, ailing=0.0, seed=s).found) for s in range(20))
    assert alarms <= 2
