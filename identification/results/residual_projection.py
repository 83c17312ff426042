"""Residuals without and with a finding, projected on its main motion, and the channel that they are plotted against."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.channels import DERIVED_CHANNEL, POINT_CHANNELS, root
from errormodel.conventions import MOTIONS, Motion, iso_symbol
from errormodel.effects.base import Effect
from errormodel.path_speed import joint_of_speed
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search.model import EffectModel
from identification.diagnosis.search.scoring import Step
from identification.plots import style

# periods in the recorded range, beyond which a periodic effect is plotted modulo its period; by judgement
FOLDED_PERIODS = 15
# colour and line style of levels, from low to high
LEVEL_STYLES = (style.FITTED, "-"), ("#009E73", "--"), ("#D55E00", "-.")
SIDE_LABELS = ("arrived from below", "arrived from above")  # labels of the directions of approach
MINUS_SIGN = " − "  # between the names of two channels
PAIR_SEPARATOR = "\0"  # separator of two channels whose difference is meant; no channel name contains it


@dataclass(frozen=True)
class Abscissa:
    """A channel as an axis of a figure: name with unit, and factor to that unit."""

    name: str
    label: str
    factor: float = 1.0
    period: float | None = None  # period by which it is folded; None: not folded

    def shown(self, values: Array) -> Array:
        """Channel values in display units."""
        folded = np.mod(values, self.period) if self.period else values
        return self.factor * folded


@dataclass(frozen=True)
class Split:
    """Grouping of rows and curves: by side of approach, or by levels of a second channel.

    Attributes
    ----------
    levels : (k,) value of the channel for each curve; `labels` : in words; `member` : (n,) level of each row.
    """

    name: str
    levels: Array
    labels: tuple[str, ...]
    member: Index

    @property
    def looks(self) -> Sequence[tuple[str, str]]:
        """Colour and line style of each level."""
        return LEVEL_STYLES if len(self.levels) == 3 else LEVEL_STYLES[::2]


@dataclass(frozen=True)
class Evidence:
    """Residuals of a finding, from the linear model.

    Attributes
    ----------
    linear : linear model without the finding, everything else fitted; `first` : (n,) first observation of each row.
    element, motion : motion with the largest effect; `direction` : (n, 3) its direction at the tip, reference's axes.
    before, after : (n,) residual along it without the finding and with it, um.
    """

    group: Sequence[Step]
    linear: LinearModel
    first: Index
    element: str
    motion: Motion
    before: Array
    after: Array
    abscissa: Abscissa
    split: Split | None

    @property
    def effect(self) -> Effect:
        return self.group[0].effect

    def channel(self, name: str) -> Array:
        """A channel at each row, (n,); the difference of two where the name says so."""
        return _channel(self.linear, name)[self.first]

    @property
    def waves(self) -> float:
        """Number of periods of a periodic effect in the abscissa; 0 for others."""
        period = getattr(self.effect, "period", None)
        span = float(np.ptp(self.abscissa.shown(self.channel(self.abscissa.name)))) / self.abscissa.factor
        return span / float(period) if period and self.abscissa.name == self.effect.drivers[0] else 0.0

    @property
    def from_mean(self) -> bool:
        """Whether its motions are relative to their mean along the abscissa: periodic effects and free curves."""
        return bool(self.waves) or any(s.effect.random for s in self.group)

    @property
    def looks(self) -> Sequence[tuple[str, str]]:
        """Colour and line style of each level, or of the only curve."""
        return self.split.looks if self.split else LEVEL_STYLES[:1]

    @property
    def symbol(self) -> str:
        """The motion in words: ``dy of W (EYW)``."""
        joints = {j.name for j in self.linear.chain.machine.joints}
        iso = f" ({iso_symbol(self.element, self.motion)})" if self.element in joints else ""
        return style.plain(f"{self.motion} of {self.element}{iso}", 30)


def evidence_of(model: EffectModel, group: Sequence[Step]) -> Evidence:
    """Projected residuals for one of the findings."""
    linear = model.without(group)
    rows = _Rows(linear)
    seen = len(linear.index)  # rows after the observations may be those of random effects
    before, after = linear.residual[:seen], model.linear.residual[:seen]
    whole, explained = rows.vectors(np.array([before, before - after]))
    shown: dict[tuple[str, Motion], tuple[float, Array]] = {}
    for element, motion in motions(linear, [group[0].effect]):
        (lever,) = rows.vectors(linear.levers[element][MOTIONS.index(motion)][None])
        length = np.linalg.norm(lever, axis=1, keepdims=True)
        direction = np.divide(lever, length, out=np.zeros_like(lever), where=length > 0)
        shown[element, motion] = float(np.square((explained * direction).sum(axis=1)).sum()), direction
    (element, motion), (_, direction) = max(shown.items(), key=lambda item: item[1][0])
    before, part = (1e3 * (v * direction).sum(axis=1) for v in (whole, explained))
    abscissa, split = _axes(linear, group, rows.first, part)
    return Evidence(group, linear, rows.first, element, motion, before, before - part, abscissa, split)


def motions(linear: LinearModel, effects: Sequence[Effect]) -> list[tuple[str, Motion]]:
    """Elements and motions of effects, in the order of their terms."""
    terms = [t for e in effects for t in e.terms(linear.channel, linear.chain.machine)]
    return list(dict.fromkeys((t.element, m) for t in terms for m in t.motion))


class _Rows:
    """Rows of the linear model: the whitened observations of each as a vector in mm.

    The derivatives by the frame's three translations, whitened in the same way, give the scale of one mm. Orientations,
    which no translation changes, have no part in it.
    """

    def __init__(self, linear: LinearModel) -> None:
        _, self.first, self._place = np.unique(linear.index, return_index=True, return_inverse=True)
        order = np.argsort(self._place, kind="stable")
        self._slot = np.empty_like(order)
        self._slot[order] = np.arange(len(order)) - np.searchsorted(self._place[order], self._place[order])
        frame = self._stack(linear.levers[linear.chain.element_names[0]][:3])
        self._back = np.linalg.pinv(frame.transpose(1, 2, 0))

    def vectors(self, observations: Array) -> Array:
        """Observations (k, N) as (k, n, 3), mm in the reference's axes."""
        out: Array = np.einsum("nij,knj->kni", self._back, self._stack(observations))
        return out

    def _stack(self, observations: Array) -> Array:
        out = np.zeros((len(observations), len(self.first), self._slot.max(initial=0) + 1))
        out[:, self._place, self._slot] = observations
        return out


def channels_of(linear: LinearModel, effects: Sequence[Effect]) -> list[str]:
    """Varying channels that effects depend on; a joint with play depends on the side of approach."""
    asked = dict.fromkeys(name for e in effects for name in e.channels(linear.chain.machine))
    for name in list(asked):
        if call := DERIVED_CHANNEL.fullmatch(name):
            asked[f"dir_{call[2]}" if call[1] == "play" else name] = None
    return [n for n in asked if not n.startswith("play(") and np.ptp(linear.channel(n)) > 0]


def is_warm(name: str) -> bool:
    """Whether a channel is time or a temperature, as recorded or lagged."""
    return name == "time" or root(name).startswith("T_")


def fades(name: str) -> bool:
    """Whether a channel is what is left of the state in the first row."""
    call = DERIVED_CHANNEL.fullmatch(name)
    return call is not None and call[1] == "initial"


def _axes(linear: LinearModel, group: Sequence[Step], first: Index, part: Array) -> tuple[Abscissa, Split | None]:
    """Channel, or pair of channels, along which bins show most of what the finding explains."""
    effect = group[0].effect
    own = channels_of(linear, [effect])
    sides = [n for n in own if n.startswith("dir_")]
    names = [n for n in own if n not in sides]
    warm = [n for n in names if is_warm(n)]
    whole = channels_of(linear, [s.effect for s in group])
    every = [n for n in whole if is_warm(n)]
    if warm:
        # what is left of the first row's state is no sensor: it shows in time
        two = len(warm) == 2 and set(every) == set(warm) and "time" not in warm and not any(map(fades, warm))
        pair = PAIR_SEPARATOR.join(warm) if two else ""
        one = pair or (warm[0] if len({root(n) for n in every}) == 1 and len(every) == 1 else "time")
        one = one if linear.scene.duration else warm[0]
        names = [*(n for n in names if n not in warm), one]
    names = names or [n.removeprefix("dir_") for n in sides] or [j.name for j in linear.scene.moving]  # a constant
    seconds = [*names, *(n for n in whole if n not in (*names, *every, *sides) and not n.startswith("dir_"))]
    period = getattr(effect, "period", None)
    if period and effect.drivers[0] in names:
        return folded(linear, effect.drivers[0], float(period)), _second_wave(linear, effect, first)
    tries: list[tuple[float, int, str, Split | None]] = []
    for name in names:
        x = _channel(linear, name)[first]
        splits: list[Split | None] = [_sides(linear, n, first) for n in sides] or [
            None,
            *_levels(linear, seconds, name, first),
        ]
        for split in splits:
            share = _explained(part, x, split) - 0.1 * (split is not None and not sides)
            tries.append((share + 0.05 * (name in effect.drivers), len(tries), name, split))
    _, _, name, split = max(tries)
    return axis_of(linear, name), split


def _explained(part: Array, x: Array, split: Split | None) -> float:
    """Part of a sum of squares that bin means along x explain, for each level by itself."""
    cell = bin_of(x, int(np.clip(len(x) // 30, 3, 12)))
    if split is not None:
        cell = cell * len(split.levels) + split.member
    sums, counts = np.bincount(cell, part), np.bincount(cell)
    return float(np.sum(sums[counts > 0] ** 2 / counts[counts > 0]) / max(float(part @ part), 1e-300))


def bin_of(x: Array, bins: int) -> Index:
    """Bin number of each value: bins of equal counts, or one per value where there are few distinct ones."""
    starts = np.unique(x)
    if len(starts) > bins:
        starts = np.unique(np.quantile(x, np.linspace(0, 1, bins + 1)[:-1]))
    return np.searchsorted(starts, x, side="right") - 1


def _sides(linear: LinearModel, name: str, first: Index) -> Split:
    member = (_channel(linear, name)[first] < 0).astype(np.intp)
    labels = tuple(f"{style.plain(name[4:], 16)} {side}" for side in SIDE_LABELS)
    return Split(name, np.array([1.0, -1.0]), labels, member)


def _levels(linear: LinearModel, names: Sequence[str], but: str, first: Index) -> Iterator[Split]:
    """Thirds of the other channels; distinct values where there are two or three."""
    for name in names:
        if name == but:
            continue
        values, axis = _channel(linear, name)[first], axis_of(linear, name)
        levels = np.unique(values)
        if len(levels) > 3:
            low, high = np.quantile(values, (1 / 3, 2 / 3))
            member = np.digitize(values, [low, high])
            levels = np.quantile(values, (1 / 6, 0.5, 5 / 6))
        else:
            member = np.searchsorted(levels, values)
        what, _, unit = axis.label.partition(" / ")
        labels = tuple(f"{what} {_digits(axis.factor * v)} {unit}".rstrip() for v in levels)
        yield Split(name, levels, labels, member.astype(np.intp))


def _second_wave(linear: LinearModel, effect: Effect, first: Index) -> Split | None:
    """For a periodic effect of two channels, thirds of the second one's period."""
    by, period = getattr(effect, "by", None), getattr(effect, "by_period", None)
    if by is None:
        return None
    if period is None:
        return next(_levels(linear, [by], "", first))
    values, axis = _channel(linear, by)[first], axis_of(linear, by)
    member = np.floor(3 * np.mod(values, period) / period).astype(np.intp) % 3
    middle = np.floor(float(np.median(values)) / period) * period
    what, _, unit = axis.label.partition(" / ")
    labels = tuple(f"{what}, {k} third of {_digits(axis.factor * period)} {unit}" for k in ("1st", "2nd", "3rd"))
    return Split(by, middle + period * (np.arange(3) + 0.5) / 3, labels, member)


def folded(linear: LinearModel, name: str, period: float) -> Abscissa:
    """Channel of a periodic effect, modulo the period where the range holds many."""
    axis = axis_of(linear, name)
    if np.ptp(linear.channel(name)) < FOLDED_PERIODS * period:
        return axis
    what, _, unit = axis.label.partition(" / ")
    length = f"{axis.factor * period:.4g} {unit}".replace(" °", "°")
    return Abscissa(name, f"{what} within its period of {length} / {unit}", axis.factor, period)


def _digits(value: float) -> str:
    return (f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}").replace("-", "−")


def axis_of(linear: LinearModel, name: str) -> Abscissa:
    """Axis of any channel."""
    joint = next((j for j in linear.chain.machine.joints if j.name == name), None)
    word = style.plain(name, 16)
    if joint is not None:
        turning = joint.type == "rotary"
        return Abscissa(name, f"{word} / {'°' if turning else 'mm'}", float(np.degrees(1.0)) if turning else 1.0)
    if name == "time":
        hours = linear.scene.duration > 3 * 3600
        return Abscissa(name, f"time / {'h' if hours else 'min'}", 1 / (3600 if hours else 60))
    if PAIR_SEPARATOR in name:
        one, other = (style.plain(root(n), 16) for n in name.split(PAIR_SEPARATOR))
        behind = _behind(name.split(PAIR_SEPARATOR, maxsplit=1)[0])
        return Abscissa(name, f"{one}{MINUS_SIGN}{other}{behind} / K")
    if is_warm(name):
        return Abscissa(name, f"{style.plain(root(name), 16)}{_behind(name)} / °C")
    if name in POINT_CHANNELS:
        return Abscissa(name, f"tip's {name[-1]} / mm")
    if moving := joint_of_speed(name):
        turning = any(j.name == moving and j.type == "rotary" for j in linear.chain.machine.joints)
        unit, scale = ("°/s", float(np.degrees(1.0))) if turning else ("mm/s", 1.0)
        return Abscissa(name, f"speed of {style.plain(moving, 16)} / {unit}", scale)
    units = {"feed": " / mm/min", "load": " / kg"} | {f"tool_{a}": " / mm" for a in "xyz"}
    return Abscissa(name, f"{word}{units.get(name, '')}")


def _behind(name: str) -> str:
    call = DERIVED_CHANNEL.fullmatch(name)
    return f", {float(call[3]) / 60:.3g} min behind" if call else ""


def _channel(linear: LinearModel, name: str) -> Array:
    if PAIR_SEPARATOR in name:
        one, other = name.split(PAIR_SEPARATOR)
        return linear.channel(one) - linear.channel(other)
    return linear.channel(name)
