"""Choice among candidate effects at one step of the search, and the acceptance test."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.effects.base import Effect
from identification.diagnosis.decisions.constants import CLEARLY, DECISIVE_ODDS
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog, Outcome
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search import correlated_noise as coloured

DETECT = math.log(DECISIVE_ODDS)
DECIMALS = 4  # of a log Bayes factor: effects that do the same have the same one, however a processor rounds


@dataclass(frozen=True)
class Step:
    """One accepted effect.

    Attributes
    ----------
    evidence : log Bayes factor against the model without it, given the steps before it; of a finished model, given all
        other findings.
    delta_chi2 : decrease of the residual sum of squares, in noise variances.
    absorbed : share of it that is collinear with the geometry.
    count : number of its parameters.
    evidence_of_form : the part that comes from the discrepancy between the effect and its textbook form.
    alternatives : other explanations, given all other findings, best first.
    parent : number of the step that this one refines, or None: a finding of its own.
    trials : number of candidates that were compared; its logarithm is the trials factor.
    names, places : number of effects among these, and of those that are this effect, at other places or by other
        drivers, for each that explains as much: all effects are equally likely beforehand, and of one effect all its
        places.
    marginal : largest evidence of the effect's shapes without refinements, given all other findings.
    """

    effect: Effect
    evidence: float
    delta_chi2: float
    absorbed: float
    count: int = 1
    evidence_of_form: float = 0.0
    alternatives: tuple[Step, ...] = ()
    parent: int | None = None
    trials: int = 0
    names: int = 1
    places: float = 1.0
    marginal: float = 0.0

    @property
    def evidence_of_textbook(self) -> float:
        """The part that its textbook form has by itself: a discrepancy counts for no detection and no first state."""
        return self.evidence - self.evidence_of_form

    @property
    def log_prior(self) -> float:
        """Of this effect at this place."""
        return -math.log(self.names * self.places)

    def of_another(self, effect: Effect, evidence: float = 0.0, parent: int | None = None) -> Step:
        """A step of an effect that was as likely beforehand, and has its evidence only."""
        own = Step(effect, evidence, 0.0, self.absorbed, parent=parent)
        return replace(own, trials=self.trials, names=self.names, places=self.places)


def choose(steps: Sequence[Step], log: DecisionLog = UNRECORDED) -> Step:
    """The likeliest named effect, unless an empirical term has clearly more evidence."""
    ranked = sorted(steps, key=lambda s: -s.evidence)
    forms = [s for s in ranked if s.effect.empirical]
    names = _names([s for s in ranked if not s.effect.empirical], log)
    if not forms or (names and forms[0].evidence <= names[0].evidence + CLEARLY):
        if forms:
            lead = forms[0].evidence - names[0].evidence
            log.add("empirical-lead", "set aside", forms[0].effect, lead, CLEARLY, beside=names[0].effect)
        return _preferred(names[0], [*forms, *names[1:], names[0]][0], log)

    return _preferred(forms[0], forms[0], log)


def _preferred(step: Step, other: Step, log: DecisionLog) -> Step:
    """The step, taken down as the preferred one, beside another."""
    beside = None if other is step else other.effect
    log.add("preference", "preferred", step.effect, step.evidence, beside=beside)
    return step


def _names(steps: Sequence[Step], log: DecisionLog) -> list[Step]:
    """Named effects in order of preference: by their log posterior odds."""
    ranked = sorted(steps, key=lambda s: -posterior(s))
    if ranked:
        log.set_aside("most-evidence", ranked, ranked[:1], posterior, posterior(ranked[0]), ranked[0].effect)
    return ranked


def posterior(step: Step) -> float:
    """Log posterior odds of an effect at its place."""
    return step.evidence + step.log_prior


def accepted(linear: LinearModel, step: Step, log: DecisionLog = UNRECORDED) -> bool:
    """Whether the evidence exceeds the trials factor and what correlated noise explains of it."""
    surplus = step.evidence - np.log(max(step.trials, 1)) - DETECT
    clear = bool(surplus >= 0)
    log.add("detection", "accepted" if clear else "refused", step.effect, surplus + DETECT, DETECT)
    if not clear:
        return False
    # a discrepancy may support a name, but it is not counted towards detection
    left, noise = surplus - step.evidence_of_form, explained_by_noise(linear, step)
    clear = bool(left >= noise)
    word: Outcome = "accepted" if clear else "refused"
    log.add("detection-in-correlated-noise", word, step.effect, left - noise + DETECT, DETECT)
    return clear


def explained_by_noise(linear: LinearModel, step: Step) -> float:
    """The part of a step's log Bayes factor that correlated noise would explain as well."""
    [(white, any_noise)] = coloured.evidence(linear, [[step.effect]])
    return max(0.0, white - any_noise)
