"""Places of stations from lengths to points in a plane, which a place on either side explains alike."""

from __future__ import annotations

import numpy as np
import pytest

from errormodel.observations.base import LineError
from errormodel.observations.station import located


@pytest.mark.parametrize("dead_path", [0.0, 659.65])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_of_two_places_the_one_near_is_taken(side: float, dead_path: float) -> None:
    rng = np.random.default_rng(8)
    tilt = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    points = np.column_stack([rng.uniform(-300, 300, (60, 2)), np.zeros(60)]) @ tilt.T
    truth = np.array([-120.0, 250.0, side * 700.0]) @ tilt.T
    readings = np.linalg.norm(points - truth, axis=1) - dead_path + rng.normal(0, 2e-3, 60)
    with pytest.raises(ValueError, match=r"at \[.*\] and at \[.*\] mm alike. Write near:"):
        located(points, readings, {})
    for off in (0.0, 60.0):
        found = located(points, readings, {}, near=truth + off)
        np.testing.assert_allclose([found[n] for n in "xyz"], truth, atol=0.5)
        assert found["dead_path"] == pytest.approx(dead_path, abs=0.5)


@pytest.mark.parametrize("known", [{}, {"dead_path": 12.5}])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_lengths_along_a_straight_line_show_no_place(sign: float, known: dict[str, float]) -> None:
    """The place that is handed on is one on the line, from which a beam along it reads the same."""
    way = np.array([0.6, -0.48, 0.64])
    points = np.array([10.0, 20.0, 30.0]) + np.linspace(0, 900, 12)[:, None] * way
    start = np.array([10.0, 20.0, 30.0]) + (450 - sign * 700) * way
    readings = np.linalg.norm(points - start, axis=1) - 12.5
    with pytest.raises(LineError, match=r"straight line.*Write near:") as error:
        located(points, readings, known)
    found = {**known, **error.value.start}
    place = np.array([found[n] for n in "xyz"])
    np.testing.assert_allclose(np.linalg.norm(points - place, axis=1) - found["dead_path"], readings, atol=1e-9)
    if known:
        np.testing.assert_allclose(place, start, atol=1e-9)
