"""Channels that are no input of tables: rows with values of their own, and means by position."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.controllers.base import Controller
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine
from identification.compensation.assessment import emulated
from identification.compensation.by_position import means_of
from identification.compensation.compensate import compensate
from identification.compensation.field import Field
from identification.compensation.rows import Rows, read_rows
from identification.compensation.volume import Volume, best_frame
from identification.estimation.fit import fit_machine
from identification.results.store import load, save
from tests.helpers.chains import Array, errors
from tests.helpers.commands import MILL, done
from tests.helpers.surveys import measured, positions, rms, survey

UM = 1e-3
YAW = 5e-3  # rad per mm by which the drives of X differ
pytestmark = pytest.mark.usefixtures("few_poses")
Made = tuple[Machine, Array, pd.DataFrame, Path]


def surveyed(machine: Machine, order: dict[str, str]) -> pd.DataFrame:
    """Rows at random, in the order of a joint or in none."""
    rng = np.random.default_rng(5)
    points = pd.DataFrame({j.name: rng.uniform(*j.travel, 150) for j in machine.joints})
    points = points.sort_values(order["by"], ignore_index=True) if order else points
    return points.assign(tool_x=0.0, tool_y=0.0, tool_z=-100.0)


def racked(folder: Path, record: Callable[[pd.DataFrame], Array]) -> Made:
    """A fit of a mill whose X yaws by a record of its drives, with the truth and the survey's rows."""
    plain = read_machine(MILL)
    machine = replace(
        plain, effects=(EffectSpec("gantry-racking", {"joint": "X", "channel": "w_sync_X", "along": False}),)
    )
    chain = Chain(machine)
    p = dict(zip(Chain(plain).ids, errors(Chain(plain), 3).tolist(), strict=True)) | {chain.effect_ids[0][0]: YAW}
    points = surveyed(machine, {})
    points["w_sync_X"] = record(points)
    table = positions(measured(machine, chain.vector(p), seed=4, noise=0.5 * UM, points=points))
    save(fit_machine(machine, survey(table)), folder)
    return machine, chain.vector(p), points, folder


def left_in_rows(made: Made) -> tuple[float, float]:
    """What the true machine has in the survey's rows with the tables of `csv`, and what is claimed, um rms."""
    machine, p, points, folder = made
    result = compensate(folder, "csv")
    assert isinstance(result.controller, Controller)
    fit = load(folder)
    table = read_rows(folder, fit.chain.machine)
    volume = Volume.of(Field.of(fit, table).following(table), table, True)
    correct = emulated(result.controller, result.usual.tables, result.setup, volume)
    names = [j.name for j in machine.joints]
    q = points[names].to_numpy()
    sent = points.copy()
    sent[names] = correct(q, np.ones_like(q), None)
    there = measured(machine, p, points=sent)[["mx", "my", "mz"]].to_numpy()
    wanted = measured(machine, np.zeros_like(p), points=points)[["mx", "my", "mz"]].to_numpy()
    frame = best_frame(there - wanted, wanted)
    return rms(there - frame.apply(wanted)), result.usual.figures[1].after.rms_um


def test_rows_are_judged_with_the_records_that_they_had(tmp_path: Path) -> None:
    """The tables hold a record at one value: rows without it would come out as if the machine had known theirs."""
    made = racked(tmp_path / "fit", lambda t: np.random.default_rng(1).uniform(-0.05, 0.05, len(t)))
    true, claimed = left_in_rows(made)
    assert true > 10
    assert claimed == pytest.approx(true, rel=0.05)
    out = done("compensate", tmp_path / "fit", "--controller", "csv", "--out", tmp_path / "o").out
    figure = json.loads((tmp_path / "o" / "compensation.json").read_text())["sets"][0]["figures"][1]
    assert figure["in_state"]["rms_um"] < 2
    assert f"the same, all in the state that the tables are for{figure['in_state']['rms_um']:11.2f}" in out


def by_position(table: pd.DataFrame) -> Array:
    """A record of the drives that mostly repeats along X, and drifts."""
    return np.asarray(0.05 * np.sin(table["X"] / 150) + np.linspace(-0.004, 0.004, len(table)))


def test_a_record_that_repeats_with_a_position_is_followed_by_it(tmp_path: Path) -> None:
    """Held at one value, racking that is a function of X would be left, which the tables of a plain fit follow."""
    made = racked(tmp_path / "fit", by_position)
    true, claimed = left_in_rows(made)
    assert true < 2
    assert claimed == pytest.approx(true, abs=1)
    done("compensate", tmp_path / "fit", "--controller", "csv", "--out", tmp_path / "o")
    written = json.loads((tmp_path / "o" / "compensation.json").read_text())
    (found,) = written["followed_by_position"]
    assert (found["channel"], found["joint"]) == ("w_sync_X", "X")
    assert found["predicted_share"] > 0.98
    assert found["beside"]["rms"] == pytest.approx(0.008 / np.sqrt(12), rel=0.2)
    (said,) = (step for step in written["checklist"] if "w_sync_X" in step)
    assert "these tables are for w_sync_X at its mean by the position of X (99." in said
    assert "more, zero and workpiece as they were" in said


@pytest.mark.parametrize(
    ("record", "order"),
    [
        (lambda t: np.random.default_rng(1).uniform(-0.05, 0.05, len(t)) + by_position(t) / 2, {}),  # mostly chance
        (lambda t: np.linspace(-0.05, 0.05, len(t)) + by_position(t) / 10, {}),  # mostly drift
        (by_position, {"by": "X"}),  # one way along X: as well a drift
        (lambda t: np.where(np.arange(len(t)) == 5, 0.05, 0.0), {}),
    ],
)
def test_another_record_is_held(record: Callable[[pd.DataFrame], Array], order: dict[str, str]) -> None:
    table = surveyed(read_machine(MILL), order)
    assert not means_of(table.assign(w_sync_X=record(table)), read_machine(MILL).joints, ["w_sync_X"])


def test_times_and_temperatures_are_held_whatever_the_order_of_the_survey() -> None:
    table = surveyed(read_machine(MILL), {})
    table = table.assign(time=table["X"] + 400, T_x=table["X"] / 100)
    assert not means_of(table, read_machine(MILL).joints, ["time", "T_x"])


def test_tables_for_a_state_are_judged_by_the_rows_nearest_to_it() -> None:
    n = 60
    warm = {"T_x": np.linspace(20.0, 26.0, n)}
    none = np.zeros((n, 3))
    rows = Rows(none, none, none, none, np.full(n, "", dtype=object), f"{n} rows left out", own=warm)
    states = [{"T_x": 20.0}, {"T_x": 23.0}, {"T_x": 26.0}]
    parts = [rows.nearest(state, states) for state in states]
    assert [len(part) for part in parts if part] == [15, 30, 15]
    assert parts[2] is not None
    assert parts[2].own["T_x"].min() > 24.5
    assert parts[2].what == "15 rows left out, nearest to this state"
    assert rows.nearest(states[0], states[:1]) is rows
    assert rows.nearest({"T_x": 50.0}, [*states, {"T_x": 50.0}]) is None  # no such rows
