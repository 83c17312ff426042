"""What a lag may have begun with: other temperatures of a member in the first row, as far as they are left open.

The likelihood is averaged over the logarithm of the time constant and, with a normal prior, over the member's departure
from its sensor's temperature in the first row: as if the sensor had gone on before as it did in as long as a time
constant after it, give or take as much. Where equilibrium was chosen, both are equally likely beforehand, and what
departs has the probability that this average gives it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from errormodel.arrays import Array
from errormodel.effects.base import Effect
from identification.diagnosis.search.model import EffectModel

# departures in changes of the sensor: what it was before the first row changed it by more, and is not recorded
DEPARTURES = 4 * np.sign(np.arange(-8, 9)) * (np.arange(-8, 9) / 8) ** 2
LEAST = 0.5  # standard deviation of the prior, in changes of the sensor, where it was steady at first
SHORTER = 0.2  # the shortest time constant, of the likeliest; the longest is as long as the recording
TIMES = 13  # time constants, evenly in their logarithm
NEAR = 2  # the departure, counted from none, within which it is known
CLEAR = 4.0  # chi-squared: two standard uncertainties


def initial_states(
    model: EffectModel, effect: Effect, rise: Callable[[Mapping[str, float]], float]
) -> Iterator[tuple[float, float, float]]:
    """Time constant (s), initial departure (K) and probability of colder and of warmer states in the first row.

    Parameters
    ----------
    rise : of chi-squared where fields of the effect have other values.
    """
    tau, best = getattr(effect, "tau", 0.0), getattr(effect, "initial", None)
    if not tau or best is None or effect.random:
        return
    change = float(np.ptp(model.start.channel(effect.drivers[0])))
    if not change:  # of two sensors that of the member itself was steady
        return
    taus = np.geomspace(SHORTER * tau, max(model.start.scene.duration, tau), TIMES)

    def rises(departure: float) -> Array:
        return np.array([rise({"tau": float(t), "initial": best + change * departure}) for t in taus])

    middle = len(DEPARTURES) // 2
    near = {number: rises(DEPARTURES[number]) for number in (middle - NEAR, middle + NEAR)}
    if min(chi2.min() for chi2 in near.values()) > CLEAR:
        return
    chi2 = np.array([near[k] if k in near else rises(d) for k, d in enumerate(DEPARTURES)])
    likelihood = np.exp(-0.5 * (chi2 - chi2.min()))
    behind = np.array([_behind(model, effect.drivers[0], float(t)) for t in taus]) / change
    width = np.hypot(behind, LEAST)
    prior = np.exp(-0.5 * ((best / change + DEPARTURES[:, None] - behind) / width) ** 2)
    prior *= np.gradient(DEPARTURES)[:, None]
    mass = np.sum(prior / prior.sum(axis=0) * likelihood, axis=1)
    whole = mass.sum() if best else mass.sum() + likelihood[middle].sum()
    for own in (np.arange(middle), np.arange(middle + 1, len(DEPARTURES))):
        typical = np.sqrt(np.sum(mass[own] * DEPARTURES[own] ** 2) / mass[own].sum())
        number = own[np.argmin(np.abs(np.abs(DEPARTURES[own]) - typical))]
        initial = best + change * float(DEPARTURES[number])
        yield float(taus[np.argmin(chi2[number])]), initial, float(mass[own].sum() / whole)


def _behind(model: EffectModel, sensor: str, tau: float) -> float:
    """Departure, K, of a lag behind a sensor that changed before the first row as it does in a time constant after."""
    time, values = model.start.channel("time"), model.start.channel(sensor)
    first = time <= time.min() + tau
    after = time[first] - time[first].mean()
    square = float(after @ after)
    return -tau * float(after @ values[first]) / square if square else 0.0
