"""Reversal errors in what `compensate` writes and prints, and on paths whose strokes are short."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.channels import channel
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.compensation.compensate import compensate
from identification.compensation.field import Field
from identification.compensation.rows import held_out, read_rows, taken_up
from identification.estimation.fit import fit_machine
from identification.results.store import load, save
from tests.helpers.chains import errors
from tests.helpers.commands import MILL, done
from tests.helpers.surveys import measured, positions, survey

UM = 1e-3
WIDTH = 60.0  # mm
pytestmark = pytest.mark.usefixtures("few_poses")


@pytest.fixture(scope="module")
def yawing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fit of a mill whose X yaws by 60 urad on reversal, within 60 mm; half of the survey's strokes are shorter."""
    folder, plain = tmp_path_factory.mktemp("yawing") / "fit", read_machine(MILL)
    machine = replace(plain, effects=(EffectSpec("hysteresis", {"joint": "X", "width": WIDTH, "motion": "ec"}),))
    chain = Chain(machine)
    p = dict(zip(Chain(plain).ids, errors(Chain(plain), 3).tolist(), strict=True)) | {chain.effect_ids[0][0]: 60e-6}
    rng = np.random.default_rng(0)
    points = pd.DataFrame({j.name: rng.uniform(*j.travel, 240) for j in machine.joints})
    low, high = next(j.travel for j in machine.joints if j.name == "X")
    points = points.assign(tool_x=0.0, tool_y=0.0, tool_z=-100.0)
    middle = rng.uniform(low + 60, high - 60, 120)
    points["X"] = np.column_stack([middle, middle + rng.choice([-8.0, 8.0], 120)]).ravel()
    table = positions(measured(machine, chain.vector(p), seed=4, noise=0.3 * UM, points=points))
    save(fit_machine(machine, survey(table)), folder)
    return folder


@pytest.mark.parametrize("name", ["siemens-cec", "heidenhain", "csv"])
def test_a_hysteresis_is_printed_and_stands_in_both_files(yawing: Path, tmp_path: Path, name: str) -> None:
    out = done("compensate", yawing, "--controller", name, "--out", tmp_path / "o").out
    data = json.loads((tmp_path / "o" / "compensation.json").read_text())
    (entry,) = data["not_in_tables"]
    assert (entry["effect"], entry["where"], entry["probability"]) == ("hysteresis", "X", None)
    (said,) = data["reversals"]
    assert said["held"] == "none"
    assert said["width"] == WIDTH
    assert said["left_um"] == pytest.approx(entry["size_um"], rel=1e-3)
    assert said["peak_to_peak"]["ec"] == pytest.approx(60e-6, rel=0.1)
    assert not any(t["direction"] for s in data["sets"] for t in s["tables"])
    for text in (out, (tmp_path / "o" / "checklist.txt").read_text()):
        words = " ".join(text.split())
        assert "turn of X about z (ECX), " in words
        assert "(hysteresis within 60 mm)" in words
        assert "not in these tables, which hold the mean of both directions" in words
    figure = data["sets"][0]["figures"][0]  # of poses after long strokes, of which no such table takes this away
    assert figure["after"]["rms_um"] > 0.9 * said["left_um"]


def test_rows_that_no_fit_saw_are_judged_with_the_path_that_they_were_reached_by(yawing: Path) -> None:
    """As the fit saw them: by the direction alone, rows after short strokes would be on the wrong side."""
    fit = load(yawing)
    table = read_rows(yawing, fit.chain.machine)
    held, field = held_out(fit, table), Field.of(fit, table)
    assert held is not None
    assert len(held) == len(table)
    plays = [field.rows(held.q, d)[-1] for d in (held.direction, held.direction[:, : len(field.joints)])]
    assert field.chain.channels[-1].startswith("play(X,")
    wanted = channel(table, field.chain.channels[-1])
    np.testing.assert_allclose(plays[0], wanted, atol=1e-9)
    assert np.mean(np.abs(plays[1] - wanted) > WIDTH / 4) > 0.2


def test_a_table_of_commands_follows_the_strokes_of_its_rows(yawing: Path, tmp_path: Path) -> None:
    """One and the same place is commanded otherwise after a long stroke, after one of 10 mm and from the other side."""
    fit = load(yawing)
    ends = {j.name: j.travel for j in fit.chain.machine.joints}
    x = ends["X"][0] + np.array([50.0, 350.0, 360.0, 350.0, 450.0, 350.0])
    rows = pd.DataFrame({n: np.full(6, high) for n, (_, high) in ends.items()}).assign(X=x)
    np.testing.assert_allclose(taken_up(fit.chain, rows)[[1, 3, 5], 0], [1.0, 1 - 2 * 10 / WIDTH, -1.0], atol=1e-9)
    rows.to_csv(tmp_path / "rows.csv", index=False)
    result = compensate(yawing, "gcode", program=tmp_path / "rows.csv")
    moved = (pd.read_csv(io.StringIO(result.usual.files["rows.csv"])) - rows)["X"].to_numpy()
    assert abs(moved[5] - moved[1]) > 3 * UM
    assert (moved[3] - moved[1]) / (moved[5] - moved[1]) == pytest.approx(10 / WIDTH, abs=0.05)
    (said,) = result.reversals
    assert said.held == "all"
    assert "follow how far each row is from the reversal before" in said.why


def test_a_programme_gets_the_mean(yawing: Path, tmp_path: Path) -> None:
    (tmp_path / "p.ngc").write_bytes(b"G21 G90 G17\nG0 X0 Y0 Z300\nG1 X20 Y10 F500\nG1 X15\nM2\n")
    command = ("compensate", yawing, "--controller", "gcode", "--dialect", "iso", "--at", "start=X0,Y0,Z300")
    done(*command, "--program", tmp_path / "p.ngc", "--out", tmp_path / "o")
    (said,) = json.loads((tmp_path / "o" / "compensation.json").read_text())["reversals"]
    assert said["held"] == "none"
    assert "not in these commands, which hold the mean" in said["why"]
