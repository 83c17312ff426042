"""The functions that a notebook or a script uses: one for each command, with results that hold tables and figures.

Machines are given as a `Machine`, a file, a name of the library or a dict; surveys as a `Survey`, a file, a folder or a
DataFrame. All are in the units of their files: mm, degrees for rotary joints, s, degC.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from identification.runtime.progress import Progress, silent

if TYPE_CHECKING:
    import pandas as pd

    from errormodel.instruments.base import Instrument
    from errormodel.machine import Machine
    from errormodel.survey import Survey
    from identification.results.compensation_result import CompensationResult
    from identification.results.description import Description
    from identification.results.diagnosis_result import DiagnosisResult
    from identification.results.fit_result import FitResult
    from identification.results.plan_result import PlanResult
    from identification.results.saved_fit import SavedFit

AnyMachine: TypeAlias = "Machine | str | Path | Mapping[str, Any]"
AnySurvey: TypeAlias = "Survey | str | Path | pd.DataFrame"
AnyFit: TypeAlias = "FitResult | SavedFit | str | Path"


def describe(machine: AnyMachine, survey: AnySurvey | None = None) -> Description:
    """Parameters of a machine, and which combinations of them can be identified (base parameters, by rank).

    Parameters
    ----------
    machine : Machine, str, Path or dict
    survey : Survey, str, Path, DataFrame or None
        Its poses and tools decide; None: random poses over the travels with the machine's one tool.

    Returns
    -------
    Description
        ``groups`` (the base parameters with their coefficients), ``groups.rank``, ``groups.condition``, ``reasons``
        (of parameters without effect).

    Raises
    ------
    InputError
        The machine or the survey cannot be read.

    Examples
    --------
    >>> from identification import describe
    >>> describe("five_axis_table_quill").groups.rank
    32
    """
    from identification.results.description import describe as stage

    model = _machine(machine)
    return stage(model, None if survey is None else _survey(survey, model, measured=False))


def plan(
    machine: AnyMachine,
    points: int,
    *,
    setup: str | Path | Mapping[str, Any] | None = None,
    noise: float | Instrument | None = None,
    criterion: str = "worst",
    seed: int = 0,
    progress: Progress = silent,
) -> PlanResult:
    """Plan poses to measure, by optimal design, and say which effects they could show (power analysis).

    Parameters
    ----------
    machine : Machine, str, Path or dict
    points : int
        Rows to measure, repeats included.
    setup : str, Path, dict or None
        What may be reached and seen; see the reference of ``--setup``.
    noise : float, Instrument or None
        Standard uncertainty of a coordinate (k = 1) in mm, or the instrument; None: the setup's, or 0.001 mm.
    criterion : {"worst", "determinant"}
        Minimise the largest predicted uncertainty in the volume, or the determinant (D-optimal).
    seed : int
    progress : callable
        Called with the name of each long part; returns a context manager around it.

    Returns
    -------
    PlanResult

    Raises
    ------
    InputError
        Too few rows for the machine's identifiable groups, or no pose is allowed.
    """
    from identification.planning import run as stage
    from identification.planning.setup import Setup, noise_of, read_setup
    from identification.results.plan_result import PlanResult

    model = _machine(machine)
    given = setup if isinstance(setup, Mapping) else None
    if setup is None or given is not None:
        circumstances = Setup.model_validate({"errormodel": 1, **(given or {})})
    else:
        circumstances = read_setup(Path(str(setup)), model)
    sigma = noise_of(circumstances, noise) if noise is None or isinstance(noise, int | float) else noise
    result = stage.plan(model, circumstances, points, sigma, seed, worst=criterion == "worst", progress=progress)
    return PlanResult(result, stage.as_file(result, circumstances))


def fit(
    machine: AnyMachine,
    survey: AnySurvey,
    *,
    robust: bool = False,
    bounds: Mapping[str, Mapping[str, float]] | None = None,
    progress: Progress = silent,
) -> FitResult:
    """Fit a machine's parameters, measuring frames and noise levels to a survey.

    Weighted least squares on the exact (finite) kinematics. The rank is decided on scaled columns, and what cannot be
    told apart is reported as groups. Noise levels that nobody declared are estimated (variance components).

    Parameters
    ----------
    machine : Machine, str, Path or dict
    survey : Survey, str, Path or DataFrame
        Rows of role ``fit`` are fitted, those of role ``test`` predicted.
    robust : bool
        Weigh rows by how far they lie from the others; outliers are named.
    bounds : dict or None
        ``{parameter id: {"low": ..., "high": ...}}`` in mm, rad and their ratios.
    progress : callable
        Called with the name of each long part; returns a context manager around it.

    Returns
    -------
    FitResult
        ``parameters``, ``residuals``, ``covariance`` (DataFrames), ``plot``, ``predict``, ``save``.

    Raises
    ------
    InputError
        The input is wrong, or has fewer equations than identifiable unknowns.

    Examples
    --------
    >>> from errormodel import simulate
    >>> from identification import fit
    >>> survey = simulate("vertical_three_axis", 60, {"X.dx.1": 0.02}, noise=0.001, seed=1)
    >>> result = fit("vertical_three_axis", survey)
    >>> row = result.parameters.loc["X.dx.1"]
    >>> bool(abs(row["value"] - 0.02) < 4 * row["std"])
    True
    """
    from identification.bayes.settings import PriorForm
    from identification.diagnosis.data_checks.gate import passed
    from identification.estimation.run import fit_machine
    from identification.results.fit_result import FitResult

    model = _machine(machine)
    with progress("Reading"):
        data = _survey(survey, model)
    forms = {name: PriorForm.model_validate(dict(form)) for name, form in (bounds or {}).items()}
    with progress("Fitting"):
        return FitResult(passed(model, data, lambda: fit_machine(model, data, robust, forms), robust))


def diagnose(machine: AnyMachine, survey: AnySurvey, *, progress: Progress = silent) -> DiagnosisResult:
    """Fit, then find the physics that the machine's model leaves out, and fit the extended machine.

    Data checks first; then every effect of the library at every place and with every driver is scored by its marginal
    likelihood beside the geometry, accepted by blocked cross-validation, and named with a probability.

    Parameters
    ----------
    machine : Machine, str, Path or dict
    survey : Survey, str, Path or DataFrame
    progress : callable
        Called with the name of each long part; returns a context manager around it.

    Returns
    -------
    DiagnosisResult
        A `FitResult` of the extended machine with ``verdict``, ``findings``, ``untestable`` and ``baseline``.

    Raises
    ------
    InputError
        The input is wrong, or holds no row to fit.
    """
    from identification.diagnosis.pipeline import diagnose as stage
    from identification.results.diagnosis_result import DiagnosisResult

    model = _machine(machine)
    with progress("Reading"):
        data = _survey(survey, model)
    return DiagnosisResult(stage(model, data, progress))


def predict(fit: AnyFit, points: AnySurvey) -> pd.DataFrame:
    """Predict positions, volumetric errors and their standard uncertainty at commands.

    Parameters
    ----------
    fit : FitResult, DiagnosisResult, SavedFit, str or Path
        A result, or the folder that one was saved in.
    points : Survey, str, Path or DataFrame
        Commands; columns as in a survey, without the measured ones.

    Returns
    -------
    DataFrame
        The commands, and ``mx my mz`` as they would be measured (measuring frame), ``ex ey ez`` the volumetric error
        (actual minus nominal), ``ux uy uz`` its standard uncertainty (k = 1), all in mm.

    Raises
    ------
    InputError
        The folder holds no fit, or the commands cannot be read.
    """
    from errormodel.effects.axis_blunder import marred
    from errormodel.simulation import outward
    from identification.uncertainty.prediction import predict as stage

    stored = _stored(fit)
    model = stored.chain.machine
    survey = _survey(points, model, measured=False)
    result = stage(stored, survey)
    table = outward(marred(survey.table, model), model)
    table = table.drop(columns=["file", "role", "row", *result.columns], errors="ignore")
    table = table.join(result)
    table.attrs["units"] = dict.fromkeys(result.columns, "mm")
    return table


def compensate(
    fit: FitResult | str | Path,
    controller: str,
    *,
    points: int | None = None,
    resolution: float | None = None,
    program: str | Path | None = None,
    tool: tuple[float, float, float] | None = None,
    seed: int = 0,
    progress: Progress = silent,
    **options: Any,
) -> CompensationResult:
    """Write a controller's compensation tables, and judge by emulation what they leave.

    Parameters
    ----------
    fit : FitResult, DiagnosisResult, str or Path
        A result, or the folder that one was saved in.
    controller : str
        A name of ``errormodel compensate --controller list``.
    points : int or None
        Points an axis; None: as many as the errors need.
    resolution : float or None
        Least increment of the controller in mm; None: the usual one of the format.
    program : str, Path or None
        For targets without tables: the programme to rewrite.
    tool : (x, y, z) or None
        Tip of the tool that the tables are for, mm in the last frame; None: that of the machine.
    seed : int
    progress : callable
        Called with the name of each long part; returns a context manager around it.
    options : what only some controllers take.

    Returns
    -------
    CompensationResult
        ``files`` (text by name), ``figures`` (before, ideal, after), ``checklist``, ``notes``.

    Raises
    ------
    InputError
        There is no such controller, or its format cannot hold this machine's corrections.
    """
    from identification.compensation.run import compensate as stage
    from identification.results.compensation_result import CompensationResult

    path = None if program is None else Path(program)
    if isinstance(fit, str | Path):
        return CompensationResult(
            stage(Path(fit), controller, points, resolution, path, tool=tool, seed=seed, progress=progress, **options)
        )
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder) / "fit"
        fit.save(here)
        return CompensationResult(
            stage(here, controller, points, resolution, path, tool=tool, seed=seed, progress=progress, **options)
        )


def save(result: FitResult, folder: str | Path) -> Path:
    """Write a result as the command line does: ``fit.json``, tables, ``machine.yaml`` and ``report.html``.

    Parameters
    ----------
    result : FitResult or DiagnosisResult
    folder : str or Path

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    InputError
        It cannot be written there, or holds files that are no results.
    """
    return result.save(folder, report=True)


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


def _machine(source: AnyMachine) -> Machine:
    from errormodel.machine import Machine
    from errormodel.machine_file import read_machine

    return source if isinstance(source, Machine) else read_machine(source)


def _survey(source: AnySurvey, machine: Machine, measured: bool = True) -> Survey:
    from errormodel.survey import Survey, read_survey

    return source if isinstance(source, Survey) else read_survey(source, machine, measured)


def _stored(fit: AnyFit) -> Any:
    from identification.results import store

    return store.load(Path(fit)) if isinstance(fit, str | Path) else fit.stored
