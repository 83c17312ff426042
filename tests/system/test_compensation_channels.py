"""Channels that tables hold at one value: what rows with values of their own have with such tables."""

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


def racked(folder: Path, record: Callable[[pd.DataFrame], Array], **order: str) -> Made:
    """A fit of a mill whose X yaws by a record of its drives, with the truth and the survey's rows."""
    plain = read_machine(MILL)
    machine = replace(
        plain, effects=(EffectSpec("gantry-racking", {"joint": "X", "channel": "w_sync_X", "along": False}),)
    )
    chain, rng = Chain(machine), np.random.default_rng(5)
    p = dict(zip(Chain(plain).ids, errors(Chain(plain), 3).tolist(), strict=True)) | {chain.effect_ids[0][0]: YAW}
    points = pd.DataFrame({j.name: rng.uniform(*j.travel, 150) for j in machine.joints})
    points = points.sort_values(order["by"], ignore_index=True) if order else points
    points = points.assign(tool_x=0.0, tool_y=0.0, tool_z=-100.0)
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
    volume = Volume.of(Field.of(fit, table), table, True)
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
