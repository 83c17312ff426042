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


@pytest.mark.parametrize("known", [{}, {"dead_path": 100.0}])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_station_roughly_on_the_line_of_its_points_stands_on_it(side: float, known: dict[str, float]) -> None:
    """Of a bow of 20 um, as errors of a machine make it, lengths would put it some millimetres beside the line."""
    along = np.linspace(0, 2000, 21)
    points = np.outer(along, [0.6, 0.8, 0.0])
    stands = points[0] - 600 * np.array([0.6, 0.8, 0.0]) if side > 0 else points[-1] + 600 * np.array([0.6, 0.8, 0.0])
    readings = np.linalg.norm(points - stands, axis=1) - 100.0 + 0.02 * (along / 1000 - 1) ** 2
    found = located(points, readings, known, near=(stands + np.array([12.0, -9.0, 5.0])).tolist())
    place = np.array([found[n] for n in "xyz"])
    assert np.linalg.norm(np.cross(place, [0.6, 0.8, 0.0])) < 1e-9
    lengths = np.linalg.norm(points - place, axis=1) - {**known, **found}["dead_path"]
    assert np.abs(lengths - readings).max() < 0.021


def test_lengths_of_the_wrong_sign_put_a_station_behind_its_points() -> None:
    points = np.outer(np.linspace(0, 2000, 21), [1.0, 0.0, 0.0])
    near = np.array([-600.0, 5.0, 0.0])
    readings = np.linalg.norm(points - near, axis=1) - 600.0
    located(points, readings, {}, near=near.tolist())
    with pytest.raises(ValueError, match=r"other side of the points than near: .* wrong sign"):
        located(points, -readings, {}, near=near.tolist())


def test_a_station_beside_the_line_of_its_points_is_found_there() -> None:
    points = np.outer(np.linspace(0, 2000, 21), [1.0, 0.0, 0.0])
    for stands in ([-300.0, 150.0, 0.0], [-300.0, 0.0, 18.0]):
        readings = np.linalg.norm(points - stands, axis=1) - 40.0
        found = located(points, readings, {}, near=[stands[0] + 3.0, stands[1] + 0.5, stands[2] - 0.5])
        assert np.hypot(found["y"], found["z"]) == pytest.approx(float(np.linalg.norm(stands[1:])), abs=1e-3)
