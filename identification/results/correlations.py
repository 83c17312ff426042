"""Correlation coefficients of the identified groups."""

from __future__ import annotations

from typing import Any

import numpy as np

from errormodel.arrays import Array
from identification.estimation.result import Fit
from identification.results.analysis import Analysis
from identification.results.parameter_table import Estimate

MOST_CORRELATED_GROUPS = 90  # groups, beyond which those of frames and instruments are left out, for legibility


def correlation(analysis: Analysis) -> tuple[list[Estimate], Array]:
    """The groups shown and their correlation coefficients, (n, n)."""
    groups = analysis.estimates
    if len(groups) > MOST_CORRELATED_GROUPS:
        groups = [e for e in groups if e.kind not in ("frame", "zero", "observation")]
    place = [e.number - 1 for e in groups]
    return groups, coefficients(analysis.fit.solution.covariance[np.ix_(place, place)])


def coefficients(covariance: Array) -> Array:
    """Correlation coefficients (n, n) of a covariance."""
    std = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(std, std))


def strongest(matrix: Array, least: float, most: int) -> list[tuple[int, int, float]]:
    """Pairs whose coefficient exceeds `least` in size, the largest first, at most `most`."""
    above = np.triu(matrix, 1)
    pairs = np.argwhere(np.abs(above) > least)
    order = np.argsort(-np.abs(above[tuple(pairs.T)]), kind="stable")[:most]
    return [(int(i), int(j), float(above[i, j])) for i, j in pairs[order]]


def correlations(fit: Fit, least: float = 0.9, most: int = 100) -> list[dict[str, Any]]:
    """Most strongly correlated pairs of groups; all correlations follow from ``covariance.csv``."""
    s = fit.solution
    names = [s.unknowns[j] for j in s.groups.base]
    return [
        {"groups": [names[i], names[j]], "correlation": coefficient}
        for i, j, coefficient in strongest(coefficients(s.covariance), least, most)
    ]
