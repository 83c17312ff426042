"""An arm with some joints' curves known, and a recording of it, for what leaves one of them out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from errormodel.machine import EffectSpec, Machine, Shape
from errormodel.machine_file import read_machine
from errormodel.survey import Survey, read_survey

# of each joint's own angle: motion, distance of the splines (rad), their size (rad)
CURVES = {
    "J1": ("ec", 0.0698, 5.4e-4),
    "J2": ("eb", 0.0349, 4.1e-4),
    "J3": ("eb", 0.0524, 5.1e-4),
    "J4": ("eb", 0.0698, 6.7e-4),
    "J5": ("ec", 0.0698, 5.4e-4),
}


def arm(folder: Path, without: str = "") -> Machine:
    """The arm with its curves, but for the curve of a joint or a constant such as ``T3.ea``."""
    machine = read_machine(folder)
    effects = [
        EffectSpec("higher-order-geometry", {"joint": joint, "motion": motion, "every": every, "size": size})
        for joint, (motion, every, size) in CURVES.items()
        if joint != without
    ]
    elements = [
        replace(e, motions=tuple(m for m in e.motions if f"{e.name}.{m}" != without)) if isinstance(e, Shape) else e
        for e in machine.elements
    ]
    return replace(machine, elements=tuple(elements), effects=tuple(effects))


def recorded(folder: Path, machine: Machine, every: int) -> Survey:
    survey = read_survey(folder / "series_c.csv", machine)
    return replace(survey, table=survey.table.iloc[::every].reset_index(drop=True))
