"""Robust weights of survey rows, and the robust noise level that scales their residuals.

Weights are scaled so that the weighted normal equations equal the information of the robust estimator, with the
finite-sample correction of P. J. Huber & E. M. Ronchetti, Robust Statistics, 2009, section 7.6.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from errormodel.arrays import Array, Index, Mask
from errormodel.exceptions import InputError
from identification.estimation.bisquare import BY_DISTANCE, Pull, Scale, normal, pull, usual
from identification.estimation.mixture import Outliers
from identification.observation.models import Kind, PositionView, View

# Quantile of the distances that sets the first noise level: low, so that surveys with more than half outliers are
# recognised as such
FIRST_LEVEL_QUANTILE = 0.25
FIRST_LEVEL_FACTOR = 0.75  # factor on that level: doubtful rows stay out while the fit may be far off; by judgement
LEAST_DOF_SHARE = 0.05  # smallest share of the observations that counts as degrees of freedom
NOISE_LEVEL_TOLERANCE = 1e-6  # relative change of the squared noise level at which its iteration stops


@dataclass(frozen=True)
class Judged:
    """Robust weights of the rows of one view.

    Attributes
    ----------
    distance : (n,) of the whole row from the fit, in robust standard deviations.
    weight : (n,) 0 for outliers, about 1 for others.
    out : (n,) whether the row, or one component of it, is an outlier.
    wrong : (n,) the component (0, 1, 2) that is the outlier, -1 for none.
    mixed : rows whose components have different weights; `roots` (mixed, 3, 3): square roots of their weight matrices.
    """

    distance: Array
    weight: Array
    out: Mask
    wrong: Index
    mixed: Index
    roots: Array

    def weigh(self, view: View) -> list[View]:
        """The view with its rows weighted; rows with different weights of components become a view of their own."""
        root = np.sqrt(self.weight)
        if view.whitener.ndim == 3:
            whitener = view.whitener * root[:, None, None]
            whitener[self.mixed] = self.roots @ view.whitener[self.mixed]
            return [replace(view, whitener=whitener)]
        whole = replace(view, whitener=view.whitener * root)
        if not len(self.mixed):
            return [whole]
        others = np.setdiff1d(np.arange(len(view)), self.mixed)
        own = self.roots @ _turn(view).T * view.whitener[self.mixed, None, None]  # a matrix acts in the measuring frame
        apart = replace(view.part(self.mixed), whitener=own)
        return [whole.part(others), apart] if len(others) else [apart]


@dataclass(frozen=True)
class Judgement:
    """Robust weights of the rows of all views.

    Attributes
    ----------
    views : one entry per view.
    sigma : robust noise level of each kind, in units of its whitener.
    count : scalar observations of each kind with non-zero weight.
    kept : mean weighted squared residual of these, for each kind, in noise variances.
    common : outlier cluster of each kind, where the mixture was used.
    """

    views: tuple[Judged, ...]
    sigma: dict[Kind, float]
    count: dict[Kind, float]
    kept: dict[Kind, float]
    common: dict[Kind, Outliers] = field(default_factory=dict)

    def weigh(self, views: Sequence[View]) -> tuple[View, ...]:
        """The weighted views without rows of weight zero."""
        weighted = [w for j, v in zip(self.views, views, strict=True) for w in j.weigh(v)]
        live = [np.abs(w.whitener).reshape(len(w), -1).max(axis=1) > 0 for w in weighted]
        return tuple(w if own.all() else w.part(own) for w, own in zip(weighted, live, strict=True) if own.any())


def judge(
    views: Sequence[View],
    gaps: Sequence[Array],
    used: Mapping[Kind, float],
    floor: Mapping[Kind, float],
    start: Mapping[Kind, float] | None = None,
    common: Mapping[Kind, Outliers] | None = None,
) -> Judgement:
    """Robust weights and noise levels from the residuals of a fit.

    Parameters
    ----------
    gaps : whitened residual (outputs, n) of each view.
    used : degrees of freedom that the fit took from each kind.
    floor : smallest noise level of each kind, in units of its whitener.
    start : noise levels to start from; None: from the quantile of the nearest rows, while the fit may be far off.
    common : outlier cluster of each kind to start from; None: bisquare of the distance alone.

    Returns
    -------
    Judgement
        Weights, noise levels and outlier clusters.
    """
    judged: dict[int, Judged] = {}
    found = Judgement((), {}, {}, {})
    fitted = round(sum(used.values()))
    for kind in dict.fromkeys(v.kind for v in views):
        own = [k for k, v in enumerate(views) if v.kind == kind]
        rows = [(gaps[k], _components(views[k]), _axes(views[k])) for k in own]
        level = _nearer(rows, used[kind], fitted, floor[kind]) if start is None else start[kind]
        for _ in range(1 if start is None else 4):
            level = max(level, floor[kind])
            scale: Scale = BY_DISTANCE
            expect = normal()
            if common is not None:
                found.common[kind] = outliers = _common(rows, level, common.get(kind))
                scale = outliers
                expect = np.array([_usual(k, rows, outliers) for k in range(4)])
            pulls = [pull(gap / level, m, axes, scale) for gap, m, axes in rows]
            live = sum(float(p.live.sum()) for p in pulls)
            expected = sum(float(expect[m] @ p.live) for (_, m, _), p in zip(rows, pulls, strict=True))
            square = sum(float(p.along.sum()) for p in pulls) / max(expected * _left(live, used[kind]), 1e-300)
            if square < 0 or not live:  # no slope of a weight is left: all rows lie beyond those that count
                raise no_majority()
            if start is None or abs(square - 1) < NOISE_LEVEL_TOLERANCE or level * np.sqrt(square) <= floor[kind]:
                break
            level *= float(np.sqrt(square))
        factor, found.kept[kind] = _information(pulls, used[kind])
        found.sigma[kind], found.count[kind] = level, live
        for k, (_, m, _), p in zip(own, rows, pulls, strict=True):
            wrong = p.wrong
            out = p.out | (wrong >= 0)
            judged[k] = Judged(p.distance, factor * p.trace / m, out, wrong, p.mixed, p.roots(factor))
    return replace(found, views=tuple(judged[k] for k in range(len(views))))


def no_majority() -> InputError:
    """Error for a robust fit that found no rows to stand on: some lie so far off that they turn its first frame."""
    found = "no fit was found near which most rows lie"
    return InputError("--robust", found, "Fit without it, which names rows that lie far off, and leave those out")


def _common(rows: Sequence[tuple[Array, Index, Array | None]], level: float, before: Outliers | None) -> Outliers:
    """The outlier cluster, estimated without rows that have one wrong component."""
    sound = [pull(gap / level, m, axes).likely[0] > 0.5 for gap, m, axes in rows]
    left = [
        np.pad(gap[:, own] / level, ((0, 3 - len(gap)), (0, 0))) for (gap, _, _), own in zip(rows, sound, strict=True)
    ]
    measured = np.concatenate([m[own] for (_, m, _), own in zip(rows, sound, strict=True)])
    return (before or Outliers.unseen()).among(np.hstack(left), measured)


def _usual(m: int, rows: Sequence[tuple[Array, Index, Array | None]], outliers: Outliers) -> float:
    """Expected ``u'psi`` per observation under the mixture; 1 where no row has `m` components."""
    if not any(m in own for _, own, _ in rows):
        return 1.0
    order = np.argsort(-np.abs(outliers.mean))  # assume that rows with fewer components have those of the largest mean
    return usual(m, replace(outliers, mean=outliers.mean[order]))


def _components(view: View) -> Index:
    """Number of scalar observations of each row, (n,)."""
    return np.asarray(view.components.sum(axis=1))


def _axes(view: View) -> Array | None:
    """Direction of each measured component in whitened units, (3, 3, n); None for angles, which are read together."""
    if view.kind != "position":
        return None
    if view.whitener.ndim == 1:  # a scalar weight keeps the axes of the reference
        return np.broadcast_to(_turn(view)[:, :, None], (3, 3, len(view)))
    columns = view.whitener.transpose(2, 1, 0)
    lengths = np.linalg.norm(columns, axis=1)[:, None]
    return np.asarray(np.divide(columns, lengths, out=np.zeros_like(columns), where=lengths > 0))


def _turn(view: View) -> Array:
    """Rotation (3, 3) from the reference's axes to those in which the view's components were measured."""
    return view.pose.rotation if isinstance(view, PositionView) else np.eye(3)


def _nearer(rows: Sequence[tuple[Array, Index, Array | None]], used: float, fitted: int, floor: float) -> float:
    """First noise level, from a low quantile of the distances.

    The fit with the smallest sum of distances passes through as many rows as it has `fitted` parameters: so many within
    `floor` say nothing of the noise (Maronna et al., 2019, section 4.4.2).
    """
    from scipy.stats import chi

    m = np.concatenate([m for _, m, _ in rows])
    distance = np.concatenate([np.linalg.norm(gap, axis=0) for gap, _, _ in rows])
    beyond = np.argsort(distance)[min(np.count_nonzero(distance <= floor), fitted) :]
    m, distance = (m[beyond], distance[beyond]) if len(beyond) else (m, distance)
    typical = np.asarray(chi.ppf(FIRST_LEVEL_QUANTILE, np.arange(1, 4)))[m - 1]
    return FIRST_LEVEL_FACTOR * float(
        np.quantile(distance / typical, FIRST_LEVEL_QUANTILE) / np.sqrt(_left(float(m.sum()), used))
    )


def _left(count: float, used: float) -> float:
    """Degrees of freedom over observations."""
    return max(1 - used / max(count, 1.0), LEAST_DOF_SHARE)


def _information(pulls: Sequence[Pull], used: float) -> tuple[float, float]:
    """Factor from weights to information (Huber & Ronchetti), and the mean weighted square in noise variances."""
    along, square, slope, live, trace = (
        np.concatenate([getattr(p, name) for p in pulls]) for name in ("along", "square", "slope", "live", "trace")
    )
    own = live > 0
    n = max(float(live.sum()), 1.0)
    mean = max(float(slope[own].sum()) / n, LEAST_DOF_SHARE)
    uneven = float(live[own] @ np.square(slope[own] / live[own] - mean)) / n
    small = 1 + used / n * uneven / mean**2
    factor = mean**2 * n**2 * _left(n, used) / (float(square.sum()) * float(trace.sum()) * small**2)
    return factor, factor * float(along.sum()) / n / _left(n, used)
