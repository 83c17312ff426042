"""What a finding says of other sensors that may be its cause, as far as a recording leaves that open."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from errormodel.effects.base import SENSORS, Effect
from errormodel.exceptions import enumerated
from identification.diagnosis.results.findings import Alternative
from identification.diagnosis.search.other_lags import OtherLag, sensors_of

ROUNDED = 1e-9  # probability
WORTH_SAYING = 0.05  # probability: less likely sensors are in the uncertainty only

Probabilities = Mapping[tuple[str, ...], float]


def sensors_probability(others: Iterable[OtherLag], effect: Effect) -> Probabilities:
    """Probability of other sensors than an effect's, each beside what it is the excess over, the likeliest first."""
    out = dict[tuple[str, ...], float]()
    for fields, weight in others:
        if own := {k: v for k, v in fields.items() if k in SENSORS}:
            sensors = tuple(sensors_of(effect.model_copy(update=own)))
            out[sensors] = out.get(sensors, 0.0) + weight
    return dict(sorted(out.items(), key=lambda item: -item[1]))


def sentence_of(effect: Effect, probability: Probabilities) -> str:
    """That other sensors may be the cause as well, and what would tell; empty where none is likely."""
    likely = {sensors: p for sensors, p in probability.items() if p > WORTH_SAYING}
    if not likely:
        return ""
    said = " or ".join(f"{' less '.join(sensors)} (probability {p:.2f})" for sensors, p in likely.items())
    names = list(dict.fromkeys(n for sensors in (sensors_of(effect), *likely) for n in sensors))
    return f"It may as well follow {said}: record while {enumerated(names)} change differently."


def by_other_sensors(effect: Effect, motions: Sequence[str], probability: Probabilities) -> list[Alternative]:
    """The same effect at the same place by other sensors."""
    own = max(1 - sum(probability.values()), ROUNDED)
    beside = [n for n in effect.drivers if n not in sensors_of(effect)]
    return [
        Alternative(effect.effect, effect.where, math.log10(p / own), False, [*motions], [*beside, *sensors])
        for sensors, p in probability.items()
        if p > WORTH_SAYING
    ]
