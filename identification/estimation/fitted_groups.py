"""What the groups of a fit are of: the combination of all parameters that each base parameter is estimated to be.

Where columns are nearly dependent, those of the base take up the others as far as the weights of the rows have it:
with weights W, the estimate of the base is that of ``p_b + (A_b' W A_b)^-1 A_b' W A_o p_o`` of the parameters p_o that
are held at zero. Of exact dependences that is the same for all weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from errormodel.arrays import Array
from errormodel.conventions import PLAUSIBLE_SIZES
from identification.observation.identifiability import Groups

UNITS = ("mm", "rad")  # of the parameters that are looked at
SHOWN = 0.1  # standard uncertainties of the group, by which a usual error changes it: less stays as the rank has it
SOUND = 1e6  # condition number up to which normal equations give the combination


def as_fitted(groups: Groups, gram: Array, covariance: Array, units: Sequence[str]) -> Groups:
    """The groups with the coefficients that the fit gives them, where these differ by what is seen.

    Parameters
    ----------
    gram : (n, n) normal equations of all parameters, weighted as in the fit.
    covariance : (rank, rank) of the groups.
    units : n units of the parameters.
    """
    base = groups.base
    others = np.setdiff1d(np.arange(len(groups.ids)), base)
    sizes = np.array([PLAUSIBLE_SIZES[units[j]] if units[j] in UNITS else 0.0 for j in others])
    if not len(base) or not sizes.any() or groups.condition > SOUND:
        return groups
    norms = np.sqrt(np.diag(gram)[base])
    own, across = gram[np.ix_(base, base)] / np.outer(norms, norms), gram[np.ix_(base, others)] / norms[:, None]
    fitted = np.linalg.solve(own, across) / norms[:, None]
    before = groups.coefficients[:, others]
    differs = np.abs(fitted - before) * sizes > SHOWN * np.sqrt(np.diag(covariance))[:, None]
    coefficients = groups.coefficients.copy()
    coefficients[:, others] = np.where(differs, fitted, before)
    return replace(groups, coefficients=coefficients)
