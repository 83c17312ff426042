"""Temperatures over time: noise of a sensor is smoothed, and what is none is taken as it is given."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from errormodel.channels import columns
from errormodel.temperature_courses import noise_name, noise_of

NOISE = 0.03  # K


def course(seed: int = 0) -> pd.DataFrame:
    time = 45.0 * np.arange(150)
    rng = np.random.default_rng(seed)
    return pd.DataFrame({"time": time, "T_bed": 22 + 3 * np.sin(time / 4000) + rng.normal(0, NOISE, len(time))})


def test_the_noise_of_a_recording_is_found() -> None:
    """Also where a tenth of the rows are off: 25 % is five standard errors of the median of 150 rows."""
    table = course()
    assert noise_of(table, ["T_bed"])["T_bed"] == pytest.approx(NOISE, rel=0.25)
    off = table.assign(T_bed=table["T_bed"] + np.where(np.arange(len(table)) % 50 < 5, 1.0, 0.0))
    assert noise_of(off, ["T_bed"])["T_bed"] < 2 * NOISE
    assert noise_of(table.drop(columns="time"), ["T_bed"]) == {"T_bed": 0.0}
    assert noise_of(table.assign(T_bed=np.nan), ["T_bed", "T_none"]) == {}


def test_rows_that_are_noise_off_a_course_are_smoothed() -> None:
    table = course(1)
    known = table.assign(**{noise_name("T_bed"): NOISE})
    (smooth,), (same,) = columns(table, ["T_bed"]), columns(known, ["T_bed"])
    np.testing.assert_array_equal(same, smooth)
    truth = 22 + 3 * np.sin(table["time"] / 4000)
    assert np.std(same - truth) < 0.6 * np.std(table["T_bed"] - truth)


@pytest.mark.parametrize("step", [1.0, 60.0])
def test_states_are_taken_as_they_are_given(step: float) -> None:
    """Cases in a table whose times run on: no course that anybody recorded."""
    given = np.tile([19.5, 22.0, 24.5], 4)
    table = pd.DataFrame({"time": step * np.arange(12), "T_bed": given})
    for noise in (0.0, NOISE):
        (taken,) = columns(table.assign(**{noise_name("T_bed"): noise}), ["T_bed"])
        np.testing.assert_array_equal(taken, given)
    (smooth,) = columns(table, ["T_bed"])  # as a recording
    assert np.abs(smooth - given).max() > 1.0


def test_one_row_that_is_another_state_is_enough() -> None:
    table = course(2).assign(**{noise_name("T_bed"): NOISE})
    table = table.assign(T_bed=table["T_bed"] + np.where(np.arange(len(table)) == 70, 0.5, 0.0))
    (taken,) = columns(table, ["T_bed"])
    np.testing.assert_array_equal(taken, table["T_bed"])
