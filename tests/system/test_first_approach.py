"""The side from which a joint came, where nothing states it: taken as the readings show it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from errormodel.approach import assumed_sides
from errormodel.machine_file import read_machine
from errormodel.simulation import random_points
from errormodel.survey import Survey
from identification.diagnosis.pipeline import diagnose
from tests.helpers.findings import known, made, survey_of

MILL = read_machine("vertical_three_axis")
PLAY_MM = 0.03


def table(**columns: object) -> pd.DataFrame:
    return pd.DataFrame({"file": "s.csv", "run": "1", **columns})


def test_the_rows_before_the_first_move_are_the_assumed_ones() -> None:
    at_rest = table(X=[1.0, 1.0, 2.0, 2.0, 1.0], Y=[5.0] * 5)
    assert assumed_sides(at_rest, "X").tolist() == [1, 1, 0, 0, 0]
    assert assumed_sides(at_rest, "Y").tolist() == [0] * 5  # without any move nothing depends on the side
    stated = at_rest.assign(dir_X=[1.0, np.nan, 1.0, 1.0, -1.0])
    assert assumed_sides(stated, "X").tolist() == [0, 1, 0, 0, 0]
    runs = table(X=[1.0, 2.0, 2.0, 3.0]).assign(run=["a", "a", "b", "b"])
    assert assumed_sides(runs, "X").tolist() == [1, 0, 2, 0]


def recorded(side: float) -> Survey:
    """A mill with play in X; it stood at its first X for 20 rows, and had come there from one `side`."""
    points = random_points(MILL, 150, 5)
    points.loc[:19, "X"] = points["X"][20] - 40.0  # its first move is upwards
    true = known(MILL, made("backlash", joint="X"))
    column = np.concatenate([[side] * 20, np.full(len(points) - 20, np.nan)])
    survey = survey_of(true, points.assign(dir_X=column), {"X.dx.backlash": PLAY_MM})
    return replace(survey, table=survey.table.drop(columns="dir_X"))


@pytest.mark.long
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_first_side_is_found_and_makes_no_finding(side: float) -> None:
    diagnosed = diagnose(MILL, recorded(side))
    found = [(f.effect, f.where) for f in diagnosed.diagnosis.findings]
    assert found == [("backlash", "X")]
    (amount,) = diagnosed.diagnosis.findings[0].parameters
    assert amount.value == pytest.approx(PLAY_MM, abs=4 * amount.std)
    said = [n for n in diagnosed.diagnosis.notes if "before its first move" in n]
    assert len(said) == (side < 0)
    if said:
        assert "rows 1, 2, 3" in said[0]
        assert "X is taken to have come with dir_X = -1" in said[0]


def diagonals(overrun: bool) -> Survey:
    """Body diagonals there and back, twice, each end read again before the way back; a mill with play in Y."""
    travel = {j.name: j.travel for j in MILL.joints}
    low, high = (np.array([t[k] for t in travel.values()]) * 0.9 for k in (0, 1))
    path, sides = [], []
    for ends in [(0, 0, 0), (0, 1, 0), (0, 0, 1), (0, 1, 1)] * 2:
        first, last = np.where(ends, high, low), np.where(ends, low, high)
        line = np.linspace(first, last, 15)
        path += [line, line[::-1]]
        sides += [np.tile(np.sign(last - first), (15, 1)), np.tile(np.sign(first - last), (15, 1))]
    points = pd.DataFrame(np.vstack(path), columns=list(travel)).assign(tool_x=0.0, tool_y=0.0, tool_z=0.0)
    if overrun:
        points["dir_Y"] = np.vstack(sides)[:, 1]
    survey = survey_of(known(MILL, made("backlash", joint="Y")), points, {"Y.dy.backlash": PLAY_MM / 2})
    return replace(survey, table=survey.table.drop(columns="dir_Y", errors="ignore"))


@pytest.mark.long
@pytest.mark.parametrize("overrun", [True, False])
def test_ends_of_lines_are_overrun_where_the_readings_show_it(overrun: bool) -> None:
    """With the sides of the rows' order the overrun one had a hysteresis, and a column that sags by 0.1 mm."""
    diagnosed = diagnose(MILL, diagonals(overrun))
    found = [(f.effect, f.where) for f in diagnosed.diagnosis.findings]
    assert found == [("backlash", "Y")]
    (amount,) = diagnosed.diagnosis.findings[0].parameters
    assert amount.value == pytest.approx(PLAY_MM / 2, abs=4 * amount.std)
    assert len([n for n in diagnosed.diagnosis.notes if "where a line begins" in n]) == overrun


def pilgrim(stated: bool, load: bool = False) -> Survey:
    """Lines of X and of Y, each target read twice: from both sides, of which X has play; or with a load and without."""
    across = [(-200.0, 150.0), (200.0, 150.0), (0.0, 350.0)]
    lines = [
        np.insert(np.tile(a, (13, 1)), axis, np.linspace(-240, 240, 13), axis=1) for a in across for axis in (0, 1)
    ]
    points = pd.DataFrame(np.vstack(lines).repeat(2, axis=0), columns=["X", "Y", "Z"])
    points = points.assign(tool_x=0.0, tool_y=0.0, tool_z=0.0)
    first, of_x = np.arange(len(points)) % 2 == 0, np.repeat([0, 1] * 3, 26) == 0
    points["dir_X"] = np.where(first & of_x, 1.0, -1.0)  # X comes to the lines of Y from its end
    survey = survey_of(known(MILL, made("backlash", joint="X")), points, {"X.dx.backlash": PLAY_MM / 2})
    table = survey.table if stated else survey.table.drop(columns="dir_X")
    return replace(survey, table=table.assign(load=np.where(first, 0.0, 50.0)) if load else table)


def test_readings_from_the_other_side_are_found_as_if_stated() -> None:
    """With the sides of the rows' order the play was read as a cyclic error of the screw."""
    found, stated = (diagnose(MILL, pilgrim(known)).diagnosis for known in (False, True))
    (own,), (true,) = found.findings, stated.findings
    assert (own.effect, own.where) == (true.effect, "X")
    assert own.parameters[0].value == pytest.approx(true.parameters[0].value, rel=1e-6)
    (said,) = [n for n in found.notes if "from the other side" in n]
    assert "rows 2, 4, 6, 8" in said


@pytest.mark.long
def test_readings_that_a_column_tells_apart_are_not_from_the_other_side() -> None:
    diagnosed = diagnose(MILL, pilgrim(stated=False, load=True))
    assert not [n for n in diagnosed.diagnosis.notes if "from the other side" in n]


@pytest.mark.long
@pytest.mark.parametrize("play", [True, False])
def test_a_column_of_one_value_is_doubted_where_the_readings_say_otherwise(play: bool) -> None:
    points = random_points(MILL, 150, 5)
    survey = survey_of(known(MILL, made("backlash", joint="X")), points, {"X.dx.backlash": PLAY_MM * play})
    diagnosed = diagnose(MILL, replace(survey, table=survey.table.assign(dir_X=1.0))).diagnosis
    assert [(f.effect, f.where) for f in diagnosed.findings] == ([("backlash", "X")] if play else [])
    assert len([n for n in diagnosed.notes if "dir_X has one value in all rows" in n]) == play
