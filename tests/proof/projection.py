"""What the engineer's model of geometry cannot absorb: the projector off its columns, and least squares with it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg

from tests.proof.hidden import Hidden, Situation
from tests.proof.kinematics import Array, added, design, geometry, levers, position
from tests.proof.noise import Noise


@dataclass(frozen=True)
class Bench:
    """A situation with the true geometry, the pose of the measuring frame ``m = turn p + shift``, and the noise."""

    sit: Situation
    values: dict[str, float]
    turn: Array  # (3, 3)
    shift: Array  # (3,)
    noise: Noise

    @cached_property
    def motions(self) -> dict[str, Array]:
        return geometry(self.sit.chain, self.sit.path.q, self.values, len(self.sit))

    @cached_property
    def clean(self) -> Array:
        """Positions (n, 3) in the reference's axes without any effect."""
        return position(self.sit.chain, self.sit.path.q, self.sit.path.tool, self.motions)

    def points(self, effects: list[tuple[Hidden, float]]) -> Array:
        """Positions (n, 3) with effects of those amplitudes, in the reference's axes."""
        motions = self.motions
        for hidden, amplitude in effects:
            if hidden.field is not None:
                motions = added(motions, hidden.field(self.sit), amplitude)
        out = position(self.sit.chain, self.sit.path.q, self.sit.path.tool, motions)
        for hidden, amplitude in effects:
            if hidden.instrument is not None:
                out = hidden.instrument(self.sit, out, amplitude)
        return out

    def seen(self, points: Array) -> Array:
        """From the reference's axes into the measuring frame, (n, 3)."""
        return points @ self.turn.T + self.shift

    def shift_of(self, hidden: Hidden, amplitude: float) -> Array:
        """Displacement (n, 3) by one effect, in the measuring frame."""
        return (self.points([(hidden, amplitude)]) - self.clean) @ self.turn.T

    @cached_property
    def levers(self) -> dict[str, Array]:
        own = levers(self.sit.chain, self.sit.path.q, self.sit.path.tool)
        return {name: np.einsum("ij,njk->nik", self.turn, lever) for name, lever in own.items()}

    @cached_property
    def design(self) -> Array:
        """(n, 3, p), in the measuring frame."""
        return design(self.sit.chain, self.sit.path.q, self.sit.path.tool, self.levers)

    @cached_property
    def course(self) -> Array | None:
        return self.noise.course(self.sit.path.time)

    def whitened(self, columns: Array) -> Array:
        """Columns (n, 3, p) or (n, 3) whitened, (3 n, p) or (3 n,)."""
        white = self.noise.whiten(self.seen(self.clean), self.course, columns)
        return white.reshape(3 * len(self.sit), *columns.shape[2:])

    @cached_property
    def basis(self) -> Array:
        """Orthonormal basis (3 n, rank) of what geometry and frame can absorb."""
        columns = self.whitened(self.design)
        return span(columns)

    def off(self, columns: Array) -> Array:
        """What is left of whitened columns (3 n,) or (3 n, p) beside the basis."""
        out: Array = columns - self.basis @ (self.basis.T @ columns)
        return out


def span(columns: Array) -> Array:
    """Orthonormal basis of columns (m, k), each scaled to unit length, by QR with pivots."""
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 1e-9 * size.max(initial=0.0)]
    if not columns.shape[1]:
        return columns
    q, r, _ = scipy.linalg.qr(columns / np.linalg.norm(columns, axis=0), mode="economic", pivoting=True)
    out: Array = q[:, np.abs(np.diag(r)) > 1e-7]
    return out


def least_squares(columns: Array, y: Array) -> Array:
    """Solution of smallest norm of scaled columns: dependent ones share."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    solution, *_ = scipy.linalg.lstsq(columns / scale, y, cond=1e-9, lapack_driver="gelsy")
    out: Array = solution / scale
    return out


def heldout_errors(here: Bench, there: Bench, effects: list[tuple[Hidden, float]], noise: Array) -> tuple[float, float]:
    """Error (um, 3-D root mean square) at later poses of the base model and of one that knows the effects' forms."""
    shown = here.seen(here.points(effects)) - here.seen(here.clean)
    later = there.seen(there.points(effects)) - there.seen(there.clean)
    y = here.whitened(shown + noise)
    base = least_squares(here.whitened(here.design), y)
    plain = there.design @ base - later
    forms = [here.shift_of(h, a)[:, :, None] for h, a in effects]
    ahead = [there.shift_of(h, a)[:, :, None] for h, a in effects]
    whole = np.concatenate([here.design, *forms], axis=2)
    knowing = least_squares(here.whitened(whole), y)
    oracle = np.concatenate([there.design, *ahead], axis=2) @ knowing - later
    return rms_um(plain), rms_um(oracle)


def rms_um(gap: Array) -> float:
    """3-D root mean square (um) of (n, 3) in mm."""
    return float(1e3 * np.sqrt(np.mean(np.sum(gap**2, axis=1))))
