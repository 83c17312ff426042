"""A wave at positions that are whole steps apart may be a shorter one."""

from __future__ import annotations

import numpy as np

from errormodel.machine_file import read_machine
from identification.diagnosis.results.aliased_periods import _aliases, _step

X = read_machine("vertical_three_axis").joints[0]


def test_what_has_the_same_values_at_the_positions_is_told() -> None:
    """A laser's thirteen targets, 52 mm apart, on a screw of 10 mm."""
    q = 52.0 * np.arange(13)
    (apparent,) = (1 / abs(1 / 10.0 - 5 / 52.0),)
    assert _step(q, X) == 52.0
    others = _aliases(apparent, 52.0)
    assert np.isclose(others, 10.0).any()
    for period in others:
        fit = np.column_stack([np.cos(2 * np.pi * q / period), np.sin(2 * np.pi * q / period), np.ones_like(q)])
        wave = np.cos(2 * np.pi * q / apparent + 0.3)
        np.testing.assert_allclose(fit @ np.linalg.lstsq(fit, wave)[0], wave, atol=1e-9)


def test_positions_at_random_tell_waves_apart() -> None:
    q = np.random.default_rng(2).uniform(*X.travel, 60)
    assert _step(q, X) == 0.0
    assert _step(np.array([3.0, 3.0]), X) == 0.0
    assert _step(np.append(52.0 * np.arange(13), [17.0, 403.0]), X) == 0.0
