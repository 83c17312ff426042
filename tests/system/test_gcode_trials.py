"""Random programmes, executed plain and rewritten by a control that shares no code with the package.

``python -m tests.benchmarks.gcode`` does the same with ten thousand of them.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable

import pytest

from tests.helpers.gcode_judge import PATH, compare
from tests.helpers.gcode_machine import execute
from tests.helpers.gcode_programmes import OFFSETS
from tests.helpers.gcode_trial import READING, SETUP, TARGET, smooth, trial, written
from tests.helpers.nightly import first_of

PROGRAMMES, BATCH = 400, 50


@pytest.mark.long
@pytest.mark.parametrize("first", first_of(range(0, PROGRAMMES, BATCH)))
def test_path_order_feeds_and_words_of_both_programmes_agree(first: int) -> None:
    seen: Counter[str] = Counter()
    worst = max(trial(seed, seen) for seed in range(first, first + BATCH))
    assert 0 < worst < PATH
    for what in ("rapid", "cut", "arc", "extrusion", "pieces"):
        assert seen[what] > 3, seen


SPOILT: dict[str, Callable[[str], str]] = {
    "a rapid names another axis": lambda s: s.replace("G0 Z", "G0 X0.1 Z", 1),
    "a rapid is left out": lambda s: without(s, "G0 Z"),
    "an end is left out": lambda s: without(s, "X", -1),
    "a word is left out": lambda s: without(s, "M30"),
    "a position is 30 um beside": lambda s: beside(s),  # noqa: PLW0108  it is defined below
    "a feed is another": lambda s: s.replace("F100", "F1000"),
    "a word comes later": lambda s: s.replace("M8\n", "", 1).replace("M30", "M8\nM30"),
}


def without(text: str, start: str, which: int = 0) -> str:
    lines = text.splitlines()
    k = [k for k, line in enumerate(lines) if line.startswith(start) and k > 1][which]
    return "\n".join([*lines[:k], *lines[k + 1 :]]) + "\n"


def beside(text: str) -> str:
    place = next(m for m in re.finditer(r"^X\S+ Y(\S+)", text, re.MULTILINE))
    return text[: place.start(1)] + f"{float(place[1]) + 0.03:.4f}" + text[place.end(1) :]


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
