"""What a checklist says beside the steps: backlash, zero shift, the machine's state, and what is left without."""

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
from errormodel.controllers.base import Controller
from errormodel.controllers.setup import Reversal
from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.compensation.assessment import emulated, left
from identification.compensation.compensate import best_tables
from identification.compensation.conditions import Conditions, Largest, check_size, conditions_of, largest
from identification.compensation.field import Field, movers_of
from identification.compensation.reversal import reversal_lines, reversals
from identification.compensation.volume import Volume
from identification.estimation.fit import fit_machine
from identification.results.store import save
from tests.helpers.chains import errors
from tests.helpers.commands import MILL, done, run, tree
from tests.helpers.compensation import volume_of
from tests.helpers.surveys import measured, positions, survey

UM = 1e-3
pytestmark = pytest.mark.usefixtures("few_poses")
LAG, SMALL, GROWTH = -12 * UM, -4 * UM, -10 * UM  # X stays 12 um behind; Y 4 um at one end, 14 at the other
WARM = 30 * UM
TWO = ("linuxcnc-type1", "csv")


@pytest.fixture(scope="module")
def worn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fit of a mill with backlash in X, lost motion in Y, and a tool that grows while it warms up for 9000 s."""
    folder = tmp_path_factory.mktemp("worn")
    effects = (
        EffectSpec("backlash", {"joint": "X"}),
        EffectSpec("lost-motion", {"joint": "Y"}),
        EffectSpec("warm-up", {"tau": 2000.0}),
    )
    machine = replace(read_machine(MILL), effects=effects, name="Mill\nG0 Z-500")
    chain, plain = Chain(machine), Chain(read_machine(MILL))
    p = dict(zip(plain.ids, errors(plain, 3).tolist(), strict=True))
    p |= {chain.effect_ids[0][0]: LAG, chain.effect_ids[2][0]: -WARM}
    p |= dict(zip(chain.effect_ids[1], (GROWTH, SMALL), strict=True))
    rng = np.random.default_rng(0)
    points = pd.DataFrame({j.name: rng.uniform(*j.travel, 200) for j in machine.joints})
    points = points.assign(tool_x=0.0, tool_y=0.0, tool_z=-100.0, time=np.linspace(0, 9000, 200))
    table = positions(measured(machine, chain.vector(p), seed=4, noise=1 * UM, points=points))
    save(fit_machine(machine, survey(table)), folder / "fit")
    return folder / "fit"


def checklist(folder: Path) -> list[str]:
    """The steps of a checklist, each on one line."""
    text = (folder / "checklist.txt").read_text().split("activation\n")[1].split("\n\n")[0]
    return [" ".join(step.split()) for step in text.split("  [ ] ")[1:]]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("siemens-lec", (r"MD32450 \$MA_BACKLASH\[0,X1\]: add \+0\.0(\d+) mm", 1e-4)),
        ("fanuc-pitch", (r"parameter 1851 of axis A1 .*: add \+(\d+) detection units of 1 um", 1.0)),
        ("heidenhain", (r"MP_backLash of X .*: add \+0\.0(\d+) mm", 1e-4)),
        ("isg", (r"getriebe\[0\]\.lose of logical axis 1 .*: add \+(\d+) \(in 0\.1 um\)", 0.1)),
        ("pmac", (r"I186 \(with I185 above 0\): add \+(\d+) sixteenths", 1 / 16)),
        ("aerotech-1d", (r"backlash distance of axis 1 .*: add \+0\.0(\d+) mm", 1e-4)),
    ],
)
def test_backlash_stands_in_the_checklist_with_the_controls_parameter(
    name: str, words: tuple[str, float], worn: Path, tmp_path: Path
) -> None:
    done("compensate", worn, "--controller", name, "--out", tmp_path)
    steps = checklist(tmp_path)
    (line,) = [s for s in steps if "backlash of X" in s]
    match = re.search(words[0], line)
    assert match is not None, line
    unit = {1e-4: 0.1, 1.0: 1.0, 0.1: 0.1, 1 / 16: 1 / 16}[words[1]]
    assert unit * int(match[1]) == pytest.approx(12.0, abs=1.0)  # um
    assert "positive where the axis stays behind its direction of travel" in line
    (lost,) = [s for s in steps if "backlash of Y" in s]
    ends = re.search(r"\(([-+\d.]+) at -205, ([-+\d.]+) at 205\)", lost)
    assert ends is not None
    assert [float(v) for v in ends.groups()] == pytest.approx([4.0, 14.0], abs=2.0)
    figures = json.loads((tmp_path / "compensation.json").read_text())["sets"][0]["conditions"]
    assert figures["parameters_um"] < 0.9 * figures["left_um"]
    (gain,) = [s for s in steps if s.startswith("backlash:")]
    assert f"{figures['left_um']:.1f} um rms are left without" in gain
    assert f"{figures['parameters_um']:.1f} with them" in gain


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("siemens-cec", "as it was during the survey"),
        ("linuxcnc-type1", "ignored beside a COMP_FILE"),
        ("twincat-nc", "as it was during the survey"),
    ],
)
def test_tables_for_each_direction_say_that_they_hold_the_backlash(
    name: str, words: str, worn: Path, tmp_path: Path
) -> None:
    done("compensate", worn, "--controller", name, "--out", tmp_path)
    steps = [s for s in checklist(tmp_path) if "backlash of" in s]
    assert len(steps) == 2
    assert all("These tables hold it" in s and words in s for s in steps)
    assert json.loads((tmp_path / "compensation.json").read_text())["sets"][0]["conditions"]["parameters_um"] is None


@pytest.mark.parametrize("name", ["klipper", "duet", "marlin"])
def test_where_nothing_holds_backlash_it_is_said_to_stay(name: str, worn: Path, tmp_path: Path) -> None:
    done("compensate", worn, "--controller", name, "--out", tmp_path)
    steps = [s for s in checklist(tmp_path) if "backlash of" in s]
    assert len(steps) == 2
    assert all("It stays" in s for s in steps)


def test_a_parameter_takes_away_what_the_simulated_play_makes() -> None:
    """Tables of pitch and a parameter for the play: the sign of the parameter is that of ordinary backlash."""
    machine = replace(read_machine(MILL), effects=(EffectSpec("backlash", {"joint": "X"}),))
    chain = Chain(machine)
    for size in (-20 * UM, 20 * UM):
        p = chain.vector({chain.effect_ids[0][0]: size, "X.dx.1": 30 * UM})
        field = Field(chain, p, movers_of(chain))
        travel = np.array([j.travel for j in machine.joints])
        volume = Volume(field, travel[:, 0], travel[:, 1], True)
        controller = target("siemens-lec")
        assert isinstance(controller, Controller)
        setup = replace(
            volume.setup(None, None)[0], reversals=reversals(field, {j.name: j.name for j in machine.joints})
        )
        tables = best_tables(controller, setup, volume)
        found = conditions_of(controller, setup, volume, tables, 0)
        assert found.parameters_um is not None
        assert found.parameters_um < 1.0 < 8.0 < found.left_um
        assert found.left_um == pytest.approx(left(volume, emulated(controller, tables, setup, volume), 0).rms_um)
        (line,) = reversal_lines(controller, setup, tables)
        # a parameter grows for an axis that stays behind; one that is ahead had too much of it
        assert f"add {-size:+.4f} mm" in line if size < 0 else f"if {size:.4f} mm or more was set" in line
        assert ("which no worn drive makes" in line) == (size > 0)
        if size > 0:
            assert "add " not in line
            assert "wrong column dir_X" in line


@pytest.mark.parametrize(
    ("name", "value"),
    [("fanuc-pitch", "12 detection units"), ("pmac", "192 sixteenths of a count"), ("isg", "120 (in")],
)
def test_an_axis_ahead_of_its_command_adds_nothing_to_a_parameter(name: str, value: str) -> None:
    """No control takes less than no backlash, and no sentence may ask for it."""
    controller = target(name)
    assert isinstance(controller, Controller)
    setup = volume_of(read_machine(MILL), np.zeros(len(Chain(read_machine(MILL)).ids))).setup(None, None)[0]
    (line,) = reversal_lines(controller, replace(setup, reversals={"X": Reversal(12 * UM, 12 * UM)}), ())
    assert f"if {value}" in line
    assert "or more was set during the survey, take that off; else leave it" in line


def test_time_has_its_unit_its_meaning_and_what_other_times_leave(worn: Path, tmp_path: Path) -> None:
    result = done("compensate", worn, "--controller", "siemens-lec", "--out", tmp_path)
    (line,) = [s for s in checklist(tmp_path) if "errors change with time" in s]
    assert re.search(r"for time = 45\d\d s \(1 h 15 min\) of the recording", line)
    rms = re.search(r"Left there ([\d.]+) um rms, ([\d.]+) at time = 0 s .* and ([\d.]+) at time = 9000 s", line)
    assert rms is not None
    here, cold, warm = map(float, rms.groups())
    grown = 1e3 * WARM * (1 - np.exp(-4500 / 2000))  # what the tool has grown until then
    assert cold == pytest.approx(np.hypot(here, grown), rel=0.15)
    assert here - 0.5 < warm < cold
    assert "warmed up as long" in line
    assert "4477" not in result.out + result.err


def test_the_zero_shift_comes_first_with_what_is_left_without_it(tmp_path: Path) -> None:
    done("simulate", "five_axis_table_quill", 90, "--noise", 0.002, "--out", tmp_path / "s.csv")
    machine = read_machine("five_axis_table_quill")
    chain = Chain(machine)
    table = positions(measured(machine, errors(chain, 2), 120, 1, noise=2 * UM))
    save(fit_machine(machine, survey(table)), tmp_path / "fit")
    done("compensate", tmp_path / "fit", "--controller", "pmac", "--out", tmp_path / "o")
    figures = json.loads((tmp_path / "o/compensation.json").read_text())["sets"][0]["conditions"]
    assert figures["unshifted_um"] > 1.2 * figures["left_um"]
    first = checklist(tmp_path / "o")[0]
    assert first.startswith("FIRST: these tables are zero at the reference point. Add to every work offset: ")
    assert f"without it {figures['unshifted_um']:.1f} um rms are left in place of {figures['left_um']:.1f}" in first


def test_every_file_that_is_written_is_counted(worn: Path, tmp_path: Path) -> None:
    for name, more in (("siemens-lec", ()), ("klipper", ()), ("csv", ("--points", 3))):
        out = done("compensate", worn, "--controller", name, *more, "--out", tmp_path / name).out.splitlines()[-1]
        there = [*tree(tmp_path / name)]
        match = re.match(
            r"(\d+) files? for the control(?:, (\d+) files? in sign_test)?, checklist.txt and compensation.json", out
        )
        assert match is not None, out
        check = sum(f.startswith("sign_test/") for f in there)
        assert int(match[2] or 0) == check
        assert int(match[1]) == len(there) - check - 3  # those two, and manifest.json


def test_the_number_of_siemens_tables_is_said(worn: Path, tmp_path: Path) -> None:
    done("compensate", worn, "--controller", "siemens-cec", "--out", tmp_path)
    text = (tmp_path / "NC_CEC.INI").read_text()
    count = len(re.findall(r"INPUT_AXIS", text))
    assert any(s.startswith(f"FIRST: {count} tables of $AN_CEC are needed") for s in checklist(tmp_path))


def test_a_name_of_several_lines_is_one_line_of_the_checklist(worn: Path, tmp_path: Path) -> None:
    done("compensate", worn, "--controller", "siemens-lec", "--out", tmp_path)
    first = (tmp_path / "checklist.txt").read_text().splitlines()[0]
    assert first.startswith("Mill G0 Z-500: tables for Siemens")
    assert "G0 Z-500" not in (tmp_path / "AX_EEC.INI").read_text().replace("; machine: Mill G0 Z-500", "")


def test_corrections_larger_than_a_machines_errors_are_refused_unless_asked_for(tmp_path: Path) -> None:
    machine = read_machine(MILL)
    chain = Chain(machine)
    p = chain.vector({"X.dx.1": 8.0})  # a scale that is 1 percent off: somebody's unit, not a screw
    table = positions(measured(machine, p, 80, 1, noise=2 * UM))
    save(fit_machine(machine, survey(table)), tmp_path / "fit")
    for name in ("linuxcnc-type1", "csv", "klipper"):  # the last could take none of it away
        result = run("compensate", tmp_path / "fit", "--controller", name, "--out", tmp_path / "o")
        assert (result.code, result.err.count("\n")) == (2, 1)
        assert re.search(r"corrections of up to [\d.]+ mm", result.err)
        assert "--allow-large" in result.err
        assert re.search(r"joint [XYZ] at X=", result.err)  # which one, and where
        assert not (tmp_path / "o").exists()
    done("compensate", tmp_path / "fit", "--controller", "csv", "--allow-large", "--out", tmp_path / "csv")


def test_steep_corrections_are_refused_with_both_joints_and_the_place() -> None:
    machine = read_machine(MILL)
    volume = volume_of(machine, Chain(machine).vector({"X.dy.1": 12.0}))
    setup = volume.setup(None, None)[0]
    found = largest(volume, setup, volume.ideal, lambda q: np.ones(len(q), dtype=bool), 0)
    assert {found.steep, found.along} == {"X", "Y"}  # the frame takes half of it
    found = replace(found, mm=0.5)  # of a shorter travel
    with pytest.raises(
        InputError, match=r"joint [XY] along [XY] at X=\S+ Y=\S+ Z=\S+: corrections that change by up to"
    ):
        check_size(found, False, "tables")
    check_size(found, True, "tables")


def test_large_corrections_of_small_errors_are_laid_to_the_joints_directions() -> None:
    found = Largest(3.67, "J2", "J0=1.0", 0.0, "J2", error_mm=0.004)
    with pytest.raises(InputError, match=r"3\.67 mm for an error of 4 um: the correcting joints hardly move the tip"):
        check_size(found, False, "tables")
    with pytest.raises(InputError, match="Look for a wrong unit or sign"):
        check_size(replace(found, error_mm=3.0), False, "tables")


def test_the_other_sign_is_refused_where_the_sign_is_public(worn: Path, tmp_path: Path) -> None:
    for name in ("linuxcnc-type1", "siemens-lec", "klipper", "csv", "gcode"):
        result = run("compensate", worn, "--controller", name, "--invert", "--out", tmp_path / "o")
        assert (result.code, "--invert" in result.err) == (2, True)
        assert not (tmp_path / "o").exists()
    done("compensate", worn, "--controller", "aerotech-1d", "--out", tmp_path / "a")
    out = done("compensate", worn, "--controller", "aerotech-1d", "--invert", "--out", tmp_path / "b").out
    assert "sign: turned round (--invert)" in out
    values = [
        np.array(
            [float(v) for v in re.findall(r"^-?\d+\.\d{5}$", (tmp_path / k / "axes.cal").read_text(), re.MULTILINE)]
        )
        for k in "ab"
    ]
    assert len(values[0]) > 5
    np.testing.assert_array_equal(values[1], -values[0])
    data = [json.loads((tmp_path / k / "compensation.json").read_text()) for k in "ab"]
    assert data[0]["sets"][0]["figures"] == data[1]["sets"][0]["figures"]
    assert (data[0]["inverted"], data[1]["inverted"]) == (False, True)


def test_tables_that_do_more_harm_than_good_are_advised_against(tmp_path: Path) -> None:
    """A mill that is not straight: tables of each axis over its own position can take nothing of that away."""
    machine = read_machine(MILL)
    p = Chain(machine).vector({"X.dy.2": 30 * UM, "Y.dx.2": 20 * UM})
    save(fit_machine(machine, survey(positions(measured(machine, p, 100, 1, noise=1 * UM)))), tmp_path / "fit")
    said = {n: done("compensate", tmp_path / "fit", "--controller", n, "--out", tmp_path / n).out for n in TWO}
    assert "DO NOT LOAD THESE TABLES" in said["linuxcnc-type1"]
    assert "--controller linuxcnc-3d or csv or gcode" in " ".join(said["linuxcnc-type1"].split())
    assert said["linuxcnc-type1"].index("DO NOT LOAD") < said["linuxcnc-type1"].index("after these tables")
    assert "DO NOT LOAD" not in said["csv"]
    written = json.loads((tmp_path / "linuxcnc-type1/compensation.json").read_text())
    assert written["first"][0].startswith("DO NOT LOAD")
    assert "DO NOT LOAD" in checklist(tmp_path / "linuxcnc-type1")[0]


@pytest.mark.parametrize(
    ("name", "parameter"),
    [
        ("siemens-lec", "MD32450 $MA_BACKLASH[0,X1] +0.00"),
        ("heidenhain", "MP_backLash of X (MP710 on TNC 4xx) +0.00"),
        ("fanuc-pitch", "parameter 1851 of axis A1 (and 1852 where 1800#4 is 1) +6 detection units of 1 um"),
    ],
)
def test_tables_that_need_the_backlash_parameter_are_loaded_together_with_it(
    name: str, parameter: str, lagging: Path, tmp_path: Path
) -> None:
    """A scale error and a backlash of its size: the table alone makes one direction worse where errors cancelled."""
    said = " ".join(done("compensate", lagging, "--controller", name, "--out", tmp_path / "o").out.split())
    assert "DO NOT LOAD" not in said
    found = json.loads((tmp_path / "o/compensation.json").read_text())
    (line,) = [x for x in found["first"] if "load these tables together with" in x]
    assert line.startswith(f"FIRST: load these tables together with {parameter}")
    conditions = found["sets"][0]["conditions"]
    assert conditions["worse_share"] > 0.1 > conditions["together_share"]
    assert conditions["together_um"] < 1.0 < conditions["left_um"]


def test_tables_that_do_harm_with_the_parameter_as_well_are_advised_against() -> None:
    size = Largest(0.01, "X", "X=0", 0.0, "X")
    both = Conditions(90.0, None, 85.0, 100.0, 0.3, size, together_um=85.0, together_share=0.2).against("csv")
    assert both.startswith("with the backlash parameters of the checklist set, this format takes away 15 %")
    assert "makes 20 % of the poses worse" in both
    good = Conditions(90.0, None, 10.0, 100.0, 0.3, size, together_um=10.0, together_share=0.0)
    assert not good.against("csv")
    assert "30 % of the poses" in good.alone


@pytest.fixture(scope="module")
def lagging(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fit of a mill with a scale error of X and a backlash of X as large as that over half the travel."""
    folder = tmp_path_factory.mktemp("lagging")
    machine = replace(read_machine(MILL), effects=(EffectSpec("backlash", {"joint": "X"}),))
    chain = Chain(machine)
    p = chain.vector({"X.dx.1": 10 * UM, chain.effect_ids[0][0]: -6 * UM})
    save(fit_machine(machine, survey(positions(measured(machine, p, 150, 1, noise=0.3 * UM)))), folder / "fit")
    return folder / "fit"
