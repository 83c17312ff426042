"""Shapes are moved off the grid of a family whose members need not all have them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from errormodel.effects import make
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.search.shape_fit import optimised
from identification.estimation.fit import fit_machine
from tests.helpers.diagnosed import empty_survey


def test_of_two_waves_at_once_one_changes_at_an_edge() -> None:
    """An edge of one proposal, which the others of its family do not have."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 150, 5, channels=False, grid=False)
    x, y, z = survey.table[["X", "Y", "mz"]].to_numpy().T
    steps = 0.02 * np.cos(2 * np.pi * x / 300) * np.sign(np.cos(2 * np.pi * (y - 20) / 220))
    linear = set_up(fit_machine(machine, replace(survey, table=survey.table.assign(mz=z + steps))))
    wave = {"element": "X", "motion": "dz", "driver": "X", "by": "Y", "by_period": 220.0}
    plain = [make(EffectSpec("unnamed", {**wave, "period": period})) for period in (250.0, 320.0)]
    edged = make(EffectSpec("unnamed", {**wave, "period": 320.0, "by_edge": 15.0}))
    found = optimised(linear, edged, (*plain, edged), 0.0)
    assert found is not None
    assert linear.square_with(found.effect) <= linear.square_with(edged)
