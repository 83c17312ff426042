"""Standard uncertainties after ten more poses: by rows as many as theirs, beside a prior that these do not change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit
from identification.uncertainty.further_poses import FURTHER_POSES, gain_of
from tests.helpers.commands import MILL
from tests.helpers.diagnosed import empty_survey, showing

ROWS, SIZES = 120, 0.02  # usual sizes of the effect's prior: as narrow as the data are
CURVE = EffectSpec("higher-order-geometry", {"joint": "X", "motion": "dz", "every": 60.0})


@pytest.fixture(scope="module")
def fit() -> Fit:
    """A curve with a narrow prior beside geometry without one."""
    machine = replace(read_machine(MILL), effects=(CURVE,))
    survey = empty_survey(machine, ROWS, 1, channels=False, grid=False)
    return fit_machine(machine, showing(survey, machine, [], 0.002), effect_sizes=SIZES)


def test_more_of_the_same_rows(fit: Fit) -> None:
    """As the normal equations have it: the information of rows grows with their number, that of the prior does not."""
    s, base = fit.solution, fit.solution.groups.base
    precision = np.diag(s.precision[base])
    assert np.trace(precision @ s.covariance) > 1  # the prior tells something
    data = np.linalg.inv(s.covariance) - precision
    more = np.linalg.inv(data * (1 + FURTHER_POSES / ROWS) + precision)
    assert gain_of(fit).like_these == pytest.approx(np.sqrt(np.diag(more)) * fit.inflation, rel=1e-5)


def test_a_covariance_of_more_than_noise(fit: Fit) -> None:
    """With the uncertainty of forms a parameter may be less certain than its prior: it gains all the same."""
    s = fit.solution
    wide = replace(fit, solution=replace(s, covariance=s.covariance + 1e3 * np.diag(np.diag(s.covariance))))
    gain, std = gain_of(wide), np.sqrt(np.diag(wide.solution.covariance)) * fit.inflation
    assert (gain.like_these > 0.9 * std).all()
    assert (gain.like_these < std).all()
    assert gain.like_these / std == pytest.approx(gain_of(fit).like_these / std * np.sqrt(1001), rel=1e-9)
