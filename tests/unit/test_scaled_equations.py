"""Steps of normal equations: the same by a triangle as by eigenvectors, and none along what they do not determine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from identification.estimation.scaled_equations import WeighedEquations, determined_step
from identification.observation.sums import Sums


@given(st.integers(1, 12), st.integers(0, 99), st.floats(0, 5))
def test_a_step_that_is_determined_solves_the_equations(count: int, seed: int, decades: float) -> None:
    rng = np.random.default_rng(seed)
    design = rng.normal(size=(3 * count, count)) * 10.0 ** rng.uniform(-decades, decades, count)
    gram, truth = design.T @ design, rng.normal(size=count)
    step = determined_step(gram, gram @ truth, 1 / np.sqrt(np.diag(gram)))
    np.testing.assert_allclose(step, truth, rtol=1e-6, atol=1e-6 * np.abs(truth).max())


@pytest.mark.parametrize("seed", range(5))
def test_along_what_is_not_determined_there_is_no_step(seed: int) -> None:
    rng = np.random.default_rng(seed)
    design = rng.normal(size=(30, 6))
    design[:, 5] = design[:, 4]  # only their sum is seen
    scale = 1 / np.linalg.norm(design, axis=0)
    aim = rng.normal(size=30)
    step = determined_step(design.T @ design, design.T @ aim, scale)
    np.testing.assert_allclose(step, np.linalg.lstsq(design * scale, aim, rcond=None)[0] * scale, atol=1e-9)
    assert step[4] == pytest.approx(step[5])


def test_no_equations_have_no_step() -> None:
    assert determined_step(np.zeros((0, 0)), np.zeros(0), np.zeros(0)).shape == (0,)


def test_an_eigenvalue_below_zero_shows_which_are_none() -> None:
    """Equations less those of a part, whose M was taken at other values: what is left of a direction is an error."""
    turn = np.linalg.qr(np.random.default_rng(4).normal(size=(4, 4)))[0]
    gram = turn @ np.diag([2.0, 1.0, 2e-6, -3e-6]) @ turn.T
    step = determined_step(gram, turn @ [2.0, 1.0, 1e-3, 1e-3], np.ones(4))
    np.testing.assert_allclose(turn.T @ step, [1.0, 1.0, 0.0, 0.0], atol=1e-9)


def test_one_factor_serves_noise_levels_that_hardly_differ() -> None:
    """The step and what it uses, as by solution and inverse; other products, columns and levels are other equations."""
    rng = np.random.default_rng(0)
    designs = {"position": rng.normal(size=(20, 5)), "orientation": rng.normal(size=(15, 5))}
    sums = {kind: Sums(own.T @ own, rng.normal(size=5)) for kind, own in designs.items()}
    sigma, precision, base = {"position": 0.5, "orientation": 2.0}, np.full(5, 0.1), np.array([0, 1, 3])
    own = WeighedEquations(sums, sigma, precision, base)
    gram = sum(s.gram / sigma[kind] ** 2 for kind, s in sums.items()) + np.diag(precision)
    inverse, slope = np.linalg.inv(gram[np.ix_(base, base)]), rng.normal(size=3)
    np.testing.assert_allclose(own.solve(slope), inverse @ slope, rtol=1e-10)
    used = {kind: np.trace(inverse @ s.gram[np.ix_(base, base)]) / sigma[kind] ** 2 for kind, s in sums.items()}
    assert own.used == pytest.approx(used, rel=1e-10)
    moved = {kind: replace(s, slope=s.slope + 1) for kind, s in sums.items()}
    assert own.serves(moved, {kind: (1 + 1e-7) * level for kind, level in sigma.items()}, precision, base)
    assert not own.serves(sums, {**sigma, "position": 0.5001}, precision, base)
    assert not own.serves(sums, sigma, precision.copy(), base)
    assert not own.serves(sums, sigma, precision, base[:2])
    assert not own.serves({kind: replace(s, gram=s.gram.copy()) for kind, s in sums.items()}, sigma, precision, base)
