"""Channels that are computed from columns: a play's scan, and sides of approach that a column states."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from errormodel.approach import direction
from errormodel.channels import channel

POSITIONS = st.lists(st.floats(-100, 100).map(lambda q: round(q, 2)), min_size=1, max_size=60)


@given(POSITIONS, st.sampled_from([0.01, 1.0, 30.0, 500.0]))
def test_a_play_is_what_each_row_leaves_of_the_one_before(positions: list[float], width: float) -> None:
    """The operator of play row by row; its scan ends where no earlier row matters any more."""
    table = pd.DataFrame({"X": positions})
    at = positions[0] - direction(table, "X")[0] * width / 2
    expected = []
    for q in positions:
        at = min(max(at, q - width / 2), q + width / 2)
        expected.append(at)
    np.testing.assert_allclose(channel(table, f"play(X,{width})"), expected, atol=1e-12)


@pytest.mark.parametrize("missing", [(), (0,), (1, 3)])
def test_sides_that_a_column_states_are_taken_and_others_derived(missing: tuple[int, ...]) -> None:
    stated = np.array([-1.0, -1.0, 1.0, -1.0])
    stated[list(missing)] = np.nan
    table = pd.DataFrame({"X": [0.0, 1.0, 2.0, 1.5], "dir_X": stated})
    derived = direction(table.drop(columns="dir_X"), "X")
    before = table.copy()
    found = direction(table, "X")
    np.testing.assert_array_equal(found, np.where(np.isnan(stated), derived, stated))
    found[:] = 0.0  # the caller's own
    pd.testing.assert_frame_equal(table, before)
