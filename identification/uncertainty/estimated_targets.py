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
            where = ", ".join(f"{v:g}" for v in place)
            yield (
                f"{count} point{'s' if count > 1 else ''} with the tool at {where} {'are' if count > 1 else 'is'} "
                f"taken to be of the target {effect.target or 'there'}, where the survey found it. Of another tool that "
                "is exactly there its place, and its uncertainty, are other ones"
            )
