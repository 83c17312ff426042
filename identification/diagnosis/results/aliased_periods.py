"""Waves along a joint at positions that are a fixed step apart: shorter waves look the same (aliasing)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from errormodel.arrays import Array
from errormodel.machine import Joint
from identification.diagnosis.results.statements import driving, period_of, position
from identification.diagnosis.search.model import EffectModel

WHOLE = 0.02  # of the step: positions that lie so near whole steps are a grid's; by judgement: commands are rounded
SHORTEST = 1 / 13  # of the step: shorter waves are not named
NAMED, SAME = 3, 0.02  # periods in the note; share by which two of them differ at least


def aliased_periods(model: EffectModel) -> Iterator[str]:
    """A note on each wave that positions on a grid do not tell from shorter ones."""
    machine = model.linear.chain.machine
    for main, *_ in model.findings:
        joint, period = driving(main.effect, machine), getattr(main.effect, "period", None)
        if joint is None or period is None or period_of(main.effect, machine) is None:
            continue
        step = _step(model.linear.channel(joint.name), joint)
        if step and (others := _aliases(period, step)):
            some = ", ".join(position(joint, p) for p in others[:NAMED])
            more = f" and {len(others) - NAMED} shorter ones" if len(others) > NAMED else ""
            yield (
                f"positions of {joint.name} are whole steps of {position(joint, step)} apart: waves of {some}{more} "
                f"look the same there as one of {position(joint, period)}. Measure at steps that are no fraction of it"
            )


def _step(positions: Array, joint: Joint) -> float:
    """The step of a grid of which all positions of a joint are; 0 where they are of none."""
    places = np.unique(np.round(positions, 6))
    gaps = np.diff(places)
    gaps = gaps[gaps > WHOLE * (joint.travel[1] - joint.travel[0]) / max(len(places), 1)]
    if len(gaps) < 2:
        return 0.0
    step = float(gaps.min())
    whole = np.round((places - places[0]) / step)
    step = float((places[-1] - places[0]) / whole[-1])
    return step if np.abs((places - places[0]) / step - whole).max() < WHOLE else 0.0


def _aliases(period: float, step: float) -> list[float]:
    """Shorter periods with the same values at multiples of a step, the longest first."""
    rates = (abs(k / step + sign / period) for k in range(1, int(1 / SHORTEST) + 1) for sign in (-1, 1))
    shorter = sorted((1 / r for r in rates if r > 0 and SHORTEST * step <= 1 / r < (1 - SAME) * period), reverse=True)
    return [p for k, p in enumerate(shorter) if k == 0 or p < (1 - SAME) * shorter[k - 1]]
