"""Location errors of axes (squareness, parallelism) that a fit determines, with their standard uncertainties.

A location error is that between lines through the middle of what was measured, as an instrument would measure them on
the fitted machine (`identification.results.axis_lines`). It is linear in the parameters. What the fit did not identify
and acts on these lines is counted as `predict` counts it; where that is much of what is known before a survey, lines
that the survey itself has are taken, or there is no figure.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array
from errormodel.location_errors import one_of_each_pair
from errormodel.machine import Joint
from identification.results.axis_lines import AxisLines, LocationAt, measured_paths, spoken_place
from identification.results.stored_fit import StoredFit
from identification.uncertainty.prediction import plausible_sizes, unidentified

if TYPE_CHECKING:
    import pandas as pd

MOST_UNKNOWN = 0.1  # of the standard deviation before a survey, beyond which a fit does not determine it; by judgement
ROUND_OFF = 1e-9  # of the largest coefficient


@dataclass(frozen=True)
class LocationEstimate:
    """A location error and its estimate, rad.

    Attributes
    ----------
    symbol, words : such as ``EC(0X)Y`` and ``squareness of Y against X``.
    members : coefficients of the parameters.
    value, std : estimate and standard uncertainty (k = 1), rad.
    at : place of the lines: ``lines through X 0, Y 0, Z 300``, or where the other joints stand along each, the line of
        the reference last: ``lines at X 0, Z 300; Y 0, Z 310``.
    """

    symbol: str
    words: str
    members: Mapping[str, float]
    value: float
    std: float
    at: str

    def as_json(self) -> dict[str, object]:
        return asdict(self) | {"unit": "rad"}

    @property
    def spoken(self) -> str:
        """Its name with the place of the lines."""
        return f"{self.words} ({self.at})"


def location_estimates(stored: StoredFit, lines: AxisLines, table: pd.DataFrame) -> tuple[LocationEstimate, ...]:
    """The location errors of the machine that a fit determines, each pair of axes once.

    Parameters
    ----------
    lines : of the fitted machine, through the middle of what was measured.
    table : rows of the survey, mm and rad.
    """
    joints = lines.field.joints
    own: dict[str, Array] | None = None
    out = []
    for error in one_of_each_pair(stored.chain.location_errors):
        at = lines.location(error)
        found = at and _determined(stored, lines.names, at)
        place = f"lines through {spoken_place(joints, lines.place)}"
        if at and not found:
            own = _paths(joints, table) if own is None else own
            names = error.reference.joint.name, error.line.joint.name
            if own.keys() >= {*names}:
                at = lines.location(error, (own[names[0]], own[names[1]]))
                found = at and _determined(stored, lines.names, at)
                both = (spoken_place(joints, own[a.joint.name][0], a.joint) for a in (error.line, error.reference))
                place = f"lines at {'; '.join(both)}"
        if found:
            out.append(LocationEstimate(error.symbol, error.words, *found, place))
    return tuple(out)


def _paths(joints: tuple[Joint, ...], table: pd.DataFrame) -> dict[str, Array]:
    q = table[[j.name for j in joints]].to_numpy(dtype=np.float64)
    return measured_paths(joints, q[np.isfinite(q).all(axis=1)])


def _determined(
    stored: StoredFit, names: tuple[str, ...], at: LocationAt
) -> tuple[dict[str, float], float, float] | None:
    """What a fit determines of a location error, its value and standard uncertainty; None: too little."""
    wanted = np.array([at.members.get(i, 0.0) for i in names])
    before = float(np.linalg.norm(wanted * plausible_sizes(stored, names)))
    unknown = [effect.item() for _, effect in unidentified(stored, list(names), wanted[:, None, None])]
    left = float(np.linalg.norm(unknown))
    if not wanted.any() or left > MOST_UNKNOWN * before:
        return None
    shares = np.array([at.members.get(i, 0.0) for i in stored.base])
    variance = float(shares @ stored.covariance @ shares) + left**2
    members: dict[str, float] = {}
    for identity, share in zip(stored.base, shares, strict=True):
        for member, coefficient in stored.groups[identity].items():
            members[member] = members.get(member, 0.0) + share * coefficient
    rounding = ROUND_OFF * max(map(abs, members.values()), default=0.0)
    return {i: c for i, c in members.items() if abs(c) > rounding}, at.value, float(np.sqrt(variance))
