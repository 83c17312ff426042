"""Noise of a recording: white, a tracker's (along the beam and across it), coloured in time, with heavy tails."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from tests.proof.kinematics import Array

Rng = np.random.Generator


@dataclass(frozen=True)
class Noise:
    """`kind` white | tracker | coloured | heavy; `sigma` mm; `beam` (mm, mm/mm) and `angle` (rad) of a tracker."""

    kind: str
    sigma: float
    beam: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0
    tau: float = 0.0  # s
    share: float = 0.0  # of the variance that is coloured
    declared: bool = False  # the survey says what the instrument is

    def whiten(self, points: Array, course: Array | None, columns: Array) -> Array:
        """Columns (n, 3) or (n, 3, p) in the measuring frame over the noise's standard deviations, its course known."""
        flat = columns.reshape(len(points), 3, -1)
        if course is not None:
            return (course @ flat.reshape(len(points), -1) / self.sigma).reshape(columns.shape)
        if self.kind != "tracker":
            return (flat / self.sigma).reshape(columns.shape)
        away = np.linalg.norm(points, axis=1)
        beam = points / away[:, None]
        along, across = self.beam[0] + self.beam[1] * away, self.angle * away
        on = np.einsum("ni,nip->np", beam, flat)
        extra = beam[:, :, None] * (on * (1 / along - 1 / across)[:, None])[:, None, :]
        out: Array = flat / across[:, None, None] + extra
        return out.reshape(columns.shape)

    def course(self, time: Array) -> Array | None:
        """What makes coloured noise at these times white, (n, n): the simulator may, its recordings are small."""
        if self.kind != "coloured":
            return None
        slow = np.exp(-np.abs(time[:, None] - time) / self.tau)
        root = np.linalg.cholesky(self.share * slow + (1 - self.share) * np.eye(len(time)))
        out: Array = solve_triangular(root, np.eye(len(time)), lower=True)
        return out

    def draw(self, points: Array, time: Array, rng: Rng) -> Array:
        """Noise (n, 3) of measured points, mm."""
        out: Array = self.sigma * self._unit(points, time, rng)
        return out

    def _unit(self, points: Array, time: Array, rng: Rng) -> Array:
        n = len(points)
        white = rng.normal(0, 1, (n, 3))
        if self.kind == "heavy":
            white = rng.standard_t(4.0, (n, 3)) / np.sqrt(2.0)
        if self.kind == "coloured":
            keep = np.exp(-np.diff(time, prepend=time[0]) / self.tau)[:, None]
            slow, state = np.empty((n, 3)), rng.normal(0, 1, 3)
            for k in range(n):
                state = keep[k] * state + np.sqrt(1 - keep[k] ** 2) * rng.normal(0, 1, 3)
                slow[k] = state
            white = np.sqrt(1 - self.share) * white + np.sqrt(self.share) * slow
        if self.kind == "tracker":
            away = np.linalg.norm(points, axis=1)
            beam = points / away[:, None]
            along, across = self.beam[0] + self.beam[1] * away, self.angle * away
            on = np.einsum("ni,ni->n", beam, white)
            white = (across[:, None] * white + beam * (on * (along - across))[:, None]) / self.sigma
        return white


def draw_noise(kind: str, sigma: float, away: float, rng: Rng) -> Noise:
    """Noise of that kind whose size at the distance `away` (mm) is about sigma a coordinate."""
    if kind == "tracker":
        beam = (0.35 * sigma, 0.15 * sigma / away)
        return Noise(kind, sigma, beam, 1.15 * sigma / away, declared=bool(rng.integers(2)))
    if kind == "coloured":
        return Noise(kind, sigma, tau=float(rng.uniform(60, 600)), share=float(rng.uniform(0.1, 0.3)))
    return Noise(kind, sigma)
