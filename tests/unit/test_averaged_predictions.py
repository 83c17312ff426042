"""Predictions averaged over what a recording leaves open of effects."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from identification.uncertainty.other_effects import OtherEffect, with_other_effects

PREDICTED = np.array([[1.0, 2.0, 3.0, 0.01, 0.02, 0.03, 0.001, 0.002, 0.003]])


@given(st.lists(st.tuples(st.floats(0.0, 0.2), st.floats(-1.0, 1.0)), min_size=1, max_size=4))
def test_mean_and_variance_are_those_of_the_mixture(models: list[tuple[float, float]]) -> None:
    """Of one effect one model holds: moments of a mixture of normal distributions, position and error alike."""
    others = [
        OtherEffect(0, {"sensor": f"T_{k}"}, weight, {"change": change}) for k, (weight, change) in enumerate(models)
    ]

    def changed(other: OtherEffect) -> np.ndarray:
        return np.full((1, 3), other.parameters["change"])

    (out,) = with_other_effects(others, 2, PREDICTED, changed)
    weights = np.array([1 - sum(w for w, _ in models), *(w for w, _ in models)])
    means = 1.0 + np.array([0.0, *(change for _, change in models)])
    mean = weights @ means
    variance = weights @ (0.001**2 + (means - mean) ** 2)
    assert out[0] == pytest.approx(mean)
    assert out[3] - PREDICTED[0, 3] == pytest.approx(mean - 1.0)
    assert out[6] == pytest.approx(np.sqrt(variance), rel=1e-6)


def test_time_constants_and_other_effects_are_independent() -> None:
    """Their variances add, whatever their probabilities add up to."""
    changes = {"tau": 0.3, "sensor": 0.4, "name": -0.1}
    others = [
        OtherEffect(0, {"tau": 60.0}, 0.6, {}),
        OtherEffect(0, {"sensor": "T_a", "tau": 60.0}, 0.7, {}),
        OtherEffect(0, {"element": "bed", "sensor": "T_a"}, 0.6, {}, "structure-drift"),
        OtherEffect(1, {"tau": 9.0}, 0.5, {}),
    ]

    def changed(other: OtherEffect) -> np.ndarray:
        return np.full((1, 3), changes["name" if other.name else "sensor" if "sensor" in other.options else "tau"])

    (out,) = with_other_effects(others, 2, PREDICTED, changed)
    assert out[0] == pytest.approx(
        1 + 0.7 * 0.4 - 0.6 * 0.1
    )  # the likeliest time constant is in the middle of the others
    between = 0.6 * 0.3**2 + 0.7 * 0.3 * 0.4**2 + 0.6 * 0.4 * 0.1**2 + 0.5 * 0.3**2
    assert out[6] == pytest.approx(np.sqrt(0.001**2 + between))


def test_an_effect_that_may_be_there_as_well_widens_and_does_not_move() -> None:
    """What was not found moves no prediction; the mean square of what it would change is in the uncertainty."""
    others = [OtherEffect(1, {"joint": "X"}, 0.3, {}, "backlash"), OtherEffect(1, {"joint": "Y"}, 0.1, {}, "backlash")]

    def changed(other: OtherEffect) -> np.ndarray:
        return np.full((1, 3), 0.2 if other.options["joint"] == "X" else -0.5)

    (out,) = with_other_effects(others, 1, PREDICTED, changed)
    assert out[:6] == pytest.approx(PREDICTED[0, :6])
    assert out[6] == pytest.approx(np.sqrt(0.001**2 + 0.3 * 0.2**2 + 0.1 * 0.5**2))
