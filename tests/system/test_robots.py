"""From a robot's description to a calibrated one: machine, simulate, fit, export, each through its command."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from pytransform3d.urdf import UrdfTransformManager

from errormodel import read_machine, simulate
from errormodel.chain import Chain
from errormodel.machine import EffectSpec
from errormodel.machine_file import write_machine
from errormodel.machine_formats.base import Extras, registry
from errormodel.simulation import random_points
from identification import export, fit, import_machine, machine_formats, save
from identification.estimation.fit import fit_machine
from identification.results import store
from tests.helpers.commands import done, run, tree, write
from tests.helpers.robots import ROBOTS, frames, positions, read_text
from tests.helpers.surveys import measured, survey
from tests.helpers.surveys import positions as without_orientations

TOOL = (40.0, -100.0, 0.0)
# an arm as it is built: constants of its members, mm and rad, as large as those of real ones
TRUTH = {
    "L1.dx": -0.4, "L1.ea": 3e-4, "L2.dx": -0.9, "L2.ea": 4e-4, "L2.eb": 3e-4, "L3.dx": 0.5, "L3.ec": -6e-4,
    "L4.dy": -0.3, "L4.ea": 5e-4, "L5.dz": 0.2, "L5.ec": -7e-4,
}  # fmt: skip

READY = read_text(ROBOTS["UR5e"].csv(), "dh")


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A table, its machine, a simulated survey in a frame of its own, and the fit."""
    folder = tmp_path_factory.mktemp("arm")
    write(folder / "ur5e.csv", "# convention: standard\n" + ROBOTS["UR5e"].csv())
    done("machine", folder / "ur5e.csv", "--tool", *TOOL, "--name", "UR5e of the cell", "--out", folder / "m.yaml")
    truth = "".join(f"  {k}: {v}\n" for k, v in TRUTH.items())
    frame = "frame: {translation: [1500, -900, 300], rotation: [2, -3, 40]}\n"
    write(folder / "truth.yaml", f"parameters:\n{truth}{frame}")
    words = ["--parameters", folder / "truth.yaml", "--seed", 4, "--out", folder / "s.csv"]
    done("simulate", folder / "m.yaml", 120, "--noise", 1e-7, *words)
    done("fit", folder / "m.yaml", folder / "s.csv", "--out", folder / "fit")
    return folder


def test_a_machine_of_a_table_describes_plans_and_fits(arm: Path) -> None:
    machine = read_machine(arm / "m.yaml")
    assert (machine.name, machine.tool) == ("UR5e of the cell", TOOL)
    assert all(not j.models for j in machine.joints)
    assert all(len(s.motions) == 6 for s in machine.shapes)
    # 30 of a 6-D target in a frame of its own, less three of its orientation and four of J1, here the reference
    assert "rank 23" in done("describe", arm / "m.yaml").out
    fitted = json.loads((arm / "fit/fit.json").read_text())["fitted"]
    assert fitted["rms_um"] < 1e-3  # the noise, 1e-4 um a coordinate


@pytest.mark.parametrize(
    ("form", "name"),
    [("urdf", "c.urdf"), ("dh", "c.csv"), ("dh", "c.yaml"), ("dh-modified", "c.csv"), ("ur-calibration", "c.yaml")],
)
def test_a_calibrated_description_is_the_arm_that_was_measured(arm: Path, tmp_path: Path, form: str, name: str) -> None:
    """Distances between any two poses, which no frame changes, against the exact simulation; nominal: 1 mm away."""
    result = done("export", arm / "fit", "--format", form, "--out", tmp_path / name)
    figure = re.search(r"at most (\S+) mm", result.out)
    assert figure
    assert float(figure[1]) < 1e-9
    machine = read_machine(arm / "m.yaml")
    q = positions(machine.joints, 60, seed=9)
    commands = dict(zip((j.name for j in machine.joints), np.degrees(q).T, strict=True))
    import pandas as pd

    actual = simulate(machine, pd.DataFrame(commands), TRUTH)[["mx", "my", "mz"]].to_numpy()
    text = (tmp_path / name).read_text()
    back = read_text(text, form)
    tip = np.array([*TOOL, 1.0])
    if form == "ur-calibration":  # the tool centre point that the command tells
        point = re.search(r"p\[(.*?)\]", result.err)
        assert point
        tip[:3] = [1e3 * float(v) for v in point[1].split(",")[:3]]
    elif form == "urdf":  # its last link is the functional point
        tip[:3] = 0.0
    found = (frames(back, q) @ tip)[:, :3]
    nominal = (frames(machine, q) @ [*TOOL, 1.0])[:, :3]
    assert np.abs(distances(found) - distances(actual)).max() < 2e-5  # noise of the survey; a told point has 1e-4 mm
    assert np.abs(distances(nominal) - distances(actual)).max() > 1.0


def distances(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[:, None] - points[None], axis=2)


def test_a_calibrated_urdf_in_another_reader(arm: Path, tmp_path: Path) -> None:
    done("export", arm / "fit", "--format", "urdf", "--out", tmp_path / "c.urdf")
    manager = UrdfTransformManager()
    manager.load_urdf((tmp_path / "c.urdf").read_text())
    back = read_text((tmp_path / "c.urdf").read_text())
    q = positions(back.joints, 10)
    expected = frames(back, q)
    for row, frame in zip(q, expected, strict=True):
        for joint, value in zip(back.joints, row, strict=True):
            manager.set_joint(joint.name, value)
        other = np.array(manager.get_transform("tool_point", "base_link"))
        assert np.abs(1e3 * other[:3, 3] - frame[:3, 3]).max() < 1e-6


def test_a_calibration_file_is_what_the_driver_reads(arm: Path, tmp_path: Path) -> None:
    """Keys, units and the arm's own hash; member by member near the maker's nominal file of ur_description."""
    words = ["--format", "ur-calibration", "--hash", "calib_123", "--out", tmp_path / "c.yaml"]
    result = done("export", arm / "fit", *words)
    assert "--hash" not in result.err
    found = yaml.safe_load((tmp_path / "c.yaml").read_text())["kinematics"]
    assert found.pop("hash") == "calib_123"
    nominal = {  # m: x, y, z of default_kinematics.yaml of the UR5e
        "shoulder": (0, 0, 0.1625), "upper_arm": (0, 0, 0), "forearm": (-0.425, 0, 0), "wrist_1": (-0.3922, 0, 0.1333),
        "wrist_2": (0, -0.0997, 0), "wrist_3": (0, 0.0996, 0),
    }  # fmt: skip
    assert list(found) == list(nominal)
    for member, place in nominal.items():
        assert list(found[member]) == ["x", "y", "z", "roll", "pitch", "yaw"]
        assert all(isinstance(v, float) for v in found[member].values())
        assert np.abs(np.array([found[member][k] for k in "xyz"]) - place).max() < 2e-3, member
    turned = {"shoulder": 0, "upper_arm": np.pi / 2, "forearm": 0, "wrist_1": 0, "wrist_2": np.pi / 2}
    for member, roll in turned.items():
        assert abs(found[member]["roll"] - roll) < 2e-3
        assert max(abs(found[member]["pitch"]), abs(found[member]["yaw"])) < 2e-3
    back = import_machine(tmp_path / "c.yaml")
    assert [s.name for s in back.machine.shapes] == [*nominal, "flange"]
    assert back.machine.joints[2].name == "elbow_joint"


def test_numbers_of_a_calibration_file_are_numbers_to_old_readers_too() -> None:
    """In YAML 1.1 an exponent without a point is a text: 1e-05."""
    elements = tuple(replace(s, offset=(0.01, 0.0, 0.0)) if s.name == "L3" else s for s in READY.elements)
    text = registry()["ur-calibration"].write(replace(READY, elements=elements), ".yaml", Extras()).text
    found = yaml.safe_load(text)["kinematics"]
    assert "e-05" in text
    assert all(isinstance(v, float) for m, own in found.items() if m != "hash" for v in own.values())


def test_the_same_fit_gives_the_same_bytes_and_nothing_is_written_over(arm: Path, tmp_path: Path) -> None:
    for form in machine_formats():
        for name in ("a.csv", "b.csv"):
            done("export", arm / "fit", "--format", form, "--out", tmp_path / form / name, "--quiet")
        assert (tmp_path / form / "a.csv").read_bytes() == (tmp_path / form / "b.csv").read_bytes()
    done("export", arm / "m.yaml", "--format", "urdf", "--out", arm / "m.urdf")
    before = tree(arm)
    for words in (
        ("export", arm / "fit", "--format", "urdf", "--out", arm / "fit/fit.json"),
        ("export", arm / "fit", "--format", "urdf", "--out", arm / "fit/machine.yaml"),
        ("export", arm / "m.yaml", "--format", "urdf", "--out", arm / "m.yaml"),
        ("machine", arm / "ur5e.csv", "--format", "dh", "--out", arm / "ur5e.csv"),
        ("machine", arm / "m.urdf", "--out", arm / "ur5e.csv"),
    ):
        assert run(*words).code == 2, words
    assert tree(arm) == before


@pytest.mark.long
def test_what_no_constant_is_becomes_the_nearest_constants_and_is_said(arm: Path, tmp_path: Path) -> None:
    """Gravity bends a joint, and another turns unevenly: most of it has a mean, and the rest is told with its size."""
    machine = read_machine(arm / "m.yaml")
    joints = (*(replace(e, models={"ec": models()}) if e.name == "J2" else e for e in machine.elements),)
    machine = replace(machine, elements=joints)
    bent = {"L2.dx": -0.9, "J2.ec.cos1": 8e-4, "J2.ec.sin1": 2e-4}
    result = fit(machine, simulate(machine, 200, bent, noise=1e-4, seed=2))
    described = export(result, "dh")
    table = described.figures.set_index("geometry")
    assert table.loc["description", "rms_um"] < 0.8 * table.loc["nominal", "rms_um"]
    assert table.loc["description", "rms_um"] > 10  # a harmonic is no constant
    assert "error motions of J2 over its position" in described.summary()
    assert described.read_back_mm < 1e-9
    # the left-out part alone, by its own formula: the lever of J2 times the spread of its angle about its mean
    path = save(result, tmp_path / "fit")
    assert "no constant" in done("export", path, "--format", "dh", "--out", tmp_path / "c.csv").out
    # without that curve the same constants come out exactly
    plain = replace(machine, elements=read_machine(arm / "m.yaml").elements)
    exact = export(fit(plain, simulate(plain, 200, {"L2.dx": -0.9}, noise=1e-7, seed=2)), "dh")
    assert exact.figures.set_index("geometry").loc["description", "rms_um"] < 1e-6


def models() -> object:
    from errormodel.machine import Basis

    return Basis("harmonic", 1)


def test_an_effect_is_named_with_its_joint(arm: Path, tmp_path: Path) -> None:
    machine = read_machine(arm / "m.yaml")
    effect = EffectSpec("eccentricity", {"joint": "J1", "harmonic": 1})
    machine = replace(machine, effects=(effect,))
    write_machine(machine, tmp_path / "e.yaml")
    own = Chain(read_machine(tmp_path / "e.yaml")).effect_ids[0]
    said = export(fit(machine, simulate(machine, 150, {own[0]: 3e-4}, noise=1e-4, seed=3)), "urdf").summary()
    assert re.search(r"eccentricity of J1 +\d", said), said


def test_constants_are_of_the_load_that_is_said(arm: Path, tmp_path: Path) -> None:
    """A shoulder that yields to the payload: its table had been for 14 kg, and said of none."""
    machine = read_machine(arm / "m.yaml")
    machine = replace(machine, effects=(EffectSpec("joint-compliance", {"joint": "J2", "payload": True}),))
    chain = Chain(machine)
    payload = next(i for i in chain.ids if i.endswith("joint-compliance-payload"))
    points = random_points(machine, 150, 1).assign(load=np.resize([0.0, 14.0, 14.0], 150))
    table = without_orientations(measured(machine, chain.vector({payload: 3e-8}), points=points, noise=1e-3))
    store.save(fit_machine(machine, survey(table)), tmp_path / "fit")
    ask = ("export", tmp_path / "fit", "--format", "dh", "--out")
    said, left = {}, {}
    for load, option in ((14, ()), (0, ("--load", 0))):
        said[load] = done(*ask, tmp_path / f"{load}.csv", *option).out
        assert f"at load = {load} kg" in (tmp_path / f"{load}.csv").read_text().splitlines()[0]
        assert f"the constants hold at load = {load} kg (another load: --load)" in said[load]
        left[load] = [float(n) for n in re.findall(r"this description.*? +(\d+\.\d\d) +\d", said[load])]
        assert f"this description, at load = {14 - load} kg" in said[load]
    assert left[0][0] < 2  # without a payload nothing yields
    assert left[0][1] > 10 * left[0][0]
    refused = run(*ask, tmp_path / "x.csv", "--load", -1)
    assert (refused.code, "--load" in refused.err) == (2, True)
    refused = run("export", "six_axis_arm", "--format", "dh", "--out", tmp_path / "x.csv", "--load", 3)
    assert (refused.code, "without a fit" in refused.err) == (2, True)


def test_a_machine_without_a_fit_is_described_too(tmp_path: Path) -> None:
    result = done("export", "six_axis_arm", "--format", "dh", "--out", tmp_path / "a.csv")
    assert "no fit" in result.out
    rows = [line.split(",") for line in (tmp_path / "a.csv").read_text().splitlines() if line.startswith("J")]
    assert [float(row[2]) for row in rows] == [0, -612, -572.3, 0, 0, 0]
    assert [float(row[4]) for row in rows] == [127.3, 0, 0, 163.941, 115.7, 92.2]


def test_export_says_what_is_missing(tmp_path: Path) -> None:
    assert [line.split()[0] for line in done("export", "list").out.splitlines()] == list(machine_formats())
    for words, said in (
        (("six_axis_arm",), "--format is missing"),
        (("six_axis_arm", "--format", "dh"), "--out is missing"),
        (("six_axis_arm", "--format", "sdf", "--out", tmp_path / "a"), "'sdf'"),
        (("no_such_arm", "--format", "dh", "--out", tmp_path / "a"), "no such file"),
        (("vertical_three_axis", "--format", "ur-calibration", "--out", tmp_path / "a"), "six rotary joints"),
    ):
        result = run("export", *words)
        assert (result.code, result.out.count("written")) == (2, 0)
        assert said in result.err
    assert not tree(tmp_path)
