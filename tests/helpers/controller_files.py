"""Tables of every controller, to be written to files."""

from __future__ import annotations

import numpy as np

from errormodel.controllers import target
from errormodel.controllers.base import Controller
from errormodel.controllers.setup import Setup
from tests.helpers.setups import filled, plain_setup


def tables_and_setup(name: str) -> tuple[Controller, Setup, tuple]:  # type: ignore[type-arg]
    controller, setup = target(name), plain_setup(reversing=frozenset({"X"}))
    assert isinstance(controller, Controller)
    terms = controller.structures(setup)[0]
    return controller, setup, filled(controller, setup, terms[: controller.most_tables], np.random.default_rng(0))
