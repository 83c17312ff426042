"""Cache of products of very many columns with the bases of linear models.

The linear models of one search differ by a few accepted effects. Their bases lie within some hundred directions.
Products with a basis are combined from those with the directions, so that each direction is multiplied only once.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from errormodel.arrays import Array, Columns

ROUNDED = 1e-6  # of a vector's length: no more of it is rounding, and no direction of its own
MOST = 1500  # directions: more take up too much memory, and are looked at anew


class Directions:
    """Orthonormal directions, and the products with them that are known."""

    def __init__(self) -> None:
        self._basis = np.zeros((0, 0))
        self._known: dict[int, tuple[Columns, Array]] = {}

    def copy(self) -> Directions:
        """One that begins with what is known here."""
        other = Directions()
        other._basis, other._known = self._basis, dict(self._known)
        return other

    def coordinates(self, vectors: Array) -> Array:
        """Coordinates (u, r) of vectors (n, r) along the directions, of which there may be more now."""
        from scipy.linalg import qr

        lengths = np.linalg.norm(vectors, axis=0)
        unit = vectors / np.where(lengths > 0, lengths, 1.0)
        if self._basis.shape[1] + vectors.shape[1] > MOST or len(self._basis) != len(vectors):
            self._basis, self._known = np.zeros((len(vectors), 0)), {}
        left = unit - self._basis @ (self._basis.T @ unit)
        left -= self._basis @ (self._basis.T @ left)
        new = np.linalg.norm(left, axis=0) > ROUNDED
        if new.any():
            q, r, _ = qr(left[:, new], mode="economic", pivoting=True)  # of dependent vectors some bring nothing new
            self._basis = np.hstack([self._basis, q[:, np.abs(np.diag(r)) > ROUNDED]])
        coordinates: Array = (self._basis.T @ unit) * lengths
        return coordinates

    def products(self, columns: Columns, times: Callable[[Array], Array], coordinates: Array) -> Array:
        """Of columns with the vectors of such coordinates (u, r): (..., r).

        Parameters
        ----------
        times : makes products of the columns with vectors (n, r).
        """
        _, known = self._known.get(id(columns), (columns, None))
        have = 0 if known is None else known.shape[-1]
        if known is None or have < len(coordinates):
            new = times(self._basis[:, have:])
            known = new if known is None else np.concatenate([known, new], axis=-1)
            self._known[id(columns)] = columns, known  # an address is another's once the columns are gone
        return known @ coordinates
