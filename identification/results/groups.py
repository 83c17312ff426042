"""The base parameters of a fit: each stands for a group that acts as one, with its value and standard uncertainty."""

from __future__ import annotations

from typing import Any

import numpy as np

from errormodel.location_errors import named
from identification.estimation.result import Fit


def groups_of(fit: Fit) -> list[dict[str, Any]]:
    """One entry a group: id of the base parameter, the group as a formula, value, standard uncertainty, unit."""
    s, chain = fit.solution, fit.chain
    std = np.sqrt(np.diag(s.covariance)) * fit.inflation
    units = {c: unit for v in fit.problem.readings for c, unit in v.units.items()}
    out = []
    for k, j in enumerate(s.groups.base):
        name = s.unknowns[j]
        plain = "frame." + name.rsplit(".", 1)[1] if name.startswith("frame[") else name
        known = chain.parameters[chain.index[plain]] if plain in chain.index else None
        motion = name.rsplit(".", 1)[1]
        members = s.groups.members(k)
        location = named(chain.location_errors, members)
        out.append(
            {
                "id": name,
                "group": s.groups.name(k),
                "members": members,
                "symbol": location.symbol if location else known.symbol if known else "",
                "meaning": location.words if location else "",
                "value": float(s.values[j]),
                "std": float(std[k]),
                "unit": known.unit if known else units.get(name) or ("mm" if motion in ("dx", "dy", "dz") else "rad"),
            }
        )
    return out
