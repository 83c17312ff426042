"""Squareness and parallelism of axes: symbols and signs, by exact kinematics and by hand."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from errormodel.arrays import Array, as_rows
from errormodel.chain import Chain
from errormodel.location_errors import location_of, named
from errormodel.machine import Joint, Machine
from errormodel.machine_file import read_machine
from tests.helpers.commands import FIVE, MILL, done, run
from tests.helpers.nightly import first_of


def tip(chain: Chain, values: dict[str, float], **position: float) -> Array:
    """The exact tip at one pose, other joints at zero."""
    table = {j.name: position.get(j.name, 0.0) for j in chain.machine.joints}
    rows = as_rows(*(np.array([table.get(c, t)]) for c, t in zip(chain.channels, _fixed(chain), strict=True)))
    p = np.zeros(len(chain.ids))
    for name, value in values.items():
        p[chain.index[name]] = value
    return np.asarray(chain.kernel("actual", outputs=(0, 1, 2))(rows, p), dtype=float).ravel()[:3]


def _fixed(chain: Chain) -> list[float]:
    tool = dict(zip(("tool_x", "tool_y", "tool_z"), chain.machine.tool, strict=True))
    return [tool.get(c, 0.0) for c in chain.channels]


def direction(chain: Chain, joint: Joint, values: dict[str, float]) -> Array:
    """Unit vector of the tip's path along a linear joint at zero."""
    step = tip(chain, values, **{joint.name: 1e-2}) - tip(chain, values, **{joint.name: -1e-2})
    unit = step / np.linalg.norm(step)
    return unit * np.sign(unit[np.argmax(np.abs(unit))])


SIGNS = {  # ISO 230-1: a positive rotation of the second axis about the third moves its line towards ...
    ("X", "Y", "C"): (1, 0, -1), ("X", "Z", "B"): (2, 0, 1), ("Y", "Z", "A"): (2, 1, -1),
}  # fmt: skip


@pytest.mark.parametrize("machine", first_of([MILL, "bridge_cmm", "horizontal_three_axis", FIVE], 2))
@pytest.mark.parametrize(("first", "second", "about"), SIGNS)
def test_squareness_is_the_angle_between_the_paths(machine: str, first: str, second: str, about: str):
    """Each shape's rotation changes the angle between two paths of the tip by what its coefficient says."""
    chain = Chain(read_machine(machine))
    (error,) = (e for e in location_of(chain.machine) if e.symbol == f"E{about}(0{first}){second}")
    assert error.words == f"squareness of {second} against {first}"
    one, other = (next(j for j in chain.machine.joints if j.name == n) for n in (first, second))
    size, (_, towards, sign) = 1e-5, SIGNS[first, second, about]
    for shape in chain.machine.shapes:
        for motion in shape.motions:
            name = f"{shape.name}.{motion}"
            a, b = (direction(chain, j, {name: size}) for j in (one, other))
            tilt = float(a @ b)  # of perpendicular lines: how far the one leans towards the other
            assert sign * tilt / size == pytest.approx(error.members.get(name, 0.0), abs=1e-3)
    assert np.eye(3)[towards] @ direction(chain, one, {}) == pytest.approx(1)


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)])
def test_the_sense_of_an_axis_does_not_change_its_squareness(axis: tuple[float, float, float]):
    machine = read_machine(MILL)
    turned = tuple(replace(e, axis=axis) if e.name == "X" else e for e in machine.elements)
    found = {e.symbol: dict(e.members) for e in location_of(Machine("m", turned, machine.tool))}
    assert found["EC(0X)Y"]["saddle.ec"] == 1
    assert found["EC(0Y)X"]["saddle.ec"] == -1


def test_only_a_group_of_the_same_members_has_the_name():
    errors = location_of(read_machine(MILL))
    slopes = {"saddle.ec": 1.0, "X.dy.1": -1 / 380, "Y.dx.1": -1 / 205}
    found = named(errors, slopes)
    assert found is not None
    assert (found.symbol, found.words) == ("EC(0X)Y", "squareness of Y against X")
    for other in (
        {"saddle.ec": 1.0}, {"table.ec": 1.0}, slopes | {"table.ec": 1.0}, slopes | {"X.dy.1": 1 / 380},
        {k: 2 * v for k, v in slopes.items()}, {"frame.ec": 1.0}, {},
    ):  # fmt: skip
        assert named(errors, other) is None
    lever = slopes | {"X.ea.1": 70.0}  # of another point of the carriage
    assert named(errors, lever) == found


def test_rotary_axes_have_the_names_of_their_standard():
    head, table = read_machine("fork_head_five_axis"), read_machine("trunnion_five_axis")
    words = {e.symbol: e.words for e in location_of(head)}
    assert words["EA(0Y)C"] == "squareness of the axis of C against Y (AOC)"
    assert words["EB(0Z)C"] == "parallelism of the axis of C to Z about y (BOC)"
    assert {e.symbol: e.words for e in location_of(table)}["EA(0C)Y"] == "squareness of Y against the axis of C (-AOC)"
    assert location_of(read_machine("six_axis_arm")) == []


def test_squareness_is_named_wherever_groups_are_printed(tmp_path: Path):
    (tmp_path / "truth.yaml").write_text("parameters: {saddle.ec: -60.0e-6}\n")
    done("simulate", MILL, 80, "--parameters", tmp_path / "truth.yaml", "--noise", 0.001, "--out", tmp_path / "s.csv")
    ended = done("fit", MILL, tmp_path / "s.csv", "--out", tmp_path / "fit")
    (line,) = (row for row in ended.out.splitlines() if "EC(0X)Y" in row)
    assert line.split()[:2] == ["EC(0X)Y", line.split()[1]]
    assert -75 < float(line.split()[1]) < -45
    assert line.endswith("squareness of Y against X")
    listed = json.loads((tmp_path / "fit" / "fit.json").read_text(encoding="utf-8"))["parameters"]
    (entry,) = (p for p in listed if p["symbol"] == "EC(0X)Y")
    assert entry["id"] == "saddle.ec"
    assert entry["meaning"] == "squareness of Y against X"
    table = (tmp_path / "fit" / "parameters.csv").read_text(encoding="utf-8")
    assert ",EC(0X)Y," in table
    page = (tmp_path / "fit" / "report.html").read_text(encoding="utf-8")
    assert "squareness of Y against X" in page
    described = done("describe", MILL).out
    assert "  EC(0X)Y   rad     saddle.ec" in described
    assert "squareness of Z against Y" in described


@pytest.mark.long
def test_squareness_shared_with_the_measuring_frame(tmp_path: Path):
    """Of joints with polynomials it is a sum of groups that each depend on the frame; fit and monitor know it."""
    machine = read_machine("bridge_cmm")
    errors = [e for e in location_of(machine) if e.symbol in ("EC(0X)Y", "EC(0Y)X")]
    shape = next(i for i in errors[0].members if i.split(".")[0] in {s.name for s in machine.shapes})

    def fitted(name: str, size: float, seed: int) -> Path:
        (tmp_path / "truth.yaml").write_text(f"parameters: {{{shape}: {size}}}\n")
        survey = tmp_path / f"{name}.csv"
        truth = ("--parameters", tmp_path / "truth.yaml")
        done("simulate", "bridge_cmm", 120, *truth, "--noise", 0.001, "--seed", seed, "--out", survey)
        return survey

    first = fitted("first", 20e-6, 0)
    done("fit", "bridge_cmm", first, "--out", tmp_path / "fit")
    fit = json.loads((tmp_path / "fit" / "fit.json").read_text(encoding="utf-8"))
    assert not any(p["symbol"] in ("EC(0X)Y", "EC(0Y)X") for p in fit["parameters"])
    (found,) = (e for e in fit["location_errors"] if e["symbol"] in ("EC(0X)Y", "EC(0Y)X"))
    truth = next(e for e in errors if e.symbol == found["symbol"]).members[shape] * 20e-6
    assert abs(found["value"] - truth) < 4 * found["std"] < 60e-6
    for seed in range(1, 7):
        assert run("monitor", tmp_path / "fit", fitted("cycle", 20e-6, seed)).code == 0
    changed = run("monitor", tmp_path / "fit", fitted("cycle", 220e-6, 9))
    assert changed.code == 1
    assert f"({found['symbol']}) left its normal range" in changed.out
