"""Two drives of one axis: one joint, two columns, and their difference as what turns the beam."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.machine import EffectSpec
from errormodel.machine_file import machine_text, read_machine, resolve
from errormodel.survey import read_survey
from errormodel.yamlfile import parse
from identification.diagnosis.pipeline import diagnose
from tests.helpers.commands import XYZ, Done, done, run, write
from tests.helpers.diagnosed import empty_survey, showing

GANTRY = """\
errormodel: 1
chain:
  - {joint: Y, type: prismatic, axis: y, travel: [0, 1800], drives: [Y1, Y2], spacing: 1200}
  - {shape: beam, offset: [0, 0, 300]}
  - {joint: X, type: prismatic, axis: x, travel: [-500, 500]}
  - {shape: saddle}
  - {joint: Z, type: prismatic, axis: z, travel: [-300, 0]}
  - {shape: spindle, offset: [0, 0, -100]}
tool: [0, 0, -120]
"""
JOINT = GANTRY.splitlines()[2]
SERIES = GANTRY.replace(
    JOINT,
    "  - {joint: Y1, type: prismatic, axis: y, travel: [0, 1800]}\n  - {shape: rail}\n"
    "  - {joint: Y2, type: prismatic, axis: y, travel: [0, 1800]}",
)
RACKED = f"{GANTRY}effects: [{{effect: gantry-racking, joint: Y, channel: w_sync_Y}}]\n"
YAW = 8.2e-4  # rad/mm


@pytest.fixture(scope="module")
def gantry(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Machines, commands of both drives, and surveys: ``two.csv`` with both columns, ``one.csv`` with Y alone."""
    folder = tmp_path_factory.mktemp("gantry")
    for name, text in {"gantry": GANTRY, "series": SERIES, "racked": RACKED}.items():
        write(folder / f"{name}.yaml", text)
    rng = np.random.default_rng(0)
    y = rng.uniform(0, 1800, 160)
    skew = 0.03 * np.sin(y / 200) + rng.normal(0, 0.004, 160)
    commands = pd.DataFrame(
        {"Y1": y + skew / 2, "Y2": y - skew / 2, "X": rng.uniform(-500, 500, 160), "Z": rng.uniform(-300, 0, 160)}
    ).round(4)
    commands.to_csv(folder / "commands.csv", index=False)
    write(
        folder / "truth.yaml", f"parameters: {{Y.ec.gantry-racking: {YAW}}}\nframe: {{translation: [2500, 90, 40]}}\n"
    )
    given = ("--parameters", folder / "truth.yaml", "--noise", 0.002, "--out", folder / "s.csv")
    done("simulate", folder / "racked.yaml", folder / "commands.csv", *given)
    seen = pd.read_csv(folder / "s.csv")
    commands.join(seen[XYZ]).to_csv(folder / "two.csv", index=False)
    seen[["Y", "X", "Z", *XYZ]].to_csv(folder / "one.csv", index=False)
    return folder


def test_both_columns_are_one_position_and_a_channel(gantry: Path) -> None:
    table = read_survey(gantry / "two.csv", read_machine(gantry / "gantry.yaml")).table
    raw = pd.read_csv(gantry / "two.csv")
    np.testing.assert_allclose(table["Y"], (raw["Y1"] + raw["Y2"]) / 2, rtol=1e-15)
    np.testing.assert_allclose(table["w_sync_Y"], raw["Y1"] - raw["Y2"], rtol=1e-12)
    assert "Y1" not in table


def test_the_difference_turns_the_beam(gantry: Path, tmp_path: Path) -> None:
    done("fit", gantry / "racked.yaml", gantry / "two.csv", "--out", tmp_path / "fit")
    found = pd.read_csv(tmp_path / "fit" / "parameters.csv", index_col="id").loc["Y.ec.gantry-racking"]
    assert abs(found["value"] - YAW) < 4 * found["std"] < 0.3 * YAW
    assert "drives: [Y1, Y2], spacing: 1200" in (tmp_path / "fit" / "machine.yaml").read_text()
    done("predict", tmp_path / "fit", gantry / "commands.csv", "--out", tmp_path / "p.csv")
    gap = (pd.read_csv(tmp_path / "p.csv")[XYZ] - pd.read_csv(gantry / "two.csv")[XYZ]).to_numpy()
    assert np.sqrt((gap**2).mean()) < 0.0025


def test_diagnose_finds_the_racking(gantry: Path, tmp_path: Path) -> None:
    result = done("diagnose", gantry / "gantry.yaml", gantry / "two.csv", "--out", tmp_path / "out")
    assert "Gantry-racking of Y, driven by w_sync_Y" in result.out
    assert "channel: w_sync_Y" in (tmp_path / "out" / "machine.yaml").read_text()


def test_the_position_alone_will_do(gantry: Path, tmp_path: Path) -> None:
    done("fit", gantry / "gantry.yaml", gantry / "one.csv", "--out", tmp_path / "out")
    done("fit", gantry / "racked.yaml", gantry / "two.csv", "--out", tmp_path / "fit")
    commands = pd.read_csv(gantry / "one.csv")[["Y", "X", "Z"]]
    commands.to_csv(tmp_path / "c.csv", index=False)
    result = done("predict", tmp_path / "fit", tmp_path / "c.csv", "--out", tmp_path / "p.csv")
    assert "the drives Y1 and Y2 of Y are taken to be in step" in result.err


def test_a_column_of_its_own_is_the_position(gantry: Path, tmp_path: Path) -> None:
    table = pd.read_csv(gantry / "two.csv")
    table.assign(Y=table["Y1"].round(1)).to_csv(tmp_path / "s.csv", index=False)
    read = read_survey(tmp_path / "s.csv", read_machine(gantry / "gantry.yaml")).table
    np.testing.assert_array_equal(read["Y"], table["Y1"].round(1))
    np.testing.assert_allclose(read["w_sync_Y"], table["Y1"] - table["Y2"], rtol=1e-12)


def test_columns_of_other_names_and_units(gantry: Path, tmp_path: Path) -> None:
    table = pd.read_csv(gantry / "two.csv").rename(columns={"Y1": "Encoder left", "Y2": "Encoder right"})
    table = table.assign(**(table[["Encoder left", "Encoder right", "X", "Z", *XYZ]] / 25.4))
    table.to_csv(tmp_path / "s.csv", index=False)
    write(
        tmp_path / "s.yaml",
        "errormodel: 1\nfiles: [{path: s.csv}]\nunits: {length: inch}\n"
        'columns: {Y1: "Encoder left", Y2: "Encoder right"}\n',
    )
    machine = read_machine(gantry / "gantry.yaml")
    inches, mm = (read_survey(f, machine).table for f in (tmp_path / "s.yaml", gantry / "two.csv"))
    np.testing.assert_allclose(inches[["Y", "w_sync_Y"]], mm[["Y", "w_sync_Y"]], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("command", ["fit", "diagnose"])
def test_drives_in_series_are_refused(command: str, gantry: Path, tmp_path: Path) -> None:
    refused(run(command, gantry / "series.yaml", gantry / "two.csv", "--out", tmp_path / "out", "--quiet"))
    assert not (tmp_path / "out").exists()


def test_drives_in_series_are_refused_when_described(gantry: Path) -> None:
    refused(run("describe", gantry / "series.yaml", gantry / "two.csv", "--quiet"))


def refused(result: Done) -> None:
    assert result.code == 2
    for words in ("columns Y1 and Y2", "two drives of one axis", "joint: Y,", "drives: [Y1, Y2]", "w_sync_Y"):
        assert words in result.err


def test_commands_alone_do_not_tell(gantry: Path) -> None:
    result = done("describe", gantry / "series.yaml", gantry / "commands.csv")
    assert "if they are two drives of one axis: declare one joint" in result.err


def test_stages_of_a_telescope_may_go_together(gantry: Path, tmp_path: Path) -> None:
    """Both stages are commanded alike, and the tool goes as far as both: a chain in series."""
    commands = pd.read_csv(gantry / "commands.csv")
    commands.assign(Y2=commands["Y1"]).to_csv(tmp_path / "c.csv", index=False)
    done("simulate", gantry / "series.yaml", tmp_path / "c.csv", "--noise", 0.002, "--out", tmp_path / "s.csv")
    result = done("fit", gantry / "series.yaml", tmp_path / "s.csv", "--out", tmp_path / "out")
    assert "two drives" not in result.err


def test_a_machine_with_drives_reads_back_the_same(gantry: Path) -> None:
    machine = read_machine(gantry / "racked.yaml")
    again = resolve(parse(machine_text(machine), "machine.yaml"))
    assert again.elements == machine.elements
    assert machine.joints[0].drives == ("Y1", "Y2")
    assert machine.joints[0].spacing == 1200


WRONG = {
    "one drive": ("drives: [Y1, Y2]", "drives: [Y1]", ("line 3, key chain[1].drives", "such as [Y1, Y2]")),
    "the same": ("drives: [Y1, Y2]", "drives: [Y1, Y1]", ("chain[1].drives[2]", "already taken in line 3")),
    "a joint's name": ("drives: [Y1, Y2]", "drives: [Y1, X]", ("line 5, key chain[3].joint", "already taken")),
    "a column": ("drives: [Y1, Y2]", "drives: [mx, Y2]", ("chain[1].drives[1]", "a column of a survey")),
    "no drives": ("drives: [Y1, Y2], ", "", ("chain[1].spacing", "Write drives: [Y1, Y2]")),
    "no distance": ("spacing: 1200", "spacing: 0", ("chain[1].spacing", "above 0, such as 1200")),
    "rotary": ("type: prismatic, axis: y", "type: rotary, axis: y", ("chain[1].drives", "rotary joint Y")),
}


@pytest.mark.parametrize("kind", WRONG)
def test_a_wrong_entry(kind: str, tmp_path: Path) -> None:
    old, new, expected = WRONG[kind]
    result = run("describe", write(tmp_path / "m.yaml", GANTRY.replace(old, new)))
    assert result.code == 2
    for words in expected:
        assert words in result.err


def test_a_wrong_table(gantry: Path, tmp_path: Path) -> None:
    table = pd.read_csv(gantry / "two.csv")
    cases = {
        "Y1, and not Y2, of the drives of Y": table.drop(columns="Y2"),
        "no commanded position": table.assign(Y2=table["Y2"].where(table.index != 6)),
        "mm between the two drives of Y": table.assign(Y2=table["Y2"] + 40),
        "w_sync_Y beside Y1 and Y2": table.assign(w_sync_Y=0.0),
    }
    for words, wrong in cases.items():
        wrong.to_csv(tmp_path / "s.csv", index=False)
        result = run("fit", gantry / "gantry.yaml", tmp_path / "s.csv", "--out", tmp_path / "out", "--quiet")
        assert result.code == 2
        assert words in result.err


def test_drives_with_zeros_that_differ_are_refused(gantry: Path, tmp_path: Path) -> None:
    table = pd.read_csv(gantry / "two.csv")
    table["Y2"] += 5.0
    table.to_csv(tmp_path / "s.csv", index=False)
    refused = run("fit", gantry / "gantry.yaml", tmp_path / "s.csv", "--out", tmp_path / "out")
    assert refused.code == 2
    assert "Y1 lies -4.98" in refused.err
    assert "zeros that differ" in refused.err


def test_drives_a_millimetre_apart_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "m.yaml", GANTRY.replace("spacing: 1200", "spacing: 1.2"))
    refused = run("describe", path)
    assert refused.code == 2
    assert "spacing: 1.2 mm between two drives of an axis that travels 1800 mm" in refused.err


@pytest.mark.parametrize(("joint", "column"), [("X", "w_x2"), ("Y", "w_x1_x2"), ("Y", "w_m2_minus_m1")])
def test_encoders_of_two_drives_are_their_record(joint: str, column: str) -> None:
    """One of them by its joint's name, and two of one letter whatever joint they move."""
    machine = read_machine("gantry_crossbeam_ram")
    survey = empty_survey(machine, 260, 5, channels=False, grid=False)
    table = survey.table.assign(**{column: 0.03 * np.random.default_rng(2).normal(size=260)})
    racking = EffectSpec("gantry-racking", {"joint": joint, "channel": column, "motion": "ec"})
    shown = showing(replace(survey, table=table), machine, [(racking, [1e-3])], 0.004)
    (finding,) = diagnose(machine, shown).diagnosis.findings
    assert (finding.effect, finding.where, finding.driver) == ("gantry-racking", joint, [column])
