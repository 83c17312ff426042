"""Names for the arrays that go around, and the making of contiguous ones and of rotations."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
Columns = NDArray[np.floating[Any]]  # single precision too, where there are many columns
Rows = slice | Index | Mask  # anything that selects rows of an array
Numbers = Sequence[float] | Array

MAD_STD = 1.4826  # standard deviation of a normal distribution over its median absolute deviation


def as_rows(*columns: NDArray[Any]) -> list[Array]:
    """Contiguous float64 columns, as kernels require (a strided view would be copied in every block)."""
    return [np.ascontiguousarray(c, dtype=np.float64) for c in columns]


def corners_of_cube(dimensions: int, most: int) -> Array:
    """Corners (n, dimensions) of the unit cube: all of them, or a random sample of `most` (same at each call)."""
    if 2**dimensions <= most:
        return np.array(list(product((0.0, 1.0), repeat=dimensions))).reshape(-1, dimensions)
    return np.random.default_rng(0).integers(0, 2, (most, dimensions)).astype(np.float64)


def rotation_matrix(angles: Sequence[float]) -> Array:
    """Rotation matrix (3, 3) of turns about x, then the new y, then the new z, by angles (3,) in rad.

    Most members are not turned, and for them SciPy, which takes as long to load as a command, is not needed.
    """
    if not any(angles):
        return np.eye(3)
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler("XYZ", angles).as_matrix(), dtype=np.float64)
