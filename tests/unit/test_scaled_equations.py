"""Steps of normal equations: the same by a triangle as by eigenvectors, and none along what they do not determine."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from identification.estimation.scaled_equations import determined_step


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
