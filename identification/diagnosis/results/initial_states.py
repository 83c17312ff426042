"""What a lag may have begun with: other temperatures of a member in the first row, as far as they are left open.

The likelihood is averaged over the logarithm of the time constant and, with a normal prior, over the member's departure
from its sensor's temperature in the first row. Where equilibrium was chosen, both are equally likely beforehand, and
what departs has the probability that this average gives it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from errormodel.arrays import Array
from errormodel.effects.base import Effect
from identification.diagnosis.search.model import EffectModel

# departures in changes of the sensor: what it was before the first row changed it by more, and is not recorded
WIDTH = 2.0  # standard deviation of the prior
DEPARTURES = 2 * WIDTH * np.sign(np.arange(-8, 9)) * (np.arange(-8, 9) / 8) ** 2
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
    taus = np.geomspace(SHORTER * tau, max(model.start.scene.duration, tau), TIMES)

    def rises(departure: float) -> Array:
        return np.array([rise({"tau": float(t), "initial": best + change * departure}) for t in taus])

    middle = len(DEPARTURES) // 2
    near = {number: rises(DEPARTURES[number]) for number in (middle - NEAR, middle + NEAR)}
    if min(chi2.min() for chi2 in near.values()) > CLEAR:
        return
    chi2 = np.array([near[k] if k in near else rises(d) for k, d in enumerate(DEPARTURES)])
    likelihood = np.exp(-0.5 * (chi2 - chi2.min()))
    prior = np.exp(-0.5 * ((best / change + DEPARTURES) / WIDTH) ** 2) * np.gradient(DEPARTURES)
    mass = prior * likelihood.sum(axis=1)
    whole = mass.sum() if best else mass.sum() + prior.sum() * likelihood[middle].sum()
    for own in (np.arange(middle), np.arange(middle + 1, len(DEPARTURES))):
        typical = np.sqrt(np.sum(mass[own] * DEPARTURES[own] ** 2) / mass[own].sum())
        number = own[np.argmin(np.abs(np.abs(DEPARTURES[own]) - typical))]
        initial = best + change * float(DEPARTURES[number])
        yield float(taus[np.argmin(chi2[number])]), initial, float(mass[own].sum() / whole)
