"""The uncertainty of an effect's form is of what it changes: what is alike in all rows is the geometry's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.diagnosis.pipeline import diagnose
from identification.results import store
from identification.results.predictions import predicted
from tests.helpers.commands import XYZ
from tests.helpers.diagnosed import empty_survey, showing

MACHINE = read_machine("vertical_three_axis")
SPEC = EffectSpec("scale-expansion", {"joint": "X", "sensor": "T_bed"})


def diagnosed_at(level: float, folder: Path) -> tuple[store.StoredFit, pd.DataFrame]:
    """What was found by a sensor that swings by 1 K about a level, and the recording."""
    survey = empty_survey(MACHINE, 400, 5, channels=False, grid=False)
    time = np.linspace(0, 7200, 400)
    survey = replace(survey, table=survey.table.assign(time=time, T_bed=level + np.sin(time / 900)))
    survey = showing(survey, MACHINE, [(SPEC, [25e-6])], 0.002)
    out = diagnose(MACHINE, survey)
    assert [f.effect for f in out.diagnosis.findings] == ["scale-expansion"]
    store.save(out.final, folder)
    return store.load(folder), survey.table


@pytest.mark.long
def test_a_sensor_far_from_the_reference_temperature(tmp_path: Path) -> None:
    (warm, table), (cool, _) = (diagnosed_at(level, tmp_path / str(level)) for level in (60.0, 20.0))
    survey = empty_survey(MACHINE, 400, 5, channels=False, grid=False)
    there, here = (
        predicted(fit, replace(survey, table=table.assign(T_bed=table["T_bed"] + change)))
        for fit, change in ((warm, 0.0), (cool, -40.0))
    )
    assert there["ux"].mean() == pytest.approx(here["ux"].mean(), rel=0.05)
    assert there["ux"].mean() < 0.002  # mm
    error, u = (t[c].to_numpy() for t, c in ((there[XYZ] - table[XYZ], XYZ), (there, ["ux", "uy", "uz"])))
    beyond = np.abs(error) > 2 * np.hypot(u, 0.002)
    assert beyond.mean() < 0.08
    # 38 K away what the geometry took is uncertain with the size
    cold = predicted(warm, replace(survey, table=table.assign(T_bed=22.0)))
    assert cold["ux"].mean() > 10 * there["ux"].mean()
