"""Uncertainty by what a recording leaves open of an effect: its time constant, its sensor, what its lag began with.

A recording that is short beside a time constant hardly shows it, and of two sensors that warmed alike it does not show
which one is the cause. In its rows that matters little, since the sizes of effects make up for it; hours later it is
most of the uncertainty. Predictions are averaged over these models, each fitted as a whole (J. A. Hoeting et al.,
Bayesian model averaging, Statistical Science 14, 1999).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array
from errormodel.effects.base import SENSORS
from errormodel.machine import EffectSpec, Machine

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class OtherEffect:
    """A model in which one effect has other fields.

    Attributes
    ----------
    effect : number of the effect in the machine.
    options : its fields that are others: `tau` (s), `initial` (K), `sensor` and the like, as in ``machine.yaml``.
    weight : the probability of those models that it stands for.
    parameters : all parameters by name, fitted with it: mm, rad, and as their effects have them.
    """

    effect: int
    options: Mapping[str, float | str]
    weight: float
    parameters: Mapping[str, float]

    def machine(self, machine: Machine) -> Machine:
        """The machine with that effect."""
        effects = [*machine.effects]
        effects[self.effect] = EffectSpec(effects[self.effect].effect, {**effects[self.effect].options, **self.options})
        return replace(machine, effects=tuple(effects))

    @property
    def sensors(self) -> list[str]:
        """Other sensors than the machine's own effect has."""
        return [str(self.options[name]) for name in SENSORS if name in self.options]

    def missing(self, table: pd.DataFrame) -> list[str]:
        """Columns of rows that it needs and that are not there, or not in all rows."""
        needed = [*self.sensors, *(["time"] if self.options.get("tau") else [])]
        return [name for name in needed if name not in table or table[name].isna().any()]


def unrecorded(others: Iterable[OtherEffect], table: pd.DataFrame) -> Iterator[str]:
    """Notes on what may be the cause as well, and is not in all rows."""
    chances = dict[str, float]()
    for other in others:
        for name in other.missing(table):
            chances[name] = chances.get(name, 0.0) + other.weight
    for name, chance in chances.items():
        yield (
            f"with a probability of {chance:.2f} an effect of the model is by {name} in truth, which is not in all "
            f"rows: what it would change is not in their uncertainty. Add the column {name}"
        )


def with_other_effects(
    others: Iterable[OtherEffect], predicted: Array, predict: Callable[[OtherEffect], Array]
) -> Array:
    """Predictions (n, 9) with what others change in their uncertainty: the mean square of it.

    Parameters
    ----------
    predicted : position, error and standard uncertainty, mm; `predict`: the same with another effect.
    """
    out = predicted.copy()
    for other in others:
        change = predict(other)[:, :3] - predicted[:, :3]
        out[:, 6:] = np.hypot(out[:, 6:], np.sqrt(other.weight) * change)
    return out
