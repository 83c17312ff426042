"""What one row says to a robust fit: a bisquare on the whole row, or on what one wrong component leaves of it.

A row counts as one: its distance is that of all its components together, so that a blunder in any direction shows.
Beside "the row as a whole" stands, for each component, "this one alone is wrong" (a misread digit, a reflected axis),
at a price; the cheapest explanation counts, softly, so that nothing jumps. Far rows get weight zero.

The bisquare and its tuning for rows of several components: R. A. Maronna & al., Robust Statistics, 2019, 5.4 and 6.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from errormodel.arrays import Array, Index, Mask

CUTS = np.array([np.inf, 4.685, 5.123, 5.490])  # sigma, by components: 95 % efficient on normal rows
PRICE = 3.0  # of one wrong component, in units of half a squared distance: as of 2.5 standard deviations
SHARP = 3.0  # how sharply the cheapest explanation is preferred
FAINT = 0.01  # an explanation less likely than this is none


@dataclass(frozen=True)
class Pull:
    """Rows at a noise level; psi is how a row pulls at the fit, W the weight of its components: ``psi = W u``.

    Attributes
    ----------
    distance : (n,) in standard deviations.
    live : (n,) scalar observations that take part.
    trace : (n,) of W; `along` = ``u'psi``, `square` = ``psi'psi``, `slope` = divergence of psi by u.
    likely, bare : (4, n) how likely "the row as a whole" is, and each component alone being wrong; weight that each of
        these leaves to the rest.
    axes : (3, 3, n) direction of each component, in whitened units; 0 where it was not measured.
    alone : (n,) how far the farthest component is by itself, where it was asked for.
    """

    distance: Array
    live: Array
    trace: Array
    along: Array
    square: Array
    slope: Array
    likely: Array
    bare: Array
    axes: Array
    alone: Array

    @property
    def mixed(self) -> Index:
        """Rows whose components count differently."""
        return np.flatnonzero((self.likely[1:] > 0).any(axis=0) & (self.trace > 0))

    @property
    def out(self) -> Mask:
        """(n,) whether the row as a whole is too far to count."""
        return np.asarray(self.bare[0] == 0)

    @property
    def wrong(self) -> Index:
        """(n,) the component that alone is wrong, -1 for none: far by itself, and the likeliest explanation."""
        best = self.likely.argmax(axis=0) - 1
        return np.where((self.trace > 0) & (self.alone > CUTS[1]), best, -1)

    def roots(self, factor: float) -> Array:
        """Symmetric square roots of ``factor W`` of the mixed rows, (mixed, 3, 3)."""
        weights, axes = (self.likely * self.bare)[:, self.mixed], self.axes[:, :, self.mixed]
        lost = np.einsum("jn,jan,jbn->nab", weights[1:], axes, axes)
        values, vectors = np.linalg.eigh(factor * (weights.sum(axis=0)[:, None, None] * np.eye(3) - lost))
        return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]) @ vectors.transpose(0, 2, 1))


class Scale(Protocol):
    """What explanations of a row cost: `price` of one wrong component, `sharp` as the cheapest is preferred."""

    @property
    def price(self) -> float: ...

    @property
    def sharp(self) -> float: ...

    def whole(self, u: Array, m: Index) -> tuple[Array, Array, Array]:
        """Cost, weight and divergence of the pull of rows as they are: residuals (components, n), how many (n,)."""

    def rest(self, distance: Array, m: Index) -> tuple[Array, Array, Array]:
        """The same of what one wrong component leaves, by its distance (n,)."""


class ByDistance:
    """Bisquares of distances."""

    price, sharp = PRICE, SHARP

    def whole(self, u: Array, m: Index) -> tuple[Array, Array, Array]:
        return bisquare(np.linalg.norm(u, axis=0), m)

    def rest(self, distance: Array, m: Index) -> tuple[Array, Array, Array]:
        return bisquare(distance, m)


BY_DISTANCE = ByDistance()


def pull(u: Array, m: Index, axes: Array | None, scale: Scale = BY_DISTANCE) -> Pull:
    """How rows pull.

    Parameters
    ----------
    u : (components, n) whitened residuals in units of the noise.
    m : (n,) components that were measured.
    axes : (3, 3, n) direction of each component in whitened units; None: they are not read one by one.
    scale : by which rows are judged.
    """
    n, square = len(m), np.square(u).sum(axis=0)
    cost, weight, slope = scale.whole(u, m)
    likely, bare = np.zeros((4, n)), np.zeros((4, n))
    likely[0], bare[0] = 1.0, weight
    out = Pull(
        np.sqrt(square), np.where(weight > 0, m, 0.0), weight * m, weight * square, weight**2 * square, slope,
        likely, bare, np.zeros((3, 3, n)) if axes is None else axes, np.zeros(n),
    )  # fmt: skip
    doubtful = np.flatnonzero((scale.sharp * (cost - scale.price) > np.log(FAINT)) & (m > 1))
    if axes is not None and len(doubtful):
        _explain(out, doubtful, u[:, doubtful], m[doubtful], cost[doubtful], scale)
    return out


def _explain(out: Pull, rows: Index, u: Array, m: Index, cost: Array, scale: Scale) -> None:
    """Ask of doubtful rows whether one component alone is wrong, and put what follows into `out`."""
    axes = out.axes[:, :, rows]
    parts = np.einsum("jan,an->jn", axes, u)
    rest = np.maximum(np.square(u).sum(axis=0) - parts**2, 0.0)
    costs, weights, slopes = scale.rest(np.sqrt(rest), m - 1)
    measured = np.abs(axes).sum(axis=1) > 0
    every = np.vstack([cost, np.where(measured, costs + scale.price, np.inf)])
    p = np.exp(-scale.sharp * (every - every.min(axis=0)))
    p[1:][p[1:] < FAINT * p.sum(axis=0)] = 0.0
    p /= p.sum(axis=0)
    bare, slope = np.vstack([out.bare[0, rows], weights]), np.vstack([out.slope[rows], slopes])
    pulls = np.concatenate([(bare[0] * u)[None], weights[:, None] * (u - axes * parts[:, None])])
    psi = np.einsum("hn,han->an", p, pulls)
    spread = (p * np.square(pulls).sum(axis=1)).sum(axis=0) - np.square(psi).sum(axis=0)
    counts = np.vstack([m, *[m - 1] * 3])
    out.live[rows] = (p * counts * (bare > 0)).sum(axis=0)
    out.trace[rows] = (p * counts * bare).sum(axis=0)
    out.along[rows] = (psi * u).sum(axis=0)
    out.square[rows] = np.square(psi).sum(axis=0)
    out.slope[rows] = (p * slope).sum(axis=0) - scale.sharp * spread
    out.likely[:, rows], out.bare[:, rows], out.alone[rows] = p, bare, np.abs(parts).max(axis=0)


def bisquare(d: Array, m: Index) -> tuple[Array, Array, Array]:
    """Cost, weight and divergence of the pull, of rows of `m` components at distance `d`."""
    cut = CUTS[m]
    t = np.square(d / cut)
    near = np.where(t < 1, 1 - t, 0.0)
    return cut**2 / 6 * (1 - near**3), near**2, m * near**2 - 4 * t * near


@lru_cache
def normal() -> Array:
    """Mean of ``u'psi`` a component that takes part, of normal rows, (4,) by components."""
    return np.array([1.0, *(usual(m, BY_DISTANCE) for m in (1, 2, 3))])


def usual(m: int, scale: Scale) -> float:
    """Mean of ``u'psi`` a component that takes part, of normal rows of `m` components."""
    w, u, axes = _normal_rows(m)
    rows = pull(u, np.full(len(w), m), axes, scale)
    return float(w @ rows.along) / float(w @ rows.live)


@lru_cache
def _normal_rows(m: int) -> tuple[Array, Array, Array]:
    """Nodes of a mean over normal rows of `m` components: weights (n,), residuals (3, n), axes (3, 3, n)."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(24)
    u = np.stack([a.ravel() for a in np.meshgrid(*[nodes] * m)])
    w = np.prod([a.ravel() for a in np.meshgrid(*[weights] * m)], axis=0)
    axes = np.repeat((np.eye(3) * (np.arange(3) < m))[:, :, None], len(w), axis=2)
    return w, np.vstack([u, np.zeros((3 - m, len(w)))]), axes
