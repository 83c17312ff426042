"""Names for the arrays that go around, and the making of contiguous ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
Columns = NDArray[np.floating[Any]]  # of single precision too, where there are many
Rows = slice | Index | Mask  # what picks rows
Numbers = Sequence[float] | Array


def as_rows(*columns: NDArray[Any]) -> list[Array]:
    """Contiguous float columns, as kernels want them (a strided view would be gathered in every block)."""
    return [np.ascontiguousarray(c, dtype=np.float64) for c in columns]
