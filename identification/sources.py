"""What users give as a machine or a survey, read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from identification.runtime.progress import Progress, silent

if TYPE_CHECKING:
    import pandas as pd

    from errormodel.machine import Machine
    from errormodel.survey import Survey

AnyMachine: TypeAlias = "Machine | str | Path | Mapping[str, Any]"
AnySurvey: TypeAlias = "Survey | str | Path | pd.DataFrame"


def machine_of(source: AnyMachine) -> Machine:
    """The machine of a file, a name of the library or a dict; one that was read already is taken as it is."""
    from errormodel.machine import Machine
    from errormodel.machine_file import read_machine

    return source if isinstance(source, Machine) else read_machine(source)


def survey_of(source: AnySurvey, machine: Machine, progress: Progress = silent, *, measured: bool = True) -> Survey:
    """The survey of a file, a folder or a table; one that was read already is taken as it is."""
    from errormodel.survey import Survey, read_survey

    if isinstance(source, Survey):
        return source
    with progress("Reading"):
        return read_survey(source, machine, measured)
