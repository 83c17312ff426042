"""Stations in one file, and units that a file states wrongly: what is taken in is right, or refused with what fits."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import InputError
from errormodel.machine_file import read_machine
from errormodel.simulation import measured_at, outward, random_points
from errormodel.truth import Truth
from identification import import_survey
from identification.importing.check import check_lines, check_survey
from identification.importing.dwells import find_dwells
from tests.helpers.importing import MILL, NOISE, points, poses

COMMANDS = poses(rows=30)


def named(measured: np.ndarray) -> pd.DataFrame:
    table = pd.DataFrame(measured.round(6), columns=["X [mm]", "Y [mm]", "Z [mm]"])
    table.insert(0, "Name", [f"P{k}" for k in range(1, len(measured) + 1)])
    return table


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    table = COMMANDS.copy()
    table.insert(0, "Name", [f"P{k}" for k in range(1, len(table) + 1)])
    table.to_csv(tmp_path / "plan.csv", index=False)
    return tmp_path / "plan.csv"


def test_two_stations_one_below_the_other_in_a_file_are_no_two_dwells(plan: Path, tmp_path: Path) -> None:
    """The step from one station to the next is far longer than those between points: these are no noise."""
    second = points(COMMANDS, seed=4, translation=(-9000.0, 14000.0, 200.0), rotation=(0.0, 0.0, -100.0))
    table = pd.concat([named(points(COMMANDS)).assign(Station="S1"), named(second).assign(Station="S2")])
    table.to_csv(tmp_path / "both.csv", index=False)
    result = import_survey(tmp_path / "both.csv", MILL, commands=plan)
    assert len(result.imported.survey.table) == 2 * len(COMMANDS)
    assert result.imported.frame == "per-run"
    assert result.imported.proof.rms_um < 20  # errors of 20 um/m over half a metre, and the noise


def test_readings_at_places_far_apart_are_no_dwells() -> None:
    rng = np.random.default_rng(2)
    apart = np.repeat([[0.0, 0, 0], [5000.0, 0, 0]], 40, axis=0)
    assert find_dwells(apart + rng.uniform(-200, 200, apart.shape)) is None
    found = find_dwells(apart + rng.normal(0, NOISE, apart.shape))
    assert found is not None
    assert len(found) == 2


def test_a_unit_that_the_file_states_wrongly_is_named(plan: Path, tmp_path: Path) -> None:
    """Millimetres under a row of units that says metres: the cure is the unit of the numbers, not of what came out."""
    table = named(points(COMMANDS))
    table.columns = pd.Index(["Name", "X", "Y", "Z"])
    table = pd.concat([pd.DataFrame([["", "m", "m", "m"]], columns=table.columns), table])
    table.to_csv(tmp_path / "wrong.csv", index=False, sep=";")
    with pytest.raises(InputError) as error:
        import_survey(tmp_path / "wrong.csv", MILL, commands=plan)
    assert "--units mx=mm,my=mm,mz=mm" in error.value.cure
    right = import_survey(tmp_path / "wrong.csv", MILL, commands=plan, units={"mx": "mm", "my": "mm", "mz": "mm"})
    assert right.imported.proof.rms_um < 20


@pytest.mark.parametrize(("aside", "placed"), [(0.0, False), (30.0, True)])
def test_errors_of_location_are_not_laid_to_the_target(tmp_path: Path, aside: float, placed: bool) -> None:
    """Axes 50 um beside their places would be gone with a target of its own, and with them half the machine's error."""
    machine = read_machine("trunnion_five_axis")
    commands = random_points(machine, 60, 3)
    commands[["tool_x", "tool_y", "tool_z"]] = np.add(machine.tool, [0, 0, aside])
    measured = measured_at(machine, commands, Truth({"head.dx": 0.05}), NOISE)[["mx", "my", "mz"]].to_numpy()
    told = outward(commands, machine)[[j.name for j in machine.joints]]
    names = [f"P{k}" for k in range(1, len(told) + 1)]
    told.assign(point=names).to_csv(tmp_path / "plan.csv", index=False)
    named(measured).to_csv(tmp_path / "measured.csv", index=False)
    result = import_survey(tmp_path / "measured.csv", "trunnion_five_axis", commands=tmp_path / "plan.csv")
    result.save(tmp_path / "s")
    assert ("targets" in (tmp_path / "s/survey.yaml").read_text()) == placed


def test_an_offset_of_a_programme_that_the_target_would_hide_is_refused(tmp_path: Path) -> None:
    """Where joints turn, a target of its own takes up a wrong work offset: nothing measured shows which it is."""
    machine = read_machine("trunnion_five_axis")
    commands = random_points(machine, 40, 3)
    told = outward(commands, machine)
    blocks = " ".join
    lines = [
        f"G1 {blocks(f'{j.name}{told[j.name].iloc[k]:.3f}' for j in machine.joints)} F2000\nG4 P3" for k in range(40)
    ]
    (tmp_path / "a.nc").write_text("G21 G90 G94 G54\n" + "\n".join(lines) + "\nM30\n")
    rounded = commands.assign(**{j.name: told[j.name].round(3) for j in machine.joints})
    for j in machine.joints:
        if j.type == "rotary":
            rounded[j.name] = np.radians(rounded[j.name])
    measured = measured_at(machine, rounded, Truth({}), NOISE)[["mx", "my", "mz"]].to_numpy()
    named(measured).to_csv(tmp_path / "measured.csv", index=False)

    def imported(z: float) -> str:
        offset = f"G54=X0,Y0,Z{z:g},{','.join(f'{j.name}0' for j in machine.joints if j.type == 'rotary')}"
        files = {"commands": tmp_path / "a.nc", "offsets": [offset]}
        return import_survey(tmp_path / "measured.csv", machine, **files).summary()  # type: ignore[arg-type]

    assert "displaced" not in imported(0)
    assert "an offset, the tool, or errors of location" in imported(0.4)
    with pytest.raises(InputError, match="The offset is wrong by so much, or the target was not the tool"):
        imported(5)


@pytest.mark.parametrize("shift", [0.0, 10.0])
def test_a_displacement_that_repeats_show_is_said_by_import_and_check(shift: float, tmp_path: Path) -> None:
    """The second pass lies ten times the noise beside the first, far below what the machine's errors are."""
    both = pd.concat([COMMANDS, COMMANDS], ignore_index=True)
    both.to_csv(tmp_path / "plan.csv", index=False)
    measured = points(both) + np.outer(np.arange(60) >= 30, shift * NOISE * np.array([0.6, -0.64, 0.48]))
    named(measured).drop(columns="Name").to_csv(tmp_path / "seen.csv", index=False)
    result = import_survey(tmp_path / "seen.csv", MILL, commands=tmp_path / "plan.csv")
    machine = read_machine(MILL)
    lines = [*check_lines(check_survey(machine, result.survey))]
    for said in (" ".join(result.summary().split()), " ".join(lines)):
        assert ("commands lie" in said) == bool(shift)
        if shift:
            assert float(said.split("commands lie ")[1].split()[0]) == pytest.approx(1e3 * shift * NOISE, rel=0.2)
            assert re.search(r"u = [\d.]+ um.*between rows 30 and 32 .* write frame: per-run in survey.yaml", said)
