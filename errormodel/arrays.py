"""Type names of NumPy arrays, and conversion of columns into contiguous float arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
Columns = NDArray[np.floating[Any]]  # single precision too, where there are many columns
Rows = slice | Index | Mask  # anything that selects rows of an array
Numbers = Sequence[float] | Array


def as_rows(*columns: NDArray[Any]) -> list[Array]:
    """Contiguous float64 columns, as kernels require (a strided view would be copied in every block)."""
    return [np.ascontiguousarray(c, dtype=np.float64) for c in columns]
