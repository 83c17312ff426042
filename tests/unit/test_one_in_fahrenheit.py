"""A single temperature in degF beside others in degC."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd

from errormodel.machine_file import read_machine
from errormodel.surveys.file import SurveyUnits
from errormodel.surveys.plausibility import check_sizes
from tests.helpers.commands import MILL

N = 160


def said(**temperatures: object) -> list[str]:
    rows = pd.DataFrame({name: np.linspace(0, 100, N) for name in "XYZ"}).assign(**temperatures)
    return check_sizes(rows, read_machine(MILL), SurveyUnits(), "s.csv", measured=False)


def test_one_temperature_in_fahrenheit_beside_another_is_noted() -> None:
    """68.9 to 74.9 "degC" beside a twin of 20.5 to 24.7: it followed it in degF; a motor and a heater do not."""
    time = 60.0 * np.arange(N)
    course = np.linspace(0, 1, len(time))
    room = 20.5 + 4 * course + 0.02 * np.cos(7 * np.arange(len(time)))
    other = room - 0.8 * course + 0.02 * np.sin(5 * np.arange(len(time)))
    [note] = said(T_a=room, T_b=1.8 * other + 32)
    assert re.search(r"T_b of 69 to 75 degC; in degF .* from T_a .* write units: \{T_b: degF\}", note)
    motor = 70 + 3 * np.sin(time / 600)
    for warm in (50 + room, 70.0, motor, 60 + 15 * (1 - np.exp(-3 * course))):
        assert not said(T_a=room, T_motor=warm)
