"""Canned cycles and subprogrammes, written out: beside published examples, and beside LinuxCNC's own interpreter."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from errormodel.gcode.cycles import CYCLES
from errormodel.gcode.reading import Reading
from tests.benchmarks.rs274 import motions
from tests.helpers.chains import Array
from tests.helpers.gcode_drilling import drilling
from tests.helpers.gcode_machine import execute
from tests.helpers.gcode_programmes import OFFSETS
from tests.helpers.gcode_trial import READING, SETUP, TARGET, smooth

PROGRAMMES = 120
RS274 = shutil.which("rs274")
HEAD = "G21 G90 G17 G94\nG0 X0 Y100 Z-60\n"


def same(q: Array, came: Array) -> Array:
    """No correction: what is written is what the cycles stand for."""
    return q


def written(text: str, reading: Reading | None = None) -> list[str]:
    return TARGET.rewrite("a.nc", text, SETUP, same, reading or Reading()).text.splitlines()


def ends(lines: list[str]) -> list[tuple[str, float, float, float]]:
    events = [e for e in execute("\n".join(lines) + "\n", OFFSETS) if e.what != "word"]
    return [(e.what, *(round(float(v), 6) for v in e.end)) for e in events]


def moving(found: list[tuple[str, Array, bool]]) -> list[tuple[str, Array, bool]]:
    """Motions without those that end where they began, which LinuxCNC's G85 has behind G99."""
    return [m for k, m in enumerate(found) if k == 0 or np.abs(m[1] - found[k - 1][1]).max() > 0]


def test_the_published_example_of_g81() -> None:
    """NIST IR 6556, 3.5.16.2: from (1, 2, 3), ``G90 G81 G98 X4 Y5 Z1.5 R2.8``; here Y and Z are in the travel."""
    lines = written("G21 G90 G17\nG0 X1 Y102 Z-97\nG90 G81 G98 X4 Y105 Z-98.5 R-97.2 F50\nG80\n")
    assert ends(lines)[1:] == [
        ("rapid", 4, 105, -97), ("rapid", 4, 105, -97.2), ("cut", 4, 105, -98.5), ("rapid", 4, 105, -97),
    ]  # fmt: skip


def test_the_published_example_of_repeats() -> None:
    """NIST IR 6556, 3.5.16.2: from (1, 2, 3), ``G91 G81 G98 X4 Y5 Z-0.6 R1.8 L3``, here with R below the tool.

    The first hole is at (5, 7), the second at (9, 12), the third at (13, 17).
    """
    lines = written("G21 G90 G17\nG0 X1 Y102 Z-97\nG91 G81 G98 X4 Y5 Z-0.6 R-1.8 L3 F50\nG80\n")
    cuts = [e for e in ends(lines) if e[0] == "cut"]
    assert cuts == [("cut", 1 + 4 * k, 102 + 5 * k, -99.4) for k in (1, 2, 3)]
    assert ends(lines)[-1] == ("rapid", 13, 117, -97)


def test_a_hole_is_drilled_where_the_correction_puts_it() -> None:
    text = HEAD + "G99 G81 X50 Y120 Z-80 R-62 F100 M8 (holes)\nX150\nY20\nG80\nG0 Z-55\nM30\n"
    sent = TARGET.rewrite("a.nc", text, SETUP, smooth, Reading())
    cuts = [e for e in execute(sent.text) if e.what == "cut" and abs(e.end[2] - e.start[2]) > 1]
    asked = np.array([[50, 120, -80], [150, 120, -80], [150, 20, -80]], dtype=float)
    came = np.tile([1.0, 1.0, -1.0], (3, 1))
    came[2, 1] = -1.0
    lowest = [max((e for e in cuts), key=lambda e, w=w: -np.abs(e.end - w).sum()).end for w in asked]
    np.testing.assert_allclose(lowest, smooth(asked, came), atol=1.1e-4)
    assert any("0 calls and 3 holes of cycles are written out" in n for n in sent.notes)
    assert sent.text.count("F100") == 1
    assert "G81" not in sent.text


@pytest.mark.long
@pytest.mark.skipif(RS274 is None, reason="LinuxCNC is not installed (rs274)")
def test_random_cycles_and_calls_move_as_in_linuxcnc() -> None:
    """The plain programme and what is written for it, both executed by LinuxCNC's own interpreter."""
    program, holes = Path(str(RS274)), 0
    for seed in range(PROGRAMMES):
        text = drilling(seed)
        lines = written(text, READING)
        plain, sent = (moving(motions(t, program)) for t in (text, "\n".join(lines) + "\n"))
        assert [k for k, *_ in plain] == [k for k, *_ in sent], (seed, text)
        gap = max(float(np.abs(a - b).max()) for (_, a, _), (_, b, _) in zip(plain, sent, strict=True))
        assert gap < 1.1e-3, (seed, text, gap)  # rs274 prints four decimals, of inches in some
        holes += sum(k == "STRAIGHT_FEED" for k, *_ in plain)
        assert not any(word in line for line in lines for word in (*CYCLES, "call ", "sub ")), lines
    assert holes > 5 * PROGRAMMES


FANUC = "%\nO0001 (MAIN)\nG21 G90 G17 G94\nG0 X0. Y100. Z-60.\n{}\nM30\n{}%\n"
SUB = "O1000 (A PART)\nG91 G1 X10. F100.\nY5.\nG90\nM99\n"


@pytest.mark.parametrize(
    ("call", "plain"),
    [
        ("M98 P1000", ["A"]),
        ("N20 M98 P1000 L3", ["A", "A", "A"]),
        ("M98 P31000", ["A", "A", "A"]),
        ("M98P2000", ["B", "A", "A", "B"]),
    ],
)
def test_subprogrammes_are_written_out(call: str, plain: list[str]) -> None:
    parts = {"A": "G91 G1 X10. F100.\nY5.\nG90\n", "B": "G0 Z-55.\n"}
    other = "O2000\nG0 Z-55.\nM98 P1000 L2\nG0 Z-55.\nM99\n"
    sent = TARGET.rewrite("a.nc", FANUC.format(call, SUB + other), SETUP, smooth, Reading()).text
    by_hand = FANUC.format("".join(parts[p] for p in plain).rstrip("\n"), "")
    wanted = TARGET.rewrite("a.nc", by_hand, SETUP, smooth, Reading()).text
    shown = [line for line in sent.splitlines() if not line.startswith(("(M98", "(N20M98", "(N20 M98"))]
    assert shown == wanted.splitlines()
    assert len(sent.splitlines()) > len(shown)


@pytest.mark.parametrize(
    ("call", "subs", "words"),
    [
        ("M98 P1000", "", "O1000, which is not in this file"),
        ("M98", SUB, "M98 with other words"),
        ("M98 P1000 X5.", SUB, "M98 with other words"),
        ("G1 X5. M98 P1000", SUB, "M98 with other words"),
        ("M98 P31000 L2", SUB, "repeats in P and in L"),
        ("M98 P1000 L0", SUB, "repeated 0 times"),
        ("M98 P1000", SUB.replace("M99", "M98 P1000\nM99"), "calls itself"),
        ("M98 P1000", SUB.replace("M99\n", ""), "without its end"),
        ("M98 P1000", SUB.replace("M99", "M99 P10"), "M99 with other words"),
        ("M98 P1000", SUB.replace("M99", "/M99"), "M99 with other words"),
        ("M98 P1000", SUB + SUB, "a second time"),
        ("M98 P1000", SUB + "G0 X5.\n", "behind the end (M99)"),
        ("M98 P1000", SUB.replace("G90", "M30"), "programme's end"),
        ("M98 P1000", SUB.replace("Y5.", "G1 X#5"), "line 9 ('G1 X#5'): X with a variable"),
        ("M98 P1000 L9999", SUB.replace("Y5.", "\n" * 99), "more than 200000 blocks"),
        ("G98 G81 X5. Z-70. R-62. F100. K2", SUB, "repeated at one place"),
        ("G98 G83 X5. Z-70. R-62. Q2000 F100.", SUB, "a parameter of the control"),
        ("G98 G81 X5. Z-70 R-62. F100.", SUB, "without a decimal point"),
        ("G98 G81 X5. Z-70. R-62 F100.", SUB, "without a decimal point"),
        ("M99", SUB, "M99 in the main programme"),
    ],
)
def test_calls_that_are_not_certain_are_refused(call: str, subs: str, words: str) -> None:
    with pytest.raises(Exception, match=r"a\.nc, line") as error:
        TARGET.rewrite("a.nc", FANUC.format(call, subs), SETUP, smooth, Reading())
    assert words in str(error.value)


def test_an_optional_call_and_optional_holes() -> None:
    text = FANUC.format("/M98 P1000\nG0 X20. Y120. Z-55.", SUB)
    lines = TARGET.rewrite("a.nc", text, SETUP, smooth, Reading()).text.splitlines()
    inner = [line for line in lines if "G91" in line or line.startswith("/")]
    assert all(line.startswith("/") for line in inner if "G91" in line or "G1" in line)
    holes = HEAD + "G98 G81 X5 Z-70 R-62 F100\n/X15\nX25\nG80\nG0 X0 Y100 Z-60\n"
    out = written(holes)
    assert [line for line in out if line.startswith("/")] == ["/G0 X15.0000", "/G0 Z-62.0000", "/G1 Z-70.0000",
                                                              "/G0 Z-60.0000"]  # fmt: skip
    with pytest.raises(Exception, match="depends on whether an optional block"):
        written(HEAD + "G98 G81 X5 Z-70 R-62 F100\n/X15 R-63\nX25\nG80\n")
