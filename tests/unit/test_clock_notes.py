"""Times in another unit: a machine that creeps or flies is noted, an ordinary one is not."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from errormodel.machine_file import read_machine
from errormodel.surveys.clock_notes import clock_notes
from errormodel.surveys.file import SurveyUnits
from errormodel.surveys.plausibility import check_sizes

MILL = read_machine("vertical_three_axis")
ROWS = 200


def survey(step_s: float, smooth: bool) -> pd.DataFrame:
    """Poses every `step_s`, on a path that runs on or at random."""
    rng, turn = np.random.default_rng(4), np.linspace(0, 20, ROWS)
    places = {}
    for k, joint in enumerate(MILL.joints):
        share = np.sin(turn * (1 + 0.3 * k) + k) / 2 if smooth else rng.uniform(-0.5, 0.5, ROWS)
        places[joint.name] = np.mean(joint.travel) + 0.9 * np.ptp(joint.travel) * share
    return pd.DataFrame({"file": "s.csv", "run": "1", "time": step_s * np.arange(ROWS), **places})


@pytest.mark.parametrize(
    ("step_s", "smooth", "said"),
    [
        (2.0, True, ""),
        (2000.0, True, "time: ms"),
        (20.0, False, ""),
        (20000.0, False, ""),  # one pose in hours is no mistake
        (20 / 3600, False, "time: h"),
        (20 / 60, False, "time: min"),
        (0.3, True, ""),  # read on the fly
    ],
)
def test_a_unit_is_suspected_where_no_machine_moves_so(step_s: float, smooth: bool, said: str) -> None:
    notes = list(clock_notes(survey(step_s, smooth), MILL))
    assert len(notes) == bool(said)
    assert all(f"{{{said}}}" in note for note in notes)


def test_without_times_or_moves_nothing_is_said() -> None:
    table = survey(2000.0, True)
    assert not list(clock_notes(table.drop(columns="time"), MILL))
    assert not list(clock_notes(table.assign(X=1.0, Y=2.0, Z=3.0), MILL))
    assert not list(clock_notes(table.assign(time=7.0), MILL))


def test_times_that_fall_all_along_are_noted() -> None:
    table = survey(2.0, True)
    (note,) = clock_notes(table.assign(time=table["time"].to_numpy()[::-1]), MILL)
    assert "times fall from row to row" in note
    half = table.assign(run=np.repeat(["2", "1"], [ROWS // 2, ROWS - ROWS // 2]))
    assert not list(clock_notes(half.iloc[::-1].assign(time=np.tile(np.arange(ROWS // 2), 2)), MILL))


def test_a_clock_that_was_set_back_is_noted() -> None:
    table = survey(2.0, True)
    (note,) = clock_notes(table.assign(time=table["time"] - 100.0 * (np.arange(ROWS) >= 120)), MILL)
    assert "before row 121 the time goes back by 98 s;" in note
    other_order = table.sample(frac=1.0, random_state=1)
    assert not list(clock_notes(other_order, MILL))
    each_from_zero = table.assign(run=np.repeat(["1", "2"], ROWS // 2), time=np.tile(np.arange(ROWS // 2), 2))
    assert not list(clock_notes(each_from_zero, MILL))


def _by_levels(seconds: float) -> pd.DataFrame:
    """Levels of Z one after another, each with random places of X and Y."""
    table = survey(seconds / ROWS, False)
    low, high = next(j.travel for j in MILL.joints if j.name == "Z")
    return table.assign(Z=low + (high - low) * np.floor(np.arange(ROWS) / 40) / 4)


def test_a_position_that_follows_the_time_is_noted() -> None:
    """What drifts over hours looks like an error of that joint."""
    (note,) = clock_notes(_by_levels(10000.0), MILL)
    assert "the position of Z follows the time" in note
    assert not list(clock_notes(_by_levels(1000.0), MILL))  # in minutes nothing drifts
    again = _by_levels(10000.0)
    again.loc[ROWS - 20 :, "Z"] = again["Z"].iloc[0]
    assert not list(clock_notes(again, MILL))
    partly = _by_levels(10000.0)
    partly.loc[: ROWS // 5 - 1, "time"] = np.nan  # a file without times beside one with them
    assert len(list(clock_notes(partly, MILL))) == 1
    partly["Z"] = partly["Z"].where(partly["time"].isna(), 100.0)
    assert not list(clock_notes(partly, MILL))


def test_faster_than_any_rapid_traverse_is_noted() -> None:
    """At 3 m/s from row to row; at 1 m/s it is not."""
    table = survey(1.0, False)
    way = np.sqrt((table[["X", "Y", "Z"]].diff()[1:] ** 2).sum(axis=1))
    at_1_m_s = table.assign(time=table["time"] * float(way.median()) / 1000)
    assert not check_sizes(at_1_m_s, MILL, SurveyUnits(), "s.csv", measured=False)
    [note] = check_sizes(at_1_m_s.assign(time=at_1_m_s["time"] / 3), MILL, SurveyUnits(), "s.csv", measured=False)
    assert "linear joints at 3 m/s (median from row to row) by the column time in s" in note
    assert "{time: min} or {time: h}" in note
