"""A calibrated ball plate that was probed forth and back in several placements, through the commands."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest

from tests.helpers.ball_plate import plate
from tests.helpers.commands import done, run, write
from tests.helpers.importing import MILL

SURVEY = "errormodel: 1\nfiles: [{path: plate.csv}]\nframe: per-run\n"
PLACES = [(20.0, 20.0, 30.0), (320.0, 150.0, 250.0), (60.0, 220.0, 400.0)]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    parts = [plate(k, run=f"plate{k}", time=3600.0 * k, at=PLACES[k]) for k in range(3)]
    pd.concat(parts).to_csv(tmp_path / "plate.csv", index=False)
    write(tmp_path / "s.yaml", SURVEY)
    return tmp_path


def test_a_plate_probed_forth_and_back_is_taken_whole(folder: Path) -> None:
    for command in ("check", "fit"):
        out = () if command == "check" else ("--out", folder / command)
        result = done(command, MILL, folder / "s.yaml", *out)
        assert "150 rows read 75 places again" in result.out + result.err
    assert json.loads((folder / "fit" / "fit.json").read_text())["fitted"]["n"] == 150


def test_copies_in_a_plate_are_named_with_the_command_that_leaves_them_out(folder: Path) -> None:
    table = pd.read_csv(folder / "plate.csv")
    pd.concat([table, table.iloc[100:110]]).to_csv(folder / "plate.csv", index=False)
    refused = run("check", MILL, folder / "s.yaml")
    assert refused.code == 2
    assert "10 of 160 rows repeat what earlier rows measured" in refused.err
    assert "`errormodel import` --leave-out 151-160" in refused.err
    found = done("diagnose", MILL, folder / "s.yaml", "--out", folder / "d")
    assert "This is said without 10 rows left out." in found.out


def test_a_plate_that_was_moved_needs_frames(folder: Path) -> None:
    refused = run("check", MILL, folder / "plate.csv")
    assert refused.code == 2
    assert "frame: per-run" in refused.err
