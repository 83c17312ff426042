"""The base parameters of a fit: each stands for a group that acts as one, with its value and standard uncertainty."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from errormodel.chain import Chain
from errormodel.machine import Shape
from identification.estimation.result import Fit
from identification.results.axis_lines import LocationAt, locations_of
from identification.uncertainty.measured_range import covered

PART_OF = "part of the "  # of a location error to which angular error motions add


def groups_of(fit: Fit) -> list[dict[str, Any]]:
    """One entry a group: id of the base parameter, the group as a formula, value, standard uncertainty, unit."""
    s, chain = fit.solution, fit.chain
    std = np.sqrt(np.diag(s.covariance)) * fit.inflation
    units = {c: unit for v in fit.problem.readings for c, unit in v.units.items()}
    locations = locations_of(chain, fit.survey.table, covered(chain, fit.span))
    out = []
    for k, j in enumerate(s.groups.base):
        name = s.unknowns[j]
        plain = "frame." + name.rsplit(".", 1)[1] if name.startswith("frame[") else name
        known = chain.parameters[chain.index[plain]] if plain in chain.index else None
        motion = name.rsplit(".", 1)[1]
        members = s.groups.members(k)
        symbol, meaning = location_name(chain, locations, members)
        out.append(
            {
                "id": name,
                "group": s.groups.name(k),
                "members": members,
                "symbol": symbol or (known.symbol if known else ""),
                "meaning": meaning,
                "value": float(s.values[j]),
                "std": float(std[k]),
                "unit": known.unit if known else units.get(name) or ("mm" if motion in ("dx", "dy", "dz") else "rad"),
            }
        )
    return out


def location_name(chain: Chain, locations: Iterable[LocationAt], members: Mapping[str, float]) -> tuple[str, str]:
    """Symbol and name of the location error that a group ``{id: coefficient}`` is, both empty of any other group.

    A group with the constants of shapes of one, to which angular error motions and straightness add at the place of the
    lines, is no location error: it has a name that says so, and no symbol.
    """
    for at in locations:
        if at.is_group(members):
            return at.error.symbol, at.error.words
    shapes = {e.name for e in chain.machine.elements if isinstance(e, Shape)}
    constants = {p.id for p in chain.parameters if p.element in shapes and p.id not in chain.of_effects}
    own = members.keys() <= set(chain.machine_ids)
    part = next((at for at in locations if own and at.is_group(members, constants)), None)
    return "", PART_OF + part.error.words if part else ""
