"""Rows that may be wrong are said where they are too few to be found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from errormodel.machine_file import read_machine
from identification.diagnosis.data_checks.outliers import gross_rows
from identification.diagnosis.results.doubtful_rows import doubtful_rows
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit
from tests.helpers.diagnosed import empty_survey


@pytest.fixture(scope="module")
def fit() -> Fit:
    machine = read_machine("vertical_three_axis")
    return fit_machine(machine, empty_survey(machine, 150, 5, channels=False, grid=False))


def noisy(fit: Fit, seed: int, wrong: float = 0.0) -> Fit:
    """The fit with normal residuals, of which row 91 is so many standard deviations more off."""
    noise = 0.004 * np.random.default_rng(seed).normal(size=fit.residuals.shape)
    noise[90, 1] += 0.004 * wrong
    return replace(fit, residuals=noise)


def test_noise_has_no_doubtful_rows(fit: Fit) -> None:
    assert not any(doubtful_rows(noisy(fit, seed)) for seed in range(30))


def test_a_wrong_row_is_found_or_said(fit: Fit) -> None:
    """Of nine standard deviations along one axis: in all of thirty draws but two one of both."""
    said, missed = list[str](), 0
    for seed in range(30):
        own = noisy(fit, seed, 9.0)
        if not gross_rows(own, earlier=np.zeros(len(own.residuals), dtype=bool))[90]:
            said += (notes := doubtful_rows(own))
            missed += not notes
    assert missed <= 2
    assert said
    assert all(note.startswith("row 91 lies ") for note in said)
