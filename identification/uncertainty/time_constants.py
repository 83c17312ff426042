"""Uncertainty of time constants in predictions: others that a recording leaves open, with all else fitted to them.

A recording that is short beside a time constant hardly shows it. In its rows that matters little, since the sizes of
effects make up for it; hours later it is most of the uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import Array
from errormodel.machine import EffectSpec, Machine


@dataclass(frozen=True)
class OtherConstant:
    """A model with another time constant of one effect.

    Attributes
    ----------
    effect : number of the effect in the machine.
    name : of its field; `value`, s; `weight`: the probability of those that it stands for.
    parameters : all parameters by name, fitted with it: mm, rad, and as their effects have them.
    initial : K warmer than its sensor the member was in the first row, with this constant; None: as in the machine.
    """

    effect: int
    name: str
    value: float
    weight: float
    parameters: Mapping[str, float]
    initial: float | None = None

    def machine(self, machine: Machine) -> Machine:
        """The machine with that time constant, and what the lag began with."""
        effects = [*machine.effects]
        options = {**effects[self.effect].options, self.name: self.value}
        if self.initial is not None:
            options["initial"] = self.initial
        effects[self.effect] = EffectSpec(effects[self.effect].effect, options)
        return replace(machine, effects=tuple(effects))


def with_other_constants(
    others: Iterable[OtherConstant], predicted: Array, predict: Callable[[OtherConstant], Array]
) -> Array:
    """Predictions (n, 9) whose uncertainty has that of time constants: the mean square of what others change.

    Parameters
    ----------
    predicted : position, error and standard uncertainty, mm; `predict`: the same with another time constant.
    """
    out = predicted.copy()
    for other in others:
        change = predict(other)[:, :3] - predicted[:, :3]
        out[:, 6:] = np.hypot(out[:, 6:], np.sqrt(other.weight) * change)
    return out
