"""Columns of commands that stand a few rows too late."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from errormodel.chain import Chain
from errormodel.machine_file import read_machine
from errormodel.surveys.columns import MEASURED
from identification.diagnosis.data_checks.late_columns import late_column
from tests.helpers.diagnosed import empty_survey

MACHINE = read_machine("vertical_three_axis")


@pytest.mark.parametrize("whole", [True, False])
def test_columns_are_moved_by_points_that_are_whole(whole: bool) -> None:
    """Where each row has one component, as a laser measures a line, nobody knows where a point lies."""
    survey = empty_survey(MACHINE, 120, 5, channels=False, grid=False)
    table = survey.table.assign(X=np.roll(survey.table["X"], 1))
    if not whole:
        measured = [*MEASURED]
        table[measured] = table[measured].where(np.arange(len(table))[:, None] % 3 == np.arange(3))
    found = late_column(Chain(MACHINE), replace(survey, table=table))
    assert (found is not None) == whole
