"""Effects that explain a fit's residuals, and the machine extended by them, refitted in exact kinematics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import Array
from errormodel.effects.base import Effect
from errormodel.survey import Survey
from identification.diagnosis.data_checks.first_approach import likelier_sides
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.jumps import jumps_instead
from identification.diagnosis.kept_findings import by_temperature, that_predicts
from identification.diagnosis.linear.noise_of_kinds import with_noise_of
from identification.diagnosis.linear.of_fit import LEAST_RUN, MOST_ROWS, set_up, unused_runs
from identification.diagnosis.results.combined_waves import Wave, largest_wave
from identification.diagnosis.results.departures import with_departures_merged
from identification.diagnosis.results.findings import Untestable
from identification.diagnosis.results.nameless_alternative import with_names_again, without_wanderers
from identification.diagnosis.results.recorded_functions import Functions
from identification.diagnosis.results.residual_dependence import predicted
from identification.diagnosis.results.undetected import Undetected, undetected
from identification.diagnosis.results.untestable import unseen
from identification.diagnosis.results.witnesses import WitnessResult, apply_witnesses
from identification.diagnosis.search.candidates import Candidates, Ranked, Scores
from identification.diagnosis.search.conditional_evidence import conditional_scores, in_correlated_noise
from identification.diagnosis.search.forward_selection import forward_select
from identification.diagnosis.search.instrument_noise import line_of_sight, tracker_noise, weighed_as_before
from identification.diagnosis.search.likeliest_sensors import with_likeliest_sensors
from identification.diagnosis.search.model import EffectModel
from identification.diagnosis.search.model_comparison import compare_alternatives
from identification.diagnosis.search.proposals import enough_rows, proposed
from identification.diagnosis.search.taken_over import Searched
from identification.diagnosis.search.whole_models import Whole, weighed_as_whole, with_likelier_names
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit
from identification.runtime.memory import give_back
from identification.runtime.progress import Progress


@dataclass(frozen=True)
class Explanation:
    """Effects that explain a fit's residuals, the fit with them, witness results, and what is untestable.

    `before` is the fit without, of the same `survey` with the same weights as the `final` one. `ranking` is that
    before all; `first` the number of the first effect that was found, among the final machine's. `perhaps` are effects
    that may be there as well. `wave` runs along two joints, and is left. `wanders` is the motion in whose favour a
    finding was left out.
    """

    survey: Survey
    before: Fit
    model: EffectModel
    final: Fit
    witnessed: dict[Effect, list[WitnessResult]]
    untestable: list[Untestable]
    ranking: list[Ranked]
    first: int
    perhaps: tuple[Undetected, ...] = ()
    wave: Wave | None = None
    wanders: Functions | None = None


def explained(
    fit: Fit,
    survey: Survey,
    changes: Sequence[Effect],
    progress: Progress,
    log: DecisionLog,
    impossible: Callable[[Effect], bool] | None = None,
    isotropic: bool = False,
    before: list[Searched] | None = None,
    weighed: bool = False,
) -> Explanation:
    """What explains a fit's residuals, and the survey fitted with it.

    Parameters
    ----------
    changes : effects that mend blunders.
    impossible : whether an effect is no candidate, because an earlier search found it larger than physics has it.
    isotropic : whether the noise is known to be, because an earlier search left nothing of a line of sight.
    before : one earlier search of the same rows with other directions of approach; the list is emptied, as nobody else
        is to keep the hundreds of megabytes.
    weighed : whether kinds of observations have the noise that an earlier search left of them.
    """
    given, plain = survey, fit

    searched = _tried(fit, progress, log, impossible, before.pop() if before else None)
    linear, candidates = searched.linear, searched.candidates
    if not isotropic and (seen := tracker_noise(fit, linear, candidates, survey, log)) is not None:
        survey, fit = seen, fit_machine(fit.chain.machine, seen)
        del linear, candidates, searched  # of an arm hundreds of megabytes, and as much again is made
        searched = _tried(fit, progress, log, impossible)
        linear, candidates = searched.linear, searched.candidates
    scores = candidates.scores(linear).alone()
    looked = dict[object, Array]()
    selected = forward_select(linear, candidates, progress, log=log, looked=looked)
    give_back()
    chosen, models = selected, list[Whole]()
    if (known := likelier_sides(survey, linear, [s.effect for s in selected.steps], log)) is None:
        chosen, models = compare_alternatives(selected, candidates, progress, log, looked, jumps_instead(selected, log))
        if chosen is not selected:
            known = likelier_sides(survey, linear, [s.effect for s in chosen.steps], log)
    if known is not None:
        log.again()
        before = [searched]
        del linear, candidates, searched, selected, chosen, models
        known = known if survey is given else weighed_as_before(known, survey, given)
        return explained(
            fit_machine(fit.chain.machine, known), known, changes, progress, log, impossible, isotropic, before, weighed
        )
    del searched
    chosen, wave = _with_wave(chosen, candidates, progress, log, looked)
    chosen = with_likeliest_sensors(chosen, candidates, log)
    perhaps = undetected(chosen, candidates, log)
    if survey is not given and chosen.steps and not line_of_sight(fit, chosen.linear, candidates, log):
        log.again()  # it was what was found
        return explained(plain, given, changes, progress, log, impossible, isotropic=True, weighed=weighed)
    del candidates, selected  # hundreds of megabytes that the fit of all rows needs
    whole = weighed_as_whole(in_correlated_noise(chosen, log), models, log)
    model = with_departures_merged(with_names_again(with_likelier_names(whole, log), log), log)
    model, witnessed = apply_witnesses(model, log)
    del models
    model, wanders = without_wanderers(model, log)
    first = len(fit.chain.machine.effects) + len(changes)
    final = fit
    model.start.ended()  # as much again as the fit of all rows needs
    if changes or model.steps:
        with progress("Fitting the extended machine"):
            model, final, larger = that_predicts(fit, model, survey, changes, log)
        if larger:  # something else is the cause, which may have a name; if not, nothing thermal has one
            log.again()
            without = by_temperature if impossible else lambda e: (e.effect, e.where) in larger
            again = explained(fit, survey, changes, progress, log, without)
            return replace(again, untestable=_untestable(scores, again.model, log), ranking=scores.ranking())
        if not weighed and model.steps and (other := with_noise_of(fit, model.start, final, log)) is not None:
            log.again()
            return explained(other, survey, changes, progress, log, impossible, isotropic, weighed=True)
    untestable = [] if impossible else _untestable(scores, model, log)
    return Explanation(
        survey, fit, model, final, witnessed, untestable, scores.ranking(), first, perhaps, wave, wanders
    )


def _with_wave(
    model: EffectModel, candidates: Candidates, progress: Progress, log: DecisionLog, looked: dict[object, Array]
) -> tuple[EffectModel, Wave | None]:
    """The model with a wave along two joints that it had left, where this is found to move a joint; else that wave."""
    wave = largest_wave(model.linear, log)
    if wave is None or not predicted(model.linear, wave.functions(model.linear))[1]:
        return model, None
    waves = Candidates.of(model.start, list(wave.proposals(model.start)))
    further = forward_select(model.start, waves, progress, model.steps, log, looked, np.inf)
    if not any(s.effect.key in waves.of_key for s in further.steps):
        return model, wave
    return conditional_scores(further, candidates.joined(waves), log), None


def _untestable(scores: Scores, model: EffectModel, log: DecisionLog) -> list[Untestable]:
    """What cannot be seen, by the scores of all effects before anything was found."""
    beside = scores.beside(model.start, model.linear)
    return unseen(model.start.scene, beside, [s.effect for s in model.steps], log)


def _tried(
    fit: Fit,
    progress: Progress,
    log: DecisionLog,
    impossible: Callable[[Effect], bool] | None,
    before: Searched | None = None,
) -> Searched:
    """The linear model of a fit, and every effect at every place that its survey shows and that is possible."""
    with progress("Trying all effects at all places"):
        linear = set_up(fit)
        library = [e for e in proposed(linear) if impossible is None or not impossible(e)]
        most = min(enough_rows(linear, library), MOST_ROWS)
        if most < MOST_ROWS:
            linear = set_up(fit, most)
        if len(fit.survey) > most:
            log.add("rows-used", "found", "rows", len(fit.survey), most)
        for label, count in unused_runs(fit.survey):
            log.add("run-labels", "not considered", f"run {label}", count, LEAST_RUN)
        searched = before.again(linear, library) if before else Searched.of(linear, library)
        searched.candidates.scores(searched.linear)
    return searched
