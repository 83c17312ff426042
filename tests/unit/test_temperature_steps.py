"""Jumps of temperatures: a reset logger or a moved sensor is noted, what happens to machines is not."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest

from errormodel.arrays import Array
from errormodel.surveys.temperature_steps import step_notes

N, AT = 120, 70  # rows, and the first one behind what happens
SINCE = np.clip(np.arange(N) - AT + 1, 0, None)  # rows
BEHIND = (SINCE > 0).astype(np.float64)


def table(pace: float = 60.0, **changes: Array) -> pd.DataFrame:
    """Three sensors of a machine that follows its room, late and with noise, with changes of some."""
    rng, time = np.random.default_rng(2), np.arange(N)
    room = {name: 20 + 1.5 * np.sin((time - late) / 15) for name, late in (("T_X", 0), ("T_Y", 1), ("T_air", -1))}
    noisy = {n: (v + rng.normal(0, 0.03, N) + changes.get(n, 0.0)).round(3) for n, v in room.items()}
    return pd.DataFrame({"file": "s.csv", "run": "1", "row": time + 1, "time": pace * time, **noisy})


@pytest.mark.parametrize("pace", [10.0, 600.0])
@pytest.mark.parametrize("kelvin", [5.0, -2.5])
def test_a_reset_logger_and_a_moved_sensor_are_noted(pace: float, kelvin: float) -> None:
    [every] = step_notes(table(pace, T_X=kelvin * BEHIND, T_Y=kelvin * BEHIND, T_air=kelvin * BEHIND))
    size = re.escape(f"{kelvin:+.0f}")
    assert re.search(rf"^s.csv: T_X T_Y T_air jump by {size}\.\d+ K from row 70 to row 71 \({pace:.3g} s\)", every)
    assert "a logger was reset. Correct them by " + ("-" if kelvin > 0 else "+") in every
    [one] = step_notes(table(pace, T_Y=kelvin * BEHIND))
    assert re.search(r"^s.csv: T_Y jumps by .* T_X, which it follows .* its sensor was moved", one)
    assert not list(step_notes(table(pace)))


def test_a_run_that_is_not_in_order_is_taken_by_its_times() -> None:
    changed = table(T_X=5.0 * BEHIND, T_Y=5.0 * BEHIND, T_air=5.0 * BEHIND)
    shuffled = changed.sample(frac=1, random_state=1, ignore_index=True).assign(row=np.arange(N) + 1)
    before, behind = (int(shuffled.loc[shuffled["time"] == 60.0 * k, "row"].iloc[0]) for k in (AT - 1, AT))
    [note] = step_notes(shuffled)
    assert f"from row {before} to row {behind} " in note


@pytest.mark.parametrize("pace", [10.0, 60.0, 600.0])
def test_what_happens_to_machines_is_no_jump(pace: float) -> None:
    warm = 6 * (1 - np.exp(-pace * SINCE / 300))  # a spindle
    door = -5.0 * BEHIND * (SINCE < 12)
    oil = np.where(BEHIND, 17 - table()["T_Y"], 0.0) + 0.02 * np.sin(np.arange(N))  # chilled from here on
    for changes in (
        {"T_Y": warm}, {"T_air": door}, {"T_Y": oil}, {"T_X": 4.0 * BEHIND, "T_Y": 5.0 * BEHIND, "T_air": 2.0 * BEHIND},
        {"T_X": 0.4 * BEHIND, "T_Y": 0.4 * BEHIND, "T_air": 0.4 * BEHIND},
    ):  # fmt: skip
        assert not list(step_notes(table(pace, **changes)))


def test_after_a_rest_in_another_run_or_by_hand_temperatures_are_others() -> None:
    every = table(T_X=5.0 * BEHIND, T_Y=5.0 * BEHIND, T_air=5.0 * BEHIND)
    for changes in (
        {"time": every["time"] + 3600.0 * BEHIND}, {"run": np.where(BEHIND, "2", "1")},
        dict.fromkeys(("T_X", "T_Y", "T_air"), 20.0 + 5.0 * BEHIND),
    ):  # fmt: skip
        assert not list(step_notes(every.assign(**changes)))
    assert not list(step_notes(every.drop(columns="time")))
    assert not list(step_notes(every.drop(columns=["T_X", "T_Y"])))
