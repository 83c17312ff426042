"""What a fitted model is used for: predict, monitor, compensate; and its folder: save, load."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from identification.runtime.progress import Progress, silent
from identification.sources import AnySurvey, survey_of

if TYPE_CHECKING:
    import pandas as pd

    from identification.results.compensation_result import CompensationResult
    from identification.results.diagnosis_result import DiagnosisResult
    from identification.results.explanation import Explanation
    from identification.results.fit_result import FitResult
    from identification.results.monitor_result import MonitorResult
    from identification.results.results_folder import ResultsFolder
    from identification.results.saved_fit import SavedFit
    from identification.results.stored_fit import Axes, StoredFit

AnyFit: TypeAlias = "FitResult | SavedFit | str | Path"


def predict(fit: AnyFit, points: AnySurvey, *, axes: Axes = "measured", progress: Progress = silent) -> pd.DataFrame:
    """Predict positions, volumetric errors and their standard uncertainty at commands.

    Parameters
    ----------
    fit : FitResult, DiagnosisResult, SavedFit, str or Path
        A result, or the folder that one was saved in.
    points : Survey, str, Path or DataFrame
        Commands; columns as in a survey, without the measured ones.
    axes : "measured" or "machine"
        Along which ``ex ey ez`` and ``ux uy uz`` are: the axes of the measuring frame, or x y z of ``machine.yaml``.
    progress : callable
        Called with the name of each long part; returns a context manager around it.

    Returns
    -------
    DataFrame
        The commands, and ``mx my mz`` as they would be measured (measuring frame), ``ex ey ez`` the volumetric error
        (actual minus nominal), ``ux uy uz`` its standard uncertainty (k = 1), all in mm. ``attrs["notes"]`` says what
        was assumed, and which commands lie outside of what was measured.

    Raises
    ------
    InputError
        The folder holds no fit, or the commands cannot be read.
    """
    from identification.results.predictions import predicted

    stored = replace(stored_of(fit), error_axes=axes)
    return predicted(stored, survey_of(points, stored.chain.machine, measured=False), progress)


def explain(diagnosis: DiagnosisResult | str | Path, effect: str | None = None) -> Explanation:
    """Say why a diagnosis found what it found, and where another effect dropped out, from its decision log.

    Parameters
    ----------
    diagnosis : DiagnosisResult, str or Path
        A result, or the folder that one was saved in.
    effect : str or None
        An effect, or one at a place, such as ``"backlash@X"``; None: all stages in their order.

    Returns
    -------
    Explanation
        ``summary()`` in words, ``decisions`` (a DataFrame), ``fates``, ``plot()``.

    Raises
    ------
    InputError
        The folder holds no diagnosis, or one without a decision log; or there is no such effect or place.
    """
    from identification.results.explanation import Explanation

    if isinstance(diagnosis, str | Path):
        return Explanation.of(Path(diagnosis), effect)
    return diagnosis.explain(effect)


def monitor(
    fit: SavedFit | str | Path,
    survey: AnySurvey,
    *,
    accept: bool = False,
    rate: float = 0.01,
    report: bool = True,
    progress: Progress = silent,
) -> MonitorResult:
    """Fit one more cycle with the model of a saved fit, and say what left its normal range.

    The range is learned from the cycles before, which ``monitor.sqlite`` in the folder of the fit keeps; the cycle is
    added to it.

    Parameters
    ----------
    fit : SavedFit, str or Path
        What `load` returned, or the folder.
    survey : Survey, str, Path or DataFrame
        The cycle.
    accept : bool
        Take this cycle into the normal range, alarm or not.
    rate : float
        Share of cycles with a false alarm, between 0 and 0.5.
    report : bool
        Write ``monitor.json`` and ``monitor.html`` to the folder.
    progress : callable
        Called with the name of each long part; returns a context manager around it.

    Returns
    -------
    MonitorResult
        ``status``, ``alarms``, ``quantities``, ``history``, ``plot``.

    Raises
    ------
    InputError
        The recording is wrong, too small, or of another machine; the history is.
    """
    from errormodel.exceptions import InputError
    from errormodel.files import locked, write_text_atomic
    from identification.monitoring.history import SCHEMA
    from identification.monitoring.monitor import Monitored, monitored
    from identification.report.monitor import monitor_page
    from identification.results.monitor_result import MonitorResult
    from identification.results.output_file import OutputFile, replaced_together, write_json

    if not 0 < rate < 0.5:
        raise InputError("rate", f"{rate:g}", "Write a share of cycles between 0 and 0.5, such as 0.01")
    saved = load(fit) if isinstance(fit, str | Path) else fit
    folder = saved.folder
    figures = OutputFile(folder / "monitor.json", mark=f'"schema": "{SCHEMA}"'.encode())
    shown = OutputFile(folder / "monitor.html", mark=b'<p class="kind">Monitor: the machine beside its')
    if report:
        figures.check()
        shown.check()
    data = survey_of(survey, saved.machine, progress)

    @contextmanager
    def pages(result: Monitored) -> Iterator[None]:
        if not report:
            yield
            return
        with replaced_together(figures, shown) as (figures_part, shown_part):
            assert figures_part is not None
            assert shown_part is not None
            write_json(result.as_json(), figures_part)
            write_text_atomic(monitor_page(result), shown_part)
            yield

    # a fit that exchanges the folder waits until the history is closed
    with progress("Fitting"), locked(folder.resolve().parent):
        result = monitored(folder, saved.stored, data, rate, accept, pages)
    return MonitorResult(result, shown.path if report else None)


def compensate(
    fit: FitResult | str | Path,
    controller: str,
    *,
    points: int | None = None,
    resolution: float | None = None,
    program: str | Path | None = None,
    dialect: str | None = None,
    offsets: Sequence[str] = (),
    at: Sequence[str] = (),
    probe: tuple[float, float] | None = None,
    tool: tuple[float, float, float] | None = None,
    axes: str | None = None,
    invert: bool = False,
    allow_large: bool = False,
    kinematics: bool = False,
    keep_alignment: bool = False,
    max_tables: int | None = None,
    load: float | None = None,
    x_counts: str | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> CompensationResult:
    """Write a controller's compensation tables, and judge by emulation what they leave.

    Parameters
    ----------
    fit : FitResult, DiagnosisResult, str or Path
        A result, or the folder that one was saved in.
    controller : str
        A name of `controllers`.
    points : int or None
        Points an axis; None: as many as the errors need.
    resolution : float or None
        Least increment of the controller in mm; None: the usual one of the format.
    program : str, Path or None
        For targets without tables: the programme (or CSV of commands) to rewrite.
    dialect : str or None
        Of the programme: ``auto``, ``iso``, ``fanuc`` or ``printer``.
    offsets : sequence of str
        Of the programme: ``"X.."``, ``"G54=X..,Y.."`` or ``"H1=Z.."`` (mm, degrees).
    at : sequence of str
        Where axes stand: ``"start=X0,Y0"``, ``"G28=Z0"`` or ``"M6=stay"`` (mm, degrees).
    probe : (x, y) or None
        For klipper: position of the probe from the nozzle, mm.
    tool : (x, y, z) or None
        Tip of the tool that the tables are for, mm in the last frame; None: that of the machine.
    axes : str or None
        Axis numbers (letters) of the joints on the controller, such as ``"X=1,Y=2"``; None: the usual ones.
    invert : bool
        Write the other sign, where the check of signs showed that the control wants it.
    allow_large : bool
        Write corrections beyond 1 mm, or 10 mm in a metre, too.
    kinematics : bool
        Put constant errors of rotary axes into the control's kinematic description, and what remains into the tables.
    keep_alignment : bool
        Write the tables that leave least where fixtures, bed and probes are not aligned again.
    max_tables : int or None
        For controls that hold few tables: use this many at most, those that gain most.
    load : float or None
        Load that the tables are for, kg, where the model depends on it; None: the median of the survey's rows.
    x_counts : str or None
        How the control counts X, ``radii`` or ``diameters``; None: as the machine shows, if it does.
    seed : int
    progress : callable
        Called with the name of each long part; returns a context manager around it.

    Returns
    -------
    CompensationResult
        ``files`` (text by name), ``figures`` (before, ideal, after), ``checklist``, ``notes``.

    Raises
    ------
    InputError
        There is no such controller, or its format cannot hold this machine's corrections.
    """
    from errormodel.gcode.detect import AUTO
    from errormodel.gcode.reading import Reading
    from identification.compensation.compensate import compensate as stage
    from identification.results.compensation_result import CompensationResult
    from identification.runtime.blas import one_blas_thread

    reading = Reading.of(dialect or AUTO, offsets, at) if dialect or offsets or at else None
    path = None if program is None else Path(program)

    def made(folder: Path) -> CompensationResult:
        with one_blas_thread():
            found = stage(
                folder, controller, points, resolution, path, probe, tool, seed, progress, reading, axes=axes,
                invert=invert, allow_large=allow_large, kinematics=kinematics,
                keep_alignment=keep_alignment, max_tables=max_tables, load=load, x_counts=x_counts,
            )  # fmt: skip
        return CompensationResult(found)

    if isinstance(fit, str | Path):
        return made(Path(fit))
    with tempfile.TemporaryDirectory() as folder:
        return made(fit.save(Path(folder) / "fit"))


def controllers() -> dict[str, str]:
    """Controllers that `compensate` writes for.

    Returns
    -------
    dict
        What each is, by its name.
    """
    from errormodel.controllers import registry

    return {name: f"{kind.title}{'; sign to be tested' if kind.doubt else ''}" for name, kind in registry().items()}


def save(result: FitResult, folder: str | Path | ResultsFolder, *, progress: Progress = silent) -> Path:
    """Write a result as the command line does: ``fit.json``, tables, ``machine.yaml`` and ``report.html``.

    Parameters
    ----------
    result : FitResult, DiagnosisResult or ThermalResult
    folder : str, Path or ResultsFolder
    progress : callable
        Called with the name of each long part; returns a context manager around it.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    InputError
        It cannot be written there, or holds files that are no results.
    """
    return result.save(folder, report=True, progress=progress)


def load(folder: str | Path) -> SavedFit:
    """Read the result of an earlier fit or diagnosis from its folder.

    Parameters
    ----------
    folder : str or Path

    Returns
    -------
    SavedFit
        ``machine``, ``parameters``, ``statistics``, ``predict``.

    Raises
    ------
    InputError
        The folder holds no finished fit, or its files do not belong together.
    """
    from identification.results.saved_fit import SavedFit

    return SavedFit.of(Path(folder))


def stored_of(fit: AnyFit) -> StoredFit:
    """What prediction needs of a fit, or of the folder of one."""
    return load(fit).stored if isinstance(fit, str | Path) else fit.stored
