"""Temperatures of a table: freed of their sensors' noise, and never mixed where they are not one course over time."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from errormodel.channels import channel, columns


def _table(time: object, warmth: object, run: object = 1) -> pd.DataFrame:
    table = pd.DataFrame({"time": time, "T_spindle": warmth}, dtype=np.float64)
    return table.assign(run=run, file="a.csv", row=range(1, len(table) + 1))


@settings(deadline=None)
@given(st.lists(st.floats(15, 45), min_size=2, max_size=9), st.sampled_from([0.0, 3600.0]))
def test_states_at_one_time_stay_what_they_are(warmth: list[float], time: float) -> None:
    """Somebody asks about several temperatures, all at one time: none is the mean of them, nor the first."""
    table = _table([time] * len(warmth), warmth)
    plain, late = columns(table, ["T_spindle", "lag(T_spindle,1800)"])
    assert np.array_equal(plain, table["T_spindle"])
    assert np.array_equal(late, table["T_spindle"])


@pytest.mark.parametrize("name", ["T_spindle", "lag(T_spindle,900)"])
def test_runs_with_clocks_of_their_own(name: str) -> None:
    """Warming and cooling, both from a time of zero on, are what each would be in a file of its own."""
    time = 60.0 * np.arange(40)
    rng = np.random.default_rng(7)
    up, down = (start + slope * time + rng.normal(0, 0.03, 40) for start, slope in ((20, 4e-3), (30, -4e-3)))
    both = _table([*time, *time], [*up, *down], ["up"] * 40 + ["down"] * 40)
    apart = [columns(_table(time, warmth), [name])[0] for warmth in (up, down)]
    assert columns(both, [name])[0] == pytest.approx(np.concatenate(apart), abs=1e-12)
    if name == "T_spindle":
        assert np.sqrt(np.mean((apart[0] - 20 - 4e-3 * time) ** 2)) < 0.02  # smoothed as before


@pytest.mark.parametrize("name", ["T_spindle", "lag(T_spindle,900)"])
def test_runs_of_one_clock(name: str) -> None:
    """Rows sorted by their tool, which took turns, have the temperatures of the one course that they are from."""
    time = 60.0 * np.arange(80)
    warmth = 20 + 3 * np.sin(time / 1500) + np.random.default_rng(3).normal(0, 0.03, 80)
    in_time = _table(time, warmth, np.arange(80) % 2)
    by_tool = in_time.sort_values("run", kind="stable")
    value = pd.Series(columns(by_tool, [name])[0], index=by_tool.index).sort_index()
    assert value.to_numpy() == pytest.approx(columns(in_time, [name])[0], abs=1e-12)


def test_the_recording_itself_is_as_it_was() -> None:
    """What is asked for without smoothing is the column."""
    table = _table([0, 60, 120], [20.0, 20.1, 20.0])
    assert np.array_equal(channel(table, "T_spindle"), table["T_spindle"])
    assert not np.array_equal(columns(table, ["T_spindle"])[0], table["T_spindle"])
