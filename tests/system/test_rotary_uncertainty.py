"""What is written of rotary axes is as uncertain as it says, and the control reads what it did."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from errormodel.chain import Chain
from errormodel.controllers import target
from errormodel.controllers.base import Controller
from errormodel.controllers.rotary_lines import Line
from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.compensation.field import Field
from identification.compensation.kinematic_description import Kinematics, description_text
from identification.compensation.rotary_axes import lines_of, refuse_large
from identification.compensation.volume import Volume
from identification.estimation.fit import fit_machine
from identification.results.store import load, save
from tests.helpers.chains import Array
from tests.helpers.compensation import UM, volume_of
from tests.helpers.surveys import measured, positions, survey

TRUNNION = "trunnion_five_axis"
TRUE = {"trunnion.dx": 30 * UM, "base.dy": 20 * UM, "trunnion.ea": 40e-6, "base.ec": -30e-6}
NOISE = 2 * UM
NUMBER = r"[-+]?\d+(?:\.\d+)?"


def found(folder: Path, seed: int, tilts: bool = True) -> tuple[Line, ...]:
    """The rotary axes of one survey of that machine."""
    machine = read_machine(TRUNNION)
    table = positions(measured(machine, Chain(machine).vector(TRUE), 150, seed, noise=NOISE))
    save(fit_machine(machine, survey(table)), folder)
    fit = load(folder)
    volume = Volume.of(Field.of(fit, table), table, True)
    return lines_of(volume, volume.setup(None, None)[0], tilts, fit)


@pytest.fixture(scope="module")
def lines(tmp_path_factory: pytest.TempPathFactory) -> tuple[Line, ...]:
    return found(tmp_path_factory.mktemp("fit") / "f", 1)


def place(lines: tuple[Line, ...]) -> Array:
    return np.array([[*x.shift, *x.tilt] for x in lines])


def truth() -> Array:
    machine = read_machine(TRUNNION)
    volume = volume_of(machine, Chain(machine).vector(TRUE))
    return place(lines_of(volume, volume.setup(None, None)[0]))


@pytest.mark.long
def test_surveys_miss_the_truth_by_as_much_as_is_said(tmp_path: Path) -> None:
    """Of 12 surveys: the mean square of 8 values' misses over their stated uncertainties is 1 within 4 sigma."""
    many = [found(tmp_path / str(k), k) for k in range(12)]
    misses, std = np.array([place(x) for x in many]) - truth(), np.array([[one.std for one in x] for x in many])
    seen = std.min(axis=0) > 1e-12
    assert seen.sum() == 8
    assert np.abs(misses[:, ~seen]).max() < 1e-9
    square = np.mean(np.square(misses / np.where(seen, std, 1.0)), axis=0)[seen]
    assert np.mean(square) == pytest.approx(1, abs=4 * np.sqrt(2 / 12 / 4))  # some four of them are independent


def swivel(lines: tuple[Line, ...]) -> tuple[dict[str, Array], dict[str, Array]]:
    """Vectors of a Siemens and their uncertainties, as they are read in the text."""
    text = written("siemens-cec", lines)
    rows = re.findall(r"(I\d|V\d) \(\$TC_CARR[^)]*\): ([^;]*); standard uncertainty ((?:\s*\d[.\d]*)+)", text)
    both = {k: tuple(np.array(re.findall(NUMBER, part), dtype=float) for part in parts) for k, *parts in rows}
    return {k: v[0] for k, v in both.items()}, {k: v[1] for k, v in both.items()}


def written(controller: str, lines: tuple[Line, ...]) -> str:
    kind = target(controller)
    assert isinstance(kind, Controller)
    machine = read_machine(TRUNNION)
    setup = volume_of(machine, np.zeros(len(Chain(machine).ids))).setup(None, None)[0]
    told = Kinematics(lines, 10.0, 1.0, asked=True, tilts=kind.describes_tilt)
    return description_text(told, [], kind.describe(lines, setup))


def test_vectors_between_axes_have_the_uncertainty_of_their_difference(lines: tuple[Line, ...]) -> None:
    """By draws of the axes, which share causes: I3 is the table's axis less the trunnion's."""
    values, std = swivel(lines)
    table, trunnion = (next(x for x in lines if x.axis == a) for a in "CA")
    draws = np.random.default_rng(0).standard_normal((20000, len(table.spread)))
    moved = {x.axis: draws @ np.array(x.spread) for x in (table, trunnion)}
    np.testing.assert_allclose(std["I2"], moved["A"][:, :3].std(axis=0), rtol=0.05, atol=1e-5)
    np.testing.assert_allclose(std["I3"], (moved["C"] - moved["A"])[:, :3].std(axis=0), rtol=0.05, atol=1e-5)
    np.testing.assert_allclose(std["I4"], moved["C"][:, :3].std(axis=0), rtol=0.05, atol=1e-5)
    turn = np.cross(moved["C"][:, 3:], table.along)
    np.testing.assert_allclose(std["V2"], turn.std(axis=0), rtol=0.05, atol=1e-8)
    right = truth()
    np.testing.assert_array_less(np.abs(values["I2"] - right[1, :3]), 4 * std["I2"] + 6e-5)
    np.testing.assert_array_less(np.abs(values["I3"] - right[0, :3] + right[1, :3]), 4 * std["I3"] + 6e-5)
    assert 0 < std["I3"][0] < 2 * NOISE


@pytest.mark.parametrize(
    ("controller", "comment"), [("siemens-cec", r" ; [^\n(]*"), ("fanuc-3d", r"\s\(STANDARD[^)]*\)"),
                                ("heidenhain", r" ; .*")],
)  # fmt: skip
def test_the_control_reads_what_it_did(lines: tuple[Line, ...], controller: str, comment: str) -> None:
    """The uncertainties are comments of the control, and without them the steps are those of lines that have none."""
    kind = target(controller)
    assert isinstance(kind, Controller)
    machine = read_machine(TRUNNION)
    setup = volume_of(machine, np.zeros(len(Chain(machine).ids))).setup(None, None)[0]
    bare = tuple(Line(x.axis, x.shift, x.tilt, x.along, x.side, x.at) for x in lines)
    said = "\n".join(kind.describe(lines, setup))
    assert "standard uncertainty" in said.lower()
    assert re.sub(comment, "", said) == "\n".join(kind.describe(bare, setup))
    assert "uncertainty" not in written(controller, bare)
    text = written(controller, lines)
    assert max(map(len, text.splitlines())) <= 120
    assert text.count("    standard uncertainty: x ") + text.count("    standard uncertainty: y ") == 2


def test_what_the_survey_does_not_tell_from_an_axis_is_named(lines: tuple[Line, ...]) -> None:
    one = Line("C", (0.01, 0, 0), (0, 0, 0), (0, 0, 1), "table", spread=((1e-4,) * 6,), confounded=tuple("abcdefgh"))
    text = written("fanuc-3d", (one,))
    assert "as if these, which the survey does not tell from it, were zero: a, b, c, d, e, f and 2 more" in text
    known = Kinematics((one,), 10.0, 1.0, asked=True).as_json()["lines"][0]
    assert known["shift_std"] == pytest.approx([1e-4] * 3)
    assert "spread" not in known
    assert "uncertainties in kinematics.txt" in Kinematics(lines, 10.0, 1.0, asked=True).apart
    assert not Kinematics(lines, 10.0, 1.0, asked=False).apart


def test_a_tip_beside_the_tool_of_the_file_is_named_as_what_moves_the_axes(tmp_path: Path) -> None:
    """A stylus off by 50 um along x and 350 um too long is in the shifts; a tip of unknown place is no matter."""
    machine = read_machine(TRUNNION)
    off = np.array([0.05, 0.0, -0.35])
    table = positions(
        measured(replace(machine, tool=tuple(machine.tool + off)), Chain(machine).vector({}), 150, 1, noise=NOISE)
    )
    for name, value in zip(("tool_x", "tool_y", "tool_z"), machine.tool, strict=True):
        table[name] = value
    fit = fit_machine(machine, survey(table))
    assert any("hold only as far as the tip" in note for note in fit.notes)
    save(fit, tmp_path / "f")
    stored = load(tmp_path / "f")
    volume = Volume.of(Field.of(stored, table), table, True)
    setup = volume.setup(None, None)[0]
    a, c = sorted(lines_of(volume, setup, True, stored), key=lambda one: one.axis)
    assert a.shift[2] == pytest.approx(0.35, abs=0.01)
    assert c.shift[0] == pytest.approx(-0.05, abs=0.01)
    assert a.confounded == ("tool_y", "tool_z")
    assert c.confounded == ("tool_x", "tool_y")
    text = description_text(Kinematics((a, c), 100.0, 5.0, True), [], [])
    assert "C (tool_x, tool_y)" in text
    assert "as if these" not in text
    near = replace(machine, effects=(EffectSpec("target-offset", {"tool": [*machine.tool], "std": "unknown"}),))
    assert not any("hold only as far as the tip" in note for note in fit_machine(near, survey(table)).notes)


def test_an_axis_millimetres_beside_its_place_is_refused() -> None:
    far = Line("C", (-1.2, 0, 0), (0, 0, 0), (0, 0, 1), "table")
    with pytest.raises(InputError, match=r"axis C: a shift of 1\.2 mm .*tool_x.*--allow-large"):
        refuse_large([far], False)
    refuse_large([far], True)
    refuse_large([replace(far, shift=(-0.9, 0, 0))], False)
