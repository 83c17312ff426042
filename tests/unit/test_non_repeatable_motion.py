"""Motions that vary from row to row: seen by their levers, or where one direction is much worse; never in noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.results.non_repeatable_motion import independent_along_rows, non_repeatable_motion
from identification.diagnosis.results.residual_dependence import dependence_of
from tests.helpers.linear_models import NOISES, ROWS, linear, nothing


@pytest.mark.parametrize("kind", NOISES)
def test_no_motion_is_non_repeatable_in_noise(kind: str) -> None:
    for seed in range(40):
        rng = np.random.default_rng(900 + seed)
        assert non_repeatable_motion(linear(nothing, NOISES[kind](rng), rng)) is None, seed


def test_a_state_that_switches_between_rows_is_seen_in_the_motion_that_it_makes() -> None:
    found = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        model = linear(nothing, rng.normal(size=3 * ROWS), rng)
        tilt = 3.0 * np.tile(rng.choice([-1.0, 1.0], ROWS), 3) * model.levers["Y"][4]
        found.append(dependence_of(replace(model, residual=model.residual + model.project(tilt[None])[0]), 1.0))
    seen = [f for f in found if f is not None]
    assert len(seen) == 6
    assert {f.motion for f in seen} == {"eb"}
    assert not any(f.channels for f in seen)  # quick functions of the clock follow it as well
    # of 3 times a lever whose square is 2/3 in the mean: 2.4, less what is clipped of it
    assert all(1.6 < f.size_um < 2.8 for f in seen)
    assert all("varies from row to row as eb of" in f.text and "repeats" in f.text for f in seen)


@pytest.mark.parametrize("dwell", [1, 4, 12])
def test_what_stays_for_some_rows_wanders(dwell: int) -> None:
    """A state that is kept for four rows depends on the clock; one that is drawn anew in each depends on nothing."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        model = linear(nothing, rng.normal(size=3 * ROWS), rng)
        states = np.repeat(rng.choice([-1.0, 1.0], ROWS // dwell + 1), dwell)[:ROWS]
        tilt = 2.0 * np.tile(states, 3) * model.levers["Y"][4]
        found = dependence_of(replace(model, residual=model.residual + model.project(tilt[None])[0]), 1.0)
        assert found is not None, seed
        assert found.motion == "eb", seed
        assert found.channels == (() if dwell == 1 else ("time",)), seed
        p_value = independent_along_rows(replace(model, residual=tilt), "Y", "eb")
        assert (p_value < 1e-3) == (dwell > 1), seed


@pytest.mark.parametrize(("times", "seen"), [(1.3, False), (3.0, True)])
def test_an_instrument_is_a_little_worse_in_one_direction(times: float, seen: bool) -> None:
    for seed in range(8):
        rng = np.random.default_rng(seed)
        noise = rng.normal(size=(3, ROWS)) * np.array([[1.0], [times], [1.0]])
        found = non_repeatable_motion(linear(nothing, noise.ravel(), rng))
        assert (found is not None) == seen, seed
        if found is not None:
            assert found.motion == "dy"
            assert found.gain_over_covariance < 5.0  # a constant covariance says as much: the direction only


def test_a_motion_that_moves_no_whole_row_is_none() -> None:
    """Its lever is zero in all rows with three components, but not in the others."""
    rng = np.random.default_rng(1)
    model = linear(nothing, rng.normal(size=3 * ROWS), rng)
    model.levers["Y"][:] = 0.0
    model.levers["Y"][0, :20] = 1.0
    left = ~np.isin(np.arange(3 * ROWS), np.arange(ROWS, ROWS + 20))  # the first rows lack y
    some = replace(
        model,
        residual=model.residual[left],
        basis=model.basis[left],
        index=model.index[left],
        levers={e: own[:, left] for e, own in model.levers.items()},
    )
    assert non_repeatable_motion(some) is None
