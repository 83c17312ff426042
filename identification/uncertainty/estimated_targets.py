"""Which commands are predicted for a target whose place was estimated, and not for a tool that stands where it was."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from errormodel.effects import make
from errormodel.effects.target_offset import SAME_TOOL_MM, TOOL_COLUMNS, TargetOffset
from errormodel.machine import Machine

if TYPE_CHECKING:
    import pandas as pd


def estimated_targets(machine: Machine, table: pd.DataFrame) -> Iterator[str]:
    """A note for each target with an estimated place that commands have as their tool."""
    tools = table[[*TOOL_COLUMNS]].to_numpy(dtype=np.float64)
    for effect in map(make, machine.effects):
        if not isinstance(effect, TargetOffset) or effect.std is None:
            continue
        place = effect.tool or machine.tool
        count = int((np.abs(tools - place).sum(axis=1) < SAME_TOOL_MM).sum())
        if count:
            where, are = ", ".join(f"{v:g}" for v in place), "points" if count > 1 else "point"
            yield (
                f"{count} {are} with the tool at {where} count as the target {effect.target or 'there'}, whose place "
                "the survey found: another tool that is exactly there has another place, and uncertainty"
            )
