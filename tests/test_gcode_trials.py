"""Random programmes, executed plain and rewritten by a control that shares no code with the package.

``python -m tests.benchmarks.gcode`` does the same with ten thousand of them.
"""

from __future__ import annotations

from collections import Counter

import pytest

from tests.gcode_machine import PATH, compare, execute
from tests.gcode_programmes import OFFSETS
from tests.gcode_trial import READING, SETUP, TARGET, smooth, trial, written

PROGRAMMES, BATCH = 240, 20


@pytest.mark.parametrize("first", range(0, PROGRAMMES, BATCH))
def test_path_order_feeds_and_words_of_both_programmes_agree(first: int) -> None:
    seen: Counter[str] = Counter()
    worst = max(trial(seed, seen) for seed in range(first, first + BATCH))
    assert 0 < worst < PATH
    for what in ("rapid", "cut", "arc", "extrusion", "pieces"):
        assert seen[what] > 10, seen


SPOILT = {
    "a rapid names another axis": lambda s: s.replace("G0 Z", "G0 X0.1 Z", 1),
    "a cut is left out": lambda s: drop(s, "G1"),
    "a piece is left out": lambda s: drop(s, "X"),
    "a word is left out": lambda s: drop(s, "M30"),
    "a position is 30 um beside": lambda s: beside(s),
}


def drop(text: str, start: str) -> str:
    lines = text.splitlines()
    k = next(k for k, line in enumerate(lines) if line.startswith(start) and k > 8)
    return "\n".join([*lines[:k], *lines[k + 1 :]]) + "\n"


def beside(text: str) -> str:
    lines = text.splitlines()
    k = next(k for k, line in enumerate(lines) if line.startswith("X") and k > 8)
    first, *rest = lines[k].split(" ")
    lines[k] = " ".join([f"X{float(first[1:]) + 0.03:.4f}", *rest])
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("how", SPOILT)
def test_the_judge_sees_a_programme_that_was_spoilt(how: str) -> None:
    text = "G21 G90 G17 G54\nG0 X0 Y0\nG0 Z0\nG1 X50 F100\nM8\nG1 Y50\nG3 X40 Y60 R10\nG0 Z50\nG1 X0\nM30\n"
    sent = TARGET.rewrite("a.nc", text, SETUP, smooth, READING).text
    compare(execute(text, OFFSETS), execute(sent, OFFSETS), smooth)
    spoilt = SPOILT[how](sent)
    assert spoilt != sent
    with pytest.raises((AssertionError, IndexError)):
        compare(execute(text, OFFSETS), execute(spoilt, OFFSETS), smooth)


def test_the_programmes_are_the_same_at_every_run() -> None:
    assert written(17) == written(17)
    assert written(17) != written(18)
