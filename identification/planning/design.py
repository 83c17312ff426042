"""Optimal experimental designs with vector observations: information, predicted variance, and exchange of poses.

Candidate pose i gives the block ``X_i`` (c, r) of whitened rows, one a reading (three coordinates, lengths), in a basis
in which all candidates together have the information I. A design is a multiset of candidates;
``C = (sum X_i' X_i)^-1``. Criteria are D (determinant of C) and the largest predicted variance in the volume. Sources:
V. V. Fedorov, *Theory of Optimal Experiments*, 1972; R. D. Cook & C. J. Nachtsheim, Technometrics 22 (1980) 315, for
the exchange pose by pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from errormodel.arrays import Array, Index

INFORMATION_RIDGE = 1e-9  # information added to every design, relative to that of all candidates: keeps it invertible
MEAN_POWER = 12.0  # exponent of the power mean of variances, a smooth substitute for the largest one; by judgement
LEAST_CRITERION_GAIN = 1e-4  # improvement of the logarithmic criterion below which the exchange stops
MOST_EXCHANGE_ROUNDS = 12  # passes over all poses of a design


@dataclass(frozen=True)
class Space:
    """Rows of the candidate poses and of the volume.

    Attributes
    ----------
    X : (n, c, r) whitened rows of each candidate pose: three coordinates, single readings, or both.
    V : (m, 3, r) rows of each pose of the volume at which predictions are wanted, mm.
    """

    X: Array
    V: Array

    @property
    def rank(self) -> int:
        """Number of identifiable groups r."""
        return int(self.X.shape[2])

    @property
    def components(self) -> int:
        """Number of readings at a pose, c."""
        return int(self.X.shape[1])

    def covariance(self, chosen: Index) -> Array:
        """Covariance C (r, r) of a design."""
        rows = self.X[chosen].reshape(-1, self.rank)
        return np.asarray(np.linalg.inv(rows.T @ rows + INFORMATION_RIDGE * np.eye(self.rank)))

    def variances(self, covariance: Array) -> Array:
        """Predicted variance (m,) of the position in the volume, sum over its three components, mm^2."""
        return np.asarray(np.einsum("mia,ab,mib->m", self.V, covariance, self.V, optimize=True))

    def log_det(self, chosen: Index) -> float:
        """Logarithm of the determinant of a design's information."""
        return -float(np.linalg.slogdet(self.covariance(chosen))[1])

    def worst(self, chosen: Index) -> float:
        """Smooth approximation of the largest predicted variance in the volume, mm^2: the power mean."""
        return power_mean(self.variances(self.covariance(chosen)))


def power_mean(variances: Array) -> float:
    """Power mean with exponent `MEAN_POWER`: close to the largest value."""
    top = float(variances.max())
    return float(top * np.mean((variances / top) ** MEAN_POWER) ** (1 / MEAN_POWER))


def exchange(space: Space, chosen: Index, worst: bool, rounds: int = MOST_EXCHANGE_ROUNDS) -> Index:
    """Exchange poses one by one for better candidates until none is better; the criterion never gets worse.

    Parameters
    ----------
    chosen : indices of the candidates in the design, with repetition.
    worst : criterion is the largest predicted variance in the volume; else the determinant (D).
    rounds : largest number of passes over all poses.
    """
    design = (Fair if worst else Design)(space, chosen)
    for _ in range(rounds):
        before = design.value
        for k in range(len(chosen)):
            design = design.improved(k)
        if before - design.value < LEAST_CRITERION_GAIN:
            break
    return design.chosen


class Design:
    """A design by the D criterion, with the products that an exchange needs. `value`: log det C, to be minimised."""

    def __init__(self, space: Space, chosen: Index) -> None:
        self.space, self.chosen = space, chosen
        self.C = space.covariance(chosen)
        self.P = _times(space.X, self.C)  # (n, c, r)
        self.S = _outer(self.P, space.X)  # (n, c, c): X_j C X_j'
        self.value = float(np.linalg.slogdet(self.C)[1])

    def improved(self, k: int) -> Self:
        """The design with pose k replaced by the best candidate, or itself if that is not better."""
        i = self.chosen[k]
        gain = self.gains(i)
        j = int(np.argmax(gain))
        if gain[j] - gain[i] <= 1e-6 * abs(gain[i]):
            return self
        chosen = self.chosen.copy()
        chosen[k] = j
        if not self.better(chosen):
            return self
        new = type(self)(self.space, chosen)
        return new if new.value < self.value else self

    def better(self, chosen: Index) -> bool:
        """Whether another design may be better: a cheap test before its products are computed."""
        return True

    def least(self) -> Index:
        """Positions in the design, in ascending order of the loss of determinant without the pose."""
        left = np.linalg.slogdet(np.eye(self.space.components) * (1 + 1e-12) - self.S[self.chosen])[1]
        return np.argsort(-left, kind="stable")

    def gains(self, i: int) -> Array:
        """Increase (n,) of log det information by each candidate, added to the design without candidate i."""
        return np.asarray(np.log(_adjoint(np.eye(self.space.components) + self.without(i)[1])[1]))

    def without(self, i: int) -> tuple[Array, Array]:
        """``X_j C X_i' G`` and ``X_j C_i X_j'``, (n, c, c) each, with ``C_i`` that of the design without i."""
        A = _times(self.P, self.space.X[i].T)
        AG = _times(A, np.linalg.inv(np.eye(self.space.components) * (1 + 1e-12) - self.S[i]))
        return AG, self.S + _outer(AG, A)


def _times(stack: Array, matrix: Array) -> Array:
    """``stack @ matrix`` for a stack (n, c, m), as one matrix product."""
    return np.asarray((stack.reshape(-1, len(matrix)) @ matrix).reshape(*stack.shape[:2], -1))


def _outer(one: Array, two: Array) -> Array:
    """``one two'`` for stacks (n, c, m)."""
    return np.asarray(np.einsum("nam,nbm->nab", one, two))


def _adjoint(a: Array) -> tuple[Array, Array]:
    """Adjugates (n, c, c) and determinants (n,) of positive definite matrices; of three rows written out for speed."""
    if a.shape[1] != 3:
        determinant = np.linalg.det(a)
        return np.asarray(determinant[:, None, None] * np.linalg.inv(a)), np.asarray(determinant)
    out = np.empty_like(a)
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        (b, c), (d, e) = ((i + 1) % 3, (i + 2) % 3), ((j + 1) % 3, (j + 2) % 3)
        out[:, i, j] = out[:, j, i] = a[:, b, d] * a[:, c, e] - a[:, b, e] * a[:, c, d]
    return out, np.einsum("ni,ni->n", a[:, 0], out[:, 0])


class Fair(Design):
    """A design by the largest predicted variance: exchanges follow the gradient of its power mean."""

    def __init__(self, space: Space, chosen: Index) -> None:
        super().__init__(space, chosen)
        variances = space.variances(self.C)
        self.value = float(np.log(power_mean(variances)))
        weight = (variances / variances.max()) ** (MEAN_POWER - 1)
        rows = (space.V * np.sqrt(weight / weight.sum())[:, None, None]).reshape(-1, space.rank)
        self.PK = _times(self.P, rows.T @ rows)
        self.Q = _outer(self.PK, self.P)  # X_j C K C X_j', K the gradient

    def better(self, chosen: Index) -> bool:
        return float(np.log(self.space.worst(chosen))) < self.value - 0.1 * LEAST_CRITERION_GAIN

    def gains(self, i: int) -> Array:
        """Decrease (n,) of ``tr C K`` by each candidate, added to the design without candidate i."""
        A, S = self.without(i)
        T = _outer(_times(self.PK, self.P[i].T), A)
        W = self.Q + T + T.transpose(0, 2, 1) + _outer(_times(A, self.Q[i]), A)
        adjoint, determinant = _adjoint(np.eye(self.space.components) + S)
        return np.asarray(np.einsum("nab,nab->n", adjoint, W) / determinant)


def rounded(weights: Array, count: int) -> Index:
    """Multiset of `count` candidates from weights (sum 1): efficient apportionment (Pukelsheim & Rieder 1992)."""
    support = np.flatnonzero(weights > 1e-6 * weights.max())
    if len(support) > count:
        support = support[np.argsort(-weights[support], kind="stable")[:count]]
    w = weights[support] / weights[support].sum()
    times = np.ceil(np.maximum((count - len(support) / 2) * w, 1e-9)).astype(int)
    while times.sum() > count:
        times[np.argmax((times - 1) / w)] -= 1
    while times.sum() < count:
        times[np.argmin(times / w)] += 1
    return np.repeat(support, times)
