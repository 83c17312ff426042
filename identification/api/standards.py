"""Evaluation by standards: of a survey, or of a fitted model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from identification.runtime.progress import Progress, silent
from identification.sources import AnyMachine, AnySurvey, machine_of, survey_of

if TYPE_CHECKING:
    from errormodel.surveys.record import Rule
    from identification.iso_standards.base import Evaluation, Standard
    from identification.iso_standards.fitted import FittedMachine
    from identification.results.evaluation_result import EvaluationResult

ALL = "all"


def iso(
    standard: str,
    source: AnyMachine,
    survey: AnySurvey | None = None,
    *,
    tolerance: Mapping[str, str] | None = None,
    decision: Rule | None = None,
    progress: Progress = silent,
) -> EvaluationResult:
    """Evaluate a survey or a fitted model by a standard, and decide on its tolerances.

    Parameters
    ----------
    standard : str
        A name of `standards`, such as ``230-2``; several with commas between; or ``all`` that the source allows.
    source : Machine, str, Path or dict
        With `survey`: the machine. Without: the folder that a fit was saved in.
    survey : Survey, str, Path, DataFrame or None
    tolerance : mapping or None
        Limits with units by the names of quantities, such as ``{"X.A": "8 um"}``; beside those of the survey.
    decision : "guard-band", "simple" or None
        Rule of decision; None: that of the survey's block ``test:``, else guard-band.
    progress : callable
        Called with the name of each long part; returns a context manager around it.

    Returns
    -------
    EvaluationResult
        ``figures``, ``verdict``, ``conformity``, ``plots``, ``certificate()``, ``save``.

    Raises
    ------
    InputError
        There is no such standard, the source does not hold what it needs, or a tolerance is wrong.
    """
    from errormodel.inputs import Run, current, running

    if current() is None:  # so that the certificate has the digests of what is read
        with running(Run("iso", {}, {}, ())):
            return _evaluated(standard, source, survey, tolerance or {}, decision, progress)
    return _evaluated(standard, source, survey, tolerance or {}, decision, progress)


def standards() -> dict[str, str]:
    """Standards that `iso` evaluates.

    Returns
    -------
    dict
        What each is, and what it is evaluated from, by its name.
    """
    from identification.iso_standards import registry

    words = {(True, True): "survey or fit", (True, False): "survey", (False, True): "fit"}
    return {name: f"{kind.title} [{words[kind.takes()]}]" for name, kind in registry().items()}


def _evaluated(
    standard: str,
    source: AnyMachine,
    survey: AnySurvey | None,
    tolerance: Mapping[str, str],
    decision: Rule | None,
    progress: Progress,
) -> EvaluationResult:
    from errormodel.exceptions import InputError
    from errormodel.surveys.record import limit_of
    from identification.conformity.decision import check_names, conformity
    from identification.iso_standards import registry
    from identification.iso_standards import standards as named
    from identification.iso_standards.series import doubts, series_kept
    from identification.results.evaluation_result import EvaluationResult

    wanted = [kind() for kind in registry().values()] if standard == ALL else named(standard)
    given = {}
    for name, text in tolerance.items():
        try:
            given[name] = limit_of(text)
        except ValueError as error:
            raise InputError(f"tolerance of {name}", f"'{text}'", str(error)) from error
    notes: tuple[str, ...] = ()
    if survey is None:
        model = _model(source)
        machine, record, inputs = model.machine, model.record, _inputs(model.folder)
        with progress("Evaluating"):
            found = _each(wanted, standard == ALL, lambda kind: kind.of_fit(model))
    else:
        machine = machine_of(source)
        data = survey_of(survey, machine, progress)
        record, inputs = data.record, _inputs(None)
        with series_kept():
            notes = (*doubts(data, machine), *data.notes)
            with progress("Evaluating"):
                found = _each(wanted, standard == ALL, lambda kind: kind.of_survey(data, machine))
    quantities = [q for e in found for q in e.quantities]
    check_names(given, quantities, "tolerance")
    limits = {**(record.limits if record else {}), **given}
    rule: Rule = decision or (record.decision if record else "guard-band")
    decided = conformity(quantities, limits, rule)
    return EvaluationResult(machine.name, found, decided, record, inputs, notes)


def _each(wanted: Sequence[Standard], every: bool, evaluate: Callable[[Standard], Evaluation]) -> list[Evaluation]:
    """The evaluations; of `every` standard those that the source allows, of which there must be one."""
    from errormodel.exceptions import InputError

    found, refused = [], []
    for kind in wanted:
        try:
            result = evaluate(kind)
            if not result.quantities:
                needed = kind.needs or "linear axes that moved"
                nothing = f"{kind.title} finds nothing to evaluate in it"
                raise InputError(result.source, nothing, f"It needs {needed}")
            found.append(result)
        except InputError as error:
            if not every:
                raise
            refused.append(error)
    if not found:
        needs = "; ".join(f"{kind.number}: {kind.needs}" for kind in wanted if kind.needs)
        raise InputError(refused[0].where, "no standard finds what it needs", f"They need, of a survey, {needs}")
    return found


def _model(source: AnyMachine) -> FittedMachine:
    """The fitted machine in a folder.

    Raises
    ------
    InputError
        That is no folder of a fit.
    """
    from errormodel.exceptions import InputError
    from errormodel.surveys.record import RecordForm
    from identification.iso_standards.fitted import FittedMachine
    from identification.results.results_folder import whole
    from identification.results.stored_fit import read_files

    if not isinstance(source, str | Path) or not Path(source).is_dir():
        found = "no folder of a fit, and no survey beside it"
        raise InputError(str(source), found, "Write the folder of a fit, or MACHINE and SURVEY")
    folder = Path(source)
    with whole(folder):
        stored = read_files(folder)
        kept = stored.data.get("test_record")
        record = None if kept is None else RecordForm.model_validate(kept)
        return FittedMachine.of(stored, folder, record)


def _inputs(folder: Path | None) -> list[tuple[str, str]]:
    """Name and digest of each file that was read, and of those that the fit in `folder` was made from."""
    from errormodel.inputs import current
    from identification.results import manifest

    run = current()
    pairs = {(path.name, digest) for path, digest in run.inputs.items()} if run else set()
    made = None if folder is None else manifest.read(folder)
    if made is not None:
        pairs |= {(name, digest) for name, digests in made.inputs.items() for digest in digests}
    return sorted(pairs)
