"""No text of a file (a machine's name, a sensor's) becomes anything but a comment in a controller's files."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from errormodel.controllers import isg, klipper, klipper_probe, registry, siemens
from errormodel.controllers.base import Controller
from errormodel.controllers.polarity_steps import check_of
from errormodel.controllers.tables import Table
from errormodel.controllers.text import Comment, printable
from errormodel.controllers.thermal import Growth, laws_of
from tests.helpers.controller_files import tables_and_setup
from tests.helpers.nightly import first_of
from tests.helpers.setups import plain_setup

TABLED = sorted(n for n, kind in registry().items() if issubclass(kind, Controller))
HOSTILE = (
    "Mill\nG0 Z-500\nM30",
    "Mill\r\nM30\r%",
    "a) G0 Z-500 (b",
    "%\nO0001",
    "*) G0 := 1; (*",
    "; M30 ; zero shift of X: 99 mm",
    "zero shift of X: 99.0 mm",
    "x\x85y\u2028G0 Z1\u2029z\x0bv\x0cw\x1cq\x00r\x1e",
    "Fräse №5 µ° \u202eabc\ufeff ）％；",
    "I51=1",
    "M17",
    "\n[JOINT_0]\nCOMP_FILE = /etc/passwd",
    "[0] only multiplies others: Y",
    "correct X by 1 mm and 1 mm/mm a kelvin of T above 1",
    "M556 S1000 X9 Y9 Z9",
    "N10000P7",
    "A" * 500,
)
ALPHABET = "aG0Z-5 \n\r\t\x00\x0b\x0c\x1c\x85\u2028\u2029%()*;/#[]{}$'\"\\äß％；）:="
names = st.one_of(st.sampled_from(HOSTILE), st.text(ALPHABET, max_size=60))
many = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])

PEOPLE = ("steps.txt", "README.txt", "temperature.txt")  # read by people, loaded by no control
COMMENTS = (
    r";[ -~]*",
    r"#[ -~]*",
    r"//[ -~]*",
    r"\([ -'*-~]*\)",  # one pair of brackets, none within
    r"\d+ ;[ -~]*",  # a numbered block of comment only
)
COMMENT = re.compile("|".join(f"(?:{c})" for c in COMMENTS))


def code(files: dict[str, str]) -> dict[str, list[str]]:
    """Every line that a control acts on; all must be printable ASCII."""
    out = {}
    for name, text in files.items():
        assert all(" " <= c <= "~" or c == "\n" for c in text), name
        lines = text.split("\n")
        if name.rpartition("/")[2] in PEOPLE:
            out[name] = [str(len(lines))]
            continue
        kept = [line for line in lines if not COMMENT.fullmatch(line) or name.endswith(".csv")]
        if name.endswith(".csv"):
            kept = [line for line in lines if not line.startswith("//")]
        out[name] = [re.sub(r"^\d+ ", "", line) for line in kept]
    return out


@cache
def plainly(name: str) -> tuple[dict[str, list[str]], tuple[Table, ...]]:
    """What a control acts on where the machine's name is plain, and the tables that are read back."""
    controller, setup, tables = tables_and_setup(name)
    files = controller.write(tables, setup)
    return code(files), tuple(controller.read(files, setup))


@cache
def plain_check(name: str) -> dict[str, list[str]]:
    controller, setup, tables = tables_and_setup(name)
    return code(check_of(controller, setup, tables))


@pytest.mark.parametrize("name", TABLED)
@given(text=names)
@many
def test_a_machines_name_changes_nothing_but_comments(name: str, text: str) -> None:
    controller, setup, tables = tables_and_setup(name)
    hostile = replace(setup, machine=text)
    files = controller.write(tables, hostile)
    acted_on, plain = plainly(name)
    assert code(files) == acted_on
    back = controller.read(files, hostile)
    assert [t.term for t in back] == [t.term for t in plain]
    for a, b in zip(back, plain, strict=True):
        assert np.array_equal(a.values, b.values)


@pytest.mark.parametrize("name", TABLED)
@pytest.mark.parametrize("text", first_of(HOSTILE, 8))
def test_the_check_of_signs_says_the_name_in_comments_only(name: str, text: str) -> None:
    controller, setup, tables = tables_and_setup(name)
    found = code(check_of(controller, replace(setup, machine=text), tables))
    assert found == plain_check(name)


@given(text=names)
@many
def test_a_sensors_name_changes_nothing_but_comments(text: str) -> None:
    for write in (siemens.temperature_file, isg.temperature_file):
        sensor = f"T_{text}"
        files, plain = (write([Growth("X", 0.01, 1e-5, s, 21.3)]) for s in (sensor, "T_a"))
        assert code(files) == code(plain)
        (law,) = [g for t in files.values() for g in laws_of(t)]
        assert (law.axis, law.offset, law.zero) == ("X", 0.01, 21.3)


@given(text=names)
@many
def test_names_in_what_a_probe_writes(text: str) -> None:
    setup = plain_setup(probe=(20.0, -5.0))
    twist = klipper_probe.Twist(0.0, 100.0, np.array([0.0, 0.01]))
    both = [
        code({"a.cfg": klipper_probe.write({"X": twist, "Y": twist}, s)}) for s in (setup, replace(setup, machine=text))
    ]
    assert both[0] == both[1]


def test_klippers_temperature_names_its_sensor_in_a_comment() -> None:
    controller, setup, _ = tables_and_setup("klipper")
    (mesh,) = [t for t in controller.terms(setup) if t.inputs]
    states = [
        ({s: t}, (Table(mesh, np.full(mesh.shape, 0.01 * t)),)) for s in ["T_a\n[extruder]"] for t in (18.0, 20.0, 25.0)
    ]
    assert isinstance(controller, klipper.Klipper)
    found = controller.thermal(states, setup)
    assert found is not None
    assert code(dict(found.files))["z_thermal_adjust.cfg"] == ["[z_thermal_adjust]", "temp_coeff: -0.010000", ""]


@given(text=st.text(max_size=80))
@many
def test_a_comment_is_one_line_of_printable_ascii_with_one_end(text: str) -> None:
    for comment in (Comment("(", ")", upper=True), Comment("; "), Comment("// ")):
        line = comment.line(text)
        assert line.rstrip() == printable(line)
        assert "%" not in line
        assert ";" not in line.removeprefix(comment.start)
        if comment.end:
            assert (line.count("("), line.count(")"), line[-1]) == (1, 1, ")")
    assert printable("Fräse Süd µ ø 20 °C – é") == "Fraese Sued u o 20 deg C - e"
