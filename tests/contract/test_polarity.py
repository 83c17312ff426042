"""The check of signs and axes: what it tests, where it drives and how slowly, read by each language's own grammar."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from errormodel.controllers import registry, target
from errormodel.controllers.base import Controller, read_back, written
from errormodel.controllers.polarity import polarity_check
from errormodel.controllers.polarity_steps import approach, check_files, check_of
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Table
from errormodel.exceptions import InputError
from tests.contract.test_controller_axes import setup_of
from tests.helpers.controller_files import tables_and_setup
from tests.helpers.nightly import first_of
from tests.helpers.setups import filled, plain_setup, setups

TABLED = sorted(n for n, kind in registry().items() if issubclass(kind, Controller))
INDICATED = [n for n in TABLED if n not in ("csv", "duet", "klipper", "marlin")]
few = settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])

AXIS, NUMBER, FEED = r"(?P<axis>[XYZ])", r"(?P<to>[-+]?\d+\.\d{3})", r"F(?P<feed>\d+)"
LANGUAGES: dict[str, tuple[str, list[str], str, list[str]]] = {
    # comment, lines before the moves in order, a move, lines after them
    "siemens": (
        r"; .*",
        ["M0", "TRAFOOF", "G17 G40 G90 G94 G500 G60 G710 D0"],
        rf"SUPA G1 {AXIS}={NUMBER} {FEED}",
        ["M30"],
    ),
    "fanuc": (
        r"\([^()a-z]*\)",
        [
            "%",
            r"O70\d\d",
            "M0",
            r"IF\[#4008NE49\]GOTO900",
            "G69",
            "G21 G90 G94 G40 G80 G59",
            *(rf"IF\[ABS\[#504{n}-#502{n}\]GT0\.01\]GOTO900" for n in "123"),
        ],
        rf"G1 {AXIS}{NUMBER} {FEED}",
        ["M30", r"N900 #3000=1\([A-Z0-9 ]+\)", "%"],
    ),
    "heidenhain": (
        r"\d+ ; .*",
        [r"0 BEGIN PGM check_\d_[XYZ] MM", r"\d+ STOP", r"\d+ TOOL CALL 0 Z"],
        rf"\d+ L {AXIS}{NUMBER} R0 {FEED} M91",
        [r"\d+ STOP", r"\d+ END PGM check_\d_[XYZ] MM"],
    ),
    "linuxcnc": (r"; .*", ["M0", "G21 G90 G94 G40 G49 G80"], rf"G53 G1 {AXIS}{NUMBER} {FEED}", ["M2"]),
    "isg": (
        r"\([^()]*\)",
        [r"%check_\d_[XYZ]", "M0", "G90 G71 G94 D0", "#MCS ON"],
        rf"G01 {AXIS}{NUMBER} {FEED}",
        ["#MCS OFF", "M30"],
    ),
}
LANGUAGES["etalon"] = LANGUAGES["isg"]


def tabled(name: str) -> Controller:
    controller = target(name)
    assert isinstance(controller, Controller)
    return controller


def moves_of(name: str, text: str) -> list[tuple[str, float, float]]:
    """Axis, machine position and feed of each move; every line must be of the control's language."""
    comment, before, move, after = LANGUAGES[name.partition("-")[0]]
    lines = [s for s in text.splitlines() if not re.fullmatch(comment, s)]
    out = []
    for pattern in before:
        assert re.fullmatch(pattern, lines.pop(0)), (pattern, text)
    while (match := re.fullmatch(move, lines[0])) is not None:
        out.append((match["axis"], float(match["to"]), float(match["feed"])))
        lines.pop(0)
    assert len(lines) == len(after)
    assert all(re.fullmatch(p, s) for p, s in zip(after, lines, strict=True)), text
    return out


@pytest.mark.long
@pytest.mark.parametrize("name", INDICATED)
@given(setup=setups())
@few
def test_every_axis_is_watched_and_every_move_is_slow_straight_and_within_the_travel(name: str, setup: Setup) -> None:
    controller = tabled(name)
    files, steps = polarity_check(controller, setup, controller.structures(setup)[0])
    back = read_back(controller, files, setup)
    assert {s.axis for s in steps} == {"X", "Y", "Z"}
    for step in steps:
        q = np.array([[step.place[n] for n in setup.names]])
        seen = controller.emulate(back, setup, q, np.ones_like(q))[0][setup.movers.index(step.axis)]
        assert step.reading == pytest.approx(seen)
        assert 0.005 <= abs(step.reading) < 0.3
        assert all(a.travel[0] <= step.place[a.name] <= a.travel[1] for a in setup.axes)
    checks = check_files(controller, setup, steps)
    assert len(checks) == 1 or len(checks) == 1 + len(steps) - checks["steps.txt"].count("by hand only")
    for k, step in enumerate(steps, start=1):
        text = next((t for n, t in checks.items() if n.startswith(f"check_{k}_{step.axis}.")), None)
        if text is None:
            continue
        moves = moves_of(name, text)
        end = step.place[step.axis]
        assert [m[0] for m in moves] == [step.axis, *(a for a in "XYZ" if a != step.axis), step.axis]
        for axis, to, feed in moves:
            low, high = setup.axis(axis).travel
            assert low + 1 <= to + 1e-3
            assert to - 1e-3 <= high - 1
            assert feed <= 500
        assert all(to == pytest.approx(step.place[axis], abs=1e-3) for axis, to, _ in moves[1:-1])
        start, last = moves[0][1], moves[-1][1]
        assert abs(start - end) == pytest.approx(10.0, abs=2e-3)  # away, along the watched axis
        assert abs(last - end) == pytest.approx(2.0, abs=2e-3)  # the rest is driven by hand
        assert (last - end) * (start - end) > 0  # from that side
        assert moves[-1][2] <= 100


@pytest.mark.parametrize("name", INDICATED)
def test_the_steps_say_both_signs_and_what_to_do(name: str) -> None:
    setup, controller = plain_setup(), tabled(name)
    files, steps = polarity_check(controller, setup, controller.structures(setup)[0])
    text = check_files(controller, setup, steps, list(files))["steps.txt"]
    assert "machine coordinates" in text
    for k, step in enumerate(steps, start=1):
        part = text.split(f"\n{k}. ")[1].split(f"\n{k + 1}. ")[0]
        right, wrong = (f"{v:+.3f} mm" for v in (step.reading, -step.reading))
        assert part.index(right) < part.index(": right.") < part.index(wrong) < part.index("other sign")
        assert f"further towards {'plus' if step.reading > 0 else 'minus'}" in part
        assert (controller.other_sign or "sign is public") in part
        assert "not active" in part
        assert "interchanged" in part
    assert ("No programme" in text) == (controller.dialect is None)
    assert all(file in text for file in files)


@pytest.mark.parametrize("name", ["fanuc-pitch", "linuxcnc-type0", "aerotech-1d", "pmac", "siemens-lec"])
def test_interchanged_axes_show_on_the_indicator(name: str) -> None:
    """The tables of two axes are swapped: some reading is neither the one wanted nor its opposite."""
    setup, controller = plain_setup(), tabled(name)
    files, steps = polarity_check(controller, setup, controller.structures(setup)[0])
    back = read_back(controller, files, setup)
    for swap in ({"X": "Y", "Y": "X"}, {"Y": "Z", "Z": "Y"}, {"X": "Z", "Z": "X"}):
        wrong = tuple(
            Table(
                replace(
                    t.term,
                    output=swap.get(t.term.output, t.term.output),
                    inputs=tuple(swap.get(i, i) for i in t.term.inputs),
                ),
                t.values,
            )
            for t in back
        )
        seen = []
        for step in steps:
            q = np.array([[step.place[n] for n in setup.names]])
            value = controller.emulate(wrong, setup, q, np.ones_like(q))[0][setup.movers.index(step.axis)]
            seen.append(abs(abs(value) - abs(step.reading)))
        assert max(seen) > 0.008, swap


def test_siemens_tables_that_only_multiply_are_watched() -> None:
    setup, controller = plain_setup(), tabled("siemens-cec")
    files, steps = polarity_check(controller, setup, controller.structures(setup)[0])
    text = check_files(controller, setup, steps)["steps.txt"]
    assert "only multiplies others" in files["NC_CEC.INI"]
    watched = [s for s in steps if s.by_itself is not None]
    assert {s.axis for s in watched} >= {"X", "Z"}
    for step in watched:
        assert abs(step.by_itself or 0.0) == pytest.approx(abs(step.place[step.axis]) / 1000)
    assert text.count("acts by itself. Switch") == sum(abs(s.by_itself or 0.0) >= 0.005 for s in watched)
    for step in (s for s in watched if abs(s.by_itself or 0.0) >= 0.005):  # with the other sign both tables turn
        both = step.reading + (step.by_itself or 0.0)
        assert f"{both:+.3f} or {-both:+.3f} mm: a table that only multiplies others acts by itself" in text


def test_siemens_tables_of_the_check_are_switched_off() -> None:
    """The check has fewer tables: a number that is on for a correction there may be one that only multiplies later."""
    setup, controller = plain_setup(), tabled("siemens-cec")
    files, steps = polarity_check(controller, setup, controller.structures(setup)[0])
    text = check_files(controller, setup, steps)["steps.txt"]
    off = "$SN_CEC_TABLE_ENABLE[t] = 0 for every t"
    assert off in text
    assert sum(off in step for step in controller.checklist(setup)) == 1
    assert off in controller.back
    marked = [int(t) for t in re.findall(r"^; \[(\d+)\] only multiplies", files["NC_CEC.INI"], re.MULTILINE)]
    assert marked == list(range(len(marked)))
    used = {int(m) - 1 for m in re.findall(r"MULT_BY_TABLE\[\d+\]=([1-9]\d*)", files["NC_CEC.INI"])}
    assert used == {*marked}


@pytest.mark.parametrize("machine", ["trunnion_five_axis", "five_axis_table_quill", "fork_head_five_axis"])
def test_the_kernels_check_uses_the_linear_axes_own_errors(machine: str) -> None:
    setup, controller = setup_of(machine), tabled("isg")
    rng = np.random.default_rng(0)
    tables = filled(controller, replace(setup, levers=None), controller.structures(setup)[0], rng)
    files, steps = polarity_check(controller, setup, [t.term for t in tables])
    header = [
        w for line in files["vol_comp_0.csv"].splitlines() for w in line.split() if re.fullmatch(r"E[XYZABC][A-Z]", w)
    ]
    assert {"EXX", "EYY", "EZZ"} <= {*header}
    own = [s for s in steps if s.table == "own table"]
    assert [s.axis for s in own] == ["X", "Y", "Z"]
    for step in steps:
        assert all(step.place[a.name] == pytest.approx(0.0) for a in setup.axes if a.rotary)
    text = check_of(controller, setup, tables)
    assert not any(re.search(r"G01 [ABC]", t) for t in text.values())  # nothing turns


def test_an_axis_without_room_is_driven_by_hand() -> None:
    setup = plain_setup()
    axes = tuple(replace(a, travel=(-6.0, 6.0), measured=(-6.0, 6.0)) if a.name == "Z" else a for a in setup.axes)
    short, controller = replace(setup, axes=axes), tabled("linuxcnc-type1")
    files, steps = polarity_check(controller, short, controller.structures(short)[0])
    checks = check_files(controller, short, steps, list(files))
    assert [n for n in checks if n.endswith(".ngc")] == ["check_1_X.ngc", "check_2_Y.ngc"]
    assert "by hand only" in checks["steps.txt"].split("\n3. ")[1]


def test_the_other_sign_is_in_the_files_and_only_there() -> None:
    for name in ("siemens-cec", "aerotech-2d", "isg", "pmac", "fanuc-pitch", "heidenhain"):
        controller, setup = tabled(name), plain_setup()
        terms = controller.structures(setup)[0]
        tables = filled(controller, setup, terms[: controller.most_tables], np.random.default_rng(0))
        other = replace(setup, inverted=True)
        files = written(controller, tables, other)
        assert "SIGN TURNED ROUND" in "\n".join(files.values())
        q = np.random.default_rng(1).uniform([-200, 0, -250], [400, 300, -50], (50, 3))
        here, there = read_back(controller, files, other), controller.read(files, other)
        plain = controller.read(written(controller, tables, setup), setup)
        np.testing.assert_allclose(controller.emulate(here, setup, q), controller.emulate(plain, setup, q), atol=1e-6)
        signs = [(a.values, -b.values) for a, b in zip(plain, there, strict=True) if a.term.inputs]
        assert all(np.array_equal(a, b + 0.0) for a, b in signs)


@pytest.mark.parametrize("name", ["klipper", "duet", "marlin"])
def test_the_check_of_a_printer_says_what_the_firmware_must_show(name: str) -> None:
    controller, setup = tabled(name), plain_setup()
    tables = filled(controller, setup, controller.terms(setup), np.random.default_rng(0))
    text = check_of(controller, setup, tables)["steps.txt"]
    rows = re.findall(r"^  X(\S+) Y(\S+) Z(\S+): X (\S+) Y (\S+) Z (\S+) mm$", text, re.MULTILINE)
    assert len(rows) == 3
    for row in rows:
        x, y, z, *wanted = map(float, row)
        moved = controller.emulate(tables, setup, np.array([[x, y, z]]))[0]
        np.testing.assert_allclose(moved, wanted, atol=6e-5)


@pytest.mark.parametrize("name", INDICATED)
@pytest.mark.parametrize(
    "machine", first_of(["bridge_cmm", "trunnion_five_axis", "gantry_crossbeam_ram", "h_gantry_dual_drive"], 2)
)
def test_machines_whose_errors_need_two_points_are_checked_on_every_axis(name: str, machine: str) -> None:
    """Machines without errors: their own tables would be straight lines, with no room for a peak."""
    setup, controller = setup_of(machine), tabled(name)
    try:
        controller.suits(setup)
        terms = controller.structures(setup)[0]
    except InputError:
        pytest.skip("the format suits no such machine")
    checks = check_of(controller, setup, tuple(Table(t, np.zeros(t.shape)) for t in terms))
    assert f"Axes that are watched: {', '.join(setup.watched)}." in checks["steps.txt"]


@pytest.mark.parametrize(
    ("tool", "start"), [((0.0, 0.0, -100.0), 10.0), ((0.0, 0.0, 0.0), 10.0), ((0.0, 0.0, 80.0), -10.0)]
)
def test_the_spindle_comes_to_the_indicator_from_its_free_side(tool: tuple[float, float, float], start: float) -> None:
    """The nose faces the table: an indicator on the table stands below it, and the approach is downwards."""
    setup, controller = replace(plain_setup(), tool=tool), tabled("siemens-lec")
    _, steps = polarity_check(controller, setup, controller.structures(setup)[0])
    came = {s.axis: (approach(setup, s) or 0.0) - s.place[s.axis] for s in steps}
    assert came == pytest.approx({"X": -10.0, "Y": -10.0, "Z": start})
    high = replace(steps[0], axis="Z", place={**steps[0].place, "Z": -52.0 if start > 0 else -248.0})
    assert approach(setup, high) is None  # no room on that side, and none below the nose


def test_after_the_other_sign_the_cure_is_to_leave_it_out_again() -> None:
    """Tables that were turned round, and are wrong again, want the plain sign."""
    controller, setup, tables = tables_and_setup("heidenhain")
    plain, turned = (check_of(controller, s, tables)["steps.txt"] for s in (setup, replace(setup, inverted=True)))
    assert "write the tables again with --invert" in plain
    assert "write the tables again without --invert" in turned
