"""Predictions as a table: commands, positions, volumetric errors, standard uncertainties."""

from __future__ import annotations

from typing import TYPE_CHECKING

from identification.runtime.progress import Progress, silent

if TYPE_CHECKING:
    import pandas as pd

    from errormodel.survey import Survey
    from identification.results.stored_fit import StoredFit

UNUSED = "predicted from the commands alone: what was measured there is not used"


def predicted(stored: StoredFit, commands: Survey, progress: Progress = silent) -> pd.DataFrame:
    """The commands with what is predicted there; ``attrs`` has the units, and notes on what was assumed."""
    from errormodel.effects.axis_blunder import marred
    from errormodel.simulation import outward
    from identification.uncertainty.prediction import predict

    machine = stored.chain.machine
    with progress("Predicting"):
        result = predict(stored, commands)
    table = commands.table.drop(columns=["file", "role", "row", *result.columns], errors="ignore").join(result)
    table = outward(marred(table, machine), machine)  # as the survey has it, mistakes of its columns included
    turns = ("ea", "eb", "ec", "u_ea", "u_eb", "u_ec", "angle", "u_angle")
    table.attrs["units"] = {name: "rad" if name in turns else "mm" for name in result.columns}
    table.attrs["notes"] = notes_on(stored, commands)
    return table


def notes_on(stored: StoredFit, commands: Survey) -> tuple[str, ...]:
    """Sentences on commands: what their reading assumed, where they lie beyond what was measured, what is unused."""
    import numpy as np

    from identification.uncertainty.prediction import notes

    unused = (UNUSED,) if np.isfinite(commands.measured).any() else ()
    return (*commands.notes, *notes(stored, commands), *unused)
