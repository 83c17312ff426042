"""How far a float64 solution is from the exact one, at full travel and where the commands hardly move."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.benchmarks import five_axis, reference
from tests.benchmarks.five_axis import IDS, Array

Fit = Callable[[Array, Array], dict[str, object]]


def worst_design_error(design: Array, ids: tuple[str, ...], q: Array) -> float:
    """Largest error of M, relative to the largest entry of its column (of M where the column is zero)."""
    exact = exact_columns(q, ids)
    size = np.abs(exact).max(axis=(0, 1))
    return float((np.abs(design - exact) / np.where(size > 0, size, size.max())).max())


def exact_columns(q: Array, ids: tuple[str, ...]) -> Array:
    """M to the last bit, (n, 3, len(ids)); the six columns of the measuring frame are named ``frame.``."""
    frame = tuple(f"frame.{motion}" for motion in five_axis.MOTIONS)
    point = np.array(reference.nominal(q), dtype=float)
    lever = np.cross(np.eye(3), point[:, None, :]).transpose(0, 2, 1)
    shift = np.broadcast_to(np.eye(3), lever.shape)
    everything = np.concatenate([np.array(reference.design(q), dtype=float), shift, lever], axis=2)
    return everything[:, :, [(*IDS, *frame).index(identity) for identity in ids]]


class Problem:
    """One small survey with its exact answer, for any choice of independent columns."""

    def __init__(self, poses: int, share: float) -> None:
        self.q = five_axis.poses(poses, share)
        self.exact = reference.design(self.q)
        self.design = np.array(self.exact, dtype=float)
        self.measured = five_axis.measured(self.q, self.design)
        self._answers: dict[tuple[str, ...], Array] = {}

    def error(self, fit: Fit) -> float:
        """``|D (p - p*)| / |D p*|`` of the fitted values p, D being the norms of the columns, p* exact."""
        found = fit(self.q, self.measured)
        ids: tuple[str, ...] = tuple(found["ids"])  # type: ignore[arg-type]
        columns = [IDS.index(identity) for identity in ids]
        scale = np.sqrt((self.design[:, :, columns] ** 2).sum(axis=(0, 1)))
        if ids not in self._answers:
            rows = [[row[c] for c in columns] for pose in self.exact for row in pose]
            pairs = zip(self.measured.ravel(), (v for point in reference.nominal(self.q) for v in point), strict=True)
            self._answers[ids] = reference.least_squares(rows, [float(m) - v for m, v in pairs], scale)
        exact = self._answers[ids]
        values = np.asarray(found["values"], dtype=float)
        return float(np.linalg.norm(scale * values - exact) / np.linalg.norm(exact))

    def condition(self, ids: tuple[str, ...]) -> float:
        """Condition of the column-scaled matrix."""
        A = self.design.reshape(-1, len(IDS))[:, [IDS.index(i) for i in ids]]
        return float(np.linalg.cond(A / np.sqrt((A**2).sum(axis=0))))
