"""Options of a compensation that only some targets or models take, and the programme of those that rewrite one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from errormodel.channels import root
from errormodel.controllers import instead, registry
from errormodel.controllers.base import Controller, Rewriter, Target
from errormodel.controllers.setup import Setup
from errormodel.controllers.turning import OPTION, X_COUNTS
from errormodel.exceptions import InputError, nearest
from errormodel.gcode.reading import Reading
from errormodel.inputs import noted
from identification.compensation.field import Field
from identification.compensation.text import COMMON_FILES
from identification.results import manifest

if TYPE_CHECKING:
    import pandas as pd


def check_invert(controller: Target, invert: bool) -> None:
    """Raise InputError where the other sign can only do harm."""
    if invert and not (isinstance(controller, Controller) and not controller.sign_known):
        found = f"{controller.title}, whose sign a public source settles ({controller.source})"
        raise InputError("--invert", found, "Leave it out: the other sign would double the errors")


def check_most(controller: Target, most: int | None) -> None:
    """Raise InputError where a number of tables (`most`) is given and the target's are not counted."""
    if most is not None and not (isinstance(controller, Controller) and controller.few_tables):
        counted = " or ".join(n for n, k in registry().items() if issubclass(k, Controller) and k.few_tables)
        found = f"{controller.title}, of which every control holds all that are written"
        raise InputError("--max-tables", found, f"Leave it out; it is for --controller {counted}")


def stated_x(counts: str | None, setup: Setup) -> str:
    """How the control counts X as the user says, empty where he does not.

    Raises
    ------
    InputError
        It is no such word, or the machine has no linear axis X.
    """
    if counts is not None and counts not in X_COUNTS:
        raise InputError(OPTION, f"'{counts}'", nearest(counts, X_COUNTS))
    if counts is not None and not any(a.name == "X" and not a.rotary for a in setup.axes):
        raise InputError(OPTION, "the machine has no linear axis X", "Leave it out")
    return counts or ""


def with_load(field: Field, load: float | None, table: pd.DataFrame) -> tuple[Field, tuple[str, ...]]:
    """The machine under a load in kg, and a note where that is beyond the loads of the survey's rows (`table`).

    Raises
    ------
    InputError
        It is no load, or the model does not depend on one.
    """
    if load is None:
        return field, ()
    if not np.isfinite(load) or load < 0:
        raise InputError("--load", f"{load:g} kg", "Write the load in kg, such as 12.5")
    if "load" not in map(root, field.chain.channels):
        found = f"{load:g} kg, where no effect of the model depends on a load"
        raise InputError("--load", found, "Leave it out, or diagnose a survey with the column load and several loads")
    low, high = float(table["load"].min()), float(table["load"].max())
    beyond = f"a load of {load:g} kg lies beyond those of the survey, {low:g} to {high:g} kg"
    return field.at({"load": load}), () if low <= load <= high else (f"{beyond}: the model is carried on unproven",)


def source_of(controller: Target, path: Path | None, reading: Reading | None) -> tuple[str, str]:
    """Name and text of the programme, empty for a target with tables.

    Raises
    ------
    InputError
        It is missing, cannot be read, or has no use.
    """
    if isinstance(controller, Controller):
        if path is not None or reading is not None:
            option = "--program" if path is not None else "--dialect, --offset, --at"
            found = f"{controller.title} takes tables, no programme"
            raise InputError(option, found, f"Leave it out, or use --controller {instead(Rewriter)}")
        return "", ""
    if path is None:
        raise InputError(f"--controller {controller.name}", "--program is missing", "Give the programme to correct")
    if path.name.lower() in (*COMMON_FILES, manifest.NAME):
        raise InputError(str(path), "a name that one of errormodel's own files has", "Rename the programme")
    if manifest.lists(path):
        raise InputError(str(path), "a programme that compensate wrote: it is corrected already", "Give the plain one")
    try:
        data = noted(path).read_bytes()  # a lone CR is no line end to every control
        return path.name, data.decode("utf-8", "surrogateescape")
    except OSError as error:
        raise InputError(str(path), f"it cannot be read ({error})", "Give a programme as plain text") from error
