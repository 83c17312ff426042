"""Lagged temperatures of later commands go on from where the recording ended, or it is said that they do not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.instruments.plain import Plain
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from errormodel.simulation import random_points
from errormodel.survey import Survey
from identification.uncertainty.recording_end import (
    after_gaps,
    as_in_last_run,
    continued,
    in_last_run,
    runs_of,
    started_anew,
    temperatures_of,
    with_runs,
)

LAG = "lag(T_bed,1800)"


@pytest.fixture(scope="module")
def chain() -> Chain:
    spec = EffectSpec("structure-drift", {"element": "column", "motion": "dy", "sensor": "T_bed", "tau": 1800.0})
    return Chain(replace(read_machine("vertical_three_axis"), effects=(spec,)))


def warming(chain: Chain, rows: int = 80) -> pd.DataFrame:
    time = np.sort(np.random.default_rng(3).uniform(0, 9000, rows))
    bed = 20 + 30 * (1 - np.exp(-time / 1500)) + np.sin(time / 300)
    return random_points(chain.machine, rows, 1).assign(time=time, T_bed=bed, file="s.csv")


def test_two_halves_are_the_whole(chain: Chain) -> None:
    table = warming(chain)
    number = chain.channels.index(LAG)
    whole = chain.columns(table)[number]
    first, later = table.iloc[:50], table.iloc[50:].reset_index(drop=True)
    anew = chain.columns(later)
    history = temperatures_of([chain.channels], first)
    went_on = continued(chain, history, later, anew)
    np.testing.assert_allclose(went_on[number], whole[50:], rtol=1e-12)
    assert np.abs(anew[number] - whole[50:]).max() > 2  # K: what a start in equilibrium makes of it
    assert all(a is b for k, (a, b) in enumerate(zip(went_on, anew, strict=True)) if k != number)
    assert not list(started_anew(chain, history, later))


def test_commands_within_the_recording(chain: Chain) -> None:
    """Their temperatures before the first row, and between rows, are those that were recorded."""
    table = warming(chain)
    number = chain.channels.index(LAG)
    some = table.iloc[20::7].reset_index(drop=True)
    recorded = temperatures_of([chain.channels], table)
    went_on = continued(chain, recorded, some, chain.columns(some))
    np.testing.assert_allclose(went_on[number], chain.columns(table)[number][20::7], rtol=1e-9)
    assert not list(started_anew(chain, recorded, some))


def test_what_differed_in_the_first_row_fades() -> None:
    """It is the solution of the lag's equation from another value; without the recording's clock nothing is left."""
    options = {"element": "column", "motion": "dy", "sensor": "T_bed", "tau": 1800.0, "initial": -2.0}
    chain = Chain(replace(read_machine("vertical_three_axis"), effects=(EffectSpec("structure-drift", options),)))
    whole = warming(chain)
    time, bed = whole["time"].to_numpy(), whole["T_bed"].to_numpy()
    steps, state = np.linspace(time[0], time[-1], 200_001), [bed[0] - 2.0]
    for warm in np.interp(steps[:-1], time, bed):
        state.append(state[-1] + (warm - state[-1]) * (steps[1] - steps[0]) / 1800)
    channels = dict(zip(chain.channels, chain.columns(whole), strict=True))
    got = channels[LAG] - 2.0 * channels["initial(T_bed,1800)"]
    np.testing.assert_allclose(got, np.interp(time, steps, state), atol=2e-3)
    first, later = whole.iloc[:40], whole.iloc[40:].reset_index(drop=True)
    number = chain.channels.index("initial(T_bed,1800)")
    history = temperatures_of([chain.channels], first)
    both = continued(chain, history, later, chain.columns(later))
    np.testing.assert_allclose(both[number], channels["initial(T_bed,1800)"][40:])
    cold = later.assign(time=later["time"] - 8000.0)
    assert not continued(chain, history, cold, chain.columns(cold))[number].any()


def test_a_gap_that_is_longer_than_the_lag_is_said(chain: Chain) -> None:
    table = warming(chain)
    first, later = table.iloc[:50], table.iloc[50:].reset_index(drop=True)
    recorded = temperatures_of([chain.channels], first)
    assert not list(after_gaps(chain, recorded, later))
    (note,) = after_gaps(chain, recorded, later.assign(time=later["time"] + 4 * 3600))
    assert "T_bed acts 30 min late" in note
    assert "h between the recording and the first row" in note


def test_of_long_recordings_few_times_are_kept(chain: Chain) -> None:
    table = warming(chain, 5000)
    number = chain.channels.index(LAG)
    recorded = temperatures_of([chain.channels], table)
    assert len(recorded["T_bed"][0]) == 200
    some = table.iloc[2000::90].reset_index(drop=True)
    went_on = continued(chain, recorded, some, chain.columns(some))
    np.testing.assert_allclose(went_on[number], chain.columns(table)[number][2000::90], atol=0.01)  # K


def begun_again(table: pd.DataFrame, rows: int) -> pd.DataFrame:
    """The rows from a number on in a file whose time begins as that of the first does."""
    after = np.arange(len(table)) >= rows
    time = table["time"] - np.where(after, table["time"][rows] - table["time"][0], 0.0)
    return table.assign(file=np.where(after, "q.csv", "p.csv"), time=time)


def test_files_on_one_clock_are_one_series(chain: Chain) -> None:
    """A laser's file after a tracker's, in any order, or a test file after that of the fit: heat goes on."""
    table = warming(chain)
    number = chain.channels.index(LAG)
    whole = chain.columns(table)[number]
    files = table.assign(file=np.repeat(["points.csv", "laser.csv"], [50, 30]))
    np.testing.assert_allclose(chain.columns(files)[number], whole, rtol=1e-12)
    order = np.r_[50:80, 0:50]
    turned = files.iloc[order].reset_index(drop=True)
    np.testing.assert_allclose(chain.columns(turned)[number], whole[order], rtol=1e-12)
    assert temperatures_of([chain.channels], files)


@pytest.mark.parametrize("case", ["earlier times", "one time", "clocks of their own", "recorded with clocks"])
def test_other_clocks_start_anew(chain: Chain, case: str) -> None:
    table = warming(chain)
    first, later = table.iloc[:50], table.iloc[50:].reset_index(drop=True)
    if case == "earlier times":
        later["time"] -= 6000
    elif case == "one time":
        later["time"] = 9000.0
    elif case == "clocks of their own":
        later = begun_again(later, 15)
    else:
        first = begun_again(first, 25)
    history = temperatures_of([chain.channels], first)
    assert bool(history) == (case != "recorded with clocks")
    anew = chain.columns(later)
    assert all(a is b for a, b in zip(continued(chain, history, later, anew), anew, strict=True))
    (note,) = started_anew(chain, history, later)
    assert note.startswith("T_bed acts late")


def test_a_station_that_was_moved_stays_where_it_was_moved_to() -> None:
    """Rows of a run that was not recorded are as the recording ended; of one that was, as it was in that."""
    shift = EffectSpec("station-shift", {"run": "b"})
    chain = Chain(replace(read_machine("vertical_three_axis"), effects=(shift,)))
    number = chain.channels.index("run(b)")
    points = random_points(chain.machine, 6, 1)

    def later(recorded: str, commands: str) -> tuple[list[float], list[str]]:
        runs = runs_of(chain, points.assign(run=list(recorded)))
        table = points.assign(run=list(commands or "a" * 6))
        table = with_runs(Survey(table, "shared", (), Plain(), Path(), labelled=bool(commands)))
        columns = in_last_run(chain, runs, table, chain.columns(table))
        return columns[number].tolist(), list(as_in_last_run(chain, runs, table))

    assert later("aaabbb", "abcdab") == ([0.0, 1.0, 1.0, 1.0, 0.0, 1.0], later("aaabbb", "abcdab")[1])
    assert "run c, d was not recorded" in later("aaabbb", "abcdab")[1][0]
    assert "in run b. Write" in later("aaabbb", "abcdab")[1][0]
    assert later("bbbaaa", "cccbbb")[0] == [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]  # moved back before the recording ended
    assert later("ababab", "cccccc")[0] == [1.0] * 6  # the last row counts
    assert not later("aaabbb", "bababa")[1]
    values, (note,) = later("aaabbb", "")  # no column run: all go on from the end
    assert values == [1.0] * 6
    assert note.startswith("the commands have no column run: what differs in run b is predicted as")
