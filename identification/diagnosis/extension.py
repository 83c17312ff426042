"""Effects that explain a fit's residuals, and the machine extended by them, refitted in exact kinematics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from errormodel.effects.base import Effect
from errormodel.machine import EffectSpec, Machine
from errormodel.survey import Survey
from identification.diagnosis.data_checks.first_approach import likelier_sides
from identification.diagnosis.decisions.log import DecisionLog, ratio
from identification.diagnosis.linear.linear_model import LEAST_RUN, MOST_ROWS, LinearModel, set_up, unused_runs
from identification.diagnosis.linear.row_residuals import spread
from identification.diagnosis.results.findings import Untestable
from identification.diagnosis.results.model_discrepancy import with_form
from identification.diagnosis.results.physical_limits import times_usual
from identification.diagnosis.results.untestable import unseen
from identification.diagnosis.results.witnesses import WitnessResult, apply_witnesses
from identification.diagnosis.search.candidates import WIDEST, Candidates, Ranked
from identification.diagnosis.search.conditional_evidence import in_correlated_noise
from identification.diagnosis.search.criteria import base_channels
from identification.diagnosis.search.forward_selection import forward_select
from identification.diagnosis.search.instrument_noise import tracker_noise
from identification.diagnosis.search.model import EffectModel, of_groups
from identification.diagnosis.search.model_comparison import NO_WORSE, compare_alternatives
from identification.diagnosis.search.proposals import enough_rows, proposed
from identification.diagnosis.search.scoring import Step
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit
from identification.runtime.progress import Progress


@dataclass(frozen=True)
class Explanation:
    """Effects that explain a fit's residuals, the fit with them, witness results, and what is untestable.

    `before` is the fit without, its rows weighed as in the `final` one. `ranking` is that before all; `first` the
    number of the first effect that was found, among the final machine's.
    """

    before: Fit
    model: EffectModel
    final: Fit
    witnessed: dict[Effect, list[WitnessResult]]
    untestable: list[Untestable]
    ranking: list[Ranked]
    first: int


def explained(
    fit: Fit,
    survey: Survey,
    changes: Sequence[Effect],
    progress: Progress,
    log: DecisionLog,
    impossible: frozenset[tuple[str, str]] = frozenset(),
) -> Explanation:
    """What explains a fit's residuals, and the survey fitted with it.

    Parameters
    ----------
    changes : effects that mend blunders.
    impossible : effects, at places, that were larger than physics has them.
    """
    linear, candidates = _tried(fit, progress, log, impossible)
    if (seen := tracker_noise(fit, linear, candidates, survey, log)) is not None:
        survey, fit = seen, fit_machine(fit.chain.machine, seen)
        del linear, candidates  # of an arm hundreds of megabytes, and as much again is made
        linear, candidates = _tried(fit, progress, log, impossible)
    if (known := likelier_sides(survey, linear, log=log)) is not None:
        return explained(fit_machine(fit.chain.machine, known), known, changes, progress, log, impossible)
    scores = candidates.scores(linear).alone()
    selected = forward_select(linear, candidates, progress, log=log)
    chosen = compare_alternatives(selected, candidates, progress, log)
    if (known := likelier_sides(survey, linear, [s.effect for s in chosen.steps], log)) is not None:
        log.again()
        return explained(fit_machine(fit.chain.machine, known), known, changes, progress, log, impossible)
    del candidates, selected  # hundreds of megabytes that the fit of all rows needs
    model, witnessed = apply_witnesses(in_correlated_noise(chosen, log), log)
    first = len(fit.chain.machine.effects) + len(changes)
    final = fit
    if changes or model.steps:
        with progress("Fitting the extended machine"):
            model, final, larger = _that_predicts(fit, model, survey, changes, log)
        if larger and not impossible:  # something else is the cause: what was found beside it was found with it
            log.again()
            return explained(fit, survey, changes, progress, log, larger)
    beside = scores.beside(model.start, model.linear)
    untestable = unseen(model.start.scene, beside, [s.effect for s in model.steps], log)
    return Explanation(fit, model, final, witnessed, untestable, scores.ranking(), first)


def _that_predicts(
    fit: Fit, model: EffectModel, survey: Survey, changes: Sequence[Effect], log: DecisionLog
) -> tuple[EffectModel, Fit, frozenset[tuple[str, str]]]:
    """The model, less findings with which rows left out are predicted worse than by the plain `fit`; and its fit.

    Less those, too, that time or temperature drives and that are larger than physics has them: their names and places.
    """
    machine = fit.chain.machine
    first = len(machine.effects) + len(changes)

    def extended(model: EffectModel) -> Fit:
        effects = [*changes, *(s.effect for s in model.steps)]
        return fit_machine(_extended(machine, effects), survey, effect_sizes=WIDEST) if effects else fit

    def error(fit: Fit) -> float:
        return spread(fit, heldout=True).rms_um or 0.0

    final, larger = extended(model), frozenset[tuple[str, str]]()
    while model.findings:
        if error(final) > NO_WORSE * error(fit):
            out = min((g[0] for g in model.findings), key=lambda s: s.evidence)
            log.add("prediction-made-worse", "removed", out.effect, ratio(error(final), error(fit)), NO_WORSE)
        elif (impossible := _impossible_later(model, final, first)) is not None:
            out, times = impossible
            log.add("physical-size", "removed", out.effect, times, WIDEST)
            larger |= {(out.effect.effect, out.effect.where)}
        else:
            break
        model = of_groups(model.start, [g for g in model.findings if g[0] is not out])
        final = extended(model)
    return model, with_form(final, model, first) if model.steps else final, larger


def _impossible_later(model: EffectModel, final: Fit, first: int) -> tuple[Step, float] | None:
    """A named effect by time or temperature that is larger than physics has it, and how many times the usual size.

    Later times and other temperatures are beyond what was measured: there such a form is no prediction.
    """
    for k, step in enumerate(model.steps):
        effect = step.effect
        if (
            step.parent is None
            and not effect.empirical
            and not effect.random
            and "temperature" in base_channels(effect)
        ):
            times, _ = times_usual(effect, final.chain.effect_ids[first + k], final)
            if times > WIDEST:
                return step, times
    return None


def _tried(
    fit: Fit, progress: Progress, log: DecisionLog, impossible: frozenset[tuple[str, str]]
) -> tuple[LinearModel, Candidates]:
    """The linear model of a fit, and every effect at every place that its survey shows and that is possible."""
    with progress("Trying all effects at all places"):
        linear = set_up(fit)
        library = [e for e in proposed(linear) if (e.effect, e.where) not in impossible]
        most = min(enough_rows(linear, library), MOST_ROWS)
        if most < MOST_ROWS:
            linear = set_up(fit, most)
        if len(fit.survey) > most:
            log.add("rows-used", "found", "rows", len(fit.survey), most)
        for label, count in unused_runs(fit.survey):
            log.add("run-labels", "not considered", f"run {label}", count, LEAST_RUN)
        candidates = Candidates.of(linear, library)
        candidates.scores(linear)
    return linear, candidates


def _extended(machine: Machine, effects: list[Effect]) -> Machine:
    specs = tuple(EffectSpec(e.effect, e.model_dump(exclude_defaults=True)) for e in effects)
    return replace(machine, effects=(*machine.effects, *specs))
