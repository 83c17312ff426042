"""Machines that may be turning centres or mills: whether X counts diameters is asked, and never guessed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from errormodel.chain import Chain
from errormodel.controllers.setup import Setup
from errormodel.controllers.turning import DIAMETERS, NOT_KNOWN, RADII, x_counts
from errormodel.machine import Joint, Machine, Shape
from errormodel.machine_file import read_machine
from errormodel.raw_formats.base import Asked, format_of, open_raw
from errormodel.raw_formats.programme_poses import plain_setup
from identification.estimation.fit import fit_machine
from identification.results.store import save
from tests.helpers.chains import errors
from tests.helpers.commands import MILL, done, run
from tests.helpers.surveys import measured, positions, survey

PROGRAMME = "%\nO1000 (SHAFT, X IN DIAMETER)\nG21 G90 G18 G94\nG0 X200. Y0. Z300. C0.\nG1 X60. Z100. F200\nM30\n%\n"
pytestmark = pytest.mark.usefixtures("few_poses")


def turning_centre() -> Machine:
    """C under the workpiece, then Z, X and Y; the turret's tip lies on the axis of C at zero."""
    plain = next(e for e in read_machine(MILL).elements if isinstance(e, Joint) and e.name == "X")

    def line(name: str, axis: tuple[int, int, int], low: float, high: float) -> Joint:
        return Joint(name, "prismatic", axis, (low, high), dict(plain.models))

    turret = Shape("turret", (150, 0, 80))
    elements = (
        Joint("C", "rotary", (0, 0, -1), (0, 2 * np.pi)), Shape("headstock"), line("Z", (0, 0, 1), 0, 600),
        Shape("saddle"), line("X", (1, 0, 0), -40, 220), Shape("slide"), line("Y", (0, 1, 0), -50, 50), turret,
    )  # fmt: skip
    return Machine("Turning centre", elements, (-150.0, 0.0, -80.0))


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    machine, folder = turning_centre(), tmp_path_factory.mktemp("turning")
    table = positions(measured(machine, errors(Chain(machine), 1), 120, 1, noise=1e-3))
    save(fit_machine(machine, survey(table)), folder / "fit")
    return folder / "fit"


def as_axes(machine: Machine) -> Setup:
    return replace(plain_setup(machine), x_stated="")


def test_what_is_open_follows_from_the_machine() -> None:
    assert x_counts(as_axes(turning_centre())) == NOT_KNOWN
    for name in ("trunnion_five_axis", "fork_head_five_axis", "five_axis_table_quill", "vertical_three_axis"):
        assert x_counts(as_axes(read_machine(name))) == RADII, name
    machine = turning_centre()
    lathe = replace(machine, elements=tuple(e for e in machine.elements if e.name != "Y"))
    assert x_counts(as_axes(lathe)) == NOT_KNOWN
    for told in (RADII, DIAMETERS):
        assert x_counts(replace(as_axes(machine), x_stated=told)) == told


def test_a_programme_whose_x_may_count_diameters_is_asked_about(fit: Path, tmp_path: Path) -> None:
    (tmp_path / "turn.nc").write_text(PROGRAMME)
    what = ("--controller", "gcode", "--dialect", "fanuc", "--offset", "X0,Y0,Z0,C0", "--program", tmp_path / "turn.nc")
    said = done("compensate", fit, *what, "--out", tmp_path / "asked")
    assert "turn.nc: X is taken for radii (--x-counts radii says so)" in said.out
    assert "where its control counts X in diameters, these corrections are wrong" in said.out
    found = run("compensate", fit, *what, "--x-counts", "diameters", "--out", tmp_path / "o")
    assert (found.code, "whose X counts diameters" in found.err) == (2, True)
    told = done("compensate", fit, *what, "--x-counts", "radii", "--out", tmp_path / "o")
    assert "diameters" not in told.out
    assert (tmp_path / "o/turn.nc").is_file()


def test_radii_that_a_programme_states_itself_are_taken(fit: Path, tmp_path: Path) -> None:
    what = ("--controller", "gcode", "--x-counts", "diameters", "--out", tmp_path / "o", "--program")
    (tmp_path / "a.ngc").write_text("G21 G90 G94\nG0 X100 Y0 Z300 C0\nG1 Z100 F100\nM2\n")
    assert run("compensate", fit, *what, tmp_path / "a.ngc").code == 2
    (tmp_path / "b.ngc").write_text("G21 G90 G94 G8\nG0 X100 Y0 Z300 C0\nG1 Z100 F100\nM2\n")
    done("compensate", fit, *what, tmp_path / "b.ngc")


@pytest.mark.parametrize("name", ["siemens-cec", "fanuc-pitch", "heidenhain"])
def test_tables_say_that_they_count_radii(name: str, fit: Path, tmp_path: Path) -> None:
    def made(*told: str) -> tuple[str, list[Path], str]:
        done("compensate", fit, "--controller", name, *told, "--out", tmp_path / "o")
        checklist = " ".join(json.loads((tmp_path / "o/compensation.json").read_text())["checklist"])
        text = (tmp_path / "o/sign_test/steps.txt").read_text()
        return checklist, sorted((tmp_path / "o/sign_test").glob("check_*")), text

    asked, programmes, text = made()
    assert "positions and corrections of the files are radii" in asked
    assert "--x-counts radii or --x-counts diameters" in asked
    assert not programmes, "a programme in diameters would drive to twice X"
    assert "--x-counts says it" in text
    asked, programmes, text = made("--x-counts", "radii")
    assert "radii" not in asked
    assert programmes
    assert not any("DIAMOF" in p.read_text() for p in programmes)
    asked, programmes, text = made("--x-counts", "diameters")
    assert "X counts in diameters" in asked
    assert "readings are radii" in text
    assert bool(programmes) == (name == "siemens-cec")
    assert all("\nDIAMOF\n" in p.read_text() for p in programmes)


def test_the_word_is_checked(fit: Path, tmp_path: Path) -> None:
    found = run("compensate", fit, "--controller", "csv", "--x-counts", "diam", "--out", tmp_path / "o")
    assert (found.code, "diameters" in found.err) == (2, True)


def test_commands_of_a_programme_say_that_x_is_taken_as_radii(tmp_path: Path) -> None:
    for machine, words in ((turning_centre(), True), (read_machine("trunnion_five_axis"), False)):
        text = "G21 G90 G94\nG0 X10 Y0 Z200 C0" + (" A0" if not words else "") + "\nG1 Z210 F100\nM2\n"
        (tmp_path / "p.nc").write_text(text)
        raw = open_raw(tmp_path / "p.nc", "p.nc")
        notes = " ".join(format_of(raw).read(raw, Asked(machine)).notes)
        assert ("X taken as radii" in notes) == words
