"""What has no name, beyond what was recorded: best linear prediction of a process that forgets exponentially.

Physics goes on; a function that nobody can name is known where it was seen. Of a stationary process with the covariance
``variance * exp(-d / length)`` (Ornstein-Uhlenbeck), the best linear prediction at a distance d beyond the last value
is ``mean + (last - mean) exp(-d / length)``, with the variance ``variance * (1 - exp(-2 d / length))`` (C. E. Rasmussen
and C. K. I. Williams, Gaussian Processes for Machine Learning, 2006, sections 2.2 and 4.2). The length is the range that
was recorded: what forgets sooner is no smooth function of it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from errormodel.conventions import unit_of
from errormodel.effects.base import Channels, Effect, EffectTerm
from errormodel.effects.ops import Value, exp, fmax, fmin, sqrt

if TYPE_CHECKING:
    from errormodel.machine import Machine

NODES = (np.arange(16) + 0.5) / 16  # of a range, over which a mean is taken
BEYOND = "beyond"  # label of the parameters that stand for what is not known there
EDGE = 1e-3  # of a standard deviation: the square root has a slope at the edge too


def predicted_terms(effect: Effect, channel: Channels, machine: Machine) -> list[EffectTerm]:
    """The terms of an effect; beyond the ranges ``within`` that it was recorded in they tend to their means.

    One parameter more for each of its motions of known ``spread`` stands for what is not known there.
    """
    if not effect.within:
        return effect.terms(channel, machine)
    ranges = {name: (low, high) for name, low, high in effect.within}

    def inside(name: str) -> Value:
        return fmin(fmax(channel(name), ranges[name][0]), ranges[name][1]) if name in ranges else channel(name)

    def at(share: float) -> list[EffectTerm]:
        values = {name: low + share * (high - low) for name, (low, high) in ranges.items()}
        return effect.terms(lambda name: values[name] if name in values else channel(name), machine)

    away = sum(
        fmax(fmax(low - channel(name), channel(name) - high), 0.0) / (high - low) for name, (low, high) in ranges.items()
    )
    kept, nodes, out = exp(-away), [at(float(share)) for share in NODES], list[EffectTerm]()
    for k, term in enumerate(effect.terms(inside, machine)):
        means = {motion: sum(n[k].motion[motion] for n in nodes) / len(nodes) for motion in term.motion}
        motions = {motion: means[motion] + kept * (value - means[motion]) for motion, value in term.motion.items()}
        out.append(replace(term, motion=motions))
    unknown = sqrt(1.0 - kept * kept + EDGE**2) - EDGE
    for element, motion, std in effect.spread:
        out.append(EffectTerm(element, BEYOND, unit_of(motion), {motion: unknown}, std, tied=True))
    return out
