"""From a fit to a controller's files: what is printed and written, what is refused."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.controllers import klipper_probe, target
from errormodel.controllers.base import Controller
from errormodel.controllers.thermal import laws_of
from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec, Joint
from errormodel.machine_file import read_machine
from identification.compensation.assessment import assess, emulated
from identification.compensation.field import Field
from identification.estimation.fit import fit_machine
from identification.results.store import save
from tests.helpers.chains import Array, errors
from tests.helpers.commands import MILL, Fill, done, run, tree, write
from tests.helpers.compensation import UM, field_of, tables_of, volume_of
from tests.helpers.nightly import first_of
from tests.helpers.surveys import measured, positions, survey

pytestmark = pytest.mark.usefixtures("few_poses")


@pytest.fixture(scope="module")
def fitted(with_mill: Fill, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return with_mill(tmp_path_factory.mktemp("mill"))


def test_a_machine_turned_round_has_its_errors_in_the_controllers_axes() -> None:
    """X and Y both written the other way: the same machine seen from behind."""
    machine = read_machine(MILL)
    turned = replace(
        machine,
        elements=tuple(
            replace(e, axis=(-e.axis[0], -e.axis[1], e.axis[2])) if isinstance(e, Joint) else e
            for e in machine.elements
        ),
    )
    chain = Chain(turned)
    controller, tables, setup = tables_of("etalon", volume := volume_of(turned, errors(chain, 3)))
    assert assess(volume, emulated(controller, tables, setup, volume), None, 0)[0].removed() > 0.97
    _, tables, _ = tables_of("etalon", volume_of(turned, chain.vector({"X.dx.2": 0.02})))
    (exx,) = (t for t in tables if t.term.output == "EXX")
    middle = len(exx.values) // 2
    bow = exx.values[[0, -1]].mean() - exx.values[middle]  # 20 um along x, which is minus X of the controller
    assert bow == pytest.approx(-0.02, rel=0.05)
    upside = replace(
        machine,
        elements=tuple(
            replace(e, axis=(e.axis[0], e.axis[1], -e.axis[2])) if isinstance(e, Joint) else e for e in machine.elements
        ),
    )
    with pytest.raises(InputError, match="left-handed"):
        controller.suits(volume_of(upside, np.zeros(len(Chain(upside).ids))).setup(None, None)[0])


@pytest.fixture(scope="module")
def warmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fit of a machine whose X screw grows by 11 um/m a kelvin, surveyed between 18 and 30 degC."""
    folder = tmp_path_factory.mktemp("warm")
    machine = replace(
        read_machine(MILL),
        effects=(EffectSpec("scale-expansion", {"joint": "X", "sensor": "T_x"}),),
    )
    chain = Chain(machine)
    identity = chain.effect_ids[0][0]
    rng = np.random.default_rng(0)
    points = pd.DataFrame({j.name: rng.uniform(*j.travel, 150) for j in machine.joints})
    points = points.assign(tool_x=0.0, tool_y=0.0, tool_z=-100.0, T_x=rng.uniform(18, 30, 150))
    table = positions(measured(machine, chain.vector({identity: 11e-6}), seed=4, noise=1 * UM, points=points))
    save(fit_machine(machine, survey(table)), folder / "fit")
    return folder / "fit"


@pytest.mark.parametrize("name", first_of(["siemens-lec", "isg", "siemens-cec"], 2))
def test_the_controllers_own_temperature_compensation_takes_the_place_of_tables(
    name: str, warmed: Path, tmp_path: Path
) -> None:
    out = done("compensate", warmed, "--controller", name, "--out", tmp_path).out
    (file,) = (tmp_path / f for f in ("TEMP_COMP.INI", "temp_comp.lis") if (tmp_path / f).exists())
    (law,) = laws_of(file.read_text())
    assert (law.axis, law.sensor) == ("X", "T_x")
    assert law.slope == pytest.approx(-11e-6, rel=0.02)
    assert "in place of a folder for each temperature" in out
    assert "not certain: the sign" in out
    assert "towards minus" in (tmp_path / "sign_test/temperature.txt").read_text()
    data = json.loads((tmp_path / "compensation.json").read_text())
    own = data["own_temperature_compensation"]["figures"]
    for figures, stated in zip(own, data["sets"], strict=True):
        alone = stated["figures"][0]["after"]["rms_um"]
        assert figures["after"]["rms_um"] < alone + 0.3  # as good as tables of its own
        assert stated["figures"][0]["before"]["rms_um"] == figures["before"]["rms_um"]


def test_a_table_for_each_temperature(warmed: Path, tmp_path: Path) -> None:
    out = done("compensate", warmed, "--controller", "linuxcnc-type1", "--out", tmp_path / "out").out
    folders = sorted(p.name for p in (tmp_path / "out").iterdir() if p.is_dir() and p.name != "sign_test")
    assert len(folders) == 3
    assert all(re.fullmatch(r"T_x_\d\d\.\d", name) for name in folders)
    spans = []
    for name in folders:
        rows = np.loadtxt(tmp_path / "out" / name / "joint_0_X.comp")
        spans.append(np.polyfit(rows[:, 0], rows[:, 1], 1)[0] * 1e6)
    warm = [float(name[4:]) for name in folders]
    assert np.polyfit(warm, spans, 1)[0] == pytest.approx(-11, rel=0.1)  # um/m a kelvin, taken back
    assert "at T_x = " in out


def test_a_spindle_that_grows_is_no_motion_of_the_workpiece(tmp_path: Path) -> None:
    """Klipper's z_thermal_adjust adds -temp_coeff times the warming: a tool that grows downwards is lifted."""
    machine = replace(read_machine(MILL), effects=(EffectSpec("spindle-growth", {"sensor": "T_spindle"}),))
    chain = Chain(machine)
    rng = np.random.default_rng(0)
    points = pd.DataFrame({j.name: rng.uniform(*j.travel, 150) for j in machine.joints})
    points = points.assign(tool_x=0.0, tool_y=0.0, tool_z=-100.0, T_spindle=rng.uniform(18, 30, 150))
    table = positions(measured(machine, chain.vector({chain.effect_ids[0][0]: 4e-3}), seed=4, points=points))
    save(fit_machine(machine, survey(table)), tmp_path / "fit")
    for name in ("klipper", "siemens-lec"):
        done("compensate", tmp_path / "fit", "--controller", name, "--out", tmp_path / name)
        data = json.loads((tmp_path / name / "compensation.json").read_text())
        for own, stated in zip(data["own_temperature_compensation"]["figures"], data["sets"], strict=True):
            kelvin = stated["state"]["T_spindle"] - data["sets"][1]["state"]["T_spindle"]
            assert own["before"]["rms_um"] == pytest.approx(abs(4 * kelvin), abs=0.3)
            assert own["after"]["rms_um"] < 0.3
            assert stated["figures"][0]["after"]["rms_um"] < 0.3
    coefficient = re.search(r"temp_coeff: (\S+)", (tmp_path / "klipper/z_thermal_adjust.cfg").read_text())
    assert coefficient is not None
    assert float(coefficient[1]) == pytest.approx(-4e-3, rel=0.02)


@pytest.mark.long
def test_a_probe_beside_the_nozzle_reads_as_the_nozzle_does(fitted: Path, tmp_path: Path) -> None:
    """The bed is touched twice, exactly, by nozzle and probe: what Klipper adds makes the readings agree."""
    machine = read_machine(MILL)
    chain = Chain(machine)
    volume = volume_of(machine, chain.vector({"X.ea.1": 2e-4, "Y.eb.1": -1e-4, "X.dz.2": 0.05}))
    setup = replace(volume.setup(None, None)[0], probe=(30.0, -25.0))
    klipper = target("klipper")
    assert isinstance(klipper, Controller)
    found = klipper.probing(setup, volume.gap(setup))
    twist = klipper_probe.read(found.files["axis_twist.cfg"])
    field, joints = volume.field, [j.name for j in machine.joints]
    x, y = (np.random.default_rng(0).uniform(t.low, t.high, 40) for t in twist.values())
    readings = []
    for dx, dy in ((0.0, 0.0), (30.0, -25.0)):
        q = np.zeros((40, 3))
        q[:, joints.index("X")], q[:, joints.index("Y")] = x - dx, y - dy
        tool = np.tile(np.asarray(machine.tool) + np.array([dx, dy, 0.0]), (40, 1))
        bed = field.nominal(q, tool)[:, 2]
        for _ in range(5):  # Z goes down until the tip is there
            q[:, joints.index("Z")] -= field.actual(q, np.ones_like(q), tool)[:, 2] - bed
        readings.append(q[:, joints.index("Z")])
    nozzle, probe = readings
    assert np.ptp(probe - nozzle) > 8 * UM
    assert np.ptp(probe + twist["X"].at(x) + twist["Y"].at(y) - nozzle) < 0.2 * UM
    assert found.after_um[1] < 0.2 < 4 < found.before_um[1]
    ends = np.array([twist["X"].low - 10.0, twist["X"].high + 10.0])  # straight on beyond the ends
    steps = np.diff(twist["X"].values)[[0, -1]] * 10 / (twist["X"].high - twist["X"].low) * (len(twist["X"].values) - 1)
    np.testing.assert_allclose(twist["X"].at(ends), twist["X"].values[[0, -1]] + [-1, 1] * steps)
    more = ("--probe", 30, -25, "--out", tmp_path)
    out = done("compensate", fitted / "fit", "--controller", "klipper", *more).out
    assert "what a probe reads against the nozzle" in out
    assert (tmp_path / "axis_twist.cfg").exists()
    result = run("compensate", fitted / "fit", "--controller", "duet", *more)
    assert (result.code, "corrects no readings" in result.err) == (2, True)


def test_tables_are_for_one_tool_and_say_what_they_do_to_others(tmp_path: Path) -> None:
    machine = read_machine(MILL)
    p = Chain(machine).vector({"X.eb.1": 4e-4, "X.dz.1": 1 * UM})  # pitch: nothing at the table, much at a long tool
    tools = ((0.0, 0.0, -60.0), (0.0, 0.0, -260.0))
    table = positions(measured(machine, p, 160, 1, noise=1 * UM, tools=tools))
    save(fit_machine(machine, survey(table)), tmp_path / "fit")
    for tip in tools:
        more = ("--tool", *tip, "--out", tmp_path / "out")
        out = done("compensate", tmp_path / "fit", "--controller", "csv", *more).out
        assert f"these are for the tip at 0 0 {tip[2]:g} (--tool)" in out
        data = json.loads((tmp_path / "out/compensation.json").read_text())
        assert data["tool"] == list(tip)
        own, other = data["sets"][0]["figures"][1:]
        assert "this tool" in own["poses"]
        assert own["removed"] > 0.97
        assert other["after"]["rms_um"] > 3 * own["after"]["rms_um"]
        if other["after"]["rms_um"] > other["before"]["rms_um"]:
            assert "WORSE THAN WITHOUT THEM" in out
            assert "only do harm" in out


def test_a_programme_that_was_corrected_is_not_corrected_again(fitted: Path, tmp_path: Path) -> None:
    """It says so itself, wherever it lies; line ends and the bytes of comments are those of the plain programme."""
    (tmp_path / "p.ngc").write_bytes(b"G21 G90 G17 (F\xe4se)\r\nG0 X0 Y0 Z300\r\nG1 X20 Y10 F500\r\nM2\r\n")
    command = ("compensate", fitted / "fit", "--controller", "gcode", "--dialect", "iso", "--at", "start=X0,Y0,Z300")
    done(*command, "--program", tmp_path / "p.ngc", "--out", tmp_path / "a")
    written = (tmp_path / "a/p.ngc").read_bytes()
    assert written.count(b"\n") == written.count(b"\r\n") > 3
    assert b"(F\xe4se)\r\n" in written
    moved = write(tmp_path / "elsewhere/q.ngc", written)
    for path in (tmp_path / "a/p.ngc", moved):
        again = run(*command, "--program", path, "--out", tmp_path / "b")
        assert (again.code, "corrected already" in again.err) == (2, True)


def test_the_command_prints_writes_and_repeats_itself(fitted: Path, tmp_path: Path) -> None:
    first = done("compensate", fitted / "fit", "--controller", "isg", "--out", tmp_path / "a").out
    for text in (
        "before", "after an ideal compensation", "after these tables", "worst then at X=", "60 rows left out",
        "region:", "activation", "[ ] ", "not certain from public sources", "sign_test/steps.txt",
    ):  # fmt: skip
        assert text in first, text
    done("compensate", fitted / "fit", "--controller", "isg", "--out", tmp_path / "b", "--quiet")
    a, b = tree(tmp_path / "a"), tree(tmp_path / "b")
    assert {*a} >= {"vol_comp_0.csv", "vol_comp_0.lis", "sign_test/check_1_X.nc", "checklist.txt", "compensation.json"}
    assert {k: v for k, v in a.items() if k != "checklist.txt"} == {k: v for k, v in b.items() if k != "checklist.txt"}
    assert f"checklist.txt and compensation.json written to {tmp_path / 'a'}" in first
    data = json.loads(a["compensation.json"])
    assert data["schema"] == "errormodel.compensation/1"
    assert data["region"]["X"]["travel"] == [-380.0, 380.0]
    assert {f["poses"][:4] for f in data["sets"][0]["figures"]} == {"1032", "60 r"}
    assert data["sets"][0]["figures"][0]["removed"] > 0.97


def test_the_list_names_every_controller() -> None:
    lines = done("compensate", "--controller", "list").out.splitlines()
    assert {line.split()[0] for line in lines} >= {"csv", "gcode", "isg", "siemens-cec", "linuxcnc-type0", "duet"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--controller", "sinumerik"), ("--controller sinumerik", "there is no such controller", "siemens-cec")),
        (("--controller", "linuxcnc-type1", "--points", 300), ("300 points", "the format holds 2 to 256")),
        (("--controller", "csv", "--points", 150), ("--points", "150 points on 3 axes", "Ask for fewer")),
        (("--controller", "csv", "--resolution", 0), ("--resolution", "least increment")),
        (("--controller", "gcode", "--program", "none.nc"), ("none.nc", "cannot be read")),
        (("--controller", "gcode"), ("--controller gcode", "--program is missing")),
        (("--controller", "csv", "--program", "a.nc"), ("--program", "takes tables")),
        (("--controller", "csv", "--at", "start=X0"), ("--at", "takes tables")),
    ],
)
def test_wrong_requests_are_refused_and_write_nothing(
    arguments: tuple[object, ...], words: tuple[str, ...], fitted: Path, tmp_path: Path
) -> None:
    result = run("compensate", fitted / "fit", *arguments, "--out", tmp_path / "out")
    assert result.code == 2
    assert result.err.count("\n") == 1
    assert all(w in result.err for w in words), result.err
    assert not (tmp_path / "out").exists()


def test_what_is_no_fit_is_refused(tmp_path: Path, fitted: Path) -> None:
    result = run("compensate", tmp_path, "--controller", "csv", "--out", tmp_path / "out")
    assert (result.code, "errormodel fit" in result.err) == (2, True)
    result = run("compensate", fitted / "fit", "--controller", "csv")
    assert (result.code, "--out is missing" in result.err) == (2, True)


@pytest.mark.long
def test_an_arm_takes_no_tables_but_corrected_commands(tmp_path: Path) -> None:
    machine = read_machine("six_axis_arm")
    chain = Chain(machine)
    p = errors(chain, 1, um=300.0, urad=500.0)
    table = positions(measured(machine, p, 120, 1, noise=20 * UM))
    save(fit_machine(machine, survey(table)), tmp_path / "fit")
    for name in ("linuxcnc-type0", "isg", "klipper"):
        result = run("compensate", tmp_path / "fit", "--controller", name, "--out", tmp_path / "out")
        assert result.code == 2
        assert "moves by rotary joints only" in result.err
    wanted = pd.DataFrame(np.random.default_rng(0).uniform(-150, 150, (20, 6)), columns=[f"J{k}" for k in range(1, 7)])
    wanted.to_csv(tmp_path / "path.csv", index=False)
    done(
        "compensate",
        tmp_path / "fit",
        "--controller",
        "gcode",
        "--program",
        tmp_path / "path.csv",
        "--out",
        tmp_path / "o",
    )
    sent = np.radians(pd.read_csv(tmp_path / "o/path.csv").to_numpy())
    truth = field_of(machine, p)
    came, asked = np.ones_like(sent), np.radians(wanted.to_numpy())
    before, after = (gap_rms(truth, commands, asked, came) for commands in (asked, sent))
    assert after < 0.2 * before


def gap_rms(field: Field, commands: Array, asked: Array, came: Array) -> float:
    """Root mean square distance of where commands lead from where they were asked to, after the best frame."""
    from identification.compensation.volume import best_frame

    nominal = field.nominal(asked)
    gap = field.actual(commands, came) - nominal
    return float(np.sqrt(np.mean(np.square(gap - (best_frame(gap, nominal).apply(nominal) - nominal)).sum(axis=1))))


def test_a_programme_is_corrected_checked_and_what_was_found_is_said(fitted: Path, tmp_path: Path) -> None:
    machine = read_machine(MILL)
    x, y, z = (sum(j.travel) / 2 for j in machine.joints if j.type == "prismatic")
    names = [j.name for j in machine.joints if j.type == "prismatic"]
    place = dict(zip(names, (x, y, z), strict=True))
    lines = ["G21 G90 G17 G54 (part)", "T1 M6", "G0 X0 Y0", "G0 Z10", "M3 S900", "G1 Z-5 F200", "X100 F900"]
    text = "\n".join([*lines, "G3 X120 Y20 J20", "G0 Z50", "M30"]) + "\n"
    (tmp_path / "part.nc").write_text(text)
    offset = "G54=" + ",".join(f"{n}{v:g}" for n, v in place.items())
    ask = (
        "compensate",
        fitted / "fit",
        "--controller",
        "gcode",
        "--program",
        tmp_path / "part.nc",
        "--out",
        tmp_path / "o",
    )
    refused = run(*ask)
    assert refused.code == 2
    assert "part.nc, line 3 ('G0 X0 Y0'): the work offset G54 is not known" in refused.err
    assert not (tmp_path / "o").exists()
    said = done(*ask, "--offset", offset).out
    found = re.search(r"part.nc: 2 rapids, 3 cuts .* path ([\d.]+) um .* rapids' ends ([\d.]+) um", said)
    assert found is not None, said
    assert 0 < float(found[1]) < 1.0
    out = (tmp_path / "o/part.nc").read_text().splitlines()
    assert out[0].startswith("(CORRECTED BY ERRORMODEL FOR ")
    assert [out[1], out[2], out[5]] == ["G21 G90 G17 G54 (part)", "T1 M6", "M3 S900"]
    assert out[3] == "G0 X0 Y0"
    assert re.fullmatch(r"G0 Z(10\.0|9\.9)\d+", out[4])
    with_notes = json.loads((tmp_path / "o/compensation.json").read_text())["sets"][0]["notes"]
    assert found[0] in with_notes[0]
    (tmp_path / "part.nc").write_bytes(text.replace("M3", "M3\xb3").encode("latin-1"))
    assert "part.nc, line 5, column 3: '\\udcb3' is no printable ASCII" in run(*ask, "--offset", offset).err


@pytest.mark.parametrize("name", ["checklist.txt", "compensation.json", "Manifest.json"])
def test_a_programme_with_the_name_of_an_own_file_is_refused(with_mill: Fill, tmp_path: Path, name: str) -> None:
    """It would be replaced by that file."""
    folder = with_mill(tmp_path)
    (tmp_path / name).write_text("G0 X0 Y0 Z0\n")
    ask = ("compensate", folder / "fit", "--controller", "gcode", "--program", tmp_path / name, "--out", tmp_path / "o")
    refused = run(*ask)
    assert refused.code == 2
    assert "Rename the programme" in refused.err
    assert not (tmp_path / "o").exists()
