"""What has no name is known where it was recorded: beyond, the extended machine predicts its mean, less surely."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.channels import CLOCKS, POINT_CHANNELS, columns, root
from errormodel.conventions import Motion
from errormodel.effects import make
from errormodel.effects.base import Effect
from errormodel.machine import EffectSpec
from identification.diagnosis.search.model import EffectModel
from identification.estimation.result import Fit
from identification.uncertainty.measured_range import all_round

TWO_VALUES = ("dir_", "run(", "of(")  # channels that have no value beyond those recorded
PLACES, FINE = 16, 256  # rows whose other channels are kept, and steps along one, for its slopes
SAMPLES, LENGTHS = 16, (1 / 32, 1.0)  # steps of a course in time, and its shortest and longest correlation length
SAME = 1e-3  # standard deviations: what moves less stands still
Place = tuple[str, Motion]  # element and motion


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
            if (effect.empirical or main.effect in nameless) and (known := _known(effect, number, final)):
                specs[number] = EffectSpec(effect.effect, {**specs[number].options, **known})
    if tuple(specs) == chain.machine.effects:
        return final
    return replace(final, chain=Chain(replace(chain.machine, effects=tuple(specs))))


def _known(effect: Effect, number: int, fit: Fit) -> dict[str, object]:
    """Fields ``within`` and ``spread`` of an effect; none where nothing beyond what was recorded is possible."""
    chain, named = fit.chain, fit.solution.named()
    names = effect.channels(chain.machine)
    own = [n for n in names if n not in POINT_CHANNELS]
    table = dict(zip(own, columns(fit.survey.table, own), strict=True))
    points = chain.kernel("nominal", outputs=(0, 1, 2))(chain.columns(fit.survey.table))
    table |= {name: point for name, point in zip(POINT_CHANNELS, points, strict=True) if name in names}
    parameters = np.array([named.get(i, 0.0) for i in chain.effect_ids[number]])

    def moved(values: Mapping[str, Array]) -> dict[Place, Array]:
        out: dict[Place, Array] = {}
        for parameter, term in zip(parameters, effect.terms(values.__getitem__, chain.machine), strict=True):
            for motion, rate in term.motion.items():
                out[term.element, motion] = out.get((term.element, motion), 0.0) + parameter * rate
        return out

    spread = {place: float(np.std(values)) for place, values in moved(table).items()}
    spread = {place: std for place, std in spread.items() if std > 0}
    rows = np.unique(np.linspace(0, len(fit.survey) - 1, PLACES).astype(int))
    within, wider = [], 1.0
    for name, (low, high) in _ranges(effect, table, fit).items():
        along = {n: np.repeat(values[rows, None], FINE + 1, axis=1) for n, values in table.items()}
        along[name] = np.broadcast_to(np.linspace(low, high, FINE + 1), along[name].shape)
        curves = {p: np.broadcast_to(v, along[name].shape) / spread[p] for p, v in moved(along).items() if p in spread}
        std = np.sqrt(sum(float(np.mean(np.var(c, axis=1))) for c in curves.values()))
        slope = np.sqrt(sum(float(np.mean(np.square(np.diff(c, axis=1)))) for c in curves.values()))
        if slope > 0:
            length = std / slope / FINE
            if _jumps_once(curves.values()):
                length = 1 / 3
            elif name in CLOCKS:
                wider = later_spread(max((c for own in curves.values() for c in own), key=np.var))
            within.append((name, low, high, _short(length * (high - low))))
    return (
        {"within": tuple(within), "spread": tuple((*p, _short(wider * std)) for p, std in spread.items())}
        if within
        else {}
    )


def _jumps_once(curves: Iterable[Array]) -> bool:
    """Whether motions (rows, steps) along a channel are one jump: a state that changes once in what was recorded.

    The covariance of a telegraph signal is ``exp(-2 rate |t|)``; of one event the rate is 1.5 a recording (Jeffreys'
    prior), so that such a state is forgotten in a third of what was recorded.
    """
    moved = np.any([np.abs(np.diff(c, axis=1)).max(axis=0) > SAME for c in curves], axis=0)
    return int(np.count_nonzero(moved)) == 1


def later_spread(curve: Array) -> float:
    """How much farther a motion (steps,) will be from its mean than it was, if it is a stationary Markov process.

    Of an Ornstein-Uhlenbeck process each value is ``exp(-h/l)`` times that a distance h before, and what is new; mean
    and variance are marginalised (normal, inverse gamma, Jeffreys' prior), and the geometric mean over the lengths,
    with a log-uniform prior, is taken. In so short a time a process with a long memory is nearer to its own mean than
    to its true one, which is as uncertain as later values are.
    """
    values = curve[:: (len(curve) - 1) // SAMPLES]
    last = len(values) - 1
    lengths = np.geomspace(*LENGTHS, 50)
    kept = np.exp(-1 / (last * lengths))[:, None]
    new = np.sqrt(1 - kept**2)
    first = np.ones((len(lengths), 1))
    y, ones = (np.hstack([first * x[0], (x[1:] - kept * x[:-1]) / new]) for x in (values, np.ones(last + 1)))
    weight = np.sum(ones**2, axis=1)
    left = np.sum(np.square(y - ones * (np.sum(ones * y, axis=1) / weight)[:, None]), axis=1)
    log = -last / 2 * np.log(left) - np.log(weight) / 2 - last * np.log(new[:, 0])
    posterior = np.exp(log - log.max())
    posterior /= posterior.sum()
    variance = left / (last - 2) * (1 + 1 / weight)
    return float(np.exp(posterior @ np.log(variance) / 2) / np.std(curve))


def _short(value: float) -> float:
    return float(f"{value:.4g}")


def _ranges(effect: Effect, table: Mapping[str, Array], fit: Fit) -> dict[str, tuple[float, float]]:
    """Least and largest fitted value of the channels that drive an effect, as it asks for them."""
    turning = {j.name for j in fit.chain.machine.joints if j.type == "rotary"}
    drivers = {root(name) for name in effect.drivers}
    out = {}
    for name, values in table.items():
        low, high = float(np.min(values)), float(np.max(values))
        whole_turn = name in turning and all_round(values)
        if root(name) in drivers and not name.startswith(TWO_VALUES) and high > low and not whole_turn:
            out[name] = low, high
    return out
