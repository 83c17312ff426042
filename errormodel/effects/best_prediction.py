"""What has no name, beyond what was recorded: the best linear prediction of a smooth stationary process.

Physics goes on; a function that nobody can name is known where it was seen. Of a process with the covariance ``variance
(1 + r) exp(-r)`` (Matern, 3/2; r: distance in correlation lengths), which has a slope and is a Markov process together
with it, the best linear prediction at r beyond the last place that was seen is ``mean + ((1 + r) value + r slope)
exp(-r)`` by the value (less the mean) and the slope (rise in a correlation length) there, and its variance ``variance
(1 - (1 + 2 r + 2 r^2) exp(-2 r))`` (C. E. Rasmussen and C. K. I. Williams, Gaussian Processes for Machine Learning,
2006, sections 2.2, 4.2.1 and B.2). The root mean square of its slope is one standard deviation in a correlation length.

What goes on in time only wanders or switches: its covariance is ``variance exp(-r)`` (Ornstein-Uhlenbeck, telegraph
signal), the best prediction ``mean + value exp(-r)`` with the variance ``variance (1 - exp(-2 r))``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from errormodel.channels import CLOCKS
from errormodel.conventions import unit_of
from errormodel.effects.base import Channels, Effect, EffectTerm
from errormodel.effects.ops import Value, exp, fmax, fmin, sqrt
from errormodel.exceptions import InputError

if TYPE_CHECKING:
    from errormodel.machine import Machine

NODES = 16  # places of a range, over which a mean is taken
STEP = 1e-3  # of a correlation length, for a slope
NOWHERE = 1e-9  # of a correlation length
EDGE = 1e-3  # of a standard deviation: the square root has a slope at the edge too
BEYOND = "beyond"  # label of the parameters that stand for what is not known there


def predicted_terms(effect: Effect, channel: Channels, machine: Machine) -> list[EffectTerm]:
    """The terms of an effect; beyond the ranges ``within`` that it was recorded in they tend to their means.

    One parameter more for each of its motions of known ``spread`` stands for what is not known there.

    Raises
    ------
    InputError
        A range ends where it begins, or before.
    """
    if not effect.within:
        return effect.terms(channel, machine)
    for name, low, high, _ in effect.within:
        if not low < high:
            found = f"{name} from {low:g} to {high:g}"
            raise InputError(f"effect {effect.effect}, key within", found, "Write [channel, low, high, length]")
    edge = {name: fmin(fmax(channel(name), low), high) for name, low, high, _ in effect.within}
    beyond = {name: channel(name) - place for name, place in edge.items()}
    r = sqrt(sum((beyond[name] / length) ** 2 for name, _, _, length in effect.within) + NOWHERE**2) - NOWHERE

    def at(places: Mapping[str, Value]) -> list[EffectTerm]:
        return effect.terms(lambda name: places[name] if name in places else channel(name), machine)

    here, in_time = at(edge), edge.keys() <= {*CLOCKS}
    before = at({name: place - STEP * beyond[name] / (r + NOWHERE) for name, place in edge.items()})
    shares = [(k + 0.5) / NODES for k in range(NODES)]
    nodes = [at({name: low + share * (high - low) for name, low, high, _ in effect.within}) for share in shares]
    out = []
    for k, term in enumerate(here):
        motions = {}
        for motion, value in term.motion.items():
            mean = sum(node[k].motion[motion] for node in nodes) / NODES
            slope = (value - before[k].motion[motion]) / STEP
            further = 0.0 if in_time else r * (value - mean + slope)
            motions[motion] = mean + (value - mean + further) * exp(-r)
        out.append(replace(term, motion=motions))
    known = 1.0 if in_time else 1 + 2 * r + 2 * r * r
    unknown = sqrt(1 - known * exp(-2 * r) + EDGE**2) - EDGE
    for element, motion, std in effect.spread:
        out.append(EffectTerm(element, BEYOND, unit_of(motion), {motion: unknown}, std, tied=True))
    return out
