"""Which entries of the machine file may be wrong where a recording fits with a column of another sign or zero.

A column of a joint that is turned or displaced is the same as a joint whose axis or neighbours are written wrongly.
Travels tell them apart where the column, put right, would leave them, or comes into them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from errormodel.effects.axis_blunder import AxisBlunder
from errormodel.exceptions import enumerated
from errormodel.machine import Joint, Machine, Shape
from errormodel.surveys.columns import MEASURED, TOOL_COLUMNS
from identification.diagnosis.data_checks.blunder import Sheet

WHOLE_TURN = 2 * np.pi * (1 - 1e-6)  # rad
LEFT = 0.05  # of the positions: so many that leave the travels tell that the column was right


def has_own_tool(machine: Machine, columns: Sheet) -> bool:
    """Whether the survey states functional points, other than the machine's tool."""
    pairs = zip(TOOL_COLUMNS, machine.tool, strict=True)
    return any(name in columns and bool((columns[name] != value).any()) for name, value in pairs)


def outside_travels(columns: Sheet, machine: Machine, *, turning: bool = True) -> float:
    """Part of the positions that lie outside the travels, summed over the joints; of joints that turn right round too.

    Without `turning` a position of these is the same a whole turn further, and lies in their travel.
    """
    total = 0.0
    for joint in machine.joints:
        if not turning and joint.type == "rotary" and joint.travel[1] - joint.travel[0] > WHOLE_TURN:
            continue
        q, slack = columns[joint.name], 0.01 * (joint.travel[1] - joint.travel[0])
        total += float(np.mean((q < joint.travel[0] - slack) | (q > joint.travel[1] + slack)))
    return total


def left_travels(machine: Machine, written: Sheet, right: Sheet) -> float:
    """Part of the positions that leave the travels where columns are put right; negative where they come into them."""
    return outside_travels(right, machine, turning=False) - outside_travels(written, machine)


def of_machine(machine: Machine, written: Sheet, right: Sheet, changes: Sequence[AxisBlunder]) -> bool:
    """Whether the machine file may be wrong rather than the columns.

    Positions that leave the travels tell it, or the lack of a column. Of all lengths together nothing does.
    """
    first = changes[0]
    if first.column in TOOL_COLUMNS:
        return not has_own_tool(machine, written)
    if all_lengths(changes):
        return True
    turned = len(changes) == 1 and (first.factor == -1 or bool(first.offset))
    return turned and left_travels(machine, written, right) > LEFT


def all_lengths(changes: Sequence[AxisBlunder]) -> bool:
    """Whether they are another unit of all lengths together, of positions and of what was measured."""
    names = {change.column for change in changes}
    return len(names) > len(MEASURED) and names.issuperset(MEASURED)


def entry_text(machine: Machine, written: Sheet, right: Sheet, change: AxisBlunder) -> str:
    """What is wrong, with the entries of the machine file that may be wrong instead."""
    text = change.text(machine)
    if change.column in TOOL_COLUMNS and not has_own_tool(machine, written):
        return text.replace("column ", "the machine file's ")
    entries = _entries(machine, change)
    if not entries or left_travels(machine, written, right) < -LEFT:
        return text
    if of_machine(machine, written, right, [change]):
        return f"{text}, or rather {entries}, as the column then leaves the travel"
    return f"{text}, or {entries}"


def _entries(machine: Machine, change: AxisBlunder) -> str:
    joint = next((j for j in machine.joints if j.name == change.column), None)
    if joint is None or change.swap:
        return ""
    if change.factor == -1:
        return f"that of the axis of {joint.name} in the machine file"
    if not change.offset or joint.type == "rotary":
        return ""
    shapes, tool = _beside(machine, joint)
    names = [*shapes, *(["tool"] if tool else [])]
    return f"along its axis to {enumerated(names, 'or')} in the machine file" if names else ""


def _beside(machine: Machine, joint: Joint) -> tuple[list[str], bool]:
    """Shapes that no rotary joint parts from a linear one, by name, and whether the tool is such a one."""
    runs: list[list[Shape | Joint]] = [[]]
    for element in machine.elements:
        if isinstance(element, Joint) and element.type == "rotary":
            runs.append([])
        else:
            runs[-1].append(element)
    own = next(k for k, run in enumerate(runs) if joint in run)
    return [e.name for e in runs[own] if isinstance(e, Shape)], own == len(runs) - 1
