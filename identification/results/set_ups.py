"""Unknown numbers of set-ups as a fit has them: stations, centres, zeros, places of targets, with uncertainties."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from errormodel.effects import make
from errormodel.effects.target_offset import TargetOffset
from identification.estimation.result import Fit


@dataclass(frozen=True)
class SetUpValue:
    """One unknown quantity of an observation.

    Attributes
    ----------
    observation, type : its entry of ``observations:`` and the model, or a target and ``target``; `id` : name of the
        unknown.
    value : absolute, in `unit` (mm, rad); coordinates in the machine's reference, of a target in the last frame.
    std : standard uncertainty (k = 1); None where the readings do not determine it, and it stays where it started.
    relative_to : parameters of the machine that the readings cannot tell from it, with their coefficients: the value is
        that of a machine in which they are 0.
    """

    observation: str
    type: str
    id: str
    value: float
    std: float | None
    unit: str
    relative_to: dict[str, float]

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def set_ups(fit: Fit) -> list[SetUpValue]:
    """All unknown quantities of a fit's observations, in the order of the survey, and places of its targets."""
    s = fit.solution
    named, std = s.named(), np.sqrt(np.diag(s.covariance)) * fit.inflation
    of_base = {s.unknowns[j]: k for k, j in enumerate(s.groups.base)}
    out: dict[str, SetUpValue] = {}

    def add(label: str, kind: str, name: str, start: float, unit: str) -> None:
        k = of_base.get(name)
        own = None if k is None else float(std[k])
        members = {} if k is None else {m: c for m, c in s.groups.members(k).items() if m != name}
        out[name] = SetUpValue(label, kind, name, start + named.get(name, 0.0), own, unit, members)

    for view in fit.problem.readings:
        for name, start in view.starts.items():
            add(view.label, view.kind, name, start, view.units[name])
    chain = fit.chain
    for spec, ids in zip(chain.machine.effects, chain.effect_ids, strict=True):
        effect = make(spec)
        if isinstance(effect, TargetOffset) and effect.std is not None:
            for name, start in zip(ids, effect.tool or chain.machine.tool, strict=True):
                add(effect.target, "target", name, start, "mm")
    return list(out.values())
