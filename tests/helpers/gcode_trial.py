"""One random programme, rewritten by the package and judged by the control of `tests.gcode_machine`."""

from __future__ import annotations

from collections import Counter

import numpy as np

from errormodel.controllers.gcode import GCode
from errormodel.controllers.setup import Setup
from errormodel.gcode.divide import Correct
from errormodel.gcode.programme import Corrected
from errormodel.gcode.reading import Reading
from tests.helpers.chains import Array
from tests.helpers.gcode_judge import compare
from tests.helpers.gcode_machine import Event, execute
from tests.helpers.gcode_programmes import OFFSETS, Author
from tests.helpers.setups import plain_setup

SETUP = plain_setup()
READING = Reading.of(offsets=[f"{k}={','.join(a + str(v) for a, v in p.items())}" for k, p in OFFSETS.items()])
MARKS = ("(CORRECTED BY ERRORMODEL FOR TEST MACHINE)", "; corrected by errormodel for test machine")


class Unmarked(GCode):
    """The rewriter, without the one line of comment that says so: the other lines are compared with the plain ones."""

    def rewrite(
        self, name: str, text: str, setup: Setup, correct: Correct, reading: Reading | None = None
    ) -> Corrected:
        done = super().rewrite(name, text, setup, correct, reading)
        lines = done.text.splitlines(keepends=True)
        kept = [line for line in lines if line.strip() not in MARKS]
        assert len(lines) - len(kept) == (not name.endswith(".csv") and "".join(kept).split() != text.split())
        return Corrected("".join(kept), done.notes)


TARGET = Unmarked()


def smooth(q: Array, came: Array) -> Array:
    """Commands that differ by some 20 um along every axis, and by 8 um of play."""
    x, y, z = q.T
    bow = [0.02 * np.sin(x / 60 + y / 90) + 0.01, 0.015 * np.cos(x / 70) - 0.01 * np.sin(z / 50)]
    return np.asarray(q + np.column_stack([*bow, 0.02 * np.sin(y / 80 + z / 100) * np.cos(x / 100)]) + 0.004 * came)


def written(seed: int) -> tuple[str, bool]:
    """A programme, and whether a printer is to run it."""
    printer = seed % 4 == 3
    return Author(seed, printer).text(), printer


def trial(seed: int, seen: Counter[str] | None = None) -> float:
    """Largest distance (mm) of the path of one rewritten programme from the plain one's, both executed.

    Raises
    ------
    AssertionError
        They differ by more than the tolerance, or in anything else.
    InputError
        The programme was refused.
    """
    text, printer = written(seed)
    sent = TARGET.rewrite("a.nc", text, SETUP, smooth, Reading() if printer else READING).text
    worst = 0.0
    for switch in (True, False):
        before, after = (execute(t, OFFSETS, printer, switch) for t in (text, sent))
        worst = max(worst, compare(before, after, smooth))
        if "/" not in text:
            break
    if seen is not None:
        seen.update(kinds(before, after, text, sent))
    return worst


def kinds(before: list[Event], after: list[Event], text: str, sent: str) -> Counter[str]:
    """What was tried."""
    out = Counter({"blocks": len(text.splitlines()), "blocks written": len(sent.splitlines())})
    for event in before:
        arc = event.turn is not None
        names = [event.what, *(["arc"] if arc else []), *(["inch"] if event.modes[1:2] == (25.4,) else [])]
        names += ["increment"] if event.modes[:1] == (False,) else []
        names += ["inverse time"] if event.modes[2:3] == (93,) and event.what == "cut" else []
        out.update(
            [
                *names,
                *(["extrusion"] if event.extruded else []),
                *(["tool length"] if event.modes[4:5] == ("H3",) else []),
            ]
        )
    out["pieces"] = sum(e.what == "cut" for e in after)
    return out
