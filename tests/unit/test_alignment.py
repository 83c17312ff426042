"""The measuring frame, of any size: what the points determine is found, what they do not stays where it was."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from identification.observation.frames import align, mean_rotation
from identification.observation.pose import Pose
from tests.helpers.chains import Array

SHIFT = np.array([1.0, 2.0, 3.0])


def pose_of(seed: int, size: float = np.pi) -> Pose:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(size * rng.uniform() * axis / np.linalg.norm(axis)).as_matrix()
    return Pose(turn, rng.normal(0, 3e3, 3))


def cloud(n: int, seed: int = 0, extent: tuple[float, float, float] = (2000, 1000, 800)) -> Array:
    return np.random.default_rng(seed).uniform(-0.5, 0.5, (n, 3)) * extent + [500, 0, 900]


def assert_carries(pose: Pose, points: Array, expected: Array, tolerance: float) -> None:
    assert np.abs(pose.apply(points) - expected).max() < tolerance
    np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(pose.rotation) == pytest.approx(1)
    np.testing.assert_allclose(pose.invert(pose.apply(points)), points, atol=1e-9)


@settings(max_examples=40)
@given(st.integers(0, 999), st.integers(3, 40))
def test_any_pose_of_any_cloud(seed: int, n: int) -> None:
    pose, points = pose_of(seed), cloud(n, seed)
    assert_carries(align(points, pose.apply(points)), points, pose.apply(points), 1e-4)


@pytest.mark.parametrize("extent", [(2000, 1000, 0), (2000, 0, 0), (0, 0, 5), (1e-3, 1e-3, 1e-3)])
@pytest.mark.parametrize("seed", range(5))
def test_flat_and_straight_and_tiny_clouds(extent: tuple[float, float, float], seed: int) -> None:
    """A plane has no mirror image, a line no turn about itself beyond what is needed."""
    pose, points = pose_of(seed), cloud(20, seed, extent)
    assert_carries(align(points, pose.apply(points)), points, pose.apply(points), 1e-5)


@pytest.mark.parametrize("n", [3, 4, 5, 6, 7, 10])
def test_few_noisy_points_are_all_used(n: int) -> None:
    """None is thrown out for being the worst of three: least squares is all there is."""
    for seed in range(20):
        pose, points = pose_of(seed), cloud(n, seed)
        measured = pose.apply(points) + np.random.default_rng(seed).normal(0, 5e-3, (n, 3))
        gap = align(points, measured).apply(points) - measured
        assert np.sqrt(np.mean(gap**2)) < 9e-3


def test_half_a_turn() -> None:
    for axis in np.vstack([np.eye(3), [[0.6, 0, 0.8]]]):
        pose, points = Pose(Rotation.from_rotvec(np.pi * axis).as_matrix(), np.ones(3)), cloud(30)
        assert_carries(align(points, pose.apply(points)), points, pose.apply(points), 1e-4)


def test_what_a_line_leaves_open_is_not_turned() -> None:
    points = cloud(20, 1, (2000, 0, 0))
    found = align(points, points + SHIFT)
    assert Rotation.from_matrix(found.rotation).magnitude() < 1e-9
    turned = Rotation.from_rotvec([0, 0, 0.7])
    found = align(points, turned.apply(points))
    assert Rotation.from_matrix(found.rotation).magnitude() == pytest.approx(0.7, abs=1e-6)


def test_one_point_and_two() -> None:
    point = np.array([[100.0, 200.0, 300.0]])
    found = align(point, point + SHIFT)
    np.testing.assert_allclose(found.translation, [1, 2, 3])
    np.testing.assert_array_equal(found.rotation, np.eye(3))
    same = np.repeat(point, 5, axis=0)
    assert_carries(align(same, same + SHIFT), same, same + SHIFT, 1e-9)


def test_components_never_measured_stay() -> None:
    points = cloud(30)
    gap = np.array([5.0, -7.0, np.nan])
    found = align(points, points + gap)
    np.testing.assert_allclose(found.translation, [5, -7, 0])
    assert (found.rotation == np.eye(3)).all()


@pytest.mark.parametrize("share", [0.1, 0.2, 0.3])
@pytest.mark.parametrize("size", [0.5, 50.0, 1e4])
@pytest.mark.parametrize("how", ["scattered", "together", "rotated"])
@pytest.mark.parametrize("seed", range(3))
def test_gross_outliers(share: float, size: float, how: str, seed: int) -> None:
    """Up to 30 %, of any size, even if all go the same way: the frame is that of the others, within their noise."""
    rng, n = np.random.default_rng(seed), 100
    pose, points = pose_of(seed), cloud(n, seed)
    measured = pose.apply(points) + rng.normal(0, 5e-3, (n, 3))
    bad = rng.permutation(n)[: round(share * n)]
    if how == "scattered":
        measured[bad] += rng.normal(0, size, (len(bad), 3))
    elif how == "together":
        measured[bad] += size * np.array([0.6, 0.0, -0.8])
    else:  # a second frame
        turn = Rotation.from_rotvec([0, 0, min(size / 1e3, 1.0)])
        measured[bad] = turn.apply(measured[bad]) + size
    assert_carries(align(points, measured), points, pose.apply(points), 0.02)


def test_weights_count() -> None:
    rng, pose, points = np.random.default_rng(0), pose_of(4), cloud(60)
    sigma = np.where(np.arange(60) < 20, 1e-3, 0.5)
    measured = pose.apply(points) + rng.normal(size=(60, 3)) * sigma[:, None]
    assert_carries(align(points, measured, 1 / sigma), points, pose.apply(points), 6e-3)


def test_mean_rotation() -> None:
    mount = Rotation.from_rotvec([2.0, -1.0, 0.5])
    rng = np.random.default_rng(0)
    seen = (Rotation.from_rotvec(rng.normal(0, 1e-5, (50, 3))) * mount).as_matrix()
    seen[:12] = Rotation.random(12, rng=1).as_matrix()
    assert Rotation.from_matrix(mean_rotation(seen).T @ mount.as_matrix()).magnitude() < 1e-5
