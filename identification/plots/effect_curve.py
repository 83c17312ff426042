"""Error motions of a finding along its driving channel over the recorded range, with their uncertainty."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from errormodel.arrays import Array, Index
from errormodel.channels import DERIVED_CHANNEL, root
from errormodel.conventions import MOTIONS, Motion, unit_of
from errormodel.effects import make
from errormodel.effects.base import Effect
from errormodel.machine_rests import RESUMED_CHANNEL
from errormodel.path_speed import joint_of_speed
from identification.diagnosis.search.model import EffectModel
from identification.estimation.result import Fit
from identification.plots import style
from identification.results.parameter_table import printed
from identification.results.residual_projection import PAIR_SEPARATOR, Evidence, axis_of, fades, is_warm

EFFECT_POINTS = 361  # points of a curve
DRAWN_PERIODS = 3  # periods drawn of a periodic effect with many
FEW_VALUES = 8  # distinct values of a channel, up to which they are drawn as markers
# share of the largest motion's displacement at the tip: smaller motions are not drawn; by judgement
SMALL_MOTION_SHARE = 0.05
MOST_PANELS = 6  # motions drawn of a finding
EFFECT_PANEL_IN = 1.75  # inches: height of a panel


@dataclass(frozen=True)
class Curve:
    """One motion along the abscissa: values and twice the standard uncertainty, (n,), um or urad."""

    x: Array
    value: Array
    band: Array
    label: str
    colour: str
    line: str


def draw_effect_curve(evidence: Evidence, model: EffectModel, fit: Fit) -> Figure:
    """Motions of a finding (um, urad), each in a panel, with bands of twice their standard uncertainty.

    `fit` is that of the extended machine. Further channels of the finding appear as a family of curves, or as two
    branches by direction of approach; all other channels are at their median. Along time a motion is relative to the
    first row, a wave or a free curve to its mean.
    """
    panels = curves(evidence, model, fit)
    lines = -(-len(panels) // 2)
    top = 0.3 if evidence.split else 0.08
    height = lines * (EFFECT_PANEL_IN + 0.62) + top
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, height), facecolor="white")
    for k, ((element, motion), family) in enumerate(panels.items()):
        wide = 3.08 if len(panels) > 1 else 7.1
        bottom = height - top - EFFECT_PANEL_IN - (k // 2) * (EFFECT_PANEL_IN + 0.62)
        axes = style.panel(figure, 0.7 + 4.0 * (k % 2), bottom, wide, EFFECT_PANEL_IN)
        style.dress(axes, "", f"{motion} of {style.plain(element, 12)} / {printed(unit_of(motion))[1]}")
        _draw(axes, evidence, family)
    axes = figure.axes[0]
    if evidence.split:
        figure.legend(
            *axes.get_legend_handles_labels(), loc="upper left", bbox_to_anchor=(0.07, 1.0), ncols=3, frameon=False,
            fontsize=style.SMALL_TEXT, labelcolor=style.INK, handlelength=2.4, columnspacing=1.6,
        )  # fmt: skip
    return figure


def _draw(axes: Axes, evidence: Evidence, family: Sequence[Curve]) -> None:
    axes.axhline(0, color=style.MUTED, lw=0.7)
    for curve in family:
        axes.fill_between(
            curve.x, curve.value - curve.band, curve.value + curve.band, color=curve.colour, alpha=0.18, lw=0
        )
        mark = "o" if len(curve.x) <= FEW_VALUES else ""
        axes.plot(curve.x, curve.value, color=curve.colour, ls=curve.line, lw=1.6, marker=mark, ms=4, label=curve.label)
    label = axis_of(evidence.linear, evidence.abscissa.name).label  # without folding
    axes.set_xlabel(label, size=style.BODY_TEXT, color=style.INK)
    axes.margins(x=0.02 if len(family[0].x) <= FEW_VALUES else 0)


def curves(evidence: Evidence, model: EffectModel, fit: Fit) -> dict[tuple[str, Motion], list[Curve]]:
    """Curves of each motion of a finding that is large enough, the largest first."""
    effects = list(_effects(evidence, model, fit))
    place = {fit.solution.unknowns[j]: k for k, j in enumerate(fit.solution.groups.base)}
    known = [i for _, ids in effects for i in ids if i in place]  # dependent parameters act through a fitted group
    some = [place[i] for i in known]
    values = fit.solution.values[fit.solution.groups.base[some]]
    covariance = fit.solution.covariance[np.ix_(some, some)] * fit.inflation**2
    out: dict[tuple[str, Motion], list[Curve]] = {}
    size: dict[tuple[str, Motion], float] = {}
    for x, channels, level in _grids(evidence):
        rates: dict[tuple[str, Motion], Array] = {}
        for effect, ids in effects:
            for identity, term in zip(ids, effect.terms(channels, fit.chain.machine), strict=True):
                for motion, rate in term.motion.items():
                    whole = rates.setdefault((term.element, motion), np.zeros((len(known), len(x))))
                    if identity in place:
                        whole[known.index(identity)] += rate
        for key, whole in rates.items():
            since = whole - _zero(evidence, whole)
            value = values @ since
            std = np.sqrt(np.maximum(np.einsum("am,ab,bm->m", since, covariance, since), 0.0))
            factor = printed(unit_of(key[1]))[0]
            label = evidence.split.labels[level] if evidence.split else ""
            curve = Curve(x, factor * value, 2 * factor * std, label, *evidence.looks[level])
            out.setdefault(key, []).append(curve)
            arm = float(np.linalg.norm(evidence.linear.levers[key[0]][MOTIONS.index(key[1])]))
            size[key] = max(size.get(key, 0.0), float(np.abs(value).max()) * arm)
    keys = sorted(out, key=lambda key: -size[key])
    keys = [k for k in keys if size[k] > SMALL_MOTION_SHARE * size[keys[0]]] or keys[:1]
    return {k: out[k] for k in keys[:MOST_PANELS]}


def _zero(evidence: Evidence, rates: Array) -> Array:
    """Derivatives (parameters, 1) at the reference of a motion: the first row in time, or the mean of a wave or curve.

    The mean of a curve is collinear with the geometry. Other motions have no reference.
    """
    if evidence.abscissa.name == "time":
        return rates[:, :1]
    return rates.mean(axis=1, keepdims=True) if evidence.from_mean else np.zeros((len(rates), 1))


def _effects(evidence: Evidence, model: EffectModel, fit: Fit) -> Iterator[tuple[Effect, list[str]]]:
    """Effects of the finding as fitted, with the ids of their parameters.

    The selected effects are the last ones of the machine. Effects of the same kind at one place have the same labels:
    the chain holds their parameters in the order of the machine.
    """
    chain = fit.chain
    left: dict[tuple[str, str, str], list[str]] = {}
    for p in reversed(chain.parameters):
        left.setdefault((p.element, p.motion, p.term), []).append(p.id)
    specs = chain.machine.effects
    owners = [False] * (len(specs) - len(model.steps)) + [s in evidence.group for s in model.steps]
    for spec, own in zip(specs, owners, strict=True):
        effect, ids = make(spec), []
        for term in effect.terms(evidence.linear.channel, chain.machine):
            label = f"{spec.effect}-{term.label}" if term.label else spec.effect
            ids.append(left[term.element, next(iter(term.motion)), label].pop())
        if own:
            yield effect, ids


def _grids(evidence: Evidence) -> Iterator[tuple[Array, Channels, int]]:
    """Abscissa in display units, channels along it, and level of each curve."""
    name, split = evidence.abscissa.name, evidence.split
    for level in range(len(split.levels) if split else 1):
        given: dict[str, Array] = {}
        if split is not None:
            given[split.name] = np.full(1, split.levels[level])
        if name == "time":
            order = np.argsort(evidence.channel("time"), kind="stable")
            rows = evidence.first[order[np.unique(np.linspace(0, len(order) - 1, EFFECT_POINTS).astype(int))]]
            x = evidence.linear.channel("time")[rows]
            yield evidence.abscissa.factor * x, Channels(evidence, given, rows), level
        else:
            x = _range(evidence)
            yield evidence.abscissa.factor * x, Channels(evidence, given | {name: x}), level


def _range(evidence: Evidence) -> Array:
    """Recorded range of the abscissa, or its few values; of a wave with many periods, three in its middle."""
    values = evidence.channel(evidence.abscissa.name)
    if len(levels := np.unique(values)) <= FEW_VALUES:
        return levels
    low, high = float(values.min()), float(values.max())
    if evidence.abscissa.period:
        low = (low + high - DRAWN_PERIODS * evidence.abscissa.period) / 2
        high = low + DRAWN_PERIODS * evidence.abscissa.period
    return np.linspace(low, high, EFFECT_POINTS)


class Channels:
    """Channels along a curve: prescribed ones, recorded ones (time and temperatures, where `rows` are), else medians.

    Without recorded rows temperatures are stationary: lagged channels equal the channels themselves, and nothing is
    left of the first row's state. Joints approach from the given direction, or from both in equal parts.
    """

    def __init__(self, evidence: Evidence, given: Mapping[str, Array], rows: Index | None = None) -> None:
        self._evidence, self._rows = evidence, rows
        self._given = dict(given)
        for name in given:
            if PAIR_SEPARATOR in name:
                one, other = name.split(PAIR_SEPARATOR)
                level = self._median(other)
                self._given |= {root(one): given[name] + level, root(other): level}
            else:
                self._given.setdefault(root(name), given[name])

    def __call__(self, name: str) -> Array:
        if self._rows is not None and is_warm(name):
            return self._evidence.linear.channel(name)[self._rows]
        if fades(name):
            return np.zeros(1)
        call = DERIVED_CHANNEL.fullmatch(name)
        if call and call[1] == "play":
            return self._behind(self(call[2]), float(call[3]) / 2)
        if name.startswith("dir_"):
            return self._side()
        # of the speeds of several joints only that along which the curve runs is given
        own = joint_of_speed(name) or RESUMED_CHANNEL.fullmatch(name)
        found = self._given.get(name if own else root(name))
        return self._median(name) if found is None else found

    def _side(self) -> Array:
        """Direction of approach: that of the branch, the same for all joints."""
        split = self._evidence.split
        return self._given[split.name] if split is not None and split.name.startswith("dir_") else np.zeros(1)

    def _behind(self, position: Array, half: float) -> Array:
        """Position behind a play of the joint, there and back over the range of the curve."""
        side = float(self._side()[0])
        there = np.maximum(position - half, position.min() + half if len(position) > 1 else -np.inf)
        back = np.minimum(position + half, position.max() - half if len(position) > 1 else np.inf)
        return there if side > 0 else back if side < 0 else (there + back) / 2

    def _median(self, name: str) -> Array:
        return np.array([np.median(self._evidence.channel(name))])
