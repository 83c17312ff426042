"""What tests of printer firmwares share: checkouts that the environment names, functions of their sources, tables."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from errormodel.controllers import target
from errormodel.controllers.base import Controller
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Tables
from tests.helpers.chains import Array
from tests.helpers.setups import filled, plain_setup

POSES = 200


def source(variable: str, file: str) -> Path:
    """A checkout that the environment names, if it has a file."""
    folder = os.environ.get(variable)
    if not folder:
        pytest.skip(f"{variable} names no checkout of the firmware")
    path = Path(folder)
    if not (path / file).is_file():
        pytest.skip(f"{variable}: {path} has no {file}")
    return path


def written(
    name: str, size: float = 0.03, setup: Setup | None = None
) -> tuple[Controller, Setup, Tables, dict[str, str]]:
    """Random tables of a controller, and their files."""
    controller, setup = target(name), setup or plain_setup()
    assert isinstance(controller, Controller)
    tables = filled(controller, setup, controller.terms(setup), np.random.default_rng(3), size)
    return controller, setup, tables, controller.write(tables, setup)


def places(setup: Setup) -> Array:
    """Random positions (n, axes) over the travels."""
    travel = np.array([a.travel for a in setup.axes])
    return np.random.default_rng(4).uniform(travel[:, 0], travel[:, 1], (POSES, len(travel)))


def function(text: str, start: str) -> str:
    """A function of a C++ source, up to its closing brace."""
    begin = text.index(start)
    depth, at = 0, text.index("{", begin)
    while True:
        depth += {"{": 1, "}": -1}.get(text[at], 0)
        at += 1
        if not depth:
            return text[begin:at]
