"""The paper's experiment with a profiler on a gantry's crossbeam, simulated; imports nothing of what it tests.

A free-form artefact stands on the table. The sensor looks down on it from the end of the chain: lever ``L`` from the
joint's frame, mount ``M`` from the tool frame. A point of the sensor's frame is at ``E L M p``; its height is where
that meets the artefact, found by Newton's method on the sensor's own grid. Finite rotations everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

POSITIONS = [350.0, 550.0, 750.0, 950.0, 1150.0, 1350.0, 1550.0, 1750.0]  # mm, section 4.3
MINUTES = (7, 15, 30, 45, 60, 90, 120, 150, 180)
LEVER = (-900.0, 0.0, -2051.0)
MOUNT = (2.7710384, -0.876047, -173.9324, 0.0028968, -0.0013013, -0.0090742)  # mm, rad: Eq. (11)
PRINTED_MOUNT = np.array([  # Eq. (11)
    [0.9999579, 0.0090741, -0.001301, 2.7710384],
    [-0.009074, 0.9999546, -0.002897, -0.876047],
    [0.0012751, 0.0028967, 0.9999949, -173.9324],
    [0, 0, 0, 1],
])  # fmt: skip
PRINTED_SIX = (2.771, -0.876, 4.219 - 178.152, 0.0029, -0.0013, -0.0091)  # section 4.2
POINTS, PITCH = 3200, 12.5e-3  # of a profile, mm
NOISE = 0.5e-3  # mm, repeatability of a height
CENTRE, RADIUS, HEIGHT = (0.0, 0.0, 0.0), 12.496, -178.152


def pose(six):
    """Trans(x, y, z) Rx Ry Rz."""
    (ca, cb, cc), (sa, sb, sc) = np.cos(six[3:]), np.sin(six[3:])
    matrix = np.eye(4)
    matrix[:3, :3] = (
        np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]])
        @ np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
        @ np.array([[cc, -sc, 0], [sc, cc, 0], [0, 0, 1]])
    )
    matrix[:3, 3] = six[:3]
    return matrix


def lever_and_mount(mount=MOUNT, lever=LEVER):
    return pose([*lever, 0, 0, 0]) @ pose(mount)


@dataclass(frozen=True)
class Artefact:
    """A free-form surface z(x, y) in the cold sensor's frame: waves of several lengths and directions, mm."""

    heights: np.ndarray
    waves: np.ndarray  # (n, 2) rad/mm
    phases: np.ndarray

    @classmethod
    def random(cls, seed, relief=3.0, n=5):
        rng = np.random.default_rng(seed)
        length, angle = rng.uniform(14, 45, n), rng.uniform(0, np.pi) + np.arange(n) * np.pi / n
        waves = 2 * np.pi / length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return cls(relief / n * rng.uniform(0.6, 1.4, n), waves, rng.uniform(0, 2 * np.pi, n))

    def at(self, xy):
        """Height (n,) and slopes (n, 2)."""
        angle = xy @ self.waves.T + self.phases
        return np.sin(angle) @ self.heights, (np.cos(angle) * self.heights) @ self.waves


def displaced(motions, mount=MOUNT, lever=LEVER):
    """``p_cold = X p_warm`` of the sensor when the joint has these error motions."""
    arm = lever_and_mount(mount, lever)
    return np.linalg.inv(arm) @ pose(motions) @ arm


def scan(artefact, x_matrix, y, x=None, noise=NOISE, rng=None):
    """A cloud (n, 3) of a sensor that stands at ``x_matrix`` in its own cold frame."""
    if x is None:
        x = (np.arange(POINTS) - POINTS // 2) * PITCH
    points = np.stack([a.ravel() for a in np.meshgrid(x, y)] + [np.zeros(len(x) * len(y))], axis=1)
    for _ in range(6):
        there = points @ x_matrix[:3, :3].T + x_matrix[:3, 3]
        height, slope = artefact.at(there[:, :2])
        points[:, 2] -= (there[:, 2] - height) / (x_matrix[2, 2] - slope @ x_matrix[:2, 2])
    if rng is not None:
        points[:, 2] += noise * rng.standard_normal(len(points))
    return points


def disturbed(cloud, rng, share=0.005, stray=4):
    """With outliers in a share of the points, and runs of stray light above the surface."""
    cloud = cloud.copy()
    wild = rng.random(len(cloud)) < share
    cloud[wild, 2] += rng.standard_cauchy(wild.sum()) * 0.05
    for start in rng.integers(0, len(cloud), stray):
        cloud[start : start + rng.integers(20, 80), 2] += rng.uniform(0.2, 3.0)
    return cloud


def bound(artefact, cloud):
    """Cramér-Rao bound (6, 6) of shift and turn about the sensor's origin, both clouds being as noisy as this one."""
    _, slope = artefact.at(cloud[:, :2])
    normal = np.column_stack([-slope, np.ones(len(cloud))])
    design = np.hstack([normal, np.cross(cloud, normal)])
    return 2 * NOISE**2 * np.linalg.inv(design.T @ design)


def rotation_vector(matrix):
    skew = (matrix[:3, :3] - matrix[:3, :3].T) / 2
    return np.array([skew[2, 1], skew[0, 2], skew[1, 0]])


def warm_up(position, minutes):
    """Six thermal error motions (mm, rad) as in the paper's figures: growing over half an hour and along the beam."""
    q, grown = (position - 350.0) / 1400.0, 1 - np.exp(-minutes / 28.0)
    shape = (
        6e-3 * np.sin(2.1 * q), 12e-3 + 38e-3 * q, 9e-3 * np.sin(np.pi * q),
        -14e-6 * q - 4e-6, 8e-6 + 10e-6 * q, -11e-6 * q,
    )  # fmt: skip
    return grown * np.array(shape)


def pocket(mount, rng, stacked=False, n=720, noise=2e-3):
    """Points (n, 3) of the pocket's edge in the sensor's frame (or with y along the machine's travel)."""
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    there = np.column_stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), np.full(n, HEIGHT)]) + CENTRE
    return _seen(there, mount, stacked) + noise * rng.standard_normal((n, 3))


def board(mount, rng, stacked=False, profiles=80, points=3000):
    """The machined plane, in profiles of 3000 points."""
    x, y = np.meshgrid((np.arange(points) - points / 2) * PITCH, np.linspace(-8, 8, profiles))
    rotation, shift = pose(mount)[:3, :3], np.array(mount[:3])
    travel = np.array([0, 1, 0]) if stacked else rotation[:, 1]
    rest = x.ravel()[:, None] * rotation[:, 0] + y.ravel()[:, None] * travel + shift
    z = (HEIGHT - rest[:, 2]) / rotation[2, 2] + NOISE * rng.standard_normal(x.size)
    return np.column_stack([x.ravel(), y.ravel(), z])


def _seen(there, mount, stacked):
    rotation, shift = pose(mount)[:3, :3], np.array(mount[:3])
    if not stacked:
        return (there - shift) @ rotation
    columns = np.column_stack([rotation[:, 0], [0, 1, 0], rotation[:, 2]])
    return np.linalg.solve(columns, (there - shift).T).T


def write_csv(cloud, path: Path, header="x,y,z"):
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, cloud, fmt="%.6f", delimiter=",", header=header, comments="")
