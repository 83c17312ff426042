"""Location errors of axes (squareness, parallelism) estimated by a fit, from whatever groups they are sums of.

A location error is a linear function of the parameters. A fit determines it if the function lies in the row space of
the identified groups, though each group may depend on the measuring frame. Rotations of a linear joint change the path
of a point by its lever, so that their coefficients are free: they are chosen so that the function is determined.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from errormodel.arrays import Array
from errormodel.location_errors import LocationError, one_of_each_pair
from identification.estimation.result import Fit
from identification.observation.identifiability import Groups

SAME_FUNCTION_SHARE = 1e-4  # relative difference of coefficients up to which two functions are the same
ROUND_OFF = 1e-9  # of the largest coefficient


@dataclass(frozen=True)
class LocationEstimate:
    """A location error and its estimate, rad.

    Attributes
    ----------
    symbol, words : such as ``EC(0X)Y`` and ``squareness of Y against X``.
    members : coefficients of the parameters.
    value, std : estimate and standard uncertainty (k = 1), rad.
    """

    symbol: str
    words: str
    members: Mapping[str, float]
    value: float
    std: float

    def as_json(self) -> dict[str, object]:
        return asdict(self) | {"unit": "rad"}


def location_estimates(fit: Fit) -> tuple[LocationEstimate, ...]:
    """The location errors of the machine that the fit determines, each pair of axes once."""
    s, out = fit.solution, []
    for error in one_of_each_pair(fit.chain.location_errors):
        shares = determined(error, s.groups)
        if shares is None:
            continue
        base = s.groups.base
        members = shares @ s.groups.coefficients
        variance = float(shares @ s.covariance @ shares) * fit.inflation**2
        rounding = ROUND_OFF * np.abs(members).max()
        kept = {i: float(c) for i, c in zip(s.groups.ids, members, strict=True) if abs(c) > rounding}
        value, std = float(shares @ s.values[base]), float(np.sqrt(variance))
        out.append(LocationEstimate(error.symbol, error.words, kept, value, std))
    return tuple(out)


def determined(error: LocationError, groups: Groups) -> Array | None:
    """Coefficients (rank,) of the base parameters that make up a location error; None where it is not determined."""
    place = {name: k for k, name in enumerate(groups.ids)}
    wanted, free = np.zeros(len(groups.ids)), np.zeros(len(groups.ids), dtype=bool)
    for name, coefficient in error.members.items():
        if name not in place:
            if name in error.free:
                continue
            return None
        wanted[place[name]] = coefficient
    free[[place[name] for name in error.free if name in place]] = True
    if not wanted.any():
        return None
    held = ~free
    design = groups.coefficients[:, held]
    shares = np.linalg.lstsq(design.T, wanted[held], rcond=1e-10)[0]
    left = np.abs(wanted[held] - shares @ design)
    size = np.maximum(np.abs(wanted[held]), np.abs(shares) @ np.abs(design))
    same = left <= SAME_FUNCTION_SHARE * size + ROUND_OFF * np.abs(wanted).max()
    return np.asarray(shares, dtype=np.float64) if same.all() else None
