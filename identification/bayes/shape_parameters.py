"""Nonlinear shape parameters of effects (a period, a time constant, a knee) by Chebyshev interpolation of columns.

Within the few standard deviations that the data allow, an effect's columns vary smoothly with its shape. They are a
linear combination of the columns at a few nodes: copies of the effect, whose sufficient statistics are gathered like
those of other effects. The likelihood at any shape then needs no pass over the rows. Shapes are sampled as logarithms,
positions (`at`) linearly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from annotated_types import Ge, Gt, Le, Lt

from errormodel import effects
from errormodel.arrays import Array
from errormodel.effects.base import Effect
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.of_fit import set_up
from identification.estimation.result import Fit
from identification.observation.models import PositionView

BRACKET_CHI2_RISE = 50.0  # rise of chi-squared at the ends of a shape's interval: about 7 standard deviations
LARGEST_LOG_SHAPE_RATIO = np.log(30.0)  # natural logarithm of the largest ratio to the value in machine.yaml
NODES_PER_SHAPE = (7, 11, 17, 25, 33, 49)  # numbers of Chebyshev nodes that are tried; piecewise effects need many
MOST_NODES_PER_EFFECT = 121  # limits time and memory
# Interpolation error of the columns between nodes, in standard uncertainties of all rows together; by judgement
INTERPOLATION_TOLERANCE_SIGMA = 0.2


@dataclass(frozen=True)
class ShapeInterpolation:
    """Chebyshev interpolation of an effect's columns over its shape parameters.

    Attributes
    ----------
    number : index of the effect in the machine.
    names : unknown fields of the effect; `logarithmic`: whether they are sampled as logarithms.
    best, low, high : (shapes,) optimum and limits, on the sampled scale.
    count : nodes per shape.
    """

    number: int
    effect: Effect
    names: tuple[str, ...]
    logarithmic: tuple[bool, ...]
    best: Array
    low: Array
    high: Array
    count: int = NODES_PER_SHAPE[0]

    def effect_at(self, moved: Array) -> Effect:
        """The effect with shapes (shapes,), given on the sampled scale."""
        values = [float(np.exp(x)) if log else float(x) for x, log in zip(moved, self.logarithmic, strict=True)]
        return self.effect.model_copy(update=dict(zip(self.names, values, strict=True)))

    @cached_property
    def nodes(self) -> Array:
        """Chebyshev nodes (count ** shapes, shapes), on the sampled scale."""
        t = np.cos((2 * np.arange(self.count) + 1) * np.pi / (2 * self.count))
        unit = np.array(list(product(t, repeat=len(self.names))))
        return np.asarray((self.low + self.high) / 2 + unit * (self.high - self.low) / 2)

    def weights(self, moved: Array) -> Array:
        """Interpolation weights (n, count ** shapes) of the nodes at shapes (n, shapes)."""
        unit = (2 * moved - self.low - self.high) / (self.high - self.low)
        k = np.arange(self.count)
        cosines = np.cos(np.outer(k, (2 * k + 1) * np.pi / (2 * self.count))) * 2 / self.count
        cosines[0] /= 2
        out = np.ones((len(moved), 1))
        for column in unit.T:
            own = np.polynomial.chebyshev.chebvander(column, self.count - 1) @ cosines
            out = (out[:, :, None] * own[:, None, :]).reshape(len(moved), -1)
        return out


def shape_interpolations(fit: Fit) -> tuple[tuple[ShapeInterpolation, ...], tuple[str, ...]]:
    """Interpolations of the shapes that can be sampled, and notes on those that keep the values of machine.yaml."""
    interpolations, notes = [], list[str]()
    seen = any(isinstance(v, PositionView) for v in fit.problem.views)
    for number, spec in enumerate(fit.chain.machine.effects):
        effect = effects.make(spec)
        names = tuple(name for name, kind in effect.shapes().items() if kind.sampled and _shaped(effect, name))
        if not names or effect.random:
            continue
        shape = _interpolated(fit, number, effect, names) if seen else None
        if shape is None:
            held = " and ".join(f"{n} {getattr(effect, n):g}" for n in names)
            notes.append(
                f"{effect.effect} at {effect.where}: {held} stays as it is, the data do not vary smoothly with it"
            )
        else:
            interpolations.append(shape)
    return tuple(interpolations), tuple(notes)


def _shaped(effect: Effect, name: str) -> bool:
    """Whether the field is a shape parameter that has a value."""
    value = getattr(effect, name)
    return isinstance(value, float) and (value > 0 or effect.shapes()[name].place)


def _interpolated(fit: Fit, number: int, effect: Effect, names: tuple[str, ...]) -> ShapeInterpolation | None:
    """The interpolation of an effect with the fewest nodes that are accurate enough; None if there is none."""
    linear, share = without_effect(fit, number)
    logs = tuple(not effect.shapes()[n].place for n in names)
    start = np.array(
        [np.log(getattr(effect, n)) if log else getattr(effect, n) for n, log in zip(names, logs, strict=True)]
    )
    shape = ShapeInterpolation(number, effect, names, logs, start, start, start)
    limits = [_limits(linear, effect, name, x) for name, x in zip(names, start, strict=True)]
    low, high, best = start.copy(), start.copy(), start.copy()
    for _ in range(1 if len(names) == 1 else 2):
        for k, (floor, ceiling) in enumerate(limits):

            def misfit(x: float, k: int = k) -> float:
                moved = best.copy()
                moved[k] = x
                return linear.with_effect(shape.effect_at(moved)).square * share

            best[k], low[k], high[k] = bracket(misfit, float(best[k]), floor, ceiling)
    if len(names) > 1:  # each was bracketed with the other held: the joint range is wider
        spread = 2.0
        low = np.maximum(best - spread * (best - low), [a for a, _ in limits])
        high = np.minimum(best + spread * (high - best), [b for _, b in limits])
    shape = replace(shape, best=best, low=low, high=high)
    for count in NODES_PER_SHAPE:
        shape = replace(shape, count=count)
        if count ** len(names) > MOST_NODES_PER_EFFECT:
            return None
        if _error(shape, linear) * np.sqrt(share) < INTERPOLATION_TOLERANCE_SIGMA:
            return shape
    return None


def without_effect(fit: Fit, number: int) -> tuple[LinearModel, float]:
    """The linear model with all but one effect fitted, and the number of survey rows per row of it."""
    solution, own = fit.solution, fit.chain.effect_ids[number]
    ours = [k for k, j in enumerate(solution.groups.base) if solution.unknowns[j] not in own]
    groups = replace(solution.groups, base=solution.groups.base[ours], coefficients=solution.groups.coefficients[ours])
    values = np.where(np.isin(solution.unknowns, own), 0.0, solution.values)
    linear = set_up(replace(fit, solution=replace(solution, groups=groups, values=values)))
    rows = sum(len(v) for v in fit.problem.views if isinstance(v, PositionView))
    return linear, rows / len(np.unique(linear.index))


def _limits(linear: LinearModel, effect: Effect, name: str, start: float) -> tuple[float, float]:
    """How far a shape may move, as moved: what its field allows, and what the survey covers."""
    if effect.shapes()[name].place:
        values = linear.channel(effect.drivers[0])
        return float(values.min()), float(values.max())
    low, high = start - LARGEST_LOG_SHAPE_RATIO, start + LARGEST_LOG_SHAPE_RATIO
    for rule in type(effect).model_fields[name].metadata:
        if isinstance(rule, Ge | Gt):
            bound = float(getattr(rule, "ge", getattr(rule, "gt", 0.0)))
            low = max(low, np.log(bound)) if bound > 0 else low
        if isinstance(rule, Le | Lt):
            high = min(high, np.log(float(getattr(rule, "le", getattr(rule, "lt", np.inf)))))
    return float(low), float(high)


def bracket(misfit: Callable[[float], float], start: float, low: float, high: float) -> tuple[float, float, float]:
    """The local minimum nearest to `start`, and the points on both sides where it has risen by `BRACKET_CHI2_RISE`.

    Parameters
    ----------
    misfit : chi-squared as a function of a shape, as sampled.
    low, high : limits, which replace a side where the rise is not reached.
    """
    from scipy.optimize import minimize_scalar

    best, least = start, misfit(start)
    step = 1e-5 * (high - low)
    for _ in range(20):
        walks = [_walk(misfit, best, least, sign * step, low, high) for sign in (-1, 1)]
        lower = min(walks, key=lambda w: w[2])
        if lower[2] > least - 1e-3:
            break
        _, best, least = lower
    left, right = walks[0][0], walks[1][0]
    found = minimize_scalar(misfit, bounds=(left, right), method="bounded", options={"xatol": 1e-4 * (right - left)})
    return (float(found.x) if found.fun < least else best), left, right


def _walk(
    misfit: Callable[[float], float], start: float, least: float, step: float, low: float, high: float
) -> tuple[float, float, float]:
    """Step outwards until the misfit has risen by `BRACKET_CHI2_RISE` or a limit is reached.

    Returns the end, the position of the smallest misfit on the way, and that misfit.
    """
    lowest = (start, least)
    while True:
        x = float(np.clip(start + step, low, high))
        here = misfit(x)
        lowest = min(lowest, (x, here), key=lambda p: p[1])
        if here - lowest[1] > BRACKET_CHI2_RISE or x in (low, high):
            return x, *lowest
        step *= 1.5


def _error(shape: ShapeInterpolation, linear: LinearModel) -> float:
    """Largest interpolation error between nodes at the effect's estimate, in standard uncertainties of all rows."""
    nodes = np.array([linear.columns(shape.effect_at(x))[0] for x in shape.nodes])
    _, values = linear.estimates([shape.effect_at(shape.best)])
    tests = np.random.default_rng(0).uniform(shape.low, shape.high, (9, len(shape.names)))
    tests = np.vstack([tests, shape.low, shape.high])
    worst = 0.0
    for x, weights in zip(tests, shape.weights(tests), strict=True):
        true, _ = linear.columns(shape.effect_at(x))
        missed = values @ (true - np.tensordot(weights, nodes, axes=1))
        worst = max(worst, float(np.linalg.norm(missed)))
    return worst
