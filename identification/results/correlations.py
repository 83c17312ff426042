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
        groups = [e for e in groups if e.kind not in ("frame", "zero")]
    place = [e.number - 1 for e in groups]
    covariance = analysis.fit.solution.covariance[np.ix_(place, place)]
    std = np.sqrt(np.diag(covariance))
    return groups, np.asarray(covariance / np.outer(std, std))


def correlations(fit: Fit, least: float = 0.9, most: int = 100) -> list[dict[str, Any]]:
    """Most strongly correlated pairs of groups; all correlations follow from ``covariance.csv``."""
    s = fit.solution
    std = np.sqrt(np.diag(s.covariance))
    matrix = np.triu(s.covariance / np.outer(std, std), 1)
    pairs = np.argwhere(np.abs(matrix) > least)
    order = np.argsort(-np.abs(matrix[tuple(pairs.T)]), kind="stable")[:most]
    names = [s.unknowns[j] for j in s.groups.base]
    return [{"groups": [names[i], names[j]], "correlation": float(matrix[i, j])} for i, j in pairs[order]]
