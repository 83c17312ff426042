"""Cells of tables as numbers, whatever somebody wrote there."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from errormodel.files import as_numbers


@pytest.mark.parametrize(
    ("cells", "numbers"),
    [
        ([10**400, 1], [np.inf, 1]),  # an integer that no float holds
        ([-(10**400), 2.5, "x", None], [-np.inf, 2.5, np.nan, np.nan]),
        ([1, 2], [1, 2]),
        (["3", " 4.5 ", ""], [3, 4.5, np.nan]),
    ],
)
def test_numbers_or_nothing(cells: list[object], numbers: list[float]) -> None:
    np.testing.assert_array_equal(as_numbers(pd.Series(cells)), numbers)
