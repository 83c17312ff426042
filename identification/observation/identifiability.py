"""Identifiable parameter groups (base parameters) of a design matrix, by singular values and QR decomposition.

The rank is decided on columns scaled to unit length, so that it does not depend on units, the order of rows or the
measuring frame. The threshold lies above round-off and, where the noise is known, above combinations whose standard
uncertainty would exceed any plausible machine error. The null space is expressed as groups: each identifiable (base)
parameter with the coefficients of its dependent parameters (base parameters: W. Khalil & E. Dombre).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Index

# Singular value of unit columns up to which a direction is a dependence: exact dependences come out below 1e-12, and
# normal equations are solvable above 1e-7
DEPENDENCE_TOLERANCE = 1e-7
# A column below this share of its norm at full travel and the longest lever names a group only where no other can,
# however preferred it is. Over the travels of the library's machines this changes no name; by judgement.
SEEN = 0.005
AT_ONCE = 32  # columns that are made orthogonal in one product: of these times the rank is its work beside


@dataclass(frozen=True)
class Floors:
    """Thresholds by the noise, for columns of unit norm at full travel and lever."""

    direction: float = 0.0  # smallest singular value that is identifiable
    lever: float = 0.0  # smallest norm of a column that has an effect


@dataclass(frozen=True)
class Groups:
    """The identifiable groups of a design.

    Attributes
    ----------
    ids : tuple of str
        All parameters, in the order of the columns.
    base : Array of int (rank,)
        Base columns, one per group; the solver keeps these and sets the others to zero.
    coefficients : Array (rank, n)
        Row k: the group of base parameter k as coefficients of all parameters (1 at the base itself).
    no_effect : tuple of str
        Parameters whose column is zero.
    singular_values : Array
        Of the scaled columns with effect, descending.
    margin : Floors
        Floors below this would leave the groups as they are.
    """

    ids: tuple[str, ...]
    base: Index
    coefficients: Array
    no_effect: tuple[str, ...]
    singular_values: Array
    margin: Floors = Floors()

    @property
    def rank(self) -> int:
        """Number of groups."""
        return len(self.base)

    @property
    def condition(self) -> float:
        """Condition number of the scaled columns: largest over smallest singular value within the rank."""
        return float(self.singular_values[0] / self.singular_values[self.rank - 1]) if self.rank else 1.0

    def members(self, k: int) -> dict[str, float]:
        """Group k as ``{id: coefficient}``, the base parameter first."""
        row = self.coefficients[k]
        order = [int(self.base[k]), *(int(j) for j in np.flatnonzero(row) if j != self.base[k])]
        return {self.ids[j]: float(row[j]) for j in order}

    def name(self, k: int) -> str:
        """Group k as a formula: ``T1.dx + T2.dx - 312.035 T5.eb``."""
        text = ""
        for identity, value in self.members(k).items():
            sign = "-" if value < 0 else "+"
            size = "" if abs(abs(value) - 1) < 1e-12 else f"{abs(value):.6g} "
            text += f" {sign} {size}{identity}" if text else f"{'-' if value < 0 else ''}{size}{identity}"
        return text

    def listed(self) -> list[dict[str, object]]:
        """All groups for JSON: ``{"name": ..., "members": {id: coefficient}}``."""
        return [{"name": self.name(k), "members": self.members(k)} for k in range(self.rank)]


def find_groups(
    design: Array,
    ids: Sequence[str],
    scale: Array,
    order: Sequence[int],
    floors: Floors | None = None,
    least: float = DEPENDENCE_TOLERANCE,
) -> Groups:
    """Groups of the columns of a design matrix.

    Parameters
    ----------
    design : (m, n)
        Rows of M (any row weights), or any triangular factor of it.
    ids : n parameter ids.
    scale : (n,)
        Norm of each column at full travel and lever (see `full_norms`): decides "no effect".
    order : columns in the order of preference as base of a group.
    floors : thresholds by the noise, where it is known.
    least : singular value of unit columns up to which a direction is a dependence.

    Returns
    -------
    Groups
        Base columns, coefficients of the groups, and parameters without effect.
    """
    floors = floors or Floors()
    norms = np.linalg.norm(design, axis=0)
    active = norms > max(1e-12, floors.lever) * scale
    order = [j for j in order if active[j]]
    if not order:
        return Groups(tuple(ids), np.zeros(0, np.intp), np.zeros((0, len(ids))), tuple(ids), np.zeros(0))
    unit = design[:, order] / norms[order]
    if unit.shape[0] > unit.shape[1]:
        unit = np.linalg.qr(unit, mode="r")
    singular = np.linalg.svd(unit, compute_uv=False)
    # weakly observable columns stay independent, but are chosen last as base columns, and dropped below the noise
    strength = norms[order] / np.maximum(scale[order], norms[order])
    sizes, directions = _singular(unit * strength)
    rank = min(int((singular > least).sum()), int((sizes > floors.direction).sum()))
    chosen = _first_independent(sizes[:rank, None] * directions[:rank], strength)
    # a_dependent = A_base K, column by column
    mix = np.zeros((rank, len(order)))
    mix[np.arange(rank), chosen] = 1.0
    others = np.setdiff1d(np.arange(len(order)), chosen)
    mix[:, others] = _combined(unit[:, chosen], unit[:, others])
    mix[np.abs(mix) < 1e-7] = 0.0
    mix[np.abs(mix) * strength < floors.direction] = 0.0  # coefficients below the noise
    coefficients = np.zeros((rank, len(ids)))
    base = np.array([order[c] for c in chosen], dtype=np.intp)
    coefficients[:, order] = mix * norms[order] / norms[base][:, None]
    coefficients = _tidy(coefficients)
    coefficients[:, base] = np.eye(rank)
    no_effect = tuple(i for i, a in zip(ids, active, strict=True) if not a)
    kept = (np.abs(mix) * strength)[mix != 0]
    margin = Floors(min(sizes[:rank].min(initial=np.inf), kept.min(initial=np.inf)), float(strength.min()))
    return Groups(tuple(ids), base, coefficients, no_effect, singular, margin)


def _singular(matrix: Array) -> tuple[Array, Array]:
    """Singular values and right singular vectors; of columns of very unlike lengths gesdd does not always converge."""
    try:
        return np.linalg.svd(matrix, full_matrices=False)[1:]
    except np.linalg.LinAlgError:
        from scipy.linalg import svd

        _, sizes, directions = svd(matrix, full_matrices=False, lapack_driver="gesvd")
        return sizes, directions


def _first_independent(seen: Array, strength: Array) -> list[int]:
    """The first columns (rank, n) that are clearly independent of those before: in order, those hardly seen last.

    A group whose members move the measured points very unequally is not named after one that hardly does.

    Parameters
    ----------
    seen : the columns projected to exactly the rank, which is as many as are chosen.
    """
    rank = len(seen)
    q = np.zeros((rank, rank))
    chosen: list[int] = []
    clearly = 1e-3
    while len(chosen) < rank:
        order = [*np.flatnonzero(strength >= SEEN), *np.flatnonzero((strength < SEEN) & (strength >= clearly))]
        left = np.setdiff1d(order, chosen, assume_unique=True).tolist()  # keeps the order
        for first in range(0, len(left), AT_ONCE):  # of many columns at once a product is as quick as of one
            own, start = left[first : first + AT_ONCE], len(chosen)
            beyond = _beyond(seen[:, own], q[:, :start])
            for j, column in zip(own, beyond.T, strict=True):
                rest = _beyond(column, q[:, start : len(chosen)])
                size = float(np.linalg.norm(rest))
                if size > clearly * strength[j] and len(chosen) < rank:
                    q[:, len(chosen)] = rest / size
                    chosen.append(j)
        clearly /= 10  # too few columns passed: lower the threshold
    return sorted(chosen)


def _combined(base: Array, columns: Array) -> Array:
    """Coefficients (rank, n) with which independent columns give others (m, n), by least squares."""
    q, triangle = np.linalg.qr(base)
    return np.asarray(np.linalg.solve(triangle, q.T @ columns))


def _beyond(columns: Array, basis: Array) -> Array:
    """What columns have beyond an orthonormal basis; taken off twice, since once is inaccurate near dependence."""
    for _ in range(2):
        columns = columns - basis @ (basis.T @ columns)
    return columns


def _tidy(values: Array) -> Array:
    """Round values that are within round-off of a nine-digit number: tool lengths stay as they were written."""
    digits = 10.0 ** (8 - np.floor(np.log10(np.maximum(np.abs(values), 1e-300))))
    short = np.round(values * digits) / digits
    return np.where(np.abs(short - values) <= 1e-11 * np.abs(values), short, values)
