"""At which places a finding's effect may be as well, as far as a recording leaves that open.

Members that do not move against each other in any row do the same to the tip, and a rotation about a fixed direction
does it wherever its axis lies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from errormodel.conventions import FRAME, INSTRUMENT
from errormodel.effects.base import Effect
from identification.diagnosis.results.findings import Alternative
from identification.diagnosis.results.other_sensors import WORTH_SAYING
from identification.diagnosis.results.statements import PLACES


def place_probabilities(effect: str, where: str, others: Sequence[Alternative]) -> dict[str, float]:
    """Probability of each place, given that the effect is what its name says; the finding's own place first.

    All places are equally likely beforehand; none is likelier than the chosen one.

    Parameters
    ----------
    effect, where : of the finding; `others`: its alternatives.
    """
    weights = {where: 1.0}
    for other in others:
        if other.effect == effect and other.where != where:
            weight = 10.0 ** min(other.log10_bayes_factor, 0.0)
            weights[other.where] = max(weights.get(other.where, 0.0), weight)
    total = sum(weights.values())
    return {place: weight / total for place, weight in weights.items()}


def with_places(
    others: Sequence[Alternative], main: Effect, motions: Sequence[str], probability: Mapping[str, float]
) -> list[Alternative]:
    """Alternatives, of which those that are the same effect elsewhere have the probability of their place.

    An instrument's effect that moves the measuring frame is at the instrument: two words for one place.

    Parameters
    ----------
    others, main, motions : alternatives, effect and motions of the finding.
    """
    name, place = main.effect, main.where
    out = [replace(a, place_probability=probability[a.where]) if a.effect == name else a for a in others]
    if place == FRAME and not main.traits().of_machine:
        same = Alternative(name, INSTRUMENT, 0.0, False, [*motions], [*main.drivers])
        out.append(replace(same, place_probability=probability[place]))
    return out


def sentence_of_places(probability: Mapping[str, float]) -> str:
    """That other places are as likely or nearly so, as a sentence; empty where none is."""
    (own, first), *others = probability.items()
    likely = sorted(((p, place) for place, p in others if p > WORTH_SAYING), reverse=True)
    if not likely:
        return ""
    *some, last = [f"{PLACES.get(place, place)} ({p:.2f})" for p, place in likely]
    said = " or ".join(part for part in (", ".join(some), last) if part)
    return f"Its place may also be {said}: that it is {PLACES.get(own, own)} has a probability of {first:.2f}."
