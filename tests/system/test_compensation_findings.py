"""What a diagnosis found and no table holds, and columns that it took with a change."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.estimation.fit import fit_machine
from identification.results.store import save
from tests.helpers.chains import errors
from tests.helpers.commands import MILL, done
from tests.helpers.surveys import measured, positions, survey

UM = 1e-3
pytestmark = pytest.mark.usefixtures("few_poses")


@pytest.fixture(scope="module")
def drifted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fit of a mill whose tracker drifts and whose tool grows, with X declared to have the wrong sign."""
    folder, plain = tmp_path_factory.mktemp("drifted"), read_machine(MILL)
    drift, growth = EffectSpec("tracker-drift", {"duration": 9000.0}), EffectSpec("warm-up", {"tau": 2000.0})
    blunder = EffectSpec("axis-blunder", {"column": "X", "factor": -1.0})
    machine = replace(plain, effects=(drift, growth))
    chain = Chain(machine)
    p = dict(zip(Chain(plain).ids, errors(Chain(plain), 3).tolist(), strict=True))
    p |= {chain.effect_ids[0][0]: 10 * UM, chain.effect_ids[1][0]: -20 * UM}
    rng = np.random.default_rng(0)
    points = pd.DataFrame({j.name: rng.uniform(*j.travel, 200) for j in machine.joints})
    points = points.assign(tool_x=0.0, tool_y=0.0, tool_z=-100.0, time=np.linspace(0, 9000, 200))
    table = positions(measured(machine, chain.vector(p), seed=4, noise=1 * UM, points=points))
    save(fit_machine(replace(machine, effects=(drift, growth, blunder)), survey(table)), folder / "fit")
    return folder / "fit"


def finding(effect: str, where: str, driver: list[str], ids: tuple[str, ...]) -> dict[str, object]:
    parameters = [{"name": i, "value": 0.0, "std": 0.0, "unit": "mm"} for i in ids]
    return {
        "effect": effect, "where": where, "probability": 0.86, "size_um": 7.6, "driver": driver,
        "parameters": parameters,
    }  # fmt: skip


def with_findings(fit: Path, found: list[dict[str, object]], folder: Path) -> Path:
    """A copy of a fit with a diagnosis that nobody sealed."""
    shutil.copytree(fit, folder)
    (folder / "manifest.json").unlink()
    (folder / "diagnosis.json").write_text(json.dumps({"schema": "errormodel.diagnosis/1", "findings": found}))
    return folder


def compensated(fit: Path, out: Path) -> tuple[dict[str, list[str]], str]:
    done("compensate", fit, "--controller", "csv", "--out", out)
    return json.loads((out / "compensation.json").read_text()), " ".join((out / "checklist.txt").read_text().split())


def test_findings_that_no_table_holds_are_named(drifted: Path, tmp_path: Path) -> None:
    chain = Chain(read_machine(drifted / "machine.yaml"))
    found = [
        finding("tracker-drift", "frame", ["time"], chain.effect_ids[0]),
        finding("warm-up", "tool", ["time"], chain.effect_ids[1]),
        finding("pitch-cyclic", "Y", ["Y"], (next(i for i in chain.ids if i.startswith("Y.")),)),
    ]
    data, text = compensated(with_findings(drifted, found, tmp_path / "d"), tmp_path / "o")
    assert [o["effect"] for o in data["not_in_tables"]] == ["tracker-drift", "warm-up"]  # type: ignore[index]
    assert "tracker-drift of frame, 0.86 likely, 7.6 um rms at the tip: it acts in the instrument" in text
    assert "if it is the machine's, this is left" in text
    assert "warm-up of tool, 0.86 likely, 7.6 um rms at the tip: it changes with time, which no table" in text
    assert "pitch-cyclic" not in text


def test_a_column_with_a_change_comes_first(drifted: Path, tmp_path: Path) -> None:
    """One that the user declared is said; one of a diagnosis is to be confirmed before the tables are loaded."""
    declared = compensated(drifted, tmp_path / "declared")[0]["first"][0]
    assert declared.startswith("FIRST: the survey was taken with a change: the sign of column X is wrong")
    found = [finding("axis-blunder", "X", ["X"], ())]
    first = compensated(with_findings(drifted, found, tmp_path / "d"), tmp_path / "diagnosed")[0]["first"][0]
    assert first.startswith("DO NOT LOAD THESE TABLES: the survey was taken with a change: the sign of column X")
    assert "they double the squareness" in first


def test_a_folder_without_a_manifest_is_said_to_be_unchecked(drifted: Path, tmp_path: Path) -> None:
    shutil.copytree(drifted, tmp_path / "fit")
    (tmp_path / "fit" / "manifest.json").unlink()
    notes = compensated(tmp_path / "fit", tmp_path / "o")[0]["notes"]
    assert notes[0].startswith("fit holds no manifest.json")
    assert "manifest" not in " ".join(compensated(drifted, tmp_path / "whole")[0]["notes"])
