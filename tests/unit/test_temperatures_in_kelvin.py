"""Temperatures in kelvin that are read as degC."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
import pytest

from errormodel.arrays import Array
from errormodel.exceptions import InputError
from errormodel.machine_file import read_machine
from errormodel.surveys.file import SurveyUnits
from errormodel.surveys.plausibility import check_sizes
from identification.diagnosis.data_checks.temperature_sensors import faults
from tests.helpers.commands import MILL

N = 50
ROOM = np.linspace(19.2, 23.4, N)


def said(temperatures: Mapping[str, Array], measured: bool = True, units: SurveyUnits | None = None) -> list[str]:
    rows = pd.DataFrame({name: np.linspace(0, 100, N) for name in "XYZ"} | {**temperatures})
    return check_sizes(rows, read_machine(MILL), units or SurveyUnits(), "s.csv", measured)


def test_a_survey_in_kelvin_is_refused() -> None:
    kelvin = {"T_a": ROOM + 273.15, "T_b": ROOM + 272}
    with pytest.raises(InputError, match=r"T_a T_b: 291.2 to 296.5 degC; in K .* 18\.\d to 23.4 degC") as error:
        said(kelvin)
    assert "units: {temperature: K}" in error.value.cure
    assert "--units T_a=K,T_b=K" in error.value.cure
    assert not said(kelvin, units=SurveyUnits.model_validate(dict.fromkeys(kelvin, "degC")))  # as its cure says
    [points] = said(kelvin, measured=False)
    assert points.endswith("units: {temperature: K} in a survey.yaml")
    [gaps] = said({"T_a": np.where(np.arange(N) == 3, 0.0, ROOM + 273.15)})  # not in all rows
    assert "units: {temperature: K}" in gaps


def test_one_sensor_in_kelvin_is_noted_and_drives_nothing() -> None:
    one = {"T_a": ROOM + 273.15, "T_b": ROOM}
    [note] = said(one)
    assert "T_a is 292.3 to 296.5 degC; in K it would be 19.2 to 23.4 degC" in note
    assert "units: {T_a: K}" in note
    assert faults(pd.DataFrame(one)) == {"T_a": "292.3 to 296.5 degC in all rows, as of K (units: {T_a: K})"}
    nozzle = {"T_nozzle": ROOM + 273.15, "T_b": ROOM}
    assert not said(nozzle)
    assert not faults(pd.DataFrame(nozzle))
