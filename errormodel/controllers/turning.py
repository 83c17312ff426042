"""How a control counts X: radii, or diameters as on lathes; decided from the machine, or told by the user.

A machine with linear axes X and Z and no Y is a lathe. One with a Y and a workpiece that a single rotary axis turns
about Z may be a turning centre or a mill with a rotary table: only the user knows.
"""

from __future__ import annotations

from errormodel.controllers.axes import ALONG_COSINE
from errormodel.controllers.setup import Axis, Setup

RADII, DIAMETERS, NOT_KNOWN = "radii", "diameters", ""
X_COUNTS = (RADII, DIAMETERS)
OPTION = "--x-counts"
LATHE_READINGS = "X: positions and readings are radii, as it moves; a display in diameters shows twice as much."


def is_lathe(setup: Setup) -> bool:
    """Whether it has linear axes X and Z and no Y."""
    return {"X", "Z"} <= _linear(setup) and "Y" not in setup.names


def spindle_of(setup: Setup) -> Axis | None:
    """The rotary axis that turns the workpiece about Z on a machine with X, Y and Z; None: there is none.

    Two rotary axes one behind the other under the workpiece are a table that swivels, as mills have it.
    """
    first, *others = setup.axes
    if not {"X", "Y", "Z"} <= _linear(setup) or not first.rotary or others[0].rotary:
        return None
    cosine = sum(a * b for a, b in zip(first.along, setup.axis("Z").along, strict=True))
    return first if abs(cosine) >= ALONG_COSINE else None


def x_counts(setup: Setup) -> str:
    """`RADII`, `DIAMETERS` or `NOT_KNOWN`."""
    if setup.x_stated:
        return setup.x_stated
    return NOT_KNOWN if is_lathe(setup) or spindle_of(setup) else RADII


def in_words(setup: Setup) -> str:
    """What the machine is that it may count X in diameters."""
    spindle = spindle_of(setup)
    if spindle is None:
        return "a machine with X and Z and no Y, a lathe"
    return f"a machine with X, Y and Z whose {spindle.joint} turns the workpiece about Z, a turning centre or a mill"


def lathe_step(setup: Setup) -> str:
    """Step of the checklist of tables; empty where X counts radii."""
    counts = x_counts(setup)
    if counts == RADII:
        return ""
    what = "positions and corrections of the files are radii, as the axis moves"
    how = "its manual says whether its tables do, too: then double both before loading"
    if counts == DIAMETERS:
        return f"X counts in diameters ({OPTION}): {what}. Of such a control {how}"
    ask = f". This is {in_words(setup)}: say how X counts with {OPTION} radii or {OPTION} diameters"
    return f"X of a lathe: {what}. Where the control counts X in diameters, {how}{ask if spindle_of(setup) else ''}"


def _linear(setup: Setup) -> set[str]:
    return {a.name for a in setup.axes if not a.rotary}
