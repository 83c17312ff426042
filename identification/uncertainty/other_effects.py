"""Uncertainty by what a recording leaves open of an effect: its time constant, its sensor, what its lag began with.

A recording that is short beside a time constant hardly shows it, and of two sensors that warmed alike it does not show
which one is the cause. In its rows that matters little, since the sizes of effects make up for it; hours later it is
most of the uncertainty. Predictions are averaged over these models, each fitted as a whole (J. A. Hoeting et al.,
Bayesian model averaging, Statistical Science 14, 1999).
"""

from __future__ import annotations

from collections import defaultdict
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
    def of_time_constant(self) -> bool:
        """Whether a time constant is all that is another one."""
        return not {"initial", *SENSORS} & {*self.options}

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
    """Predictions (n, 9) averaged over the models: their mean, and the variance between them in their uncertainty.

    The variance between them is the mean square of what they change less the square of its mean. Different effects,
    and a time constant beside all else of an effect, are independent of each other.

    Parameters
    ----------
    predicted : position, error and standard uncertainty, mm; `predict`: the same with another effect.
    """
    square = np.zeros_like(predicted[:, :3])
    mean = defaultdict[tuple[int, bool], Array](lambda: np.zeros_like(square))
    for other in others:
        change = predict(other)[:, :3] - predicted[:, :3]
        mean[other.effect, other.of_time_constant] += other.weight * change
        square += other.weight * change**2
    out = predicted.copy()
    for change in mean.values():
        out[:, :6] += np.hstack([change, change])
        square -= change**2
    out[:, 6:] = np.sqrt(out[:, 6:] ** 2 + np.maximum(square, 0.0))
    return out
