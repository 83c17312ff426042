"""What has no name is known where it was recorded: beyond, the extended machine predicts its mean, less surely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.channels import columns, root
from errormodel.conventions import MOTIONS, Motion
from errormodel.effects import make
from errormodel.effects.base import Effect
from errormodel.machine import EffectSpec
from identification.diagnosis.search.model import EffectModel
from identification.estimation.result import Fit
from identification.uncertainty.measured_range import FULL_TURN_DEG

TWO_VALUES = ("dir_", "run(")  # channels that have no value beyond those recorded


def known_where_recorded(final: Fit, model: EffectModel, first: int, nameless: Sequence[Effect]) -> Fit:
    """The fit whose effects without a name state where they were recorded, and how large they are there.

    Its values and residuals are the same: in the rows that were fitted nothing changes.

    Parameters
    ----------
    first : number of the model's first effect among the machine's.
    nameless : main effects of the findings without a name.
    """
    chain = final.chain
    specs = list(chain.machine.effects)
    for main, *more in model.findings:
        for step in (main, *more):
            number = first + model.steps.index(step)
            effect = make(specs[number])
            if (effect.empirical or main.effect in nameless) and (within := _ranges(effect, final)):
                own = {"within": within, "spread": _spread(chain.effect_ids[number], final)}
                options = effect.model_copy(update=own).model_dump(exclude_defaults=True)
                specs[number] = EffectSpec(effect.effect, options)
    if tuple(specs) == chain.machine.effects:
        return final
    return replace(final, chain=Chain(replace(chain.machine, effects=tuple(specs))))


def _ranges(effect: Effect, fit: Fit) -> tuple[tuple[str, float, float], ...]:
    """Channels that drive an effect, as it asks for them, with the least and the largest value that was fitted."""
    machine = fit.chain.machine
    turning = {j.name for j in machine.joints if j.type == "rotary"}
    drivers = {root(name) for name in effect.drivers}
    names = [n for n in effect.channels(machine) if root(n) in drivers and not n.startswith(TWO_VALUES)]
    out = []
    for name, values in zip(names, columns(fit.survey.table, names), strict=True):
        low, high = float(np.min(values)), float(np.max(values))
        whole_turn = name in turning and np.degrees(high - low) >= FULL_TURN_DEG
        if high > low and not whole_turn:
            out.append((name, low, high))
    return tuple(out)


def _spread(ids: Sequence[str], fit: Fit) -> tuple[tuple[str, Motion, float], ...]:
    """Element, motion and its standard deviation (mm, rad) over the fitted rows, of the parameters of one effect."""
    chain, named = fit.chain, fit.solution.named()
    rows = chain.columns(fit.survey.table)
    terms = chain.kernel("terms", tuple(ids))(rows, np.zeros(len(chain.ids))).reshape(-1, 6, len(fit.survey))
    whole: dict[tuple[str, Motion], Array] = {}
    for name, term in zip(ids, terms, strict=False):
        parameter = chain.parameters[chain.index[name]]
        for motion, values in zip(MOTIONS, term, strict=True):
            key = parameter.element, motion
            whole[key] = whole.get(key, 0.0) + named.get(name, 0.0) * values
    return tuple((*key, float(std)) for key, values in whole.items() if (std := np.std(values)) > 0)
