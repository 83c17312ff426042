"""What is said of rows whose times make a course of their temperatures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.instruments.plain import Plain
from errormodel.survey import Survey
from identification.uncertainty.rows_in_time import as_course, smoothed, timed

LAG = ["X", "lag(T_bed,900)", "initial(T_bed,900)"]
ONCE = ["X", "T_bed"]


def cases(step: float, *temperatures: float) -> pd.DataFrame:
    time = step * np.arange(len(temperatures))
    return pd.DataFrame({"X": 1.0, "time": time, "T_bed": np.array(temperatures), "file": "p.csv", "run": "1"})


@pytest.mark.parametrize(("own", "others", "word"), [(LAG, [], "acts"), (ONCE, [ONCE, LAG], "may act")])
def test_changes_in_much_less_than_a_time_constant_are_said(own: list[str], others: list[list[str]], word: str) -> None:
    (note,) = as_course(own, others, cases(1.0, 19.5, 22.0, 24.5))
    assert note.startswith(f"T_bed {word} up to 900 s late, and changes by 2.5 K in 1 s from one row to another")
    assert note.endswith("give all of them one time")


@pytest.mark.parametrize(
    "table",
    [
        cases(200.0, 19.5, 22.0, 24.5),  # the lag sees much of it
        cases(0.0, 19.5, 22.0, 24.5),
        cases(1.0, 20.0, 20.1, 20.0),  # a sensor's noise
        cases(1.0, 19.5, 22.0, 24.5).drop(columns="time"),
    ],
)
def test_else_nothing_is_said(table: pd.DataFrame) -> None:
    assert not list(as_course(LAG, [], table))
    assert not list(as_course(ONCE, [ONCE], cases(1.0, 19.5, 22.0, 24.5)))


def test_what_is_smoothed_is_said() -> None:
    def said(table: pd.DataFrame, noise: float) -> list[str]:
        return list(smoothed(ONCE, Survey(table, "shared", (), Plain(), Path()), {"T_bed": noise}))

    (note,) = said(cases(1.0, 20.0, 20.1, 20.0), 0.03)
    assert note.startswith("T_bed (by up to 0.067 K): what this departs by from a course in the column time")
    assert not said(cases(1.0, 20.0, 20.1, 20.0), 0.0)
    assert not said(cases(1.0, 19.5, 22.0, 24.5), 0.03)
    assert not said(cases(0.0, 20.0, 20.1, 20.0), 0.03)
    assert not said(cases(1.0, 20.0, 20.1, 20.0).drop(columns="T_bed"), 0.03)


def test_rows_without_times_are_in_equilibrium() -> None:
    table = cases(1.0, 20.0, 22.0).drop(columns="time")
    assert timed(LAG, table)["time"].tolist() == [0.0, 0.0]
    assert timed(["rate(X)"], table)["time"].tolist() == [0.0, 0.0]
    assert timed(ONCE, table) is table
    gaps = table.assign(time=[5.0, np.nan])
    assert timed(LAG, gaps)["time"].tolist() == [0.0, 0.0]
    whole = cases(1.0, 20.0, 22.0)
    assert timed(LAG, whole) is whole
