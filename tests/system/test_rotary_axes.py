"""Constant errors of rotary axes: found where they are, put into the kinematic description, tables for the rest."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from errormodel.chain import Chain
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from errormodel.simulation import random_points
from identification.compensation.assessment import left, nothing
from identification.compensation.rotary_axes import described, lines_of
from identification.compensation.volume import Volume
from identification.estimation.fit import fit_machine
from identification.results.store import save
from tests.helpers.commands import Fill, done, run
from tests.helpers.compensation import UM, volume_of
from tests.helpers.surveys import measured, positions, survey

pytestmark = pytest.mark.usefixtures("few_poses")
TRUNNION = "trunnion_five_axis"
SECOND_ORDER_UM = 0.01  # products of errors of some 50 um and 50 urad


def trunnion(**errors: float) -> Volume:
    machine = read_machine(TRUNNION)
    return volume_of(machine, Chain(machine).vector({k.replace("_", "."): v for k, v in errors.items()}))


@pytest.mark.parametrize(
    ("errors", "axis", "shift", "tilt"),
    [
        # what follows the trunnion lies further along x: the table's axis lies back
        ({"trunnion_dx": 30 * UM}, "C", (-0.03, 0, 0), (0, 0, 0)),
        # everything behind the trunnion's axis further along y: both axes lie back
        ({"base_dy": 20 * UM}, "A", (0, -0.02, 0), (0, 0, 0)),
        ({"base_ec": 30e-6}, "A", (0, 0, 0), (0, 0, -30e-6)),
        # about a point 50 mm above the table, in which the axis is shifted then, too
        ({"trunnion_ea": 50e-6}, "C", (0, -0.0025, 0), (-50e-6, 0, 0)),
    ],
)
def test_a_displaced_axis_is_found_and_its_description_leaves_nothing(
    errors: dict[str, float], axis: str, shift: tuple[float, ...], tilt: tuple[float, ...]
) -> None:
    volume = trunnion(**errors)
    setup = volume.setup(None, None)[0]
    lines = lines_of(volume, setup)
    found = next(x for x in lines if x.axis == axis)
    np.testing.assert_allclose(found.shift, shift, atol=1e-5)
    np.testing.assert_allclose(found.tilt, tilt, atol=1e-8)
    assert found.side == "table"
    known = replace(volume, field=described(volume.field, setup, lines))
    assert left(volume, nothing, 0).rms_um > 5
    assert left(known, nothing, 0).rms_um < SECOND_ORDER_UM


@pytest.mark.long
def test_what_the_description_takes_is_nothing_for_the_tables(tmp_path: Path) -> None:
    machine = read_machine(TRUNNION)
    chain = Chain(machine)
    p = chain.vector({"trunnion.dx": 30 * UM, "base.dy": 20 * UM, "trunnion.ea": 40e-6, "X.dz.2": 8 * UM})
    save(fit_machine(machine, survey(positions(measured(machine, p, 200, 1, noise=0.5 * UM)))), tmp_path / "fit")
    ask = ("compensate", tmp_path / "fit", "--controller", "siemens-lec", "--out")
    hint = done(*ask, tmp_path / "plain").out
    assert "--kinematics writes it" in hint
    assert not (tmp_path / "plain/kinematics.txt").exists()
    said = done(*ask, tmp_path / "o", "--kinematics").out
    assert "FIRST: put the rotary axes of kinematics.txt" in said
    text = (tmp_path / "o/kinematics.txt").read_text()
    found = re.search(r"axis C \(carries the workpiece\): shift x (-0\.\d+) mm", text)
    assert found is not None, text
    assert float(found[1]) == pytest.approx(-0.03, abs=2e-3)
    assert max(map(len, text.splitlines())) <= 120
    # two tables: I2 to the trunnion's axis, I3 from there to the table's, I4 closes
    vectors = {k: np.array(v.split(), dtype=float) for k, v in re.findall(r"(I\d) \(\$TC_CARR[^)]*\): ([^;]*)", text)}
    np.testing.assert_allclose(vectors["I2"] + vectors["I3"] + vectors["I4"], 0, atol=2e-4)
    assert vectors["I3"][0] == pytest.approx(-0.03, abs=2e-3)
    assert vectors["I2"][1] == pytest.approx(-0.02, abs=2e-3)
    result = {n: json.loads((tmp_path / n / "compensation.json").read_text()) for n in ("plain", "o")}
    after = {n: r["sets"][0]["conditions"]["left_um"] for n, r in result.items()}
    assert after["o"] < 0.3 * after["plain"]
    assert result["o"]["rotary_axes"]["tables_alone_um"] > 3 * after["o"]
    fanuc = done("compensate", tmp_path / "fit", "--controller", "fanuc-pitch", "--out", tmp_path / "f", "--kinematics")
    assert fanuc.code == 0
    assert "19700 to 19702 (position of the rotary table)" in (tmp_path / "f/kinematics.txt").read_text()


def test_where_axes_lie_is_said_for_the_state_it_holds_in(tmp_path: Path) -> None:
    """A spindle that grows by 2 um/K moves the trunnion's axis beside the tool, and nothing said when."""
    plain = read_machine(TRUNNION)
    machine = replace(
        plain, effects=(EffectSpec("spindle-growth", {"sensor": "T_spindle", "element": plain.elements[-1].name}),)
    )
    chain = Chain(machine)
    growth = next(i for i in chain.ids if "spindle-growth" in i)
    points = random_points(machine, 150, 1).assign(T_spindle=np.linspace(20.0, 30.0, 150))
    p = chain.vector({"trunnion.dx": 30 * UM, growth: 2 * UM})
    save(fit_machine(machine, survey(positions(measured(machine, p, points=points, noise=0.5 * UM)))), tmp_path / "f")
    ask = ("compensate", tmp_path / "f", "--controller", "heidenhain", "--points", "3", "--out")
    said = " ".join(done(*ask, tmp_path / "o", "--kinematics").out.split())
    found = json.loads((tmp_path / "o/compensation.json").read_text())
    rotary, sets = found["rotary_axes"], found["sets"]
    warm = [s["state"]["T_spindle"] for s in sets]
    assert rotary["state"] == {"T_spindle": warm[1]}
    assert [one["state"]["T_spindle"] for one in rotary["others"]] == [warm[0], warm[2]]
    for one, there in zip(rotary["others"], (warm[0], warm[2]), strict=True):
        moved = one["moved"]["A"]["shift"][2]
        assert abs(moved) == pytest.approx(2 * UM * abs(there - warm[1]), rel=0.1)
        assert f"at T_spindle = {there:.1f} degC A lies elsewhere by z {moved:+.4f} mm" in said
    # with the description alone, and what stands above each state's tables: the same machine
    left_um = [rotary["others"][0]["left_um"], rotary["left_um"], rotary["others"][1]["left_um"]]
    assert left_um == pytest.approx([s["figures"][0]["before"]["rms_um"] for s in sets], rel=0.01)
    assert left_um[0] > 3 * left_um[1] < left_um[2]
    text = (tmp_path / "o/kinematics.txt").read_text()
    assert f"They hold at T_spindle = {warm[1]:.1f} degC" in text
    for one in rotary["others"]:
        assert f"at T_spindle = {one['state']['T_spindle']:.1f} degC {one['before_um']:.2f} without" in text
    hint = " ".join(done(*ask, tmp_path / "plain").out.split())
    assert f"um rms at T_spindle = {warm[1]:.1f} degC, {left_um[0]:.1f} of " in hint


def test_a_machine_without_rotary_axes_has_nothing_to_describe(with_mill: Fill, tmp_path: Path) -> None:
    with_mill(tmp_path)
    result = run("compensate", tmp_path / "fit", "--controller", "csv", "--out", tmp_path / "o", "--kinematics")
    assert result.code == 2
    assert "no rotary joint moved" in result.err
    result = run("compensate", tmp_path / "fit", "--controller", "linuxcnc-3d", "--out", tmp_path / "o", "--kinematics")
    assert result.code == 2
    assert "has no kinematic description of rotary axes" in result.err
