"""A test file without a channel that the model depends on is judged without what depends on it, and that is said."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine, write_machine
from tests.helpers.commands import MILL, done, run
from tests.helpers.compensation import UM
from tests.helpers.surveys import measured, positions

DRIFT = 0.05  # mm


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mill with a play of 20 um and a tool that grows by 50 um with time; the test file has no times."""
    out = tmp_path_factory.mktemp("lacking")
    effects = (EffectSpec("warm-up", {"tau": 2000.0}), EffectSpec("backlash", {"joint": "X"}))
    machine = replace(read_machine(MILL), effects=effects)
    chain = Chain(machine)
    values = chain.vector({chain.effect_ids[0][0]: -DRIFT, chain.effect_ids[1][0]: 0.02})
    rng = np.random.default_rng(2)
    for name, rows, noise in (("fit", 160, 4), ("test", 60, 5)):
        points = pd.DataFrame({j.name: rng.uniform(*j.travel, rows) for j in machine.joints})
        points = points.assign(tool_x=0.0, tool_y=0.0, tool_z=-100.0, time=np.linspace(0, 9000, rows))
        points = points.assign(dir_X=rng.choice([-1, 1], rows))
        table = positions(measured(machine, values, seed=noise, noise=UM, points=points))
        table.drop(columns=["time"] if name == "test" else []).to_csv(out / f"{name}.csv", index=False)
    write_machine(machine, out / "machine.yaml")
    files = "files:\n  - {path: fit.csv, role: fit}\n  - {path: test.csv, role: test}\nframe: shared\n"
    (out / "survey.yaml").write_text(f"errormodel: 1\n{files}")
    return out


@pytest.mark.parametrize("command", [("fit",), ("fit", "--stream")])
def test_it_is_judged_without_the_effect(folder: Path, tmp_path: Path, command: tuple[str, ...]) -> None:
    done(*command, folder / "machine.yaml", folder / "survey.yaml", "--out", tmp_path / "f")
    fit = json.loads((tmp_path / "f/fit.json").read_text())
    (note,) = (n for n in fit["notes"] if "judged without" in n)
    assert note.startswith("test.csv has no time: it is judged without warm-up,")
    assert fit["fitted"]["rms_um"] < 3
    (test,) = fit["test"]
    assert 10 < test["fitted"]["rms_um"] < 60  # the growth is there, and the play is taken off all the same


def test_its_rows_get_no_values_that_nobody_recorded(folder: Path, tmp_path: Path) -> None:
    done("fit", folder / "machine.yaml", folder / "survey.yaml", "--out", tmp_path / "f")
    rows = pd.read_csv(tmp_path / "f/residuals.csv")
    assert rows.loc[rows["file"] == "test.csv", "time"].isna().all()


def test_a_gap_is_refused_as_before(folder: Path, tmp_path: Path) -> None:
    """One row without a time is a mistake, and no file of another kind."""
    table = pd.read_csv(folder / "fit.csv").head(60)
    table.loc[7, "time"] = np.nan
    table.to_csv(tmp_path / "test.csv", index=False)
    (tmp_path / "fit.csv").write_bytes((folder / "fit.csv").read_bytes())
    (tmp_path / "survey.yaml").write_bytes((folder / "survey.yaml").read_bytes())
    result = run("fit", folder / "machine.yaml", tmp_path / "survey.yaml", "--out", tmp_path / "f")
    assert result.code == 2
    assert "test.csv, row 8 (line 9), column time: no time" in result.err
