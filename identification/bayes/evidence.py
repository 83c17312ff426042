"""Bayes factors of the effects of a machine in closed form, with the scores of the diagnosis."""

from __future__ import annotations

import numpy as np

from errormodel import effects
from identification.bayes.posterior import EffectEvidence
from identification.bayes.shape_parameters import without_effect
from identification.diagnosis.search.candidates import Candidates
from identification.estimation.result import Fit
from identification.observation.models import PositionView


def evidence_of(fit: Fit) -> tuple[EffectEvidence, ...]:
    """Bayes factor of each effect at its present shapes against the machine without it.

    Positions only, with white noise; empty for surveys without positions.
    """
    if not any(isinstance(v, PositionView) for v in fit.problem.views):
        return ()
    out, chain = [], fit.chain
    for number, spec in enumerate(chain.machine.effects):
        if any(np.isinf(chain.parameters[chain.index[i]].size) for i in chain.effect_ids[number]):
            continue  # of no size that is known beforehand: as of a measuring frame, there is no evidence for it
        effect = effects.make(spec)
        linear, _ = without_effect(fit, number)
        scores = Candidates.of(linear, [effect]).scores(linear)
        if len(scores.evidence) and np.isfinite(scores.evidence[0]):
            log_factor = float(scores.evidence[0] + effect.cost(linear.scene))
            out.append(EffectEvidence(effect.effect, effect.where, float(log_factor / np.log(10))))
    return tuple(out)
