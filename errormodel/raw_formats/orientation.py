"""Orientations as instruments write them, as rotation vectors."""

from __future__ import annotations

import numpy as np


def rotation_vectors(q: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """Rotation vectors (n, 3) in rad of quaternions (n, 4), scalar first; NaN where `whole` (n,) is false."""
    from scipy.spatial.transform import Rotation

    out = np.full((len(q), 3), np.nan)
    out[whole] = Rotation.from_quat(q[whole], scalar_first=True).as_rotvec()
    return out
