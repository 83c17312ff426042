"""Rows that no physics explains: found by their distance in units of a robust noise, one round at a time."""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Mask
from identification.fit.result import Fit

GROSS = 10.0  # robust standard deviations: Gaussian noise never gets there, knees and local defects rarely
MOST = 0.15  # of the rows: more is not a handful of accidents


def gross_rows(fit: Fit) -> Mask:
    """Mask (n,) of rows whose residual vector is longer than `GROSS` robust standard deviations of one component."""
    residuals = fit.residuals
    seen = np.isfinite(residuals).any(axis=1)
    length = np.sqrt(np.nansum(np.square(residuals), axis=1) / np.maximum(np.isfinite(residuals).sum(axis=1), 1))
    scale = float(np.median(length[seen])) / 0.888 if seen.any() else 1.0  # median of chi/sqrt(3) with three components
    gross = seen & (length > GROSS * max(scale, 1e-9) / np.sqrt(3))
    return gross if 0 < gross.sum() <= MOST * seen.sum() else np.zeros_like(gross)
