"""Rigid alignment of points of which components are missing: grid plates, two of three sensors, a straightness.

Robust nonlinear least squares on the components that were measured. Only rotations that move these components by more
than the misfit are estimated: a grid plate in the plane x y determines the rotation about z, and a tilt of it, which
shortens distances by its cosine only, stays as assumed.
"""

from __future__ import annotations

from itertools import permutations, product

import numpy as np

from errormodel.arrays import MAD_STD, Array, Mask
from identification.observation.pose import ROTATION_SPREAD_RATIO, Pose

MOST_POINTS = 400  # the frame is found from so many, evenly spread
ROUNDS = 4  # of axes that a better pose lets the points determine
# of the largest: axes with less move the components in second order only, which any error of scale imitates
FIRST_ORDER_SHARE = 0.1
ROUND_OFF = 1e-12  # of the size of the moves


def align_measured_components(nominal: Array, measured: Array, weights: Array, largest: float) -> Pose:
    """Pose that maps nominal points onto measured ones as far as the measured components determine it.

    A single component (an interferometer, a switch, a straightness) has one direction. It is turned from the machine's
    if then no more is left than errors of a machine can cause, since a mistake in a column would turn it as well.

    Parameters
    ----------
    nominal : (n, 3) mm.
    measured : (n, 3) mm, NaN where a component is missing.
    weights : (n,) 1/sigma.
    largest : misfit (mm) that errors of a machine can cause; with more, frames turned by right angles are tried too.
    """
    every = _Points(nominal, measured, weights)
    some = np.unique(np.linspace(0, len(nominal) - 1, MOST_POINTS).astype(int))
    some = some[np.isfinite(measured[some]).any(axis=1)]
    points = _Points(nominal[some], measured[some], weights[some])
    best = points.aligned(np.eye(3), largest)
    if best[1] > largest:
        if every.seen.any(axis=0).sum() < 2:
            return Pose(np.eye(3), every.shift(np.eye(3)), np.eye(3))
        others = (points.aligned(start, largest) for start in right_angles())
        best = min((best, *others), key=lambda found: found[1])
    rotation, _, undetermined = best
    return Pose(rotation, every.shift(rotation), undetermined)


def right_angles() -> list[Array]:
    """The 24 rotations (3, 3) of a cube, the identity first."""
    signed = (np.eye(3)[list(p)] * s for p in permutations(range(3)) for s in product((1.0, -1.0), repeat=3))
    return sorted((r for r in signed if np.linalg.det(r) > 0), key=lambda r: -float(np.trace(r)))


class _Points:
    def __init__(self, nominal: Array, measured: Array, weights: Array) -> None:
        self.nominal, self.measured = nominal, measured
        self.seen: Mask = np.isfinite(measured)
        self.weights = np.where(self.seen, (weights / weights.max())[:, None], 0.0)

    def shift(self, rotation: Array) -> Array:
        """Translation (3,): the median shift of each component; 0 of one that was never measured."""
        gaps = np.where(self.seen, self.measured - self.nominal @ rotation.T, np.nan)
        out = np.zeros(3)
        known = self.seen.any(axis=0)
        out[known] = np.nanmedian(gaps[:, known], axis=0)
        return out

    def aligned(self, start: Array, largest: float) -> tuple[Array, float, Array]:
        """Rotation from a start, the misfit (mm) that it leaves, and the axes about which it stays at the start."""
        size, axes = self._moves(start)
        axes = axes[size >= FIRST_ORDER_SHARE * max(size.max(), 1e-300)]
        for _ in range(ROUNDS):
            rotation = self._rotated(start, axes)
            misfit = self._misfit(rotation)
            size, every = self._moves(rotation)
            determined = every[size >= ROTATION_SPREAD_RATIO * max(min(misfit, largest), ROUND_OFF * size.max())]
            if len(determined) == len(axes):
                break
            axes = determined
        else:
            rotation = self._rotated(start, axes)
        whole = np.linalg.svd(axes)[2] if len(axes) else np.eye(3)
        return rotation, self._misfit(rotation), whole[len(axes) :]

    def _rotated(self, start: Array, axes: Array) -> Array:
        """The best rotation (3, 3) from a start about some axes (k, 3), by robust least squares."""
        from scipy.optimize import least_squares
        from scipy.spatial.transform import Rotation

        if not len(axes):
            return start

        def turned(x: Array) -> Array:
            return np.asarray(start @ Rotation.from_rotvec(x[3:] @ axes).as_matrix())

        def residual(x: Array) -> Array:
            gaps = self.measured - self.nominal @ turned(x).T - x[:3]
            return np.asarray((gaps * self.weights)[self.seen])

        x = np.append(self.shift(start), np.zeros(len(axes)))
        for loss in ("linear", "soft_l1"):  # the size of the residuals, against which some are outliers, is known then
            scale = max(3 * float(np.median(np.abs(residual(x)))), 1e-9)
            x = least_squares(residual, x, x_scale="jac", loss=loss, f_scale=scale, xtol=1e-14, ftol=1e-14).x
        return turned(x)

    def _misfit(self, rotation: Array) -> float:
        """Root mean square of a component's residual, mm; robust, from the median."""
        gaps = (self.measured - self.nominal @ rotation.T - self.shift(rotation))[self.seen]
        return MAD_STD * float(np.median(np.abs(gaps)))

    def _moves(self, rotation: Array) -> tuple[Array, Array]:
        """Principal axes (3, 3) in the reference, and how far (3,) a radian about each moves the measured components.

        A shift is taken out; root mean square, mm.
        """
        moves = np.cross(np.eye(3)[:, None, :], self.nominal[None]) @ rotation.T  # (3, n, 3)
        total = np.maximum(self.weights.sum(axis=0), 1e-300)
        moves -= (self.weights * moves).sum(axis=1, keepdims=True) / total
        moves *= np.sqrt(self.weights)
        square, axes = np.linalg.eigh(np.einsum("inc,jnc->ij", moves, moves) / self.weights.sum())
        return np.sqrt(np.maximum(square, 0.0)), axes.T
