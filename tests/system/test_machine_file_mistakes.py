"""Mistakes in a machine's file: each is named with line and key and the cure; what is hardly meant is a note."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from errormodel.exceptions import InputError
from errormodel.machine_file import library, read_machine, resolve
from errormodel.machine_plausibility import check_degrees
from errormodel.yamlfile import parse
from tests.helpers.commands import done, run, write

MACHINE = """\
errormodel: 1
chain:
  - {joint: X, type: prismatic, axis: x, travel: [0, 800]}
  - {shape: saddle, offset: [0, 0, 100]}
  - {joint: B, type: rotary, axis: y, travel: [-120, 30]}
  - {joint: Z, type: prismatic, axis: z, travel: [-400, 0]}
tool: [0, 0, -150]
"""
PLACE = "m.yaml, line 8, key effects[1]."

REFUSED: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "radians": ("[-120, 30]", "[-2.09, 0.52]", ("line 5, key chain[3].travel", "angle: rad", "travel: [-120, 30]")),
    "a half turn": ("[-120, 30]", "[-3.1416, 3.1416]", ("line 5, key chain[3].travel", "travel: [-180, 180]")),
    "a misspelt model": ("tool:", "errors: {joints: {polynom: 2}}\ntool:",
                         ("line 7, key errors.joints.polynom", "Did you mean 'polynomial'?", "{polynomial: 3}")),
    "a model of a joint": ("tool:", "errors: {joints: {X: {polynom: 2}}}\ntool:",
                           ("line 7, key errors.joints.X.polynom", "Did you mean 'polynomial'?")),
    "a joint that is not there": ("tool:", "errors: {joints: {Q: first-order}}\ntool:",
                                  ("key errors.joints.Q: the chain has no joint 'Q'. Valid: B, X, Z",)),
    "an entry too far left": ("  - {joint: B", " - {joint: B", ("m.yaml, line 5: the line is indented", "spaces")),
    "an entry too far right": ("  - {joint: B", "   - {joint: B", ("m.yaml, line 5: the line is indented", "spaces")),
    "no colon": ("tool: ", "notes\ntool: ", ("a line without a colon", "Write 'key: value'")),
}  # fmt: skip

EFFECTS: dict[str, tuple[str, tuple[str, ...]]] = {
    "no joint": (
        "{effect: backlash}",
        ("of backlash the key 'joint' is missing", "Example: {effect: backlash, joint: X}"),
    ),
    "a misspelt key": ("{effect: backlash, joints: X}", ("joints: unknown key", "Did you mean 'joint'?")),
    "too large": ("{effect: beam-sag, joint: X, exponent: 9}", ("exponent: 9. It must be less than or equal to 3",)),
    "a tilt along the axis": (
        "{effect: local-defect, joint: X, motion: dx, at: 100, width: 30, tilt: true}",
        ("motion: dx, which is no displacement across the axis of X", "Write one of dy, dz"),
    ),
    "a tilt of a rotation": (
        "{effect: contact-knee, joint: Z, motion: ea, at: -100, tilt: true}",
        ("motion: ea, which is no displacement across the axis of Z", "Write one of dx, dy"),
    ),
    "a bend along the axis": (
        "{effect: thermal-bending, joint: Z, motion: dz, sensor: T_a}",
        ("motion: dz, which is no displacement across the axis of Z",),
    ),
    "a word": ("{effect: beam-sag, joint: X, exponent: two}", ("exponent: 'two'. It must be a valid number.",)),
    "another motion": ("{effect: beam-sag, joint: X, motion: up}", ("motion: 'up'", "Valid: dx, dy, dz")),
    "along itself": ("{effect: beam-sag, joint: X, motion: dx}", ("dx is along it", "Write dy or dz")),
    "another kind of joint": ("{effect: eccentricity, joint: X}", ("joint: joint X is prismatic", "rotary joint: B")),
    "a second joint": ("{effect: column-bending, joint: Z, load_joint: Q}", ("load_joint: 'Q': the machine has no",)),
    "no text": ("{effect: gantry-racking, joint: X, channel: 3}", ("channel: 3. It must be a valid string",)),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_refused_with_line_key_and_cure(kind: str, tmp_path: Path) -> None:
    old, new, expected = REFUSED[kind]
    refused(MACHINE.replace(old, new), expected, tmp_path)


@pytest.mark.parametrize("kind", EFFECTS)
def test_an_effect_is_refused_with_line_key_and_cure(kind: str, tmp_path: Path) -> None:
    entry, expected = EFFECTS[kind]
    refused(f"{MACHINE}effects: [{entry}]\n", (PLACE, *expected), tmp_path)


def refused(text: str, expected: tuple[str, ...], folder: Path) -> None:
    result = run("describe", write(folder / "m.yaml", text))
    assert result.code == 2, result.out
    assert result.err.count("\n") == 1
    for words in expected:
        assert words in result.err
    for words in ("field required", "found {", "<block", "{'"):  # Python's words, or the parser's
        assert words not in result.err


NOTED = {
    "800 m": ("[0, 800]", "[0, 800000]", "line 3, joint X: a travel of 800 m"),
    "a rotary slide": ("joint: Z, type: prismatic", "joint: Z, type: rotary", "line 6, joint Z: a rotary joint"),
    "twenty powers": ("tool:", "errors: {joints: {X: {polynomial: 20}}}\ntool:", "polynomial: 20 for dx wants"),
    "small turns": ("joint: Z, type: prismatic, axis: z, travel: [-400, 0]}",
                    "joint: C, type: rotary, axis: z, travel: [-2.9, 2.9]}", "units: {angle: rad}"),
}  # fmt: skip


@pytest.mark.parametrize("kind", NOTED)
def test_what_is_hardly_meant_is_noted(kind: str, tmp_path: Path) -> None:
    old, new, words = NOTED[kind]
    text = MACHINE.replace(old, new)
    if kind == "small turns":
        text = text.replace("[-120, 30]", "[-1.9, 0.4]")
    assert words in done("describe", write(tmp_path / "m.yaml", text)).err
    assert not done("describe", write(tmp_path / "m.yaml", MACHINE)).err


@pytest.mark.parametrize("name", library())
def test_the_library_leaves_no_doubt(name: str) -> None:
    assert not read_machine(name).doubts


@given(turns=st.integers(-24, 24).filter(bool), more=st.integers(1, 24), places=st.integers(2, 6))
def test_radians_said_to_be_degrees_are_refused(turns: int, more: int, places: int) -> None:
    low, high = (round(math.radians(15 * k), places) for k in (turns, turns + more))
    text = MACHINE.replace("[-120, 30]", f"[{low!r}, {high!r}]")
    ends = [v for v in (low, high) if v]
    told = all(len(repr(v).partition(".")[2]) >= 2 and abs(v) < 6.29 for v in ends)
    assert looks_wrong(text) == told
    assert not looks_wrong(f"{text}units: {{angle: rad}}\n")


@given(low=st.integers(-3600, 3600), size=st.integers(1, 7200), tenths=st.integers(0, 9))
def test_degrees_as_people_write_them_pass(low: int, size: int, tenths: int) -> None:
    assert not looks_wrong(MACHINE.replace("[-120, 30]", f"[{low}.{tenths}, {low + size}.{tenths}]"))


def looks_wrong(text: str) -> bool:
    document = parse(text, "m.yaml")
    try:
        check_degrees(document, resolve(document).elements)
    except InputError:
        return True
    return False
