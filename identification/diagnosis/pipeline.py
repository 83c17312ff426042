"""The diagnosis from gate 0 to the extended machine, refitted in exact kinematics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from errormodel.arrays import Array, Mask
from errormodel.conventions import Motion
from errormodel.effects.base import Effect
from errormodel.effects.unnamed import Unnamed
from errormodel.exceptions import InputError
from errormodel.machine import Machine
from errormodel.survey import Survey
from errormodel.surveys.observations import groups
from identification.diagnosis.courses import with_courses, with_wanderer
from identification.diagnosis.data_checks.approach_direction import contrary_sides
from identification.diagnosis.data_checks.blunder import Blunder, misses
from identification.diagnosis.data_checks.checks import MOST_BLUNDERS, find_blunders, without
from identification.diagnosis.data_checks.gate import refuse_another_machine, refused
from identification.diagnosis.data_checks.head_axes import refuse_turned_head
from identification.diagnosis.data_checks.orientations import orientation_notes
from identification.diagnosis.data_checks.outliers import gross_rows, masked_rows
from identification.diagnosis.data_checks.runs_of_motions import (
    compared_runs,
    lost_zero,
    opposite_runs,
    refuse_scaled_runs,
)
from identification.diagnosis.data_checks.temperature_sensors import dead_sensors
from identification.diagnosis.data_checks.tool_lengths import tool_notes
from identification.diagnosis.data_checks.unrelated import refuse_unstated_rotation
from identification.diagnosis.data_checks.untimed_path import untimed_path
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.extension import Explanation, explained
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.motions_as_points import as_points, carried
from identification.diagnosis.linear.residual_rows import heldout_um, rms_um, views_of
from identification.diagnosis.linear.row_residuals import by_observation, noise_mm, spread
from identification.diagnosis.results.aliased_periods import aliased_periods
from identification.diagnosis.results.beyond_recorded import known_where_recorded
from identification.diagnosis.results.diagnosed import Diagnosed
from identification.diagnosis.results.doubtful_rows import doubtful_rows
from identification.diagnosis.results.effect_size import whole_of
from identification.diagnosis.results.findings import (
    Diagnosis,
    Finding,
    HeldOut,
    alternatives_of,
    elsewhere,
    log_names,
    look_alikes,
    motions_of,
    moved_by,
    p_value_of,
    probability_of,
)
from identification.diagnosis.results.left_out import outlier_finding
from identification.diagnosis.results.nameless_alternative import checked_alternative
from identification.diagnosis.results.open_expansion import open_expansions
from identification.diagnosis.results.other_sensors import by_other_sensors, sensors_probability, sentence_of
from identification.diagnosis.results.physical_limits import checked_name
from identification.diagnosis.results.places import place_probabilities, sentence_of_places, with_places
from identification.diagnosis.results.profile_likelihood import other_effects, time_constants
from identification.diagnosis.results.recorded_functions import alike_motions, recorded
from identification.diagnosis.results.statements import (
    alike_of,
    brief_of,
    named,
    next_measurement,
    period_of,
    periods_of,
    statement_of,
    subject,
)
from identification.diagnosis.results.undetected import perhaps_there, with_one_more
from identification.diagnosis.results.untestable import unconsidered
from identification.diagnosis.results.verdict import judge, no_larger
from identification.diagnosis.results.witnesses import WitnessResult, with_witnesses
from identification.diagnosis.search.instrument_noise import station_notes
from identification.diagnosis.search.model import EffectModel
from identification.diagnosis.search.other_lags import lags_left_open
from identification.diagnosis.search.scoring import Step
from identification.diagnosis.together import together
from identification.estimation.checks import check_declared, check_readings, noise_notes
from identification.estimation.fit import fit_if_possible, fit_machine
from identification.estimation.large_scales import large_scales
from identification.estimation.result import Fit
from identification.observation.normal_equations import design_rows
from identification.runtime.progress import Progress, silent


def diagnose(machine: Machine, survey: Survey, progress: Progress = silent) -> Diagnosed:
    """Find what physics a survey shows beyond the machine's model, and put it into the model.

    Parameters
    ----------
    progress : surrounds each long part, with its name.

    Raises
    ------
    InputError
        The survey has nothing to fit, or no row with a measured position.
    """
    runs, lost, log = compared_runs(survey), list[Blunder](), DecisionLog()
    refuse_scaled_runs(runs)
    while len(lost) < MOST_BLUNDERS and (found := lost_zero(survey, runs, log)) is not None:
        lost.append(found)
        survey = found.survey
        runs = compared_runs(survey)
    notes = tuple(opposite_runs(runs, log))
    survey = as_points(machine, survey)
    if parts := carried(machine, survey):
        diagnosed = together(
            machine, survey, [(p, diagnose_points(p.machine, p.survey, p.telling(progress), True)) for p in parts]
        )
    else:
        diagnosed = diagnose_points(machine, survey, progress)
    log.join(diagnosed.log)
    diagnosed = replace(diagnosed, log=log)
    return _with_lost_zeros(diagnosed, lost, notes) if lost or notes else diagnosed


def _with_lost_zeros(diagnosed: Diagnosed, lost: Sequence[Blunder], notes: tuple[str, ...]) -> Diagnosed:
    """The diagnosis with what was put right before it, first."""
    d = diagnosed.diagnosis
    findings = tuple(_blunder_finding(b, None, None) for b in lost)
    verdict = "explained" if lost and d.verdict == "adequate" else d.verdict
    return replace(
        diagnosed,
        diagnosis=replace(d, findings=(*findings, *d.findings), verdict=verdict, notes=(*d.notes, *notes)),
    )


def diagnose_points(machine: Machine, survey: Survey, progress: Progress = silent, read: bool = False) -> Diagnosed:
    """The diagnosis of measured positions; `read`: they stand for error motions, in which no column can be wrong."""
    if not np.isfinite(survey.fit.measured).any() and not any(groups(survey.fit.table, survey.observations)):
        nothing = "no row to fit has a measured position, reading or error motion, which the diagnosis works on"
        cure = "Add rows with mx my mz, of observations (length, angle), or about error motions (joint, dx ... ec)"
        raise InputError(str(survey.source), nothing, cure)
    blunders, log, oriented = list[Blunder](), DecisionLog(), tuple[str, ...]()
    if not read:
        with progress("Looking for mistakes in the columns"):
            blunders = find_blunders(machine, survey, log)
        if unclear := [b for b in blunders if b.open]:
            raise refused(survey, unclear[0])
    with progress("Fitting the machine"):
        before = [fit_if_possible(machine, s) for s in (survey, *(b.survey for b in blunders))[: len(blunders)]]
        survey = blunders[-1].survey if blunders else survey
        mended = fit_machine(machine, survey)
        check_readings(mended)
        check_declared(mended)
        if not read:
            refuse_turned_head(mended)
            oriented = orientation_notes(mended.survey, mended.problem)
            refuse_unstated_rotation(mended)
            refuse_another_machine(mended, tried=True)
        noise_checked = bool(survey.motions_of) and not read  # by the registration that they come from
        sound, fit, bad = _without_outliers(machine, survey, mended, log, 0 if noise_checked else 3)
    changes = [change for b in blunders for change in b.changes]
    dead = dead_sensors(survey)
    for name, reason in dead.items():
        log.add("sensor-fault", "not considered", f"column {name}", beside=reason)
    found = explained(fit, sound, changes, progress, log)

    def again(left_out: Mask) -> tuple[Fit, Explanation]:
        """The fit and the search without other gross rows."""
        log.again()
        rest = _without_fit_rows(survey, left_out)
        refitted = fit_machine(machine, rest)
        return refitted, explained(refitted, rest, changes, progress, log)

    if bad.any() and found.model.steps:
        # what was found may explain rows that were far out: then they are no outliers, and show its form best
        extended = found.final.chain.machine
        _, _, still = _without_outliers(extended, survey, fit_machine(extended, survey), log)
        fewer = still.sum() < bad.sum()
        log.add("outliers-explained", "found" if fewer else "passed", "rows", int(still.sum()), int(bad.sum()))
        if fewer:
            bad = still
            fit, found = again(bad)
    if not noise_checked and (more := gross_rows(found.final, log, earlier=bad) & ~bad).any():
        bad = bad | more  # what was found had hidden them, or made them seem heavy tails
        fit, found = again(bad)
    found = with_wanderer(found, changes, progress, log)
    # what was found before courses in time is judged without them: they take the place of what has no name
    earlier = {g[0].effect.key: (found.model, g) for g in found.model.findings}
    found, dependence = with_courses(found, changes, progress, log)
    model, final, first = found.model, found.final, found.first
    fits = [*before, mended]
    findings = [_blunder_finding(b, *fits[k : k + 2]) for k, b in enumerate(blunders)]
    causes = []
    functions = recorded(model.start, np.unique(model.start.index)) if model.findings else []
    for g in model.findings:
        cause = _finding(g, model, final, found.before, first, found.witnessed.get(g[0].effect, []), log)
        causes.append(checked_alternative(cause, *earlier.get(g[0].effect.key, (model, g)), functions, log))
    # in a form that is not its name
    nameless = [g[0].effect for g, c in zip(model.findings, causes, strict=True) if c.effect != g[0].effect.effect]
    # in the rows that are fitted both are the same, and what is beyond them takes several times as long
    others = other_effects(final, model, first)
    known = {g[0].effect.key for g in model.findings}
    perhaps = [p for p in found.perhaps if p.effect.key not in known]
    others += with_one_more(final, perhaps)
    final = replace(known_where_recorded(final, model, first, nameless), others=others)
    # the evidence of what is perhaps there takes for noise what varies from row to row with its levers: then it is none
    said = () if dependence is not None and not dependence.channels else perhaps
    findings += sorted(causes, key=lambda f: -f.heldout_rms_um.before)
    if bad.any():
        findings.append(outlier_finding(bad, mended.survey, found.final))
    dependence = no_larger(dependence, final)
    verdict = judge(final, bool(findings), dependence, log)
    final = replace(
        final,
        systematic_mm=1e-3 * verdict.systematic_um,
        systematic_by=verdict.systematic_by,
        expansions=open_expansions(model.linear, final),
    )
    baseline = next((b for b in fits if b is not None), mended)
    diagnosis = Diagnosis(
        verdict.word,
        1e3 * noise_mm(final),
        _summary(baseline),
        _summary(final),
        tuple(findings),
        tuple(found.untestable),
        verdict.unexplained,
        dependence,
        (
            *final.notes,
            *noise_notes(mended),
            *oriented,
            *large_scales(final),
            *station_notes(final, log),
            *(f"{name} drives nothing: {reason}" for name, reason in dead.items()),
            *contrary_sides(survey, log),
            *tool_notes(mended.chain, survey),
            *aliased_periods(model),
            *doubtful_rows(final),
            *perhaps_there(said, model.linear.scene.columns),
            *(untimed_path(model.linear) if findings or verdict.word != "adequate" else ()),
            *verdict.notes,
        ),
        by_observation(baseline, final),
        final.fitted.n > 0 or not final.problem.readings,
        final.solution.dof,
        None if final.sigma_rad is None else 1e6 * final.sigma_rad,
    )
    model.start.ended()  # of an arm hundreds of megabytes, beside the fits that tables and the report are of
    return Diagnosed(diagnosis, baseline, final, model, found.ranking, log=log)


def _without_outliers(
    machine: Machine, survey: Survey, fit: Fit, log: DecisionLog, times: int = 3
) -> tuple[Survey, Fit, Mask]:
    """The survey without what was measured in gross rows, its fit, and those rows (mask over the rows to fit)."""
    bad = np.zeros(len(fit.survey), dtype=bool)
    for _ in range(times):  # gross rows hide smaller ones
        more = gross_rows(fit, log) & ~bad
        if not more.any():
            more = masked_rows(fit, partial(fit_if_possible, machine, survey, robust=True), log) & ~bad
        if not more.any():
            break
        bad |= more
        survey = _without_fit_rows(survey, bad)
        fit = fit_machine(machine, survey)
    return survey, fit, bad


def _without_fit_rows(survey: Survey, bad: Mask) -> Survey:
    mask = np.zeros(len(survey), dtype=bool)
    mask[np.flatnonzero((survey.table["role"] == "fit").to_numpy())[bad]] = True
    return without(survey, mask)


def _summary(fit: Fit) -> dict[str, float | None]:
    s = fit.solution
    return {
        "rms_um": spread(fit).rms_um,
        "heldout_rms_um": spread(fit, heldout=True).rms_um,
        "reduced_chi2": s.chi2 / s.dof if s.dof > 0 else None,
    }


def _finding(
    group: Sequence[Step],
    model: EffectModel,
    final: Fit,
    before: Fit,
    first: int,
    results: Sequence[WitnessResult],
    log: DecisionLog,
) -> Finding:
    """A finding from its steps: the effect, and the refinements of its form."""
    step, machine = group[0], final.chain.machine
    main = step.effect
    linear = model.without(group)  # geometry and the other findings fitted, this one not
    columns, values = linear.estimates([s.effect for s in group])
    numbers = [first + k for k, step in enumerate(model.steps) if any(step is s for s in group)]
    made = values @ columns[:, : model.start.size]
    left = model.start.project(made[None])[0]
    hidden = 1 - min(float(left @ left) / max(float(made @ made), 1e-300), 1.0)  # by the geometry (R squared)
    seen_um = rms_um(before, model.start, left[: len(model.start.index)])
    whole = replace(whole_of(final, [s.effect for s in group], numbers), seen_um=seen_um)
    probability = with_witnesses(probability_of(step), results)
    others = alternatives_of(step, linear, probability)
    log_names(log, main, probability, others)
    known = {(a.effect, a.where): a.probability for a in others}
    alike = sorted(look_alikes(step), key=lambda e: -(known.get((e.effect, e.where)) or 0.0))
    names = [named(subject(e), known.get((e.effect, e.where))) for e in alike]
    same = _same_motions(main, model.start)
    others += [a for a in elsewhere(main, same) if (a.effect, a.where) not in known]
    statement = statement_of(whole, machine, hidden, probability, names)
    sensors = sensors_probability(lags_left_open(final, model, step), main)
    others += by_other_sensors(main, motions_of(main, linear), sensors)
    places = place_probabilities(main.effect, main.where, others)
    elsewhere_said = alike_of(same, machine) or sentence_of_places(places)
    other_sensors = (sentence_of(main, sensors), unconsidered(main, linear.scene))
    at = getattr(main, "at", None) if "time" in main.drivers else None
    finding = Finding(
        effect=main.effect,
        where=main.where,
        motion=list(dict.fromkeys(m for e in _of_one_cause(group) for m in motions_of(e, linear))),
        driver=list(main.drivers),
        runs=[d[4:-1] for d in main.drivers if d.startswith("run(")] or None,
        time=[float(at)] if at is not None else None,
        period=period_of(main, machine),
        periods=periods_of(main, machine),
        statement=" ".join(filter(None, (statement, *(f"{t}." for t in results), elsewhere_said, *other_sensors))),
        parameters=whole.amounts,
        time_constants=[amount for s in group for amount in time_constants(final, model, s)],
        probability=probability,
        p_value=p_value_of(step),
        heldout_rms_um=HeldOut(*(heldout_um(before, b) for b in (linear, model.linear))),
        absorbed=hidden,
        moved=_moved(before, model.start, columns[:, : len(linear.index)], values),
        alternatives=with_places(others, main, motions_of(main, linear), places),
        next_measurement=next_measurement(main, alike[0] if alike else None, linear.scene.columns),
        size_um=whole.size_um,
        brief=brief_of(whole, machine),
        positive=main.positive(machine),
        place_probability=places[main.where],
    )
    return checked_name(finding, whole, final, log)


def _same_motions(main: Effect, linear: LinearModel) -> list[tuple[str, Motion]]:
    """Of what has no name, other elements and motions that would be the same to the tip."""
    if not isinstance(main, Unnamed) or main.element not in linear.levers:
        return []
    return alike_motions(linear, main.element, main.motion)


def _of_one_cause(group: Sequence[Step]) -> list[Effect]:
    """The effects of a finding that move the main one's element by the same drivers."""
    main = group[0].effect
    return [s.effect for s in group if s.effect.where == main.where and s.effect.drivers == main.drivers]


def _moved(before: Fit, linear: LinearModel, columns: Array, values: Array) -> dict[str, float]:
    """How far the missing effect had pushed the geometry's parameters, in the linear model's rows."""
    base, place = before.solution.groups.base, before.problem.place()
    designs = []
    for part in views_of(before, linear):
        rows = design_rows(part, place, most=len(part))[:, base]
        # component by component
        designs.append(rows[part.components.T.ravel()] / before.solution.sigma[part.kind])
    design = np.vstack(designs)
    return moved_by(design, [before.solution.unknowns[j] for j in base], columns, values)


def _blunder_finding(blunder: Blunder, before: Fit | None, after: Fit | None) -> Finding:
    errors = [spread(fit, heldout=True).rms_um if fit else float("nan") for fit in (before, after)]
    text = f"{blunder.text[0].upper()}{blunder.text[1:]}{blunder.mended}{misses(blunder)}"
    return Finding(
        effect=blunder.effect,
        where=blunder.where,
        driver=list(blunder.driver),
        statement=f"{text}.",
        probability=0.999,
        p_value=0.0,
        heldout_rms_um=HeldOut(*errors),
        next_measurement=blunder.check,
        brief=blunder.text.split(":")[0],
        size_um=blunder.before_um or 0.0,
        rows=list(blunder.rows) if blunder.rows else None,
    )
