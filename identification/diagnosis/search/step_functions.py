"""Step functions in place of waves for a finding without a name: a motion that switches between two values at edges.

Supports and relays switch. A fitted wave has the right period and misses the corners; a polynomial misses the jump. Of
two drivers one may switch and the other oscillate. Edges are searched on a grid, one driver after the other, because
a step has no derivative with respect to its edge.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from errormodel.arrays import Array
from errormodel.conventions import MOTIONS
from errormodel.effects.unnamed import Unnamed, switch
from identification.diagnosis.decisions.constants import CLEARLY
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog, Outcome
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search.model import EffectModel, of_groups

PERIODS = np.geomspace(0.75, 1.33, 17)  # times that of the wave
EDGES = np.arange(16) / 32  # of a period: after half of one it switches back
FINER = 5.0  # times: the last sweep
SWEEPS = 3
STEPS = np.linspace(0.06, 0.94, 23)  # of a channel's range, where a single edge may be
MOST = 500  # places of an edge between the values that a channel has
ALONE = 8.0  # half ranges: a period of which one edge is within the range


@dataclass(frozen=True)
class _Driver:
    """A channel that switches (else swings): its values (N,) at the observations, period and edge (or zero)."""

    x: Array
    period: float
    edge: float
    once: bool = False
    switches: bool = True

    @property
    def shape(self) -> Array:
        if self.switches:
            return np.asarray(switch(self.x, self.period, self.edge))
        return np.sin(2 * np.pi / self.period * (self.x - self.edge))

    def near(self, narrow: float) -> Iterator[_Driver]:
        """Other periods and edges, `narrow` times nearer than at first."""
        if self.once:
            low, high = float(self.x.min()), float(self.x.max())
            edges = low + (high - low) * STEPS
            if narrow > 1:  # between the values that there are
                values = np.unique(self.x)
                between = (values[1:] + values[:-1]) / 2
                edges = between[np.abs(between - self.edge) < (high - low) / narrow / 2][:: len(between) // MOST + 1]
            yield from (replace(self, edge=float(e)) for e in edges)
            return
        for factor in PERIODS ** (1 / narrow):
            period = self.period * float(factor)
            shifts = EDGES if narrow == 1 else (EDGES - EDGES.mean()) / narrow
            yield from (replace(self, period=period, edge=self.edge + period * float(s)) for s in shifts)


def switched(model: EffectModel, log: DecisionLog = UNRECORDED) -> EffectModel:
    """The model with its latest finding as a step function, where that explains it clearly better."""
    if not model.findings:
        return model
    *others, group = model.findings
    main = group[0].effect
    if not isinstance(main, Unnamed) or main.random or (main.edge, main.by_edge) != (None, None):
        return model
    linear = model.without(group)
    spent = sum(len(linear.columns(s.effect)[1]) + _shapes(s.effect) for s in group)
    most = _schwarz(model.linear, spent) + CLEARLY
    step = None
    for form in _switching(linear, main):
        after, count = linear.with_effect(form), len(linear.columns(form)[1])
        value = _schwarz(after, count + _shapes(form))
        word: Outcome = "accepted" if value > most else "refused"
        log.add("step-function", word, form, value - most + CLEARLY, CLEARLY, beside=main)
        if value > most:
            step, most = replace(group[0], effect=form, delta_chi2=linear.delta_chi2(after), count=count), value
    if step is None:
        return model
    return of_groups(model.start, [*others, [step]])


def _schwarz(linear: LinearModel, parameters: int) -> float:
    """Schwarz's approximation of a model's log evidence, up to a constant."""
    n = len(linear.index)
    return float(-0.5 * n * np.log(linear.square) - 0.5 * parameters * np.log(n))


def _shapes(effect: object) -> int:
    return sum(getattr(effect, name, None) is not None for name in ("period", "by_period", "edge", "by_edge"))


def _switching(linear: LinearModel, form: Unnamed) -> Iterator[Unnamed]:
    """The best of each kind at the form's place by its drivers, where these can switch."""
    started = _started(linear, form)
    for kinds in product((True, False), repeat=len(started)):
        if any(kinds):
            drivers = [replace(d, switches=kind) for d, kind in zip(started, kinds, strict=True)]
            yield _as_effect(form, _searched(linear, form, drivers))


def _searched(linear: LinearModel, form: Unnamed, drivers: list[_Driver]) -> list[_Driver]:
    """Periods and edges that leave least, one driver after the other."""
    seen = len(linear.index)
    lever, basis, residual = (
        linear.levers[form.element][MOTIONS.index(form.motion)],
        linear.basis[:seen],
        linear.residual,
    )
    for sweep in range(SWEEPS):
        narrow = FINER if sweep == SWEEPS - 1 else 1.0
        for k in range(len(drivers)):
            rest = lever * np.prod([d.shape for n, d in enumerate(drivers) if n != k], axis=0)
            tries = [drivers[k], *drivers[k].near(narrow)]
            columns = np.array([d.shape for d in tries]) * rest
            whole = np.sum(columns**2, axis=1)
            left = whole - np.sum(np.square(columns @ basis), axis=1)
            slope = np.where(left > 1e-3 * whole, columns @ residual[:seen], 0.0)
            drivers[k] = tries[int(np.argmax(slope**2 / np.maximum(left, 1e-3 * whole)))]
    return drivers


def _as_effect(form: Unnamed, drivers: list[_Driver]) -> Unnamed:
    fields: dict[str, object] = {}
    for by, driver in zip(("", "by_"), drivers, strict=False):
        middle = float(driver.x.min() + driver.x.max()) / 2
        edge = driver.edge + driver.period * round((middle - driver.edge) / driver.period)  # one within the travel
        shape = {"form": "linear", "center": 0.0, "half_range": 1.0, "period": _short(driver.period)}
        fields |= {by + name: value for name, value in shape.items()}
        fields[by + "edge"] = _short(edge) if driver.switches else None
    return form.model_copy(update=fields)


def _started(linear: LinearModel, form: Unnamed) -> list[_Driver]:
    """The form's drivers with the phases that its own fit has."""
    joints = {j.name for j in linear.scene.moving}
    x = linear.channel(form.driver)
    if form.by is None and form.period is None:
        half = float(np.ptp(x)) / 2
        if form.driver in joints or form.driver.startswith(("dir_", "run(")) or not half:
            return []  # straightness of the joint itself is geometry
        return [_Driver(x, ALONE * half, float(np.median(x)), once=True)]
    if form.period is None or (form.by is not None and form.by_period is None):
        return []
    _, values = linear.estimates([form])
    if form.by is None or form.by_period is None:
        return [_Driver(x, form.period, _edge(values, form.period))]
    left, _, right = np.linalg.svd(values.reshape(2, 2))
    one = _Driver(x, form.period, _edge(left[:, 0], form.period))
    return [one, _Driver(linear.channel(form.by), form.by_period, _edge(right[0], form.by_period))]


def _edge(wave: Array, period: float) -> float:
    """Where ``wave[0] sin + wave[1] cos`` crosses zero on its way up."""
    return float(-np.arctan2(wave[1], wave[0]) * period / (2 * np.pi))


def _short(value: float) -> float:
    return float(f"{value:.6g}")
