"""Waves along two joints together: found where they are, and in no noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.results.combined_waves import largest_wave
from identification.diagnosis.results.residual_dependence import dependence_of
from tests.helpers.chains import Array
from tests.helpers.linear_models import NOISES, ROWS, linear, nothing
from tests.helpers.nightly import first_of

WAVES = 2 * np.pi / 0.13  # rad per unit of X and of Y, whose ranges are 2


def belts(columns: dict[str, Array]) -> Array:
    """A pulley that X and Y turn together."""
    return np.asarray(1.1 * np.sin(WAVES * (columns["X"] - columns["Y"])))


def one_joint(columns: dict[str, Array]) -> Array:
    return np.asarray(0.9 * np.sin(WAVES * columns["X"]))


@pytest.mark.parametrize("kind", first_of(NOISES, 3))
@pytest.mark.parametrize("seeds", first_of([range(10), range(10, 20)]), ids=str)
def test_no_wave_is_found_in_noise(kind: str, seeds: range) -> None:
    for seed in seeds:
        rng = np.random.default_rng(500 + seed)
        assert largest_wave(linear(nothing, NOISES[kind](rng), rng)) is None, seed


@pytest.mark.long
@pytest.mark.parametrize("order", first_of(["X", "Y"]))
def test_no_wave_is_found_where_noise_follows_the_path(order: str) -> None:
    """Rows in the order of a joint's positions: what is correlated in time is in space."""
    for seed in range(15):
        rng = np.random.default_rng(700 + seed)
        model = linear(nothing, NOISES["correlated"](rng), rng)
        model.scene.columns[order].sort()
        assert largest_wave(model) is None, seed


@pytest.mark.long
@pytest.mark.parametrize(("error", "joints", "signs"), [(belts, ("X", "Y"), -1), (one_joint, ("X",), 1)])
def test_a_wave_is_found_with_its_periods(
    error: Callable[[dict[str, Array]], Array], joints: tuple[str, ...], signs: int
) -> None:
    for seed in range(8):
        rng = np.random.default_rng(seed)
        wave = largest_wave(linear(error, rng.normal(size=3 * ROWS), rng))
        assert wave is not None, seed
        assert wave.joints == joints
        assert wave.p_value < 1e-3
        np.testing.assert_allclose(wave.periods, 0.13, rtol=0.02)  # of a wave in sixteen a quarter
        assert np.sign(np.prod(wave.numbers)) == signs


def test_what_is_left_is_said_with_periods_and_size() -> None:
    rng = np.random.default_rng(3)
    model = linear(belts, rng.normal(size=3 * ROWS), rng)
    found = dependence_of(model, 1.0, wave=largest_wave(model))
    assert found is not None
    assert (found.channels, found.axis, found.units) == (("X", "Y"), "x", ("mm", "mm"))
    assert "repeats every 0.13 mm of X and every 0.13 mm of Y" in found.text
    assert 0.3 < found.size_um < 1.2  # 0.9 / sqrt(2) is there


def test_few_rows_say_nothing() -> None:
    rng = np.random.default_rng(1)
    whole = linear(belts, rng.normal(size=3 * ROWS), rng)
    few = np.isin(whole.index, np.arange(30))
    levers = {name: own[:, few] for name, own in whole.levers.items()}
    some = type(whole)(whole.chain, whole.residual[few], whole.basis[few], levers, {}, whole.index[few], whole.scene)
    assert largest_wave(some) is None


def test_levels_show_no_wave_that_has_two_of_them_in_a_period() -> None:
    """Its sine is zero at all of them, or a longer wave has the same values: nothing between levels is known."""
    levels = np.linspace(-1, 1, 9)
    for seed in range(6):
        rng = np.random.default_rng(seed)
        model = linear(nothing, rng.normal(size=3 * ROWS), rng)
        z = model.scene.columns["Z"]
        z[:] = rng.choice(levels, ROWS)
        wave = 1.5 * np.cos(np.pi * (z + 1) / 0.25) * np.cos(2 * np.pi * model.scene.columns["X"] / 0.13)
        shown = np.zeros(3 * ROWS)
        shown[:ROWS] = wave
        left = shown - model.basis @ (model.basis.T @ shown)
        found = largest_wave(replace(model, residual=model.residual + left))
        assert found is None or all(p > 0.5 for j, p in zip(found.joints, found.periods, strict=True) if j == "Z"), seed
