"""Fields of error and tables that take them away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from errormodel.chain import Chain
from errormodel.controllers import target
from errormodel.controllers.base import Controller
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Tables
from errormodel.machine import Machine
from identification.compensation.compensate import best_tables
from identification.compensation.field import Field, movers_of
from identification.compensation.volume import Volume
from tests.helpers.chains import Array

UM = 1e-3


def field_of(machine: Machine, p: Array, **state: float) -> Field:
    return Field(Chain(machine), p, movers_of(Chain(machine)), state)


def volume_of(machine: Machine, p: Array, share: tuple[float, float] = (0.0, 1.0), **state: float) -> Volume:
    field = field_of(machine, p, **state)
    travel = np.array([j.travel for j in machine.joints])
    low, high = (travel[:, 0] + s * (travel[:, 1] - travel[:, 0]) for s in share)
    return Volume(field, low, high, True)


def tables_of(name: str, volume: Volume, **more: object) -> tuple[Controller, Tables, Setup]:
    controller = target(name)
    assert isinstance(controller, Controller)
    setup = replace(volume.setup(None, None)[0], **more)  # type: ignore[arg-type]
    return controller, best_tables(controller, setup, volume), setup
