"""ISO 230-1 from readings of straightness and angles along a line: figures by hand, signs, what shows no squareness."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import read_machine
from errormodel.exceptions import InputError
from errormodel.machine import Joint, Machine
from errormodel.observations.base import Observation
from identification import iso
from identification.iso_standards.base import Quantity
from tests.helpers.lengths import entry, survey

MILL = read_machine("vertical_three_axis")
AT = np.array([-200.0, -100.0, 0.0, 100.0, 200.0])
UM = 1e-3
X_ACROSS = UM * np.array([0.0, 1.0, 3.0, 2.0, -1.0])  # in y: least squares 1 - 1e-6 x, left over -1.2 to 2.0 um
Y_ACROSS = UM * np.array([-1.0, -0.5, 0.0, 0.5, 1.0])  # in x: a straight line, 5e-6
STATED = 12e-6  # slope of the reference line along y towards x


def rows(name: str, joint: str, values: np.ndarray, column: str = "length", **others: float) -> pd.DataFrame:
    still = {"X": 0.0, "Y": 0.0, "Z": 300.0} | others
    return pd.DataFrame({**still, "observation": name, "run": "1", joint: AT, column: values})


def lines(sign: float = 1.0, **more: object) -> tuple[pd.DataFrame, dict[str, Observation]]:
    """X in y and z, Y in x, as read; `sign`: of the displacements in x that count positive."""
    table = pd.concat([
        rows("x_in_y", "X", 7.0 + X_ACROSS), rows("x_in_z", "X", 2e-4 * AT), rows("y_in_x", "Y", 3.0 + sign * Y_ACROSS),
        rows("angle", "X", 1e-5 * np.array([0.0, 1.0, -2.0, 4.0, 3.0]), "angle"),
    ], ignore_index=True)  # fmt: skip
    entries = {
        "x_in_y": entry(type="line-straightness", along=[1, 0, 0], across=[0, 1, 0], slope=0.0, **more),
        "x_in_z": entry(type="line-straightness", along=[1, 0, 0], across=[0, 0, 1], **more),
        "y_in_x": entry(type="line-straightness", along=[0, 1, 0], across=[sign, 0, 0], slope=sign * STATED, **more),
        "angle": entry(type="line-angle", axis=[0, -1, 0]),
    }
    return table, entries


def figures(machine: Machine, table: pd.DataFrame, entries: dict[str, Observation]) -> dict[str, Quantity]:
    result = iso("230-1", machine, replace(survey(machine, table, entries), source=Path("s")))
    return {q.symbol: q for q in result.evaluations[0].quantities}


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_straightness_and_squareness_by_hand(sign: float) -> None:
    found = figures(MILL, *lines(sign))
    assert found["EYX"].value == pytest.approx(3.8 * UM)
    assert found["EYX end points"].value == pytest.approx(3.5 * UM)  # 3.0 + 0.5 above the line from 0 to -1
    assert found["EYX minimum zone"].value == pytest.approx(3.5 * UM)  # along the edge below: from 0 to -1
    assert found["EZX"].value == pytest.approx(0.0, abs=1e-9)  # the slope of a line that was set up is none of it
    assert found["EXY"].value == pytest.approx(0.0, abs=1e-9)
    assert found["EBX"].value == pytest.approx(6e-5)
    # about z: X by -1 urad, Y by -(5 + 12) urad
    assert found["EC(0X)Y"].value == pytest.approx(-16e-6)
    assert "EB(0X)Z" not in found


def test_uncertainty_of_a_squareness_is_that_of_two_slopes() -> None:
    found = figures(MILL, *lines(sigma=[5e-4, 0.0]))["EC(0X)Y"]
    slope = 5e-4 / np.sqrt(np.sum(AT**2))
    assert found.expanded == pytest.approx(2 * np.sqrt(2) * slope, rel=0.15)  # by 400 draws


def test_lines_of_slopes_of_their_own_show_no_squareness() -> None:
    table, entries = lines()
    entries["x_in_y"] = entry(type="line-straightness", along=[1, 0, 0], across=[0, 1, 0])
    assert not [s for s in figures(MILL, table, entries) if "(0" in s]


def test_two_joints_along_one_reference_line_are_parallel_by_their_slopes() -> None:
    z, w = (Joint(n, "prismatic", (0.0, 0.0, 1.0), (-300.0, 300.0)) for n in ("Z", "W"))
    machine = Machine("spindle head and quill", (z, w))
    both = [rows("line", "Z", 20e-6 * AT + X_ACROSS, W=0.0), rows("line", "W", 50e-6 * AT, Z=0.0)]
    table = pd.concat(both, ignore_index=True).drop(columns=["X", "Y"])
    table["run"] = ["1"] * 5 + ["2"] * 5
    along = {"along": [0, 0, 1], "across": [1, 0, 0]}
    found = figures(machine, table, {"line": entry(type="line-straightness", slope="unknown", **along)})
    (symbol,) = (s for s in found if "(0" in s)
    assert symbol in ("EB(0W)Z", "EB(0Z)W")
    apart = (20e-6 - 1e-6) - 50e-6  # of Z against W, about y: towards x along z
    assert found[symbol].value == pytest.approx(apart if symbol == "EB(0W)Z" else -apart)
    assert found[symbol].words.startswith("parallelism")


def test_readings_along_a_line_that_is_not_the_joints_own_are_asked_for() -> None:
    table, _ = lines()
    table = table[table["observation"] == "x_in_y"]
    across = entry(type="line-straightness", along=[0, 0, 1], across=[0, 1, 0])
    with pytest.raises(InputError, match="observations of straightness"):
        figures(MILL, table, {"x_in_y": across})
