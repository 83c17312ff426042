"""Effects that are likely, with too little evidence to be found: the uncertainty of predictions has them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from errormodel.arrays import Array
from errormodel.effects.base import Effect
from identification.diagnosis.decisions.constants import CLEARLY
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog
from identification.diagnosis.results.statements import named, next_measurement, subject
from identification.diagnosis.search.candidates import WIDEST, Candidates
from identification.diagnosis.search.model import EffectModel
from identification.diagnosis.search.refinement import refined
from identification.diagnosis.search.scoring import DETECT, Step, explained_by_noise, posterior
from identification.diagnosis.search.shape_fit import optimise_shapes
from identification.estimation.fit import parameters_of
from identification.estimation.result import Fit
from identification.runtime.memory import give_back
from identification.uncertainty.other_effects import OtherEffect

EXAMINED = 12  # effects at places, the likeliest
MOST = 4  # of them in predictions: each is a fit
LEAST = 0.02  # probability: a change by less is hardly seen beside the uncertainty
WORTH_SAYING = 0.1  # probability


class Undetected(NamedTuple):
    """An effect that was not found, and the probability that it is there."""

    effect: Effect
    probability: float


def undetected(model: EffectModel, candidates: Candidates, log: DecisionLog = UNRECORDED) -> tuple[Undetected, ...]:
    """Effects with a name that may be there beside those of a model, the likeliest first.

    That there is one more is as likely beforehand as that there is none. It is any name of the library, and that at any
    of its places, by the evidence of each; a form without a name is less likely, as in the search. What correlated
    noise explains as well is no evidence, nor is a departure from a textbook form. What has evidence enough, and was
    refused for another reason, is not among them.
    """
    odds = list[tuple[float, Step]]()
    for step in optimise_shapes(model.linear, candidates, EXAMINED):
        own = posterior(step) - step.evidence_of_form - CLEARLY * step.effect.empirical
        if own > math.log(LEAST) and (own := own - explained_by_noise(model.linear, step)) < DETECT:
            odds.append((math.exp(own), step))
    whole = 1.0 + sum(value for value, _ in odds)
    named_ones = [(v / whole, s) for v, s in odds if not (s.effect.empirical or s.effect.random)]
    likely = sorted((own for own in named_ones if own[0] > LEAST), key=lambda own: -own[0])
    out = [Undetected(s.effect, p) for p, s in likely if refined(model, s) is None][:MOST]
    for effect, probability in out:
        log.add("perhaps-there", "kept", effect, probability, LEAST)
    return tuple(out)


def with_one_more(final: Fit, perhaps: Sequence[Undetected]) -> tuple[OtherEffect, ...]:
    """The models with one effect more, each fitted to the recording."""
    machine, out = final.chain.machine, []
    for effect, probability in perhaps:
        give_back()  # what the fit before has left
        spec = effect.spec
        other = OtherEffect(len(machine.effects), spec.options, probability, {}, spec.effect)
        out.append(other.fitted(parameters_of(other.machine(machine), final, WIDEST)))
    return tuple(out)


def perhaps_there(perhaps: Sequence[Undetected], columns: Mapping[str, Array]) -> Iterator[str]:
    """Notes on what may be there as well, whatever drives it; `columns`: the survey's channels by name."""
    alike = dict[str, list[Undetected]]()
    for one in perhaps:
        alike.setdefault(subject(one.effect), []).append(one)
    for what, own in alike.items():
        probability = sum(one.probability for one in own)
        if probability > WORTH_SAYING:
            yield (
                f"{'probably' if probability > 0.5 else 'perhaps'} there, with less evidence than a finding needs: "
                f"{named(what, probability)}. The uncertainty of predictions has it by that probability. To settle it: "
                f"{next_measurement(own[0].effect, None, columns)}"
            )
