"""Where tables would do harm in silence: noise, other tools, axes that stood still, lathes, zero shifts."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.controllers import target
from errormodel.controllers.base import Controller, read_back
from errormodel.machine import Joint, Machine, Shape
from errormodel.machine_file import read_machine
from errormodel.simulation import random_points
from identification.compensation.assessment import Rows, emulated, fresh_rows, remaining
from identification.compensation.conditions import check_size, conditions_of
from identification.compensation.field import Field
from identification.compensation.model_uncertainty import model_uncertainty
from identification.compensation.rows import read_rows
from identification.compensation.volume import Volume
from identification.estimation.fit import fit_machine
from identification.results import store
from identification.results.store import save
from tests.helpers.chains import errors
from tests.helpers.commands import MILL, done, run
from tests.helpers.compensation import tables_of, volume_of
from tests.helpers.surveys import measured, positions, rms, stored, survey

UM = 1e-3
FORK = "fork_head_five_axis"
pytestmark = pytest.mark.usefixtures("few_poses")


def fitted(machine: Machine, p: np.ndarray, folder: Path, n: int = 150, noise: float = 2 * UM, **more: object) -> Path:
    table = positions(measured(machine, p, n, 1, noise=noise, **more))  # type: ignore[arg-type]
    save(fit_machine(machine, survey(table)), folder / "fit")
    return folder / "fit"


def first(out: Path) -> str:
    return " ".join(json.loads((out / "compensation.json").read_text())["first"])


def steps(out: Path) -> str:
    return " ".join(json.loads((out / "compensation.json").read_text())["checklist"])


@pytest.fixture(scope="module")
def noise_only(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mill without any error, measured with noise at hardly more poses than it has parameters."""
    folder, machine = tmp_path_factory.mktemp("noise"), read_machine(MILL)
    return fitted(machine, np.zeros(len(Chain(machine).ids)), folder, n=30, noise=5 * UM)


def test_a_model_of_noise_is_advised_against(noise_only: Path, tmp_path: Path) -> None:
    done("compensate", noise_only, "--controller", "csv", "--out", tmp_path / "csv")
    said = first(tmp_path / "csv")
    assert said.startswith("DO NOT LOAD THESE TABLES: the model's own standard uncertainty over the volume is")
    assert "errormodel plan" in said
    (tmp_path / "a.ngc").write_text("G21 G90 G94\nG0 X0 Y0 Z300\nG1 Y5 F500\nX50\nM2\n")
    what = ("--program", tmp_path / "a.ngc", "--out", tmp_path / "nc")
    done("compensate", noise_only, "--controller", "gcode", *what)
    assert first(tmp_path / "nc").startswith("DO NOT RUN WHAT WAS WRITTEN")


def test_what_was_measured_is_the_error_before(noise_only: Path, tmp_path: Path) -> None:
    """Not what was measured plus the difference of two fits, which flatters a model of noise."""
    done("compensate", noise_only, "--controller", "csv", "--out", tmp_path / "o")
    nominal = json.loads((noise_only / "fit.json").read_text())["nominal"]["rms_um"]
    held = json.loads((tmp_path / "o/compensation.json").read_text())["sets"][0]["figures"][1]
    # both after the best frame; the fit's is linear about its own estimate
    assert held["before"]["rms_um"] == pytest.approx(nominal, rel=0.01)
    assert held["after"]["rms_um"] > held["before"]["rms_um"]


def test_the_uncertainty_of_the_model_is_its_error_over_many_surveys() -> None:
    machine = read_machine(MILL)
    p, gaps, claims = errors(Chain(machine), 3), list[float](), list[float]()
    for seed in range(8):
        fit = stored(fit_machine(machine, survey(positions(measured(machine, p, 60, seed, noise=3 * UM)))))
        table = pd.DataFrame({j.name: [*j.travel] for j in machine.joints})
        volume = Volume.of(Field.of(fit, table), table, True)
        rows = fresh_rows(volume, 0)
        truth = replace(volume.field, values=p)
        gap = truth.actual(rows.q, rows.direction) - volume.field.actual(rows.q, rows.direction)
        seen = replace(rows, left=gap - (volume.field.actual(rows.q, rows.direction) - volume.field.nominal(rows.q)))
        gaps.append(rms(remaining(volume, lambda q, came, tool: q, seen)))
        claims.append(1e3 * model_uncertainty(fit, volume, rows).whole)
    # a mean of eight squares of some forty errors each is known to a tenth
    assert np.sqrt(np.mean(np.square(gaps))) == pytest.approx(np.sqrt(np.mean(np.square(claims))), rel=0.25)


def test_figures_say_the_uncertainty_of_the_model(noise_only: Path, tmp_path: Path) -> None:
    out = done("compensate", noise_only, "--controller", "csv", "--out", tmp_path / "o").out
    (line,) = re.findall(r"standard uncertainty of the model itself, beside that +([\d.]+)", out)
    figures = json.loads((tmp_path / "o/compensation.json").read_text())["sets"][0]["figures"]
    assert float(line) == pytest.approx(figures[0]["model_um"], abs=0.005)
    assert figures[1]["model_um"] is None


@pytest.mark.long
def test_no_table_follows_a_length_that_the_survey_does_not_show(tmp_path: Path) -> None:
    """A head that turned a little: how its angles act on a longer tool is not known, whatever a fit may say."""
    machine = read_machine(FORK)
    points = random_points(machine, 300, 0).assign(C=0.5, A=np.random.default_rng(7).uniform(-0.4, 0.2, 300))
    fit = fitted(machine, 0.3 * errors(Chain(machine), 2), tmp_path, points=points)
    done("compensate", fit, "--controller", "linuxcnc-3d", "--out", tmp_path / "o")
    assert "\ntool 0\n" in (tmp_path / "o/errormodel_3d.table").read_text()
    assert "tool-follow" not in (tmp_path / "o/errormodel_3d.hal").read_text()
    said = steps(tmp_path / "o")
    assert "the survey does not show how errors change with the length of the tool" in said
    assert re.search(
        r"FIRST: C stood at 28\.6\d* deg in the whole survey: what is written is right with it there only", said
    )


def test_axes_that_only_moved_together_are_told_from_a_wrong_unit(tmp_path: Path) -> None:
    machine = read_machine(MILL)
    points = random_points(machine, 200, 0)
    x, y = (next(j for j in machine.joints if j.name == n).travel for n in "XY")
    points["Y"] = y[0] + (points["X"] - x[0]) * (y[1] - y[0]) / (x[1] - x[0])
    fit = fitted(machine, errors(Chain(machine), 2), tmp_path, points=points)
    result = run("compensate", fit, "--controller", "csv", "--out", tmp_path / "o")
    said = result.err if result.code else first(tmp_path / "o")
    assert "the model's own standard uncertainty over the volume is" in said


def test_a_table_follows_the_length_that_the_survey_shows(tmp_path: Path) -> None:
    machine = read_machine(MILL)
    fit = fitted(machine, errors(Chain(machine), 3), tmp_path)
    done("compensate", fit, "--controller", "linuxcnc-3d", "--out", tmp_path / "o")
    assert "\ntool 1\n" in (tmp_path / "o/errormodel_3d.table").read_text()
    assert re.search(
        r"with a tool 100 mm longer, followed, the model is less certain by [\d.]+ um", steps(tmp_path / "o")
    )


def test_rows_with_another_tool_than_the_tables_are_named(tmp_path: Path) -> None:
    machine = read_machine(MILL)
    fit = fitted(machine, errors(Chain(machine), 3), tmp_path)
    out = done("compensate", fit, "--controller", "csv", "--tool", 0, 0, -160, "--out", tmp_path / "o").out
    assert "rows left out of the fit in blocks, other tools" in out
    assert "DO NOT LOAD" not in out


def test_a_printer_far_from_square_gets_marlins_skew() -> None:
    """The firmware corrects nothing at its limits: a step there is no slope of the skew."""
    machine = read_machine(MILL)
    p = Chain(machine).vector({"saddle.ec": 2e-3})  # 2 mm in a metre: not rare for a printer
    volume = volume_of(machine, p)
    controller, tables, setup = tables_of("marlin", volume)
    found = conditions_of(controller, setup, volume, tables, 0).largest
    assert found.slope == pytest.approx(2e-3, rel=0.05)
    check_size(found, False, "Marlin")


def lathe() -> Machine:
    def line(name: str, axis: tuple[int, int, int], low: float, high: float) -> Joint:
        plain = next(e for e in read_machine(MILL).elements if isinstance(e, Joint) and e.name == "X")
        return Joint(name, "prismatic", axis, (low, high), dict(plain.models))

    shapes = [Shape("bed", (0, 0, 0)), Shape("slide", (40, 0, 120)), Shape("turret", (30, 0, -60))]
    elements = (shapes[0], line("Z", (0, 0, 1), 10, 900), shapes[1], line("X", (1, 0, 0), -20, 260), shapes[2])
    return Machine("Lathe", elements, (25.0, 0.0, -35.0))


@pytest.fixture(scope="module")
def turned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    machine = lathe()
    return fitted(machine, errors(Chain(machine), 1), tmp_path_factory.mktemp("lathe"), n=80)


@pytest.mark.parametrize("name", ["siemens-lec", "linuxcnc-type1", "heidenhain"])
def test_files_for_a_lathe_say_that_they_count_radii(name: str, turned: Path, tmp_path: Path) -> None:
    done("compensate", turned, "--controller", name, "--out", tmp_path / "o")
    assert "X of a lathe: positions and corrections of the files are radii" in steps(tmp_path / "o")
    check = {p.name for p in (tmp_path / "o/sign_test").iterdir()}
    assert not [n for n in check if n.startswith("check_")], "a programme in diameters would drive to twice X"
    text = (tmp_path / "o/sign_test/steps.txt").read_text()
    assert "positions and readings are radii" in text
    assert "Run the programme" not in text


def test_programmes_of_lathes_count_radii_or_are_refused(turned: Path, tmp_path: Path) -> None:
    (tmp_path / "a.nc").write_text("%\nO0001\nG21 G18 G54\nG0 X100. Z102.\nG1 Z50. F100.\nM30\n%\n")
    what = ("--controller", "gcode", "--offset", "G54=X0,Z0", "--program")
    result = run("compensate", turned, *what, tmp_path / "a.nc", "--out", tmp_path / "o")
    assert (result.code, "X counts diameters" in result.err) == (2, True)
    (tmp_path / "b.ngc").write_text("G21 G90 G94\nG0 X100 Z102\nG1 Z50 F100\nM2\n")
    what = ("--controller", "gcode", "--out", tmp_path / "o", "--program")
    assert "X in radii (G8)" in done("compensate", turned, *what, tmp_path / "b.ngc").out
    (tmp_path / "c.ngc").write_text("G21 G90 G94 G8\nG0 X100 Z102\nG1 Z50 F100\nM2\n")
    assert "X in radii (G8)" not in done("compensate", turned, *what, tmp_path / "c.ngc").out


def test_the_zero_shift_is_what_every_work_offset_gets(tmp_path: Path) -> None:
    """Added to what is commanded, the shift in the checklist's own words and digits leaves what is claimed."""
    machine = read_machine("five_axis_table_quill")
    fit = fitted(machine, errors(Chain(machine), 2), tmp_path, n=120)
    done("compensate", fit, "--controller", "pmac", "--out", tmp_path / "o")
    said = first(tmp_path / "o")
    shift = dict(re.findall(r"(\w) ([-+]\d\.\d{4}) mm", said.split("Add to every work offset: ")[1].split("(")[0]))
    assert shift
    assert "off the coordinate that the reference point is given" in said
    loaded = store.load(fit)
    table = read_rows(fit, loaded.chain.machine)
    volume = Volume.of(Field.of(loaded, table), table, True)
    controller, setup = target("pmac"), volume.setup(None, None)[0]
    assert isinstance(controller, Controller)
    tables = read_back(controller, {"comp.pmc": (tmp_path / "o/comp.pmc").read_text()}, setup)
    kept = tuple(t for t in tables if t.term.inputs)
    bare = emulated(controller, kept, setup, volume)
    rows: Rows = fresh_rows(volume, 0)
    figures = json.loads((tmp_path / "o/compensation.json").read_text())["sets"][0]["conditions"]
    for sign, wanted in ((1, figures["left_um"]), (0, figures["unshifted_um"])):
        add = np.array([sign * float(shift.get(n, 0)) for n in setup.names])
        left = rms(remaining(volume, lambda q, came, tool, add=add: bare(q, came, tool) + add, rows))
        assert left == pytest.approx(wanted, rel=0.02)  # digits of the shift, 0.05 um, beside 10 um and more
