"""A ball on a rotary table that a probe centres: commands are the indicated axes, measured is always its place."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd

from tests.helpers.commands import XYZ, run
from tests.system.test_r_test import MILL, r_test

# errors of the linear axes too: a machine that does not move at all fits the place of one ball
WITH_SCALES = MILL.replace("joints: none", "joints: {Y: first-order, X: first-order, Z: first-order}")
BALL = (50.0, 20.0, 100.0)


def probed() -> pd.DataFrame:
    """The R-test's rows as a probe gives them: the axes move by what the tip stood off, to first order in errors."""
    table = r_test([BALL], rows=90)
    for k, (c, a) in enumerate(np.radians(table[["C", "A"]].to_numpy())):
        about_z = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
        about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
        off = table.loc[k, XYZ].to_numpy(dtype=float) - BALL
        table.loc[k, ["X", "Y", "Z"]] -= (about_z @ about_x).T @ off
    table[XYZ] = BALL
    return table


def test_a_probed_ball_is_fitted_as_an_r_test_is(tmp_path: Path) -> None:
    (tmp_path / "mill.yaml").write_text(WITH_SCALES)
    found = {}
    for name, table in (("r-test", r_test([BALL], rows=90)), ("probed", probed())):
        table.to_csv(tmp_path / "data.csv", index=False)
        result = run("fit", tmp_path / "mill.yaml", tmp_path / "data.csv", "--out", tmp_path / name)
        assert result.code == 0, result.err
        assert "ran away" not in result.err
        assert "invalid value" not in result.err
        fit = json.loads((tmp_path / name / "fit.json").read_text())
        found[name] = {p["id"]: (p["value"], p["std"]) for p in fit["parameters"]}
        assert abs(fit["sigma_um"] - 1) < 0.25
    assert {*found["probed"]} == {*found["r-test"]}
    for identity, (value, std) in found["probed"].items():
        assert abs(value - found["r-test"][identity][0]) < std, identity


def test_tables_of_readings_without_a_proved_sign_say_so_first(tmp_path: Path) -> None:
    """Commands are nominal, and the deviation of the indicated axes was added to the ball's place: the wrong sign."""
    table = r_test([BALL], rows=90)
    table[XYZ] = 2 * np.array(BALL) - table[XYZ]
    (tmp_path / "mill.yaml").write_text(WITH_SCALES)
    table.to_csv(tmp_path / "data.csv", index=False)
    run("fit", tmp_path / "mill.yaml", tmp_path / "data.csv", "--out", tmp_path / "fit")
    assert json.loads((tmp_path / "fit" / "fit.json").read_text())["open_signs"]
    result = run("compensate", tmp_path / "fit", "--controller", "csv", "--out", tmp_path / "tables")
    assert result.code == 0, result.err
    first = (tmp_path / "tables" / "checklist.txt").read_text().split("FIRST: ")[1]
    assert first.startswith("the sign of all corrections is that of the readings, which nothing proves")


def test_a_place_that_does_not_change_has_no_sign(tmp_path: Path) -> None:
    (tmp_path / "mill.yaml").write_text(WITH_SCALES)
    probed().to_csv(tmp_path / "data.csv", index=False)
    result = run("fit", tmp_path / "mill.yaml", tmp_path / "data.csv", "--out", tmp_path / "fit")
    assert "signs" not in result.err
    assert "open_signs" not in json.loads((tmp_path / "fit" / "fit.json").read_text())
