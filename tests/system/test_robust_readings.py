"""A robust fit of points and readings that fit each other keeps all of them."""

from __future__ import annotations

import pytest

from identification.diagnosis.data_checks.gate import passed
from identification.estimation.fit import fit_machine
from tests.helpers.lengths import entry
from tests.helpers.mixed import KINDS, MACHINE, NOISE, mixed


@pytest.mark.parametrize("word", KINDS)
def test_no_right_reading_is_left_out(word: str) -> None:
    """The fit that it starts from passes through as many of the sharpest readings as it has parameters."""
    survey = mixed({"A": word})
    fit = passed(MACHINE, survey, lambda: fit_machine(MACHINE, survey, robust=True), robust=True)
    assert len(fit.outliers) <= 2
    noise = NOISE[entry(type=word, **KINDS[word][0]).reading]
    assert fit.solution.sigma[word] == pytest.approx(noise, rel=0.4)
