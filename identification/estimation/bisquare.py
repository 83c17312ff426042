"""Bisquare psi function for rows of up to three components, with the alternative that one component is the outlier.

The bisquare acts on the length of the row's whitened residual, so that an outlier in any direction is found. For each
component there is the alternative explanation that it alone is wrong (a misread digit, a reflected axis), at a fixed
cost. The explanations are averaged with weights that fall with their cost, so that weights change smoothly with the
residual. Rows beyond the cut-off get weight zero. Residuals are in standard deviations of the noise.

Source of the bisquare and its tuning for several components: R. A. Maronna et al., Robust Statistics, 2019, 5.4, 6.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from errormodel.arrays import Array, Index, Mask

# Cut-off of the bisquare by number of components (0 to 3), in sigma: 95 % efficiency on normal rows
BISQUARE_CUT_SIGMA = np.array([np.inf, 4.685, 5.123, 5.490])
# Cost of "one component is wrong", in half squared sigma: that of a residual of 2.5 sigma, by judgement
ONE_COMPONENT_COST = 3.0
EXPLANATION_SHARPNESS = 3.0  # factor on the cost in the weights of the explanations, by judgement
ROUND_OFF_SHARE = 1e-12  # of the largest weight of a row: smaller ones are round-off, since probabilities are not
LEAST_EXPLANATION_PROBABILITY = 0.01  # less likely explanations are set to zero, by judgement: saves time


@dataclass(frozen=True)
class Pull:
    """The psi function of each row at a noise level: ``psi = W u``, u the residual, W the (3, 3) weight matrix.

    Attributes
    ----------
    distance : (n,) length of u, in standard deviations.
    live : (n,) expected number of scalar observations with non-zero weight.
    trace : (n,) trace of W.
    along, square : (n,) ``u'psi`` and ``psi'psi``.
    slope : (n,) divergence of psi with respect to u.
    likely : (4, n) probabilities of the explanations: no component wrong, or only the first, second, third.
    bare : (4, n) weight of the components that are not wrong under each explanation.
    axes : (3, 3, n) direction of each component, in whitened units; 0 where it was not measured.
    alone : (n,) largest single component in standard deviations; 0 where one-component alternatives were not tried.
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
        """Indices of rows whose components have different weights."""
        return np.flatnonzero((self.likely[1:] > 0).any(axis=0) & (self.trace > 0))

    @property
    def out(self) -> Mask:
        """(n,) whether the whole row is beyond the cut-off."""
        return np.asarray(self.bare[0] == 0)

    @property
    def wrong(self) -> Index:
        """(n,) component that is the outlier, -1 for none: beyond the cut-off and the best explanation."""
        best = self.likely.argmax(axis=0) - 1
        return np.where((self.trace > 0) & (self.alone > BISQUARE_CUT_SIGMA[1]), best, -1)

    def roots(self, factor: float) -> Array:
        """Symmetric square roots of ``factor W`` of the mixed rows, (mixed, 3, 3)."""
        weights, axes = (self.likely * self.bare)[:, self.mixed], self.axes[:, :, self.mixed]
        lost = np.einsum("jn,jan,jbn->nab", weights[1:], axes, axes)
        values, vectors = np.linalg.eigh(factor * (weights.sum(axis=0)[:, None, None] * np.eye(3) - lost))
        values[values < ROUND_OFF_SHARE * values[:, -1:]] = 0.0  # its root would not be small beside a far component
        return np.asarray((vectors * np.sqrt(values)[:, None, :]) @ vectors.transpose(0, 2, 1))


class Scale(Protocol):
    """Cost function of a row. `price`: cost of one wrong component; `sharp`: factor on costs in the weights."""

    @property
    def price(self) -> float: ...

    @property
    def sharp(self) -> float: ...

    def whole(self, u: Array, m: Index) -> tuple[Array, Array, Array]:
        """Cost, weight and divergence of psi, (n,) each, of residuals u (components, n) with m (n,) components."""

    def rest(self, distance: Array, m: Index) -> tuple[Array, Array, Array]:
        """The same for the m (n,) components that remain beside a wrong one, by their length (n,)."""


class ByDistance:
    """Bisquare of the residual's length."""

    price, sharp = ONE_COMPONENT_COST, EXPLANATION_SHARPNESS

    def whole(self, u: Array, m: Index) -> tuple[Array, Array, Array]:
        return bisquare(np.linalg.norm(u, axis=0), m)

    def rest(self, distance: Array, m: Index) -> tuple[Array, Array, Array]:
        return bisquare(distance, m)


BY_DISTANCE = ByDistance()


def pull(u: Array, m: Index, axes: Array | None, scale: Scale = BY_DISTANCE) -> Pull:
    """Psi function of rows.

    Parameters
    ----------
    u : (components, n) whitened residuals in standard deviations of the noise.
    m : (n,) number of measured components.
    axes : (3, 3, n) direction of each component in whitened units; None: no one-component alternatives.
    scale : cost function of the rows.

    Returns
    -------
    Pull
        Psi, weights and derivatives of each row.
    """
    n, square = len(m), np.square(u).sum(axis=0)
    cost, weight, slope = scale.whole(u, m)
    likely, bare = np.zeros((4, n)), np.zeros((4, n))
    likely[0], bare[0] = 1.0, weight
    out = Pull(
        np.sqrt(square), np.where(weight > 0, m, 0.0), weight * m, weight * square, weight**2 * square, slope,
        likely, bare, np.zeros((3, 3, n)) if axes is None else axes, np.zeros(n),
    )  # fmt: skip
    doubtful = np.flatnonzero((scale.sharp * (cost - scale.price) > np.log(LEAST_EXPLANATION_PROBABILITY)) & (m > 1))
    if axes is not None and len(doubtful):
        _explain(out, doubtful, u[:, doubtful], m[doubtful], cost[doubtful], scale)
    return out


def _explain(out: Pull, rows: Index, u: Array, m: Index, cost: Array, scale: Scale) -> None:
    """Try "one component is wrong" for the given rows, and write the averaged psi into `out`."""
    axes = out.axes[:, :, rows]
    parts = np.einsum("jan,an->jn", axes, u)
    beside = u - axes * parts[:, None]  # (3, components, n), the digits of what is left beside a component far off
    rest = np.linalg.norm(beside, axis=1)
    costs, weights, slopes = scale.rest(rest, m - 1)
    measured = np.abs(axes).sum(axis=1) > 0
    every = np.vstack([cost, np.where(measured, costs + scale.price, np.inf)])
    p = np.exp(-scale.sharp * (every - every.min(axis=0)))
    p[1:][p[1:] < LEAST_EXPLANATION_PROBABILITY * p.sum(axis=0)] = 0.0
    p /= p.sum(axis=0)
    bare, slope = np.vstack([out.bare[0, rows], weights]), np.vstack([out.slope[rows], slopes])
    pulls = np.concatenate([(bare[0] * u)[None], weights[:, None] * beside])
    psi = np.einsum("hn,han->an", p, pulls)
    spread = (p * np.square(pulls).sum(axis=1)).sum(axis=0) - np.square(psi).sum(axis=0)
    counts = np.vstack([m, *[m - 1] * 3])
    out.live[rows] = (p * counts * (bare > 0)).sum(axis=0)
    out.trace[rows] = (p * counts * bare).sum(axis=0)
    out.along[rows] = p[0] * bare[0] * np.square(u).sum(axis=0) + (p[1:] * weights * rest**2).sum(axis=0)
    out.square[rows] = np.square(psi).sum(axis=0)
    out.slope[rows] = (p * slope).sum(axis=0) - scale.sharp * spread
    out.likely[:, rows], out.bare[:, rows], out.alone[rows] = p, bare, np.abs(parts).max(axis=0)


def bisquare(d: Array, m: Index) -> tuple[Array, Array, Array]:
    """Cost rho, weight w and divergence of psi of the bisquare, (n,) each.

    Parameters
    ----------
    d : (n,) lengths of residuals, in standard deviations.
    m : (n,) number of components of each row.
    """
    cut = BISQUARE_CUT_SIGMA[m]
    t = np.square(d / cut)
    near = np.where(t < 1, 1 - t, 0.0)
    return cut**2 / 6 * (1 - near**3), near**2, m * near**2 - 4 * t * near


@lru_cache
def normal() -> Array:
    """Expected ``u'psi`` per observation with weight, for normal rows; (4,) by number of components."""
    return np.array([1.0, *(usual(m, BY_DISTANCE) for m in (1, 2, 3))])


def usual(m: int, scale: Scale) -> float:
    """Expected ``u'psi`` per observation with weight, for normal rows of `m` components (Gauss-Hermite quadrature)."""
    w, u, axes = _normal_rows(m)
    rows = pull(u, np.full(len(w), m), axes, scale)
    return float(w @ rows.along) / float(w @ rows.live)


@lru_cache
def _normal_rows(m: int) -> tuple[Array, Array, Array]:
    """Gauss-Hermite nodes of normal rows of `m` components: weights (n,), residuals (3, n), axes (3, 3, n)."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(24)
    u = np.stack([a.ravel() for a in np.meshgrid(*[nodes] * m)])
    w = np.prod([a.ravel() for a in np.meshgrid(*[weights] * m)], axis=0)
    axes = np.repeat((np.eye(3) * (np.arange(3) < m))[:, :, None], len(w), axis=2)
    return w, np.vstack([u, np.zeros((3 - m, len(w)))]), axes
