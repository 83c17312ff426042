"""Repeats in many sound surveys: they accuse the model no more often than is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from errormodel.machine_file import read_machine
from identification.diagnosis.results.verdict import judge
from identification.estimation.fit import fit_machine
from tests.helpers.findings import NOISE, survey_of, walked


def test_repeats_stay_quiet_on_good_data() -> None:
    """With heavy tails too: one misfit in a hundred would be one in a hundred false verdicts."""
    machine = read_machine("vertical_three_axis")
    rng = np.random.default_rng(0)
    survey = survey_of(machine, walked(), {}, 0.0)
    clean = survey.table[["mx", "my", "mz"]].to_numpy()
    for k in range(40):
        noise = rng.standard_t(4, clean.shape) if k % 2 else rng.normal(size=clean.shape)
        table = survey.table.assign(**dict(zip(("mx", "my", "mz"), (clean + NOISE * noise).T, strict=True)))
        assert judge(fit_machine(machine, replace(survey, table=table)), False).word == "adequate"
