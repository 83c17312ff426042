"""A station of lengths that was moved on the way is found and named: from which row on, how far, and what to write."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import InputError, read_machine
from errormodel.chain import Chain
from errormodel.survey import Survey
from identification import import_survey
from identification.diagnosis.data_checks.gate import passed
from identification.diagnosis.data_checks.moved_stations import moved_stations
from identification.estimation.fit import fit_machine
from identification.importing.check import check_lines, check_survey
from identification.observation.assembly import build
from tests.benchmarks.length_coverage import NOISE, STATIONS
from tests.helpers.lengths import commands, entry, survey, tips, truth

MACHINE = read_machine("vertical_three_axis")
ROWS, FIRST = 60, 25
MORE = 100  # rows that show what errors of the machine might follow


def moved(
    shift: float, backlash: float = 0.0, layers: bool = False, dead_path: str = "unknown", rows: int = ROWS
) -> Survey:
    """Lengths from A and B; B was moved by `shift` (mm) before reading 26."""
    rng = np.random.default_rng(3)
    at = commands(MACHINE, rows, rng)
    at = at.sort_values("Z", ignore_index=True) if layers else at
    actual = tips(MACHINE, truth(MACHINE, rng), at)
    actual[:, 0] += backlash / 2 * np.sign(np.append(1, np.diff(at["X"])))
    parts = []
    for label, way in (("A", 0.0), ("B", shift)):
        place = STATIONS[label] + way * np.outer(np.arange(rows) >= FIRST, [0.48, -0.6, 0.64])
        length = np.linalg.norm(actual - place, axis=1) - 50.0 + rng.normal(0, NOISE, rows)
        parts.append(at.assign(observation=label, length=length, run=1 + (np.arange(rows) >= FIRST)))
    entries = {k: entry(type="station-distance", dead_path=dead_path) for k in "AB"}
    return survey(MACHINE, pd.concat(parts, ignore_index=True), entries)


@pytest.mark.parametrize("shift", [1.0, 20.0, 400.0])
def test_a_station_that_was_moved_is_refused_with_its_row_and_how_far(shift: float) -> None:
    """Where no one place fits any more, where one does badly, and where the machine's errors would follow."""
    with pytest.raises(InputError, match=r"observation B: lengths of a station that was moved") as error:
        build(Chain(MACHINE), moved(shift))
    words = str(error.value)
    assert f"from reading {FIRST + 1} of {ROWS} on" in words
    said = float(words.split("fit a place ")[1].split(maxsplit=1)[0])
    assert said == pytest.approx(shift, rel=0.2)
    assert "station: per-run" in words


def test_a_station_that_other_runs_have_elsewhere_is_refused() -> None:
    """Runs that share a station have a dead path each, which would take the move for a counter."""
    with pytest.raises(InputError, match=r"where the file or the other rows put the station, but from 1\..* mm"):
        build(Chain(MACHINE), moved(1.2, dead_path="per-run"))


def test_a_small_move_is_said_by_check_and_fit() -> None:
    data = moved(0.05, rows=MORE)
    words = f"B: from row {MORE + FIRST + 1} of a.csv on the lengths fit a place about"
    assert any(line.startswith(words) for line in check_lines(check_survey(MACHINE, data)))
    assert any(note.startswith(words) for note in passed(MACHINE, data, lambda: fit_machine(MACHINE, data)).notes)


@pytest.mark.parametrize("layers", [False, True])
def test_errors_of_a_machine_move_no_station(layers: bool) -> None:
    data = moved(0.0, backlash=0.02, layers=layers, rows=MORE)
    assert not [*moved_stations(data, build(Chain(MACHINE), data).views)]


def test_an_import_says_what_to_write(tmp_path: Path) -> None:
    """It takes the file in, since the order is right; the run is a column of the pairs, no edit of the raw file."""
    table = moved(5.0).table.query("observation == 'B'")
    table[["X", "Y", "Z"]].to_csv(tmp_path / "plan.csv", index=False)
    (tmp_path / "B.txt").write_text("Length [mm]\n" + "".join(f"{v:.5f}\n" for v in table["length"]))
    said = import_survey(
        tmp_path / "B.txt", "vertical_three_axis", commands=tmp_path / "plan.csv", observation="station-distance"
    ).summary()
    assert re.search(rf"from reading {FIRST + 1} of {ROWS} on they fit a place (4\.9|5|5\.0)\d* mm", said)
    assert "(a column run of pairs.csv)" in said
