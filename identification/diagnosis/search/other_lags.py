"""Lags behind temperatures that a recording leaves open: of which sensor, how long, and from which state on.

The evidence is averaged over the logarithm of the time constant and, with a normal prior, over the member's departure
from its sensor's temperature in the first row: as if the sensor had gone on before as it did in as long as a time
constant after it, give or take as much. All sensors are equally likely beforehand, and so are equilibrium and not;
where a departure was chosen, equilibrium had been refused.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from errormodel.arrays import Array
from errormodel.effects.base import SENSORS, Effect
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search.blocks import NOTHING
from identification.diagnosis.search.marginal_likelihood import free_scores
from identification.diagnosis.search.model import EffectModel
from identification.diagnosis.search.scoring import Step
from identification.estimation.result import Fit

# departures in changes of the sensor: what it was before the first row changed it by more, and is not recorded
DEPARTURES = 4 * np.sign(np.arange(-8, 9)) * (np.arange(-8, 9) / 8) ** 2
MIDDLE = len(DEPARTURES) // 2
LEAST = 0.5  # standard deviation of the prior, in changes of the sensor, where it was steady at first
SHORTEST = 1 / 300  # time constant, of the recording's length; the longest is as long as that
TIMES = 9  # time constants, evenly in their logarithm, and as many about the likeliest of them
SELDOM = 0.01  # what is less likely is left out
OtherLag = tuple[dict[str, float | str], float]  # fields of an effect that are others (s, K, sensors), and probability


@dataclass(frozen=True)
class Lags:
    """Lags behind one sensor.

    Attributes
    ----------
    effect : with that sensor; its `initial` is the middle of the departures.
    taus : (t,) time constants, s; `initial`: (d,) K, or (1,) where none is possible.
    evidence : (d, t) log evidence; `prior`: (d, t) densities of departures, times their widths.
    cost : log prior odds against the effect by that sensor: of a spindle's growth its own one is likelier.
    """

    effect: Effect
    taus: Array
    initial: Array
    evidence: Array
    prior: Array
    cost: float

    def masses(self, rows: float = 1.0) -> Array:
        """Log probability, but for a factor, of each departure (d,) and at last of the steady state.

        Without the latter where a departure was chosen, which is then among the others: equilibrium was refused.

        Parameters
        ----------
        rows : that each row of the linear model stands for.
        """
        from scipy.special import logsumexp

        times = len(self.taus) > 1
        step = np.gradient(np.log(self.taus)) / np.log(self.taus[-1] / self.taus[0]) if times else np.ones(1)
        evidence = rows * self.evidence - self.cost
        steady = logsumexp(evidence[len(self.initial) // 2], b=step)
        if len(self.initial) == 1:
            return np.array([steady])
        departing = logsumexp(evidence, axis=1, b=np.maximum(self.prior * step, NOTHING))
        masses = departing if self.departed else np.append(departing, steady)
        return np.asarray(masses - np.log(2))

    @property
    def averaged(self) -> float:
        """Log evidence of the sensor, over all time constants and states."""
        from scipy.special import logsumexp

        return float(logsumexp(self.masses()))

    @property
    def departed(self) -> bool:
        """Whether a departure was chosen, which is then among the others."""
        return bool(getattr(self.effect, "initial", 0.0))

    def departing(self, probability: Array) -> Iterator[OtherLag]:
        """What stands for colder and for warmer first states, of which each departure has a `probability`."""
        for own in (np.arange(MIDDLE), np.arange(MIDDLE + 1, len(DEPARTURES))):
            if mass := float(probability[own].sum()):
                typical = np.sqrt(np.sum(probability[own] * DEPARTURES[own] ** 2) / mass)
                yield self._with(int(own[np.argmin(np.abs(np.abs(DEPARTURES[own]) - typical))])), mass

    def steady(self) -> dict[str, float | str]:
        """Fields of the likeliest one that began in equilibrium."""
        return self._with(len(self.initial) // 2)

    def _with(self, departure: int) -> dict[str, float | str]:
        """Fields of the likeliest one with a departure."""
        tau = float(self.taus[np.argmax(self.evidence[departure])])
        out: dict[str, float | str] = {"tau": tau} if tau else {}
        return out | ({"initial": float(self.initial[departure])} if len(self.initial) > 1 else {})


def lags_behind(beside: LinearModel, effect: Effect) -> Lags:
    """Lags behind an effect's sensor, of all lengths.

    Parameters
    ----------
    beside : the linear model without the effect.
    """
    return beside.answer(partial(_lags_behind, beside, effect), (effect,), "lags")


def _lags_behind(beside: LinearModel, effect: Effect) -> Lags:
    duration, best, sensor = beside.scene.duration, getattr(effect, "initial", None), sensors_of(effect)[0]
    change = float(np.ptp(beside.channel(sensor)))
    departures = DEPARTURES if best is not None and change and duration else np.zeros(1)
    initial = (best or 0.0) + change * departures
    tau = getattr(effect, "tau", None)
    taus = np.zeros(1)
    if tau is not None and duration:
        taus = np.geomspace(SHORTEST * beside.scene.worked, max(duration, tau), TIMES)
    evidence = _evidence(beside, effect, taus, initial)
    if len(taus) > 1:
        step = taus[1] / taus[0]
        centres = {int(np.argmax(evidence.max(axis=0))), int(np.argmax(evidence[len(initial) // 2]))}
        finer = np.concatenate([taus[k] * np.geomspace(1 / step, step, TIMES + 2)[1:-1] for k in centres])
        finer = np.setdiff1d(finer, taus)
        evidence = np.hstack([evidence, _evidence(beside, effect, finer, initial)])
        order = np.argsort(taus := np.append(taus, finer))
        taus, evidence = taus[order], evidence[:, order]
    prior = np.ones((1, len(taus)))
    if len(initial) > 1:
        behind = np.array([_behind(beside, sensor, float(t)) for t in taus]) / change
        prior = np.exp(-0.5 * ((initial[:, None] / change - behind) / np.hypot(behind, LEAST)) ** 2)
        prior *= np.gradient(DEPARTURES)[:, None]
        prior /= prior.sum(axis=0)
    return Lags(effect, taus, initial, evidence, prior, in_equilibrium(effect).cost(beside.scene))


def lags_left_open(final: Fit, model: EffectModel, step: Step) -> list[OtherLag]:
    """Lags that the recording leaves open: of a step's own sensor from other states, and of other sensors.

    None where no temperature drives it.
    """
    from scipy.special import logsumexp

    effect, beside = step.effect, model.without([step])
    if effect.random or not sensors_of(effect):
        return []
    lags = [lags_behind(beside, e) for e in (effect, *by_others(beside, effect))]
    masses = [own.masses(rows_of(final, model)) for own in lags]
    whole = logsumexp(np.concatenate(masses))
    if not np.isfinite(whole):  # beside all others nothing is seen of it
        return []
    out = []
    for own, mass in zip(lags, masses, strict=True):
        named = {k: getattr(own.effect, k, None) for k in SENSORS}
        of_another: dict[str, float | str] = {k: v for k, v in named.items() if v and v != getattr(effect, k)}
        probability = np.exp(mass - whole)
        states = list[OtherLag]()
        if len(own.initial) > 1:
            states += own.departing(probability[: len(own.initial)])
        if of_another:
            states.append((own.steady(), float(probability[-1])))
        # sums of probabilities may be larger than 1 by rounding
        out += [(of_another | fields, min(weight, 1.0)) for fields, weight in states if weight > SELDOM]
    return out


def sensors_of(effect: Effect) -> list[str]:
    """Temperature columns that drive an effect: its member's, and the one that it is the excess over."""
    return [str(sensor) for name in SENSORS if (sensor := getattr(effect, name, None))]


def rows_of(final: Fit, model: EffectModel) -> float:
    """Rows of the survey that each row of the linear model stands for."""
    return len(final.survey) / max(len(np.unique(model.start.index)), 1)


def in_equilibrium(effect: Effect) -> Effect:
    """The effect of a member that had its sensor's temperature in the first row."""
    return effect.model_copy(update={"initial": 0.0}) if hasattr(effect, "initial") else effect


def by_others(beside: LinearModel, effect: Effect) -> Iterator[Effect]:
    """The effect with another sensor in place of one, in equilibrium in the first row."""
    for field in SENSORS:
        if getattr(effect, field, None):
            for sensor in beside.scene.sensors:
                if sensor not in sensors_of(effect):
                    yield in_equilibrium(effect).model_copy(update={field: sensor})


def _evidence(beside: LinearModel, effect: Effect, taus: Array, initial: Array) -> Array:
    """Log evidence (d, t) with each time constant and departure."""
    return np.stack([_of_departures(beside, effect, float(tau), initial) for tau in taus], axis=1)


def _of_departures(beside: LinearModel, effect: Effect, tau: float, initial: Array) -> Array:
    """Log evidence (d,) with each departure, in which the columns of an effect are linear."""
    fields: list[Mapping[str, float]] = [{"tau": tau} if tau else {}]
    if len(initial) > 1:
        fields = [{"tau": tau, "initial": k} for k in (0.0, 1.0)]
    swept = [beside.swept([effect.model_copy(update=dict(f))]) for f in fields]
    sizes = swept[0][1]
    columns = swept[0][0][0] if len(swept) == 1 else np.vstack([swept[0][0][0], swept[1][0][0] - swept[0][0][0]])
    columns = columns * np.tile(sizes, len(swept))[:, None]
    whole, inner = columns @ columns.T, columns @ beside.basis
    one = np.eye(len(sizes))
    mix = np.stack([np.hstack([one, k * one]) if len(swept) > 1 else one for k in initial.tolist()])
    gram, square = (np.einsum("dap,pq,dbq->dab", mix, products, mix) for products in (whole - inner @ inner.T, whole))
    slope = mix @ (columns @ beside.residual)
    lengths = np.maximum(np.diagonal(square, axis1=1, axis2=2), NOTHING) * effect.changing(beside.scene)
    return np.asarray(free_scores(beside, gram, slope, lengths, np.zeros(len(initial), dtype=bool))[0])


def _behind(beside: LinearModel, sensor: str, tau: float) -> float:
    """Departure, K, of a lag behind a sensor that changed before the first row as it does in a time constant after."""
    time, values = beside.channel("time"), beside.channel(sensor)
    first = time <= time.min() + tau
    after = time[first] - time[first].mean()
    square = float(after @ after)
    return -tau * float(after @ values[first]) / square if square else 0.0
