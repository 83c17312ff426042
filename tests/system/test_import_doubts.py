"""What a file does not prove is doubted where it is unlikely: copies, readings that are too good, one-sided lengths."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import InputError, read_machine, read_survey
from identification import import_survey
from tests.helpers.importing import MILL, points, poses, programme

TARGETS = np.arange(0.0, 400.1, 50.0)


def runs(seed: int = 3, scatter: float = 0.4) -> pd.DataFrame:
    """Five runs both ways, deviations in um with a digit behind the point."""
    rng = np.random.default_rng(seed)
    table = pd.DataFrame({"Target [mm]": TARGETS})
    for k in range(1, 6):
        for word, side in (("+", 0.0), ("-", 3.0)):
            table[f"Run {k} {word}"] = (0.02 * TARGETS + side + rng.normal(0, scatter, len(TARGETS))).round(1)
    return table


def noted(table: pd.DataFrame, folder: Path, unit: str = "um") -> str:
    table.to_csv(folder / "x.csv", index=False)
    result = import_survey(folder / "x.csv", MILL, joint="X", units={"deviation": unit})
    return "\n".join(result.notes)


def test_a_run_that_is_a_copy_is_named(tmp_path: Path) -> None:
    assert "repeats run" not in noted(runs(), tmp_path)
    copied = runs()
    copied["Run 4 +"] = copied["Run 3 +"]
    assert "run 4 + of X repeats run 3 + to the last digit in all 9 targets" in noted(copied, tmp_path)


def test_coarse_readings_may_repeat(tmp_path: Path) -> None:
    """Of a resolution of ten scatters all runs are alike."""
    coarse = runs(scatter=0.3)
    coarse[coarse.columns[1:]] = (coarse[coarse.columns[1:]] / 5).round() * 5
    assert "repeats run" not in noted(coarse, tmp_path)


def test_deviations_a_thousand_times_too_small_are_doubted(tmp_path: Path) -> None:
    small = runs()
    small[small.columns[1:]] *= 1e-3
    said = noted(small, tmp_path)
    assert said.count("no machine is so good") == 1
    assert re.search(r"Read in mm, not in um, they vary by 10\.?\d* um: .* --units deviation=mm", said)
    assert "so good" not in noted(runs(), tmp_path)


def test_readings_that_repeat_too_well_are_doubted_where_a_unit_is_their_cause(tmp_path: Path) -> None:
    """A wide range in a wrong unit: 300 um over 400 mm in mm, 0.3 um in um, which the best stage may have."""
    table = runs()
    table[table.columns[1:]] += 0.75 * TARGETS[:, None]
    small = table.copy()
    small[small.columns[1:]] *= 1e-3
    assert "repeat to 0.00051 um: no machine is so good" in noted(small, tmp_path)
    assert "so good" not in noted(table, tmp_path)
    quiet = runs(scatter=0.0) + 1e-6 * np.random.default_rng(0).normal(0, 1, (9, 11))
    quiet["Target [mm]"] = TARGETS
    assert "so good" not in noted(quiet, tmp_path)  # simulated without noise: no unit is the cause


@pytest.mark.parametrize(
    ("motion", "unit", "per_unit", "larger"),
    [("dx", "mm", 1e-3, "m"), ("dx", "um", 1.0, "mm"), ("eb", "rad", 1e-6, ""), ("eb", "urad", 1.0, "mrad")],
)
def test_a_table_of_a_survey_is_doubted_by_every_command(
    tmp_path: Path, motion: str, unit: str, per_unit: float, larger: str
) -> None:
    """Deviations of 20 um (urad) that repeat to 0.5, written in a unit, and a thousandth of them in it."""
    machine = read_machine(MILL)
    q = np.tile(TARGETS - 200, 4)
    size = (20 * np.sin(q / 100) + np.random.default_rng(5).normal(0, 0.5, len(q))) * per_unit
    for factor in (1.0, 1e-3):
        table = pd.DataFrame(
            {"joint": "X", "X": q, motion: factor * size, "run": np.repeat([1, 2, 3, 4], len(TARGETS))}
        )
        table.to_csv(tmp_path / "t.csv", index=False)
        (tmp_path / "survey.yaml").write_text(
            f"errormodel: 1\nfiles: [{{path: t.csv}}]\nunits: {{{motion}: {unit}}}\n", encoding="utf-8"
        )
        found = [note for note in read_survey(tmp_path, machine).notes if "so good" in note]
        assert len(found) == (factor < 1)
        if found and larger:
            assert f"write units: {{{motion}: {larger}}} in a survey.yaml" in found[0]


def test_points_a_thousand_times_too_near_are_doubted(tmp_path: Path) -> None:
    commands = poses(seed=2, rows=30)
    exact = commands.rename(columns=dict(zip("XYZ", ("mx", "my", "mz"), strict=True)))
    near = exact + np.random.default_rng(1).normal(0, 2e-5, exact.shape)
    pd.concat([commands, near], axis=1).to_csv(tmp_path / "t.csv", index=False)
    assert any("none is so good" in note for note in import_survey(tmp_path / "t.csv", MILL).notes)
    fair = pd.DataFrame(points(commands), columns=["mx", "my", "mz"])
    pd.concat([commands, fair], axis=1).to_csv(tmp_path / "t.csv", index=False)
    assert not any("none is so good" in note for note in import_survey(tmp_path / "t.csv", MILL).notes)


def test_clockwise_and_counter_clockwise_are_ways_of_a_rotary_axis(tmp_path: Path) -> None:
    angles = np.arange(0.0, 331.0, 30.0)
    rows = [
        (run, word, angle, 0.5 * k)
        for run in (1, 2, 3)
        for word, way in (("CW", angles), ("CCW", angles[::-1]))
        for k, angle in enumerate(way)
    ]
    table = pd.DataFrame(rows, columns=["Run", "Direction", "Target (deg)", "Error (arcsec)"])
    table.to_csv(tmp_path / "c.csv", index=False)
    result = import_survey(tmp_path / "c.csv", "trunnion_five_axis", joint="C")
    assert "'CW' taken as +" in result.summary()
    sides = result.survey.table.groupby(["run", "dir_C"], sort=False).size()
    assert [side for _, side in sides.index] == [1.0, -1.0] * 3
    both = table.assign(Direction=np.where(table["Target (deg)"] > 100, "CW", "CCW"))
    both.to_csv(tmp_path / "c.csv", index=False)
    with pytest.raises(InputError, match="as a direction"):
        import_survey(tmp_path / "c.csv", "trunnion_five_axis", joint="C")


def test_a_trace_whose_ways_are_one_is_named(tmp_path: Path) -> None:
    angle = np.arange(0.0, 360.0, 2.0)
    ways = {
        w: 3 * np.cos(np.radians(2 * angle)) + np.random.default_rng(k).normal(0, 0.2, 180) for k, w in enumerate("ab")
    }
    head = "Plane: XY\nRadius: 100 mm\n"
    for copied in (False, True):
        one = ways["a"]
        other = one if copied else ways["b"]
        lines = [f"{a:.1f};CCW;{d:.2f}" for a, d in zip(angle, one, strict=True)]
        lines += [f"{a:.1f};CW;{d:.2f}" for a, d in zip(angle[::-1], other[::-1], strict=True)]
        text = head + "Angle [deg];Direction;Deviation [um]\n" + "\n".join(lines)
        (tmp_path / "b.csv").write_text(text)
        result = import_survey(tmp_path / "b.csv", MILL, centre={"X": 0, "Y": 0, "Z": 300}, plane="XY", radius=100.0)
        assert any("is a copy of the other" in note for note in result.notes) == copied


def test_rows_outside_a_log_and_the_zero_of_a_programme_are_said(tmp_path: Path) -> None:
    commands = poses(seed=2, rows=20)
    (tmp_path / "p.nc").write_text(programme(commands).replace("G0 Z620", "G54 G0 Z620"))
    table = pd.DataFrame(points(commands), columns=["X [mm]", "Y [mm]", "Z [mm]"]).assign(
        **{"t [s]": np.arange(20) * 30.0}
    )
    table.to_csv(tmp_path / "t.csv", index=False)
    pd.DataFrame({"t [s]": np.arange(0, 331.0, 30.0), "T_bed": 20.0}).to_csv(tmp_path / "log.csv", index=False)
    result = import_survey(
        [tmp_path / "t.csv", tmp_path / "log.csv"], MILL, commands=tmp_path / "p.nc", offsets=["G54=X0,Y0,Z0"]
    )
    said = result.summary()
    assert "T_bed of 8 of 20 rows is not known" in said
    assert "the zero of the programme is taken as --offset states it" in said


@pytest.mark.parametrize(("more", "doubted"), [(0.0, False), (0.05, True)])
def test_lengths_that_are_all_too_long_are_said(more: float, doubted: bool, tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    first, second = poses(seed=2, rows=24).to_numpy(), poses(seed=3, rows=24).to_numpy()
    length = np.linalg.norm(first - second, axis=1) + rng.normal(0, 0.008, 24) + more
    names = [f"from_{a}" for a in "XYZ"] + [*"XYZ"]
    pd.DataFrame(np.column_stack([first, second]), columns=names).assign(length=length).to_csv(
        tmp_path / "bar.csv", index=False
    )
    said = import_survey(tmp_path / "bar.csv", MILL, observation="pose-distance").summary()
    assert ("nearly all of them too long" in said) == doubted


@pytest.mark.parametrize("word", ["perso", "Strahl unterbrochen", "beam broken", "perdu"])
def test_words_of_lost_readings_are_no_value(word: str, tmp_path: Path) -> None:
    commands = poses(seed=2, rows=20)
    seen = pd.DataFrame(points(commands).round(5), columns=["mx", "my", "mz"]).astype(object)
    seen.iloc[4] = word
    pd.concat([commands, seen], axis=1).to_csv(tmp_path / "t.csv", index=False)
    assert len(import_survey(tmp_path / "t.csv", MILL).survey) == 19
