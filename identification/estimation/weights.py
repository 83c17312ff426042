"""What the rows of a survey count in a robust fit, and the noise level by which they are judged.

Weights are scaled so that the weighted normal equations are the information that the estimator really has, with the
finite-sample correction of P. J. Huber & E. M. Ronchetti, Robust Statistics, 2009, section 7.6.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from errormodel.arrays import Array, Index, Mask
from identification.estimation.bisquare import BY_DISTANCE, Pull, Scale, normal, pull, usual
from identification.estimation.mixture import Outliers
from identification.observation.models import Kind, PositionView, View

LOW = 0.25  # of the rows set the first noise level: more than half of them may be out, and are then told of
TIGHT = 0.75  # of that level: what is not clearly good stays out while the fit has still to move
LEAST_LEFT = 0.05  # of the observations, whatever the fit used up
STEADY = 1e-6  # relative change of a noise level


@dataclass(frozen=True)
class Judged:
    """The rows of one view.

    Attributes
    ----------
    distance : (n,) of the whole row from the fit, in robust standard deviations.
    weight : (n,) what the row counts: 0 for outliers, about 1 for others.
    out : (n,) whether the row is out, in whole or with one component.
    wrong : (n,) the component (0, 1, 2) that alone is wrong, -1 for none.
    mixed : rows whose components count differently; `roots` (mixed, 3, 3): square roots of their weights.
    """

    distance: Array
    weight: Array
    out: Mask
    wrong: Index
    mixed: Index
    roots: Array

    def weigh(self, view: View) -> list[View]:
        """The view with its rows weighted; in a view of their own those of which one component counts less."""
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
    """What the rows of all views count.

    Attributes
    ----------
    views : one entry a view.
    sigma : robust noise level of each kind, in units of its whitener.
    count : scalar observations of each kind that take part.
    kept : for each kind, mean of the weighted squared residual of rows that take part, in noise variances.
    common : what the outliers of each kind have in common, once that was asked for.
    """

    views: tuple[Judged, ...]
    sigma: dict[Kind, float]
    count: dict[Kind, float]
    kept: dict[Kind, float]
    common: dict[Kind, Outliers] = field(default_factory=dict)

    def weigh(self, views: Sequence[View]) -> tuple[View, ...]:
        """The views, weighted; rows that take no part are left out."""
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
    """Judge rows by what a fit leaves of them.

    Parameters
    ----------
    gaps : for each view its whitened residual, (outputs, n).
    used : degrees of freedom that the fit took from each kind.
    floor : least noise level of each kind.
    start : noise levels to start from; None: those of the nearer rows, while the fit has still to move.
    common : what the outliers were found to have in common; None: rows are judged by their distance alone.
    """
    judged: dict[int, Judged] = {}
    found = Judgement((), {}, {}, {})
    for kind in dict.fromkeys(v.kind for v in views):
        own = [k for k, v in enumerate(views) if v.kind == kind]
        rows = [(gaps[k], _components(views[k]), _axes(views[k])) for k in own]
        level = _nearer(rows, used[kind]) if start is None else start[kind]
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
            if start is None or abs(square - 1) < STEADY or level * np.sqrt(square) <= floor[kind]:
                break
            level *= float(np.sqrt(square))
        factor, found.kept[kind] = _information(pulls, used[kind])
        found.sigma[kind], found.count[kind] = level, live
        for k, (_, m, _), p in zip(own, rows, pulls, strict=True):
            wrong = p.wrong
            out = p.out | (wrong >= 0)
            judged[k] = Judged(p.distance, factor * p.trace / m, out, wrong, p.mixed, p.roots(factor))
    return replace(found, views=tuple(judged[k] for k in range(len(views))))


def _common(rows: Sequence[tuple[Array, Index, Array | None]], level: float, before: Outliers | None) -> Outliers:
    """What outliers have in common; rows of which one component alone is wrong are none."""
    sound = [pull(gap / level, m, axes).likely[0] > 0.5 for gap, m, axes in rows]
    left = [
        np.pad(gap[:, own] / level, ((0, 3 - len(gap)), (0, 0))) for (gap, _, _), own in zip(rows, sound, strict=True)
    ]
    measured = np.concatenate([m[own] for (_, m, _), own in zip(rows, sound, strict=True)])
    return (before or Outliers.unseen()).among(np.hstack(left), measured)


def _usual(m: int, rows: Sequence[tuple[Array, Index, Array | None]], outliers: Outliers) -> float:
    if not any(m in own for _, own, _ in rows):
        return 1.0
    order = np.argsort(-np.abs(outliers.mean))  # what rows of fewer components have is where the mean is
    return usual(m, replace(outliers, mean=outliers.mean[order]))


def _components(view: View) -> Index:
    """How many scalar observations each row holds, (n,)."""
    return np.asarray(view.components.sum(axis=1))


def _axes(view: View) -> Array | None:
    """Direction of each measured component in whitened units, (3, 3, n); of angles none: they are read together."""
    if view.kind != "position":
        return None
    if view.whitener.ndim == 1:  # whitened without leaving the reference's axes
        return np.broadcast_to(_turn(view)[:, :, None], (3, 3, len(view)))
    columns = view.whitener.transpose(2, 1, 0)
    lengths = np.linalg.norm(columns, axis=1)[:, None]
    return np.asarray(np.divide(columns, lengths, out=np.zeros_like(columns), where=lengths > 0))


def _turn(view: View) -> Array:
    """Rotation (3, 3) from the reference's axes to those in which the view's components were measured."""
    return view.pose.rotation if isinstance(view, PositionView) else np.eye(3)


def _nearer(rows: Sequence[tuple[Array, Index, Array | None]], used: float) -> float:
    """A first noise level: from the rows that are nearer than most."""
    from scipy.stats import chi

    m = np.concatenate([m for _, m, _ in rows])
    distance = np.concatenate([np.linalg.norm(gap, axis=0) for gap, _, _ in rows])
    typical = np.asarray(chi.ppf(LOW, np.arange(1, 4)))[m - 1]
    return TIGHT * float(np.quantile(distance / typical, LOW) / np.sqrt(_left(float(m.sum()), used)))


def _left(count: float, used: float) -> float:
    """Share of the residual variance that a fit leaves."""
    return max(1 - used / max(count, 1.0), LEAST_LEFT)


def _information(pulls: Sequence[Pull], used: float) -> tuple[float, float]:
    """Factor that turns weights into information, and the mean weighted square in noise variances."""
    along, square, slope, live, trace = (
        np.concatenate([getattr(p, name) for p in pulls]) for name in ("along", "square", "slope", "live", "trace")
    )
    own = live > 0
    n = max(float(live.sum()), 1.0)
    mean = max(float(slope[own].sum()) / n, LEAST_LEFT)
    uneven = float(live[own] @ np.square(slope[own] / live[own] - mean)) / n
    small = 1 + used / n * uneven / mean**2
    factor = mean**2 * n**2 * _left(n, used) / (float(square.sum()) * float(trace.sum()) * small**2)
    return factor, factor * float(along.sum()) / n / _left(n, used)
