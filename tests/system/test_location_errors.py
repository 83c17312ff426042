"""Squareness and parallelism of axes: symbols and signs, by exact kinematics and by hand."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.arrays import Array, as_rows
from errormodel.chain import Chain
from errormodel.location_errors import location_of
from errormodel.machine import Joint, Machine
from errormodel.machine_file import read_machine
from identification.results.axis_lines import LocationAt, locations_of
from identification.results.groups import location_name
from tests.helpers.commands import FIVE, MILL, done, run
from tests.helpers.nightly import first_of

MACHINES = Path(__file__).resolve().parents[2] / "machines"


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


def locations(machine: Machine) -> dict[str, LocationAt]:
    """Location errors between lines through the middle of the travels."""
    return {at.error.symbol: at for at in locations_of(Chain(machine), pd.DataFrame(), {})}


SIGNS = {  # ISO 230-1: a positive rotation of the second axis about the third moves its line towards ...
    ("X", "Y", "C"): (1, 0, -1), ("X", "Z", "B"): (2, 0, 1), ("Y", "Z", "A"): (2, 1, -1),
}  # fmt: skip


@pytest.mark.parametrize("machine", first_of([MILL, "bridge_cmm", "horizontal_three_axis", FIVE], 2))
@pytest.mark.parametrize(("first", "second", "about"), SIGNS)
def test_squareness_is_the_angle_between_the_paths(machine: str, first: str, second: str, about: str):
    """Each shape's rotation changes the angle between two paths of the tip by what its coefficient says."""
    chain = Chain(read_machine(machine))
    at = locations(chain.machine)[f"E{about}(0{first}){second}"]
    assert at.error.words == f"squareness of {second} against {first}"
    one, other = (next(j for j in chain.machine.joints if j.name == n) for n in (first, second))
    size, (_, towards, sign) = 1e-5, SIGNS[first, second, about]
    for shape in chain.machine.shapes:
        for motion in shape.motions:
            name = f"{shape.name}.{motion}"
            a, b = (direction(chain, j, {name: size}) for j in (one, other))
            tilt = float(a @ b)  # of perpendicular lines: how far the one leans towards the other
            assert sign * tilt / size == pytest.approx(at.members.get(name, 0.0), abs=1e-3)
    assert np.eye(3)[towards] @ direction(chain, one, {}) == pytest.approx(1)


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)])
def test_the_sense_of_an_axis_does_not_change_its_squareness(axis: tuple[float, float, float]):
    machine = read_machine(MILL)
    turned = tuple(replace(e, axis=axis) if e.name == "X" else e for e in machine.elements)
    found = locations(Machine("m", turned, machine.tool))
    assert found["EC(0X)Y"].members["saddle.ec"] == pytest.approx(1)
    assert found["EC(0Y)X"].members["saddle.ec"] == pytest.approx(-1)


def without_angles(machine: Machine) -> Machine:
    """The machine with straightness and positioning errors of its joints only."""
    elements = [
        replace(e, models={k: v for k, v in e.models.items() if k in ("dx", "dy", "dz")}) if isinstance(e, Joint) else e
        for e in machine.elements
    ]
    return Machine("m", tuple(elements), machine.tool)


def test_only_a_group_of_the_same_members_has_the_name():
    machine = without_angles(read_machine(MILL))
    chain, found = Chain(machine), list(locations(machine).values())
    slopes = {"saddle.ec": 1.0, "X.dy.1": -1 / 380, "Y.dx.1": -1 / 205}
    assert location_name(chain, found, slopes) == ("EC(0X)Y", "squareness of Y against X")
    for other in ({"saddle.ec": 1.0}, slopes | {"X.dy.1": 1 / 380}):
        assert location_name(chain, found, other) == ("", "part of the squareness of Y against X")
    for other in (
        {"table.ec": 1.0}, slopes | {"table.ec": 1.0}, {k: 2 * v for k, v in slopes.items()}, {"frame.ec": 1.0},
        slopes | {"frame.ec": -1.0}, {},
    ):  # fmt: skip
        assert location_name(chain, found, other) == ("", "")


def test_constants_to_which_angular_error_motions_add_are_no_squareness():
    """X rolls: its path at the height of the tool leans, so that the constants are a part of the squareness."""
    machine = read_machine(MILL)
    chain, found = Chain(machine), locations(machine)
    slopes = {"saddle.ec": 1.0, "X.dy.1": -1 / 380, "Y.dx.1": -1 / 205}
    assert location_name(chain, list(found.values()), slopes) == ("", "part of the squareness of Y against X")
    whole = found["EC(0X)Y"].members
    assert location_name(chain, list(found.values()), whole) == ("EC(0X)Y", "squareness of Y against X")
    # the tip leans with the roll by its height over the guides
    (joint,) = (j for j in machine.joints if j.name == "X")
    ends = [tip(chain, {"X.ea.1": 1e-6}, X=x, Z=375.0)[1] for x in joint.travel]
    assert whole["X.ea.1"] == pytest.approx(-1e6 * (ends[1] - ends[0]) / (joint.travel[1] - joint.travel[0]), rel=1e-4)
    assert abs(whole["X.ea.1"]) > 0.5


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
    assert -75 < float(line.split()[1]) < -45
    assert line.endswith("squareness of Y against X")
    assert "part of the" not in line
    fitted = json.loads((tmp_path / "fit" / "fit.json").read_text(encoding="utf-8"))
    (found,) = (e for e in fitted["location_errors"] if e["symbol"] == "EC(0X)Y")
    assert found["at"].startswith("lines through X ")
    assert found["at"].removeprefix("lines through ") in ended.out
    (entry,) = (p for p in fitted["parameters"] if p["id"] == "saddle.ec")
    assert (entry["symbol"], entry["meaning"]) == ("", "part of the squareness of Y against X")
    assert "part of the squareness of Y against X" in done("describe", MILL).out
    page = (tmp_path / "fit" / "report.html").read_text(encoding="utf-8")
    assert f"squareness of Y against X ({found['at']})" in page


def test_a_constant_that_is_the_squareness_has_its_name(tmp_path: Path):
    text = (MACHINES / f"{MILL}.yaml").read_text(encoding="utf-8")
    machine = tmp_path / "mill.yaml"
    machine.write_text(text[: text.index("errors:")] + "errors: {shapes: all}\n", encoding="utf-8")
    done("simulate", machine, 80, "--noise", 0.001, "--out", tmp_path / "s.csv")
    done("fit", machine, tmp_path / "s.csv", "--out", tmp_path / "fit")
    fitted = json.loads((tmp_path / "fit" / "fit.json").read_text(encoding="utf-8"))
    (entry,) = (p for p in fitted["parameters"] if p["symbol"] == "EC(0X)Y")
    assert (entry["id"], entry["meaning"]) == ("saddle.ec", "squareness of Y against X")
    assert ",EC(0X)Y," in (tmp_path / "fit" / "parameters.csv").read_text(encoding="utf-8")
    (found,) = (e for e in fitted["location_errors"] if e["symbol"] == "EC(0X)Y")
    assert found["value"] == pytest.approx(entry["value"], abs=1e-9)
    described = done("describe", machine).out
    assert "  EC(0X)Y   rad     saddle.ec" in described
    assert "squareness of Z against Y" in described


@pytest.mark.long
def test_squareness_shared_with_the_measuring_frame(tmp_path: Path):
    """Of joints with polynomials it is a sum of groups that each depend on the frame; fit and monitor know it."""
    machine = read_machine("bridge_cmm")
    errors = locations(machine)
    shape = "bridge.ec"

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
    truth = errors[found["symbol"]].members[shape] * 20e-6
    assert abs(found["value"] - truth) < 4 * found["std"] < 60e-6
    for seed in range(1, 7):
        assert run("monitor", tmp_path / "fit", fitted("cycle", 20e-6, seed)).code == 0
    changed = run("monitor", tmp_path / "fit", fitted("cycle", 220e-6, 9))
    assert changed.code == 1
    assert f"({found['symbol']}) left its normal range" in changed.out
