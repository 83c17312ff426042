"""Beside readings of other instruments, what happens to the tracker happens to the points alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec
from errormodel.survey import Survey
from identification.diagnosis.pipeline import diagnose
from identification.estimation.fit import fit_machine
from tests.helpers.mixed import MACHINE, mixed

DRIFT = np.array([0.06, -0.04, 0.03])  # mm over the recording
ANGLES = np.array([4e-5, -6e-5, 5e-5])  # rad


@pytest.fixture(scope="module")
def drifted() -> Survey:
    """A tracker that moves while the points are measured, and lengths of an interferometer, which stays."""
    survey = mixed({"A": "pose-distance"})
    table = survey.table.assign(time=30.0 * np.arange(len(survey)))
    points = table["observation"].isin(["", None]) | table["observation"].isna()
    gone = (table["time"] / table["time"].max()).to_numpy()[:, None]
    place = table[["mx", "my", "mz"]].to_numpy()
    table.loc[points, ["mx", "my", "mz"]] = (place + gone * (DRIFT + np.cross(ANGLES, place)))[points]
    return replace(survey, table=table)


def test_a_drift_of_the_tracker_is_named_and_the_interferometer_does_not_contradict_it(drifted: Survey) -> None:
    result = diagnose(MACHINE, drifted)
    (finding,) = result.diagnosis.findings
    assert (finding.effect, finding.where) == ("tracker-drift", "frame")
    (effect,) = result.final.chain.machine.effects
    assert effect.options["of"] == "points"
    channel = Chain(result.final.chain.machine).columns(drifted.table)
    number = result.final.chain.channels.index("of(points)")
    np.testing.assert_array_equal(channel[number], drifted.table["observation"].fillna("") == "")
    assert result.diagnosis.verdict == "explained"


def test_an_effect_of_an_observation_that_is_not_there_is_refused(drifted: Survey) -> None:
    machine = replace(MACHINE, effects=(EffectSpec("tracker-drift", {"of": "B"}),))
    with pytest.raises(InputError, match="is of B, which is no observation of the survey"):
        fit_machine(machine, drifted)
