"""A copied row is told from a repeat that agrees by chance."""

from __future__ import annotations

import pandas as pd
import pytest

from errormodel import read_machine, read_survey, simulate
from errormodel.chain import Chain
from identification.diagnosis.data_checks.duplicates_and_clock import copied_rows
from tests.helpers.commands import XYZ
from tests.helpers.importing import MILL, poses


@pytest.mark.parametrize(("noise", "copies"), [(0.0008, (61,)), (0.0002, None)])
def test_one_copied_row_is_told_from_a_repeat_by_the_noise(noise: float, copies: tuple[int, ...] | None) -> None:
    """At eight steps of the last digit a repeat agrees once in 22 000 times, at two once in 350."""
    machine = read_machine(MILL)
    table = simulate(MILL, poses(4, 60), noise=noise, seed=4).round(dict.fromkeys(XYZ, 4))
    table = pd.concat([table, table.iloc[[10]]], ignore_index=True)
    found = copied_rows(Chain(machine), read_survey(table, machine))
    assert (found and found.rows) == copies
