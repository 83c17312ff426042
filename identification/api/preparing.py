"""From files of instruments to a survey: import, check, template."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from identification.runtime.progress import Progress, silent
from identification.sources import AnyMachine, AnySurvey, machine_of, survey_of

if TYPE_CHECKING:
    from identification.results.check_result import CheckResult
    from identification.results.import_result import ImportResult

Match = Literal["auto", "name", "order", "nearest", "time"]


def import_survey(
    files: str | Path | Sequence[str | Path],
    machine: AnyMachine,
    *,
    commands: str | Path | None = None,
    match: Match = "auto",
    columns: Mapping[str, str] | str | Sequence[str] = (),
    units: Mapping[str, str] | None = None,
    command_columns: Mapping[str, str] | str | Sequence[str] = (),
    command_units: Mapping[str, str] | None = None,
    format: str = "",  # noqa: A002  the word of survey.yaml
    command_format: str = "",
    sheet: str = "",
    dates: Literal["", "day-first", "month-first"] = "",
    joint: str = "",
    offsets: Sequence[str] = (),
    at: Sequence[str] = (),
    dialect: str = "auto",
    observation: str | Mapping[str, object] | Sequence[str | Mapping[str, object]] = "",
    axes: Literal["reference", "tool"] = "reference",
    frame: Literal["", "shared", "per-run", "per-file", "fixed"] = "",
    leave_out: Sequence[str] = (),
    dwells: bool = True,
    log_offset: float = 0.0,
    centre: Mapping[str, float] | None = None,
    plane: str = "",
    radius: float | None = None,
    start: float = 0.0,
    seed: int = 0,
    progress: Progress = silent,
) -> ImportResult:
    """Take in files as instruments and controllers wrote them, join them, and prove the join.

    Parameters
    ----------
    files : str, Path or list of these
        Measured files, of one or several stations, and logs of temperatures.
    machine : Machine, str, Path or dict
    commands : str, Path or None
        An NC programme, a plan, a log or a table; None: the commands stand beside what was measured.
    match : {"auto", "name", "order", "nearest", "time"}
        How readings find their commands; auto: by name where both have names, by time where counts differ and both have
        clocks, by order where counts agree, else by the nearest after a robust alignment.
    columns, command_columns : dict, str or list of str
        Our column: the file's own (``{"mx": "East", "my": "-North"}``), or names by position ``"point,mx,my,mz"``.
    units, command_units : dict
        Units by kind or by our column, where the file does not state them.
    format, command_format : str
        Raw formats; empty: recognised by their content.
    sheet : str
        Of a workbook that has it; empty: the first that is no cover sheet.
    dates : {"", "day-first", "month-first"}
        Where a file does not show the order of day and month.
    joint : str
        The joint that a file of readings of one joint is about.
    offsets, at, dialect : of an NC programme, as for `compensate`.
    observation : str, dict or list of these
        What single readings (lengths, angles) are of: a type of ``observations:``, alone or with keys behind it
        (``"line-angle, axis: [0, 1, 0]"``); of one file or label, with it before ``=``
        (``"A=station-distance, near: [0, 0, 500]"``).
    axes : {"reference", "tool"}
        Of ``mx my mz``: the machine's reference (the table's where the chain begins with it), or those of the last
        frame, of a nest in the spindle that reads along its own.
    frame : {"", "shared", "per-run", "per-file", "fixed"}
        Which rows share a measuring frame; empty: a frame a station, a file, or a run where the points ask for it.
    leave_out : list of str
        Rows of raw files that count for nothing: ``"27,41-45"``, of one of several files ``"tracker.csv:27"``.
    dwells : bool
        Whether dwells are looked for in a continuous log, and averaged.
    log_offset : float
        Seconds to add to the times of a log of temperatures.
    centre : dict or None
        Of traces of a ballbar: commanded position (mm, degrees) of every joint at the centre of the circle.
    plane, radius, start : str, float or None, float
        Of traces of a ballbar, where the file does not state them: plane such as ``"XY"`` (angles count from the first
        axis to the second), commanded radius (mm), degrees to add to the angles.
    seed : int
        Of the search for the nearest commands.
    progress : callable
        Called with the name of each long part; returns a context manager around it.

    Returns
    -------
    ImportResult
        ``survey``, ``summary()`` (the proof in words), ``save(folder)``.

    Raises
    ------
    InputError
        A file cannot be read, or what was measured does not follow the commands: then it says what fits instead.
    """
    from identification.importing.importing import import_files
    from identification.importing.leaving_out import rows_of
    from identification.importing.reading_pairs import observations_of
    from identification.importing.sources import Wishes, parse_columns
    from identification.importing.traces import circle_of
    from identification.results.import_result import ImportResult

    def mapping(given: Mapping[str, str] | str | Sequence[str], option: str) -> dict[str, str]:
        if isinstance(given, Mapping):
            return dict(given)
        return parse_columns([given] if isinstance(given, str) else given, option)

    circle = circle_of(centre, plane, radius, start)
    paths = [Path(files)] if isinstance(files, str | Path) else [Path(f) for f in files]
    wishes = Wishes(
        mapping(columns, "--columns"), mapping(command_columns, "--command-columns"), dict(units or {}),
        dict(command_units or {}), format, command_format, dates, joint, tuple(offsets), tuple(at), dialect, match,
        dwells, log_offset, circle, observations_of(observation), axes, sheet,
        rows_of(leave_out), frame,
    )  # fmt: skip
    with progress("Reading and joining"):
        command_file = None if commands is None else Path(commands)
        return ImportResult(import_files(machine_of(machine), paths, command_file, wishes, seed))


def check(machine: AnyMachine, survey: AnySurvey, *, progress: Progress = silent) -> CheckResult:
    """Say all that can be said of a survey before a fit.

    Parameters
    ----------
    machine : Machine, str, Path or dict
    survey : Survey, str, Path or DataFrame
    progress : callable
        Called with the name of each long part; returns a context manager around it.

    Returns
    -------
    CheckResult
        ``summary()`` in words, ``notes``.

    Raises
    ------
    InputError
        The survey cannot be read or holds a mistake: what is wrong, and what to write instead.
    """
    from identification.importing.check import check_survey
    from identification.importing.raw_hint import with_hint
    from identification.results.check_result import CheckResult

    model = machine_of(machine)
    with with_hint(survey, model):
        data = survey_of(survey, model, progress)
    with progress("Looking for mistakes"):
        return CheckResult(check_survey(model, data))


def template(machine: AnyMachine, *, joint: str = "") -> str:
    """A table to fill in for a survey of a machine, as CSV: names with units, and one example.

    Parameters
    ----------
    machine : Machine, str, Path or dict
    joint : str
        For readings of the error motions of one joint; empty: for measured points.

    Returns
    -------
    str
        Two lines of CSV, which `import_survey` reads when it is filled in.

    Raises
    ------
    InputError
        The machine has no such joint.

    Examples
    --------
    >>> from identification import template
    >>> print(template("vertical_three_axis").splitlines()[0])
    X [mm],Y [mm],Z [mm],mx [mm],my [mm],mz [mm],run,time [s],T_air [degC]
    """
    from errormodel.machine import joint_of
    from identification.importing.template import template_text

    model = machine_of(machine)
    return template_text(model, joint_of(model, joint).name if joint else "")
