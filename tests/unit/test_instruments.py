"""What instruments say of their noise: covariances of trackers and of machines that measure lengths."""

from __future__ import annotations

import math

import numpy as np
import pytest

from errormodel.instruments import instruments
from errormodel.instruments.laser_tracker import LaserTracker

# ---- instruments


def test_tracker_covariance_is_that_of_spherical_noise():
    tracker = LaserTracker(type="laser-tracker", station=[100.0, -200.0, 50.0], range=[0.02, 2e-5], angle=1e-4)
    point = np.array([[1500.0, 700.0, -400.0]])
    (covariance,) = tracker.covariance(point)
    rng = np.random.default_rng(0)
    n = 400_000
    x, y, z = (point - tracker.station)[0]
    r, azimuth, elevation = (
        math.sqrt(x * x + y * y + z * z),
        math.atan2(y, x),
        math.asin(z / np.hypot(np.hypot(x, y), z)),
    )
    r_n = r + math.hypot(0.02, 2e-5 * r) * rng.standard_normal(n)
    a_n = azimuth + 1e-4 / math.cos(elevation) * rng.standard_normal(n)
    e_n = elevation + 1e-4 * rng.standard_normal(n)
    seen = r_n * np.array([np.cos(e_n) * np.cos(a_n), np.cos(e_n) * np.sin(a_n), np.sin(e_n)])
    np.testing.assert_allclose(np.cov(seen), covariance, atol=0.01 * np.trace(covariance))
    drawn = tracker.draw_noise(np.repeat(point, n, axis=0), rng)
    np.testing.assert_allclose(np.cov(drawn.T), covariance, atol=0.01 * np.trace(covariance))


@pytest.mark.parametrize("name", ["profiler", "cmm", "interferometer"])
def test_length_dependent_covariance(name: str):
    instrument = instruments()[name](type=name, sigma=[0.003, 1e-6])
    points = np.array([[3000.0, 0.0, 4000.0], [np.nan, 1000.0, np.nan]])
    covariance = instrument.covariance(points)
    np.testing.assert_allclose(covariance[0], (0.003**2 + 0.005**2) * np.eye(3))
    np.testing.assert_allclose(covariance[1], (0.003**2 + 0.001**2) * np.eye(3))
    a, b = (instrument.draw_noise(points, np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(a, b)


def test_tracker_at_odd_points():
    tracker = LaserTracker(type="laser-tracker", range=[0.02, 2e-5], angle=1e-4)
    points = np.array([[0.0, 0.0, 0.0], [1000.0, np.nan, 0.0]])
    assert np.isfinite(tracker.draw_noise(points, np.random.default_rng(0))).all()
    assert not instruments()["plain"](type="plain").draw_noise(points, np.random.default_rng(0)).any()


def test_usual_uncertainty_grows_from_the_station():
    tracker = LaserTracker(type="laser-tracker", station=[1000.0, 0.0, 0.0])
    (a, b) = tracker.usual
    far = np.array([[5000.0, 3000.0, np.nan]])
    assert tracker.usual_sigma(far) == pytest.approx(math.hypot(a, 5000 * b))
    assert instruments()["plain"](type="plain").usual_sigma(far) is None
