"""What a finding says of other sensors that may be its cause, as far as a recording leaves that open."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from errormodel.effects.base import Effect
from identification.diagnosis.results.findings import Alternative
from identification.diagnosis.results.other_lags import OtherLag
from identification.diagnosis.results.statements import channel

WORTH_SAYING = 0.05  # probability: less likely sensors are in the uncertainty only

Probabilities = Mapping[tuple[str, ...], float]


def sensors_probability(others: Iterable[OtherLag], effect: Effect) -> Probabilities:
    """Probability of other sensors than an effect's, by its drivers then, the likeliest first."""
    out = dict[tuple[str, ...], float]()
    for fields, weight in others:
        if own := {k: v for k, v in fields.items() if k in ("sensor", "minus")}:
            drivers = effect.model_copy(update=own).drivers
            out[drivers] = out.get(drivers, 0.0) + weight
    return dict(sorted(out.items(), key=lambda item: -item[1]))


def sentence_of(effect: Effect, probability: Probabilities) -> str:
    """That other sensors may be the cause as well, and what would tell; empty where none is likely."""
    likely = {drivers: p for drivers, p in probability.items() if p > WORTH_SAYING}
    if not likely:
        return ""
    said = " or ".join(f"{' less '.join(map(channel, drivers))} (probability {p:.2f})" for drivers, p in likely.items())
    names = list(dict.fromkeys(n for drivers in (effect.drivers, *likely) for n in drivers))
    return f"It may as well follow {said}: record while {', '.join(names[:-1])} and {names[-1]} change differently."


def by_other_sensors(effect: Effect, motions: Sequence[str], probability: Probabilities) -> list[Alternative]:
    """The same effect at the same place by other sensors."""
    import math

    own = max(1 - sum(probability.values()), 1e-9)
    return [
        Alternative(effect.effect, effect.where, math.log10(p / own), False, [*motions], [*drivers])
        for drivers, p in probability.items()
        if p > WORTH_SAYING
    ]
