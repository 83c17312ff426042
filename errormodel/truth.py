"""What is true in a simulation: errors of the machine, measuring frame, unknown numbers of set-ups; mm and rad."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np

from errormodel.chain import Chain
from errormodel.exceptions import nearest

# errors, other than of effects, beyond which nothing is a machine any more, so that the unit is a mistake; by judgement
LARGEST = {"mm": 1e4, "rad": math.pi, "1": 0.5, "rad/mm": 0.1}


@dataclass(frozen=True)
class Truth:
    """Known parameter values by id (mm, rad and their ratios), and the pose of the measuring frame.

    ``measured = rotation @ actual + translation`` with ``rotation = Rx Ry Rz`` of the three angles. `set_ups` has the
    unknown numbers of observations by their names, in the machine's reference, mm and rad.
    """

    parameters: Mapping[str, float]
    translation: tuple[float, float, float] = (0.0, 0.0, 0.0)  # mm
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)  # rad
    set_ups: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


def read_truth(path: Path, chain: Chain) -> Truth:
    """Read ``parameters: {T1.dx: 0.01, ...}`` (mm, rad), the measuring frame and unknown numbers of set-ups.

    Optional are ``frame: {translation: mm, rotation: deg}`` and ``observations: {A: {x: 900, dead_path: 12.5}}``.

    Raises
    ------
    InputError
        The file is not such a mapping, an id is not one of the machine's, or a value is no machine's.
    """
    from pydantic import Field, FiniteFloat

    from errormodel import yamlfile

    bounded = Annotated[FiniteFloat, Field(ge=-yamlfile.LARGEST_NUMBER, le=yamlfile.LARGEST_NUMBER)]

    class FrameForm(yamlfile.FileModel):
        translation: yamlfile.Vector3 = Field([0.0, 0.0, 0.0], description="[x, y, z] in mm")
        rotation: yamlfile.Vector3 = Field([0.0, 0.0, 0.0], description="three angles in degrees, such as [0, 0, 90]")

    class TruthForm(yamlfile.FileModel):
        parameters: dict[str, bounded] = Field(default_factory=dict)
        frame: FrameForm = Field(default_factory=FrameForm)
        observations: dict[str, dict[str, bounded]] = Field(
            default_factory=dict,
            description="unknown numbers of set-ups, such as {A: {x: 900, y: 0, z: 0}}, mm and rad",
        )

    document = yamlfile.load(path)
    form = yamlfile.validate(document, TruthForm)
    for identity, value in form.parameters.items():
        if wrong := wrong_with(identity, value, chain):
            raise document.error(("parameters", identity), *wrong)
    x, y, z = form.frame.translation
    a, b, c = np.radians(form.frame.rotation).tolist()
    return Truth(form.parameters, (x, y, z), (a, b, c), form.observations)


def wrong_with(identity: str, value: float, chain: Chain) -> tuple[str, str] | None:
    """What is wrong with a parameter's id or value, and what to write instead, in words; None where nothing is."""
    if identity not in chain.index:
        return f"the machine has no parameter '{identity}'", nearest(identity, chain.ids)
    parameter = chain.parameters[chain.index[identity]]
    most = math.inf if identity in chain.frame_ids or math.isfinite(parameter.size) else LARGEST.get(parameter.unit)
    if most is None or abs(value) <= most:
        return None
    unit = "mm/mm" if parameter.unit == "1" else parameter.unit
    return f"{value:g} {unit}, which is no machine's error", f"Write it in {unit}, at most {most:g} in size"
