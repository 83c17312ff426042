"""From a machine and a survey to a model: describe, plan, fit, diagnose, thermal, register."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from identification.runtime.progress import Progress, Steps, silent, uncounted
from identification.sources import AnyMachine, AnySurvey, machine_of, survey_of

if TYPE_CHECKING:
    from errormodel.instruments.base import Instrument
    from identification.results.description import Description
    from identification.results.diagnosis_result import DiagnosisResult
    from identification.results.fit_result import FitResult
    from identification.results.plan_result import PlanResult
    from identification.results.registration_result import RegistrationResult
    from identification.results.thermal_result import ThermalResult


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
    from errormodel.surveys.target_places import with_places
    from identification.results.description import describe as stage

    model = machine_of(machine)
    if survey is None:
        return stage(model, None)
    data = survey_of(survey, model, measured=False)
    return stage(with_places(model, data.places), data)


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
    from identification.planning import plan as stage
    from identification.planning.setup import Setup, noise_of, read_setup
    from identification.results.plan_result import PlanResult

    model = machine_of(machine)
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
    bayes: bool = False,
    priors: Mapping[str, Mapping[str, float]] | str | Path | None = None,
    seed: int = 0,
    checkpoint: Path | None = None,
    progress: Progress = silent,
    steps: Steps = uncounted,
) -> FitResult:
    """Fit a machine's parameters, measuring frames and noise levels to a survey.

    Weighted least squares on the exact (finite) kinematics. The rank is decided on scaled columns, and what cannot be
    distinguished is reported as groups. Noise levels that nobody declared are estimated (variance components).

    Parameters
    ----------
    machine : Machine, str, Path or dict
    survey : Survey, str, Path or DataFrame
        Rows of role ``fit`` are fitted, those of role ``test`` predicted.
    robust : bool
        Weigh rows by how far they lie from the others; outliers are named.
    bayes : bool
        The posterior: unknown noise, shapes of effects, with `robust` outliers. Parameters are then its means.
    priors : dict, str, Path or None
        What is known beforehand: ``{parameter id: {"low": ..., "high": ...}}`` in mm, rad and their ratios, or a file
        of them; with `bayes` normal priors, too (``mean``, ``std``).
    seed : int
        Of the posterior's draws.
    checkpoint : Path or None
        Folder that keeps an unfinished chain of the sampler, which the next call goes on with.
    progress, steps : callable
        Called with the name of each long part, and of work that knows how far it is; return context managers.

    Returns
    -------
    FitResult
        ``parameters``, ``residuals``, ``covariance``, ``budget`` (DataFrames), ``posterior``, ``plot``, ``predict``,
        ``save``.

    Raises
    ------
    InputError
        The input is wrong, or has fewer equations than identifiable unknowns.
    NotConvergedError
        The sampler's chain has not converged.

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
    from errormodel.surveys.target_places import with_places
    from identification.bayes.settings import priors_of
    from identification.diagnosis.data_checks.gate import passed
    from identification.estimation.fit import fit_machine
    from identification.importing.repeat_shift import displacement_notes
    from identification.results.fit_result import FitResult

    model = machine_of(machine)
    data = survey_of(survey, model, progress)
    model = with_places(model, data.places)
    given, document = priors_of(priors, bounds_only=not bayes)
    bounds = {} if bayes else given
    with progress("Fitting"):
        result = passed(model, data, lambda: fit_machine(model, data, robust, bounds, document), robust)
        result = replace(result, notes=(*result.notes, *displacement_notes(model, data)))
    if bayes:
        from identification.bayes.inference import bayesian

        result = bayesian(
            result, lambda m: fit_machine(m, data, robust), given, document, robust=robust, seed=seed,
            folder=checkpoint, progress=progress, count=steps,
        )  # fmt: skip
    return FitResult(result)


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
    from errormodel.surveys.target_places import with_places
    from identification.diagnosis.pipeline import diagnose as stage
    from identification.results.diagnosis_result import DiagnosisResult

    model = machine_of(machine)
    data = survey_of(survey, model, progress)
    return DiagnosisResult(stage(with_places(model, data.places), data, progress))


def thermal(machine: AnyMachine, survey: AnySurvey, *, progress: Progress = silent) -> ThermalResult:
    """Model how error motions drift with temperatures, and judge that on another thermal cycle.

    Parameters
    ----------
    machine : Machine, str, Path or dict
    survey : Survey, str, Path or DataFrame
        Error motions at a few positions of a joint, read again and again over a warm-up (columns ``joint``, ``dx`` ...
        ``ec``, ``time``, ``T_<sensor>``); files of another cycle have the role ``test``.
    progress : callable
        Called with the name of each long part; returns a context manager around it.

    Returns
    -------
    ThermalResult
        A `FitResult` of the machine with its drifts, with ``motions``.

    Raises
    ------
    InputError
        The survey holds no such recordings, or no second cycle.
    """
    from identification.results.thermal_result import ThermalResult
    from identification.thermal_drift.drift_model import thermal as stage

    model = machine_of(machine)
    return ThermalResult(stage(model, survey_of(survey, model, progress), progress))


def register(
    cold: str | Path, warm: Sequence[str | Path], profiler: str | Path, *, progress: Progress = silent
) -> RegistrationResult:
    """Register point clouds of artefacts: from a cold and each warm folder to six thermal error motions of a joint.

    Parameters
    ----------
    cold, warm : str or Path, sequence of them
        Folders with one cloud an artefact (csv, xyz, ply, pcd), mm in the sensor's frame.
    profiler : str or Path
        YAML: joint, positions, lever, mount or calibration.
    progress : callable
        Called with the name of each long part; returns a context manager around it.

    Returns
    -------
    RegistrationResult
        ``table``: a survey of the joint's error motions.

    Raises
    ------
    InputError
        A file is missing or wrong, or clouds do not show what they should.
    """
    from identification.registration.register import register as stage
    from identification.results.registration_result import RegistrationResult

    return RegistrationResult(stage(Path(cold), [Path(folder) for folder in warm], Path(profiler), progress))
