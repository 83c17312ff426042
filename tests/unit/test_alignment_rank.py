"""The rotation of the measuring frame is determined as far as the nominal points spread beside the misfit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from identification.observation.frames import align

SCALES = st.sampled_from([1e-3, 0.1, 10.0, 1e3, 1e4])


@settings(max_examples=150)
@given(
    st.integers(0, 10**6),
    st.integers(1, 60),
    SCALES,
    st.sampled_from([(0, 0, 0), (1, 0, 0), (1, 0.7, 0), (1, 0.8, 0.6)]),
    st.floats(-5, 1),
)
def test_no_rotation_is_taken_from_the_misfit(
    seed: int, n: int, scale: float, shape: tuple[float, float, float], misfit: float
) -> None:
    """Points and lines and volumes of any size, turned or not, with errors of 1e-5 to 10 times their size.

    Either the rotation is right within what the misfit over the spread allows, or it is said to be undetermined.
    """
    rng = np.random.default_rng(seed)
    turn = Rotation.random(rng=rng)
    away = rng.uniform(-3, 3, 3) * scale
    points = Rotation.random(rng=rng).apply(rng.uniform(-1, 1, (n, 3)) * shape) * scale + away
    noise = 10**misfit * scale
    truth = Rotation.identity() if seed % 2 else turn
    measured = truth.apply(points) + rng.normal(0, noise, (n, 3)) + away
    pose = align(points, measured)
    found = Rotation.from_matrix(pose.rotation)
    if len(pose.undetermined) == 3:
        assert found.magnitude() == 0
        return
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(points.T, bias=True)), 0))[::-1]
    if len(pose.undetermined) == 1:  # the line goes where it went, without any turn about itself
        line = pose.undetermined[0]
        gap = np.arccos(np.clip(found.apply(line) @ truth.apply(line), -1, 1))
        assert gap < max(0.5, 10 * noise / spread[0])
        assert found.magnitude() < np.pi + 1e-9
        assert abs(found.as_rotvec() @ line) < 1e-6 * max(found.magnitude(), 1e-9) + 1e-9
    else:
        assert (found * truth.inv()).magnitude() < max(0.5, 10 * noise / spread[1])
        assert spread[1] > 0.3 * noise / np.sqrt(n)  # else any rotation would do


@pytest.mark.long
@pytest.mark.parametrize("n", [2, 3, 4, 6, 12, 48, 500])
def test_a_point_seen_often_never_turns(n: int) -> None:
    """Nominal points that differ by rounding only, measured with errors ten times as large: 200 times each."""
    for seed in range(200):
        rng = np.random.default_rng(seed)
        points = np.array([120.0, -40.0, 600.0]) + rng.uniform(-5e-4, 5e-4, (n, 3))
        pose = align(points, points + rng.normal(0, 1e-2, (n, 3)))
        assert len(pose.undetermined) == 3


def test_clouds_of_symmetric_points_keep_their_rotation() -> None:
    """Corners of a cube and of an octahedron: all principal directions alike, and the rotation sure all the same."""
    cube = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T * 100.0
    cross = np.vstack([np.eye(3), -np.eye(3)]) * 100.0
    rng = np.random.default_rng(3)
    for points in (cube, cross):
        for _ in range(50):
            turn = Rotation.random(rng=rng)
            pose = align(points, turn.apply(points) + rng.normal(0, 1e-2, points.shape))
            assert not len(pose.undetermined)
            assert (Rotation.from_matrix(pose.rotation) * turn.inv()).magnitude() < 1e-3


def on_a_line(spread: float, n: int, seed: int, turn: float = 0.0, **more: float) -> int:
    """Rotations that stay undetermined of n points on a line, measured with noise of 1: `spread` and all lengths in it.

    The line is measured turned by `turn` (rad).
    """
    rng = np.random.default_rng(seed)
    along = np.linspace(-1, 1, n)
    points = np.outer(along / np.std(along) * spread, [0.6, 0.8, 0.0])
    seen = Rotation.from_rotvec([0.0, 0.0, turn]).apply(points) + rng.normal(size=(n, 3))
    return len(align(points, seen, **more).undetermined)  # type: ignore[arg-type]


def test_points_that_spread_ten_times_their_misfit_determine_a_direction() -> None:
    """Of a line one rotation is left; errors that no machine makes are mistakes, and count no further."""
    assert [on_a_line(7.0, 500, seed) for seed in range(5)] == [3] * 5
    assert [on_a_line(13.0, 500, seed) for seed in range(5)] == [1] * 5
    assert [on_a_line(7.0, 500, seed, largest=0.5) for seed in range(5)] == [1] * 5


def test_points_that_spread_less_determine_a_direction_where_they_are_clearly_turned() -> None:
    """A turn that doubles the sum of squares may be an error of the machine, one that makes it tenfold is none."""
    assert [on_a_line(7.0, 500, seed, turn=0.25) for seed in range(5)] == [3] * 5
    assert [on_a_line(7.0, 500, seed, turn=1.0) for seed in range(5)] == [1] * 5


@pytest.mark.parametrize(("n", "spread"), [(2, 3.0), (3, 3.0), (4, 7.0)])
def test_few_points_seldom_look_turned_or_sure_by_chance(n: int, spread: float) -> None:
    """One in a thousand looks turned, and fewer still have so small a misfit: of 300 hardly one."""
    assert sum(on_a_line(spread, n, seed) < 3 for seed in range(300)) <= 4


@pytest.mark.long
@pytest.mark.parametrize("missing", [[2], [0]])
@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40)
def test_missing_components_of_a_volume(missing: list[int], seed: int) -> None:
    """What the measured components determine is right for any rotation: the predicted components are."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (80, 3)) * [400, 300, 250]
    truth = Rotation.random(rng=rng)
    measured = truth.apply(points) + rng.uniform(-500, 500, 3) + rng.normal(0, 2e-3, (80, 3))
    measured[:, missing] = np.nan
    pose = align(points, measured, largest=0.2)
    seen = np.isfinite(measured)
    assert np.abs((pose.apply(points) - measured)[seen]).max() < 0.02
    assert (Rotation.from_matrix(pose.rotation) * truth.inv()).magnitude() < 1e-4
    assert not len(pose.undetermined)


@given(st.integers(0, 2**32 - 1), st.floats(-180, 180), st.floats(-3e-5, 3e-5))
@settings(max_examples=40)
def test_a_grid_plate_is_turned_in_its_plane_only(seed: int, angle: float, scale: float) -> None:
    """An error of scale is not taken for a tilt, which shortens one direction as well."""
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(0, 800, (90, 1)), rng.uniform(0, 600, (90, 1)), np.full((90, 1), -300.0)])
    turned = Rotation.from_euler("z", angle, degrees=True)
    measured = turned.apply(points * [1 + scale, 1, 1]) + rng.normal(0, 5e-4, (90, 3))
    measured[:, 2] = np.nan
    pose = align(points, measured, largest=0.4)
    left = Rotation.from_matrix(pose.rotation) * turned.inv()
    assert left.magnitude() < 1e-4
    assert len(pose.undetermined) == 2
    assert np.abs(pose.undetermined[:, 2]).max() < 0.02


def test_two_sensors_about_one_point_determine_no_rotation() -> None:
    rng = np.random.default_rng(0)
    noise = rng.normal(0, 1e-3, (60, 3))
    noise[:, 2] = np.nan
    pose = align(np.full((60, 3), 100.0) + rng.normal(0, 5e-4, (60, 3)), 100.0 + noise)
    assert np.array_equal(pose.rotation, np.eye(3))
    assert len(pose.undetermined) == 3


@given(st.integers(0, 2**32 - 1), st.floats(0, 1.2))
@settings(max_examples=40)
def test_one_component_has_a_direction(seed: int, angle: float) -> None:
    """Of points in a volume all that it sees is right; about its own direction nothing turns."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-300, 300, (60, 3))
    axis = rng.normal(size=3)
    turned = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
    measured = np.column_stack([np.full((60, 2), np.nan), turned.apply(points)[:, 2] + 5 + rng.normal(0, 1e-4, 60)])
    pose = align(points, measured, largest=0.4)
    others = rng.uniform(-300, 300, (60, 3))
    assert pose.apply(others)[:, 2] == pytest.approx(turned.apply(others)[:, 2] + 5, abs=1e-3)
    assert len(pose.undetermined) == 1


def test_one_component_that_is_none_of_the_points_has_the_machines_direction() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-300, 300, (60, 3))
    measured = np.column_stack([np.full((60, 2), np.nan), rng.uniform(-300, 300, 60)])
    pose = align(points, measured, largest=0.4)
    assert np.array_equal(pose.rotation, np.eye(3))
    assert len(pose.undetermined) == 3


def test_one_component_along_its_own_line_has_the_machines_direction() -> None:
    points = np.column_stack([np.zeros((60, 2)), np.linspace(0, 900, 60)])
    measured = np.column_stack([np.full((60, 2), np.nan), 1.00002 * points[:, 2] + 5])
    pose = align(points, measured, largest=0.4)
    assert np.array_equal(pose.rotation, np.eye(3))
    assert len(pose.undetermined) == 3
