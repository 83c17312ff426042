"""Evidence of each finding and of its alternatives beside all other findings, in white and in correlated noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog, Outcome
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search import correlated_noise as coloured
from identification.diagnosis.search.candidates import Candidates, score_of
from identification.diagnosis.search.criteria import log_likelihood_gain
from identification.diagnosis.search.model import EffectModel, of_groups
from identification.diagnosis.search.scoring import DECIMALS, Step
from identification.diagnosis.search.shape_fit import optimise_shapes, scored

MOST_EXAMINED = 8  # proposals that are looked at closely beside a finding


def conditional_scores(model: EffectModel, candidates: Candidates, log: DecisionLog = UNRECORDED) -> EffectModel:
    """The model with the evidence and the alternatives of each finding, given all other findings."""
    groups = model.findings
    for k, (main, *more) in enumerate(groups):
        linear = model.without([main, *more])
        steps = optimise_shapes(linear, candidates, MOST_EXAMINED)
        shapes = len(candidates.of_key.get(main.effect.key, [0]))
        places = next((s.places for s in steps if s.effect.effect == main.effect.effect), main.places)
        own = scored(linear, main.effect, shapes, main.trials, main.names, places) or main
        marginal = max([own.evidence, *(s.evidence for s in steps if s.effect.key == main.effect.key)])
        # refinements of the same name (a second sensor) add to its evidence; of an unnamed finding, all do
        evidence, beside = own.evidence, linear
        for before, step in pairwise([main, *more]):
            beside = beside.with_effect(before.effect)
            if main.effect.empirical or step.effect.effect == main.effect.effect:
                evidence += max(0.0, (score_of(beside, step.effect) or (0.0,))[0])
        alternatives = tuple(s for s in sorted(steps, key=lambda s: -s.evidence) if s.effect.key != main.effect.key)
        groups[k] = [
            replace(own, evidence=max(evidence, marginal), marginal=marginal, alternatives=alternatives),
            *more,
        ]
        for s in groups[k][0], *alternatives:
            word: Outcome = "kept" if s is groups[k][0] else "compared"
            gain = log_likelihood_gain(linear, s.delta_chi2)
            other = main.effect if word == "compared" else None
            log.add("conditional-evidence", word, s.effect, s.evidence, beside=other, gain=gain)
    return of_groups(model.start, groups)


def in_correlated_noise(model: EffectModel, log: DecisionLog = UNRECORDED) -> EffectModel:
    """The model with the evidence of each finding and alternative capped at its value under correlated noise."""
    groups = model.findings
    for k, (main, *more) in enumerate(groups):
        steps = [main, *main.alternatives]
        capped = _in_any_noise(model.without([main, *more]), steps)
        best, *alternatives = (replace(s, evidence=min(s.evidence, n)) for s, n in zip(steps, capped, strict=True))
        alternatives.sort(key=lambda r: -r.evidence)
        log.add("evidence-in-correlated-noise", "kept", best.effect, best.evidence)
        for s in alternatives:
            log.add("evidence-in-correlated-noise", "compared", s.effect, s.evidence, beside=main.effect)
        groups[k] = [replace(best, alternatives=tuple(alternatives)), *more]
    return of_groups(model.start, groups)


def _in_any_noise(linear: LinearModel, steps: Sequence[Step]) -> list[float]:
    """Log Bayes factor of each step under correlated noise; the discrepancy's part shrinks in proportion."""
    both = coloured.evidence(linear, [[s.effect] for s in steps])
    pairs = zip(steps, both, strict=True)
    return [round(s.evidence * max(averaged, 0.0) / max(white, 1.0), DECIMALS) for s, (white, averaged) in pairs]
