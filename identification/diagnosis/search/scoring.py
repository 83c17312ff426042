"""One explanation against others at a step of the search, and when it is convincing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.effects.base import Effect
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search import correlated_noise as coloured
from identification.diagnosis.search.criteria import base_channels

DETECT = 4.6  # nats beyond the number of places looked at, a hundred to one: of 300 empty surveys the best had 3.4
CLEARLY = 6.0  # nats
NEAR = 0.1  # of the best evidence
# nats for physics of a form of its own, unbent, against what follows any smooth curve: right in 56 of the 66 calls by
# which it was chosen, of three seeds of the proof (141421, 17320508 and 2236067)
ODDS = 1.0
AS_GOOD = 2.3  # nats: less than ten to one
STIFF = 2  # parameters of a form that can hardly bend: a line, or a product of two
FORM = 0.85  # a name may explain this much less than the best mere form: forms bend to anything
ANOTHER_CAUSE = 0.95  # the same of a line that something else drives


@dataclass(frozen=True)
class Step:
    """One accepted effect.

    Attributes
    ----------
    evidence : nats against nothing, beside what was accepted before, and of a growth that is done beside all other
        findings; `alone`: that of it by itself, as its rivals have theirs; `drop`: of the residual sum of squares, in
        noise variances; `absorbed`: the part of it that the geometry hides.
    alternatives : other explanations beside all other findings, best first.
    count : its parameters; `bend`: the part of the drop that is a departure from its textbook form, and
        `worth`: that of the evidence.
    partner : a second cause of the same motion that was accepted with it.
    parent : number of the step that this one refines, or None: a finding of its own.
    """

    effect: Effect
    evidence: float
    delta_chi2: float
    absorbed: float
    count: int = 1
    delta_chi2_of_form: float = 0.0
    evidence_of_form: float = 0.0
    alternatives: tuple[Step, ...] = ()
    partner: tuple[Effect, ...] = ()
    parent: int | None = None
    trials: int = 0
    marginal: float = 0.0


def choose(linear: LinearModel, steps: Sequence[Step]) -> Step:
    """The named explanation with most evidence, unless a mere form explains clearly more, or as much more simply."""
    ranked = sorted(steps, key=lambda s: -s.evidence)
    forms = [s for s in ranked if s.effect.empirical]
    names = _names(linear, [s for s in ranked if not s.effect.empirical])
    if not forms or (names and forms[0].evidence <= names[0].evidence + CLEARLY):
        return names[0]

    def explains_as_much(name: Step) -> bool:
        idle = name.count - forms[0].count  # parameters that the name has and the form does without
        stiff = forms[0].count <= STIFF
        bends = name.delta_chi2_of_form if stiff else 0.0  # what bends may not be said to explain what does not
        as_much = name.delta_chi2 - bends >= FORM * forms[0].delta_chi2
        if stiff and not base_channels(forms[0].effect) <= base_channels(name.effect):  # nor what follows another cause
            as_much = as_much and name.delta_chi2 >= ANOTHER_CAUSE * forms[0].delta_chi2
        return as_much and (idle <= 1 or name.delta_chi2 - forms[0].delta_chi2 >= 2 * idle)

    return next(filter(explains_as_much, names), forms[0])


def _names(linear: LinearModel, ranked: Sequence[Step]) -> list[Step]:
    """Names in the order in which they are to be considered.

    Of what is nearly alike, first what leaves residuals that need no correlated noise to be explained; and physics of
    a form of its own that needs little bending before what follows any smooth curve: that need not be bent.
    """
    if len(ranked) < 2:
        return list(ranked)
    reach = max(CLEARLY, NEAR * ranked[0].evidence)
    able = [s for s in ranked if s.evidence > ranked[0].evidence - reach]
    left = dict(zip(map(id, able), evidence_in_any_noise(linear, able), strict=True))
    near = [s for s in able if left[id(s)] > max(left.values()) - reach]
    near = sorted((s for s in near if s.evidence > near[0].evidence - CLEARLY), key=lambda s: -left[id(s)])
    most = max(s.delta_chi2 - s.delta_chi2_of_form for s in near)
    least = max((s.evidence - s.evidence_of_form for s in near if s.effect.flexible), default=-np.inf) - ODDS
    own = [s for s in near if not s.effect.flexible and s.evidence - s.evidence_of_form > least]
    own = [s for s in own if left[id(s)] > left[id(own[0])] - AS_GOOD]
    first = [s for s in own if s.delta_chi2 - s.delta_chi2_of_form >= FORM * most] or near
    return [*first, *(s for s in ranked if s not in first)]


def evidence_in_any_noise(linear: LinearModel, steps: Sequence[Step]) -> list[float]:
    """Nats of each step where noise may go along from row to row: bends take their share of what that leaves."""
    both = coloured.evidence(linear, [[s.effect] for s in steps])
    return [s.evidence * max(nats, 0.0) / max(white, 1.0) for s, (white, nats) in zip(steps, both, strict=True)]


def accepted(linear: LinearModel, step: Step, *, noise_checked: bool = True) -> bool:
    """Whether evidence outweighs the places looked at and, `noise_checked`, what correlated noise would make of it."""
    surplus = step.evidence - np.log(max(step.trials, 1)) - DETECT
    # to a form that bends, correlated noise would be worth even more: bending helps a name, it detects nothing
    return bool(
        surplus >= 0 and (not noise_checked or surplus - step.evidence_of_form >= explained_by_noise(linear, step))
    )


def explained_by_noise(linear: LinearModel, step: Step) -> float:
    """Nats of a step's evidence that noise correlated from row to row would make as well."""
    [(white, any_noise)] = coloured.evidence(linear, [[step.effect, *step.partner]])
    return max(0.0, white - any_noise)
