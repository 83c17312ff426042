"""Uncertainty by what a recording leaves open of an effect: its lag, its sensor, its place, its name.

A recording that is short beside a time constant hardly shows it, and of two sensors that warmed alike it does not show
which one is the cause; a grid of few levels does not show which curve lies between them. In its rows that matters
little, since the sizes of effects make up for it; hours later, or elsewhere, it is most of the uncertainty. Predictions
are averaged over these models, each fitted as a whole (J. A. Hoeting et al., Bayesian model averaging, Statistical
Science 14, 1999).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.arrays import Array
from errormodel.channels import GAPLESS, root
from errormodel.effects import make
from errormodel.effects.base import SENSORS
from errormodel.machine import EffectSpec, Machine
from identification.uncertainty.recording_end import complete, lags

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class OtherEffect:
    """A model in which one effect has other fields, or another effect is in its place, or is there as well.

    Attributes
    ----------
    effect : number of the effect in the machine; as many as it has: one more.
    options : its fields that are others: `tau` (s), `initial` (K), `sensor` and the like, as in ``machine.yaml``.
    weight : the probability of those models that it stands for.
    parameters : all parameters by name, fitted with it: mm, rad, and as their effects have them.
    name : of another effect, of which `options` are all fields; "" of the same one.
    """

    effect: int
    options: Mapping[str, Any]
    weight: float
    parameters: Mapping[str, float]
    name: str = ""

    def spec(self, effects: Sequence[EffectSpec]) -> EffectSpec:
        """That effect, among the `effects` of the machine."""
        if self.name:
            return EffectSpec(self.name, self.options)
        own = effects[self.effect]
        return replace(own, options={**own.options, **self.options})

    def machine(self, machine: Machine) -> Machine:
        """The machine with that effect."""
        before, after = machine.effects[: self.effect], machine.effects[self.effect + 1 :]
        return replace(machine, effects=(*before, self.spec(machine.effects), *after))

    def fitted(self, parameters: Mapping[str, float]) -> OtherEffect:
        """The same with all parameters as they are fitted with it."""
        return replace(self, parameters=parameters)

    @property
    def of_time_constant(self) -> bool:
        """Whether a time constant is all that is another one."""
        return not (self.name or {"initial", "ends", *SENSORS} & {*self.options})

    @property
    def sensors(self) -> list[str]:
        """Other sensors than the machine's own effect has."""
        return [str(self.options[name]) for name in SENSORS if name in self.options]

    def channels(self, machine: Machine) -> Sequence[str]:
        """Channels that the effect depends on."""
        return make(self.spec(machine.effects)).channels(machine)

    def missing(self, machine: Machine, table: pd.DataFrame) -> list[str]:
        """Columns that it needs, and the machine's own effect does not, that are not there, or not in all rows.

        What it takes late needs no times: without them each row is in equilibrium.
        """
        own = machine.effects[self.effect : self.effect + 1]
        known = {root(c) for spec in own for c in make(spec).channels(machine)}
        needed = dict.fromkeys(root(c) for c in self.channels(machine))
        lacking = [n for n in needed if n.startswith(GAPLESS) and (n not in table or table[n].isna().any())]
        return [name for name in lacking if name not in known]


def unrecorded(others: Iterable[OtherEffect], machine: Machine, table: pd.DataFrame) -> Iterator[str]:
    """Notes on what may be the cause as well, and is not in all rows."""
    chances = dict[tuple[int, str], float]()
    likeliest = dict[tuple[int, str], OtherEffect]()
    for other in others:
        for name in other.missing(machine, table):
            key = other.effect, name
            chances[key] = chances.get(key, 0.0) + other.weight
            likeliest[key] = max(likeliest.get(key, other), other, key=lambda o: o.weight)
    for (number, name), chance in chances.items():
        found = make(likeliest[number, name].spec(machine.effects))
        yield (
            f"with a probability of {chance:.2f} {found.effect} of {found.where} acts by {name}, which is not in all "
            f"rows: what it would change is not in their uncertainty. Add the column {name}"
        )


def without_times(others: Iterable[OtherEffect], machine: Machine, table: pd.DataFrame) -> Iterator[str]:
    """Notes on effects that act late, or may, where the rows have no times."""
    if complete(table):
        return
    late = defaultdict[int, list[OtherEffect]](list)
    for other in others:
        if any(lags(other.channels(machine))):
            late[other.effect].append(other)
    for number, effect in enumerate(map(make, machine.effects)):
        if any(lags(effect.channels(machine))):
            late.pop(number, None)
            yield _settled(f"{effect.effect} of {effect.where} acts late (by {getattr(effect, 'tau', 0.0):.3g} s)")
    for same in late.values():
        likeliest = max(same, key=lambda other: other.weight)
        found = make(likeliest.spec(machine.effects))
        # time constants are independent of all else that is open
        chances = [sum(o.weight for o in same if o.of_time_constant is kind) for kind in (True, False)]
        chance = 1 - float(np.prod([1 - min(own, 1.0) for own in chances]))
        what = f"with a probability of {chance:.2f} {found.effect} of {found.where} acts late"
        yield _settled(f"{what} (likeliest: by {getattr(found, 'tau', 0.0):.3g} s)")


def _settled(late: str) -> str:
    return (
        f"{late}, and the rows have no times: in each its temperature is taken to have been the same for long. Add the "
        "column time for the course that it had"
    )


def possible_causes(others: Iterable[OtherEffect], machine: Machine) -> dict[str, str]:
    """What the recording leaves open, in words, by the column on which it depends; of the likeliest."""
    out = dict[str, str]()
    for other in sorted(others, key=lambda o: -o.weight):
        effect, channels = make(other.spec(machine.effects)), other.channels(machine)
        for name in (*map(root, channels), *(["time"] if any(lags(channels)) else [])):
            out.setdefault(name, f"{effect.effect} of {effect.where}")
    return out


def perhaps_ended(others: Iterable[OtherEffect], machine: Machine, table: pd.DataFrame) -> Iterator[str]:
    """A note on rows after the recording's end, where what warmed up may have followed what nobody recorded."""
    latest = float(table["time"].max()) if "time" in table else -np.inf
    for other in others:
        if latest > float(other.options.get("ends") or np.inf):
            warm = make(other.spec(machine.effects)).where
            yield (
                f"what warms {warm} up may be a temperature that nobody recorded, which does not settle by the clock: "
                "later than the recording the mean of both is predicted, that it goes on and that it stays as it was, "
                "and their difference is in the uncertainty. Record temperatures beside it"
            )


def with_other_effects(
    others: Iterable[OtherEffect], effects: int, predicted: Array, changed: Callable[[OtherEffect], Array]
) -> Array:
    """Predictions (n, 9) averaged over the models: their mean, and the variance between them in their uncertainty.

    The variance between them is the mean square of what they change less the square of its mean. Different effects
    are independent of each other, and so are its name and place, its sensor and first state, and its time constant. The
    likeliest time constant is in the middle of the others, and the mean over them, evenly in their logarithm, would be
    that of the longest, which the prior bounds and not the data: they are in the uncertainty only (of 58 recordings of
    two simulators they made the mean worse by more than 8 % in 9, one three times, and better in 4). So are effects
    that may be there as well: what was not found moves no prediction (in 300 recordings of four simulators the mean
    with them was worse by more than 8 % in 9, better in 4, and as good altogether).

    Parameters
    ----------
    effects : number of the machine's effects.
    predicted : position, error and standard uncertainty, mm.
    changed : how far positions (n, 3) with another effect are from those of the likeliest model, mm.
    """
    square = np.zeros_like(predicted[:, :3])
    mean = defaultdict[tuple[int, bool], Array](lambda: np.zeros_like(square))
    for other in others:
        change = changed(other)
        if other.effect < effects and not other.of_time_constant:
            mean[other.effect, bool(other.name)] += other.weight * change
        square += other.weight * change**2
    out = predicted.copy()
    for change in mean.values():
        out[:, :6] += np.hstack([change, change])
        square -= change**2
    out[:, 6:] = np.sqrt(out[:, 6:] ** 2 + np.maximum(square, 0.0))
    return out
