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

    machine, timed = stored.chain.machine, in_clock_of(stored, commands)
    with progress("Predicting"):
        result = predict(stored, timed)
    table = timed.table.drop(columns=["file", "role", "row", *result.columns], errors="ignore").join(result)
    table = outward(marred(table, machine), machine)  # as the survey has it, mistakes of its columns included
    turns = ("ea", "eb", "ec", "u_ea", "u_eb", "u_ec", "angle", "u_angle")
    table.attrs["units"] = {name: "rad" if name in turns else "mm" for name in result.columns}
    table.attrs["notes"] = notes_on(stored, commands)
    return table


def notes_on(stored: StoredFit, commands: Survey) -> tuple[str, ...]:
    """Sentences on commands: what their reading assumed, where they lie beyond what was measured, what is unused."""
    import numpy as np

    from identification.uncertainty.prediction import notes

    commands = in_clock_of(stored, commands)
    unused = (UNUSED,) if np.isfinite(commands.measured).any() else ()
    return (*commands.notes, *notes(stored, commands), *unused)


def in_clock_of(stored: StoredFit, commands: Survey) -> Survey:
    """The commands with times that count from the zero of the fitted survey's.

    Raises
    ------
    InputError
        The times are dates, those of the survey were not, and the model depends on the time; or the model depends on a
        temperature that has two values at one time; or a temperature is in another unit than those of the survey.
    """
    from dataclasses import replace

    import numpy as np

    from errormodel.channels import check_one_temperature, lacking, root
    from errormodel.exceptions import InputError
    from identification.uncertainty.measured_range import refuse_far_temperatures

    refuse_far_temperatures(stored.data.get("covered", {}), commands.table)
    sensors = dict.fromkeys(map(root, stored.chain.channels))
    check_one_temperature(commands.table, [name for name in sensors if name.startswith("T_")])
    depends, may = (
        any("time" in lacking((), channels) for channels in models)
        for models in ([stored.chain.channels], [o.channels(stored.chain.machine) for o in stored.others])
    )
    if "time" not in commands.table or not (depends or may):
        return commands
    zero = stored.data.get("clock_zero")
    if depends and zero is None and commands.clock_zero is not None:
        found = "dates, where the fitted survey has seconds: what they count from is not known"
        raise InputError(f"{commands.name}, column time", found, "Write seconds of the fitted survey's clock")
    if zero is None:
        return commands
    note = f"time 0 is {zero[:19].replace('T', ' ')}, where the fitted survey begins"
    table, begin = commands.table, float(np.datetime64(zero).astype("int64")) * 1e-6
    if commands.clock_zero is not None:
        table = table.assign(time=table["time"] + (commands.clock_zero - begin))
    return replace(commands, table=table, notes=(*commands.notes, note), clock_zero=None)
