"""Findings that the fit of all rows keeps: those of a size that physics has, with which rows left out are predicted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from errormodel.effects.base import Effect
from errormodel.machine import Machine
from errormodel.survey import Survey
from identification.diagnosis.decisions.constants import LEAST_EVIDENCE, NO_WORSE
from identification.diagnosis.decisions.log import DecisionLog, ratio
from identification.diagnosis.linear.row_residuals import noise_mm, spread
from identification.diagnosis.results.effect_size import whole_of
from identification.diagnosis.results.model_discrepancy import with_form
from identification.diagnosis.results.physical_limits import times_usual
from identification.diagnosis.search.candidates import WIDEST
from identification.diagnosis.search.criteria import base_channels
from identification.diagnosis.search.model import EffectModel, of_groups, with_estimated_sizes
from identification.diagnosis.search.scoring import Step
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit
from identification.runtime.memory import give_back

# times the usual size, of what temperature or time drives: three standard deviations of the widest prior distribution;
# of some 750 right findings the largest was 29
LARGEST = WIDEST
# times what the plain fit leaves, of what a finding does at the tip: beyond, it cancels the geometry, and commands that
# hardly differ make both. Of 590 findings in simulators by others the largest had 60, nearly all less than 6
CANCELS = 100.0
# times the whole of a finding, of its largest part: beyond, its parts cancel. Of 27 findings with several parts in six
# simulators by others the largest right one had 1.1; one without a name had 7, and 137 um at other temperatures for 5
OPPOSED = 3.0
LITTLE_WORSE = 1.1  # times the error of rows left out that the parts of such a one must mend, to stay; by judgement
WORTH_A_TRIAL = 2.0  # error variance of rows left out, over the residuals', from which fewer refinements are tried


def that_predicts(
    fit: Fit, model: EffectModel, survey: Survey, changes: Sequence[Effect], log: DecisionLog
) -> tuple[EffectModel, Fit, set[tuple[str, str]]]:
    """The model, less findings with which rows left out are predicted worse than by the plain `fit`; and its fit.

    Also what in it is larger than physics has it, by name and place (`_too_large`).
    """
    machine = fit.chain.machine
    first = len(machine.effects) + len(changes)

    def extended(model: EffectModel) -> Fit:
        effects = [*changes, *with_estimated_sizes(model)]
        give_back()  # what the search, or the fit before, has left
        return fit_machine(_extended(machine, effects), survey, effect_sizes=WIDEST) if effects else fit

    final = extended(model)
    while model.findings:
        large = _too_large(model, final, first, log)
        if further := [s for s in large if s.parent is not None]:  # without a second sensor or lag it may be usual
            model = of_groups(model.start, [[s for s in g if s not in further] for g in model.findings])
        elif large:
            return model, final, {(s.effect.effect, s.effect.where) for s in large}
        elif (group := _cancelling(model, final, first, fit, log)) is not None:
            model = of_groups(model.start, [g for g in model.findings if g[0] is not group[0]])
        elif (
            simpler := _of_second_order(model, final, first, extended, log)
            or _with_parts_that_add(model, final, first, extended, log)
        ) is not None:
            model, final = simpler
            continue  # it is fitted
        elif _error(final) <= NO_WORSE * _error(fit):
            gone, shorter, fewer = _with_fewer_refinements(model, final, extended)
            if gone is None:
                return model, with_form(final, model, first), set()
            log.add("prediction-made-worse", "removed", gone.effect, ratio(_error(final), _error(fewer)), NO_WORSE)
            model, final = shorter, fewer
            continue  # it is fitted
        else:
            out = min((g[0] for g in model.findings), key=lambda s: s.evidence)
            log.add("prediction-made-worse", "removed", out.effect, ratio(_error(final), _error(fit)), NO_WORSE)
            model = of_groups(model.start, [g for g in model.findings if g[0] is not out])
        final = extended(model)
    return model, final, set()


def _error(fit: Fit) -> float:
    """Root mean square error of rows left out, um."""
    return spread(fit, heldout=True).rms_um or 0.0


def _with_fewer_refinements(
    model: EffectModel, final: Fit, extended: Callable[[EffectModel], Fit]
) -> tuple[Step | None, EffectModel, Fit]:
    """The model and its fit with the first refinements of a finding only, where that predicts rows left out best.

    Before them the first refinement that was given up; None, with the model and the fit as they are, where none was.

    Lags of one sensor that nearly cancel fit all rows, and miss those of another time by far. Of the error's variance
    much must be beyond that of the residuals.
    """
    if _error(final) ** 2 < WORTH_A_TRIAL * _left(final) ** 2:
        return None, model, final
    best: tuple[Step | None, EffectModel, Fit] = None, model, final
    least = _error(final) / NO_WORSE
    for number, group in enumerate(model.findings):
        for kept in range(1, len(group)):
            shorter = of_groups(model.start, [g[:kept] if k == number else g for k, g in enumerate(model.findings)])
            fewer = extended(shorter)
            if _error(fewer) < least:
                best, least = (group[kept], shorter, fewer), _error(fewer)
    return best


def _with_parts_that_add(
    model: EffectModel, final: Fit, first: int, extended: Callable[[EffectModel], Fit], log: DecisionLog
) -> tuple[EffectModel, Fit] | None:
    """The same with the first part only of a finding whose parts cancel, where rows left out show little of the rest.

    Two temperatures that rose together fit all rows by their difference, which is another thing when they do not.
    """
    for k, group in enumerate(model.findings):
        if len(group) < 2:
            continue
        *parts, whole = _sizes(model, final, first, [*([s] for s in group), group])
        if (times := ratio(max(parts), whole)) < OPPOSED:
            continue
        shorter = of_groups(model.start, [g[: 1 if n == k else None] for n, g in enumerate(model.findings)])
        fewer = extended(shorter)
        if _error(fewer) < LITTLE_WORSE * _error(final):
            log.add("opposed-parts", "removed", group[1].effect, times, OPPOSED)
            return shorter, fewer
    return None


def _too_large(model: EffectModel, final: Fit, first: int, log: DecisionLog) -> list[Step]:
    """Effects by time or temperature that are larger than physics has them.

    Later times and other temperatures are beyond what was measured: there such a form is no prediction.
    """
    out = []
    for k, step in enumerate(model.steps):
        effect = step.effect
        if not effect.random and by_temperature(effect):
            times, _ = times_usual(effect, final.chain.effect_ids[first + k], final)
            if times > LARGEST:
                log.add("physical-size", "removed", effect, times, LARGEST)
                out.append(step)
    return out


def _cancelling(model: EffectModel, final: Fit, first: int, fit: Fit, log: DecisionLog) -> list[Step] | None:
    """The finding that does most at the tip, where that is far beyond what the plain `fit` leaves of all of them."""
    left, sizes = _left(fit), _sizes(model, final, first, model.findings)
    most = int(np.argmax(sizes))
    if not left or sizes[most] <= CANCELS * left:
        return None
    group = model.findings[most]
    log.add("cancels-geometry", "removed", group[0].effect, ratio(sizes[most], left), CANCELS)
    return group


def _of_second_order(
    model: EffectModel, final: Fit, first: int, extended: Callable[[EffectModel], Fit], log: DecisionLog
) -> tuple[EffectModel, Fit] | None:
    """The model and its fit without a finding that explains nothing in exact kinematics; None where there is none.

    The search is of first order. Of an effect that moves the tip of a machine of size L by s it leaves s**2 / L, which
    seems another effect where it is more than the noise.
    """
    sizes = _sizes(model, final, first, model.findings)
    most = int(np.argmax(sizes))
    if len(sizes) < 2 or (1e-3 * sizes[most]) ** 2 < final.chain.size * noise_mm(final):
        return None
    others = [g for k, g in enumerate(model.findings) if k != most]
    for group in sorted(others, key=lambda g: g[0].evidence):
        shorter = of_groups(model.start, [g for g in model.findings if g[0] is not group[0]])
        fewer = extended(shorter)
        evidence = final.solution.dof * float(np.log(ratio(_left(fewer), _left(final))))
        enough = evidence >= LEAST_EVIDENCE
        log.add("second-order", "kept" if enough else "removed", group[0].effect, evidence, LEAST_EVIDENCE)
        if not enough:
            return shorter, fewer
    return None


def _sizes(model: EffectModel, final: Fit, first: int, groups: Sequence[Sequence[Step]]) -> list[float]:
    """Root mean square of what each group of steps of a model does at the tip, um."""
    number = {id(step): first + k for k, step in enumerate(model.steps)}
    return [whole_of(final, [s.effect for s in g], [number[id(s)] for s in g]).size_um for g in groups]


def _left(fit: Fit) -> float:
    """Root mean square residual, um."""
    return spread(fit).rms_um or 0.0


def by_temperature(effect: Effect) -> bool:
    """Whether an effect has a name, and temperature or time drives it."""
    return not effect.empirical and "temperature" in base_channels(effect)


def _extended(machine: Machine, effects: list[Effect]) -> Machine:
    return replace(machine, effects=(*machine.effects, *(e.spec for e in effects)))
