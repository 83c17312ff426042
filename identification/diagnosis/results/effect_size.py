"""Size of a finding in the final fit: parameters, the motions they cause, and their effect at the tool tip."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.conventions import FRAME, MOTIONS, TRANSLATIONS, Motion, unit_of
from errormodel.effects.base import Effect
from identification.estimation.result import Fit
from identification.observation.models import PositionView
from identification.observation.readings import ReadingView

MOST_ROWS = 2000
ROUNDED = 1e-12  # mm, rad: what a motion changes less is constant


@dataclass(frozen=True)
class Amount:
    """A parameter of a finding: its id (or what it summarises), value and standard uncertainty in mm, rad and so on."""

    name: str
    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class Whole:
    """What the effects of one finding add together.

    Attributes
    ----------
    effects, ids : the main effect and its refinements, and each one's parameters in the final fit.
    values, covariance : (k,), (k, k) of all their parameters.
    motions : (element, motion) -> (k, n) of the motion (mm, rad) per unit of each parameter, at the survey's rows.
    tip : (element, motion) -> root mean square (um) of what that motion does at the tip, about its mean where any
        varies: a constant is the geometry's as well.
    size_um : root mean square of what all of them do at the tip, likewise.
    seen_um : that of what the geometry leaves of it in the rows, which is what the data show.
    """

    effects: tuple[Effect, ...]
    ids: tuple[tuple[str, ...], ...]
    units: Mapping[str, str]
    values: Array
    covariance: Array
    motions: Mapping[tuple[str, Motion], Array]
    tip: Mapping[tuple[str, Motion], float]
    size_um: float
    seen_um: float = float("nan")

    @property
    def every(self) -> list[str]:
        return [i for ids in self.ids for i in ids]

    @property
    def amounts(self) -> list[Amount]:
        """The main effect's parameters first; a curve of many tied ones is summed up."""
        out = []
        for effect, ids in zip(self.effects, self.ids, strict=True):
            if effect.random:
                out += self._summary(effect, ids)
            else:
                out += [Amount(i, *self.total({i: 1.0}), self.units[i]) for i in ids]
        return out

    def total(self, weights: Mapping[str, float]) -> tuple[float, float]:
        """Value and standard uncertainty of a sum of parameters."""
        w = np.array([weights.get(i, 0.0) for i in self.every])
        return self._spread(w)

    def range(self, place: tuple[str, Motion], ids: Sequence[str] | None = None) -> tuple[float, float]:
        """Peak to peak (mm, rad) of a motion over the survey's rows, with its standard uncertainty; of some `ids`."""
        rows = self._rows(place, ids)
        curve = self.values @ rows
        return self._spread(rows[:, int(np.argmax(curve))] - rows[:, int(np.argmin(curve))])

    def shift(self, place: tuple[str, Motion]) -> tuple[float, float] | None:
        """Length of a displacement between the rows where that along one axis is extreme, mm, as `range` has of one.

        None where the element is displaced along no other axis.
        """
        element, motion = place
        others = [p for p in self.motions if p[0] == element and p[1] in TRANSLATIONS and p != place]
        if motion not in TRANSLATIONS or not others:
            return None
        curve = self.values @ self.motions[place]
        high, low = int(np.argmax(curve)), int(np.argmin(curve))
        weights = np.array([self.motions[p][:, high] - self.motions[p][:, low] for p in (place, *others)])
        vector = weights @ self.values
        return self._spread(vector / float(np.linalg.norm(vector)) @ weights) if vector.any() else None

    def rms(self, place: tuple[str, Motion], ids: Sequence[str]) -> tuple[float, float]:
        """Root mean square (mm, rad) of a motion about its mean over the survey's rows, with its standard uncertainty.

        A constant is the geometry's as well, and not known apart.
        """
        rows = self._rows(place, ids)
        rows = rows - rows.mean(axis=1, keepdims=True)
        curve = self.values @ rows
        rms = float(np.sqrt(np.mean(curve**2)))
        return rms, self._spread(rows @ curve / (len(curve) * max(rms, 1e-300)))[1]

    def _summary(self, effect: Effect, ids: Sequence[str]) -> list[Amount]:
        out = []
        for (element, motion), rows in self.motions.items():
            if self.of(rows, ids).any():
                name, unit = f"{element}.{motion}.{effect.effect}", unit_of(motion)
                out.append(Amount(f"{name} rms", *self.rms((element, motion), ids), unit))
                out.append(Amount(f"{name} peak to peak", *self.range((element, motion), ids), unit))
        return out

    def _rows(self, place: tuple[str, Motion], ids: Sequence[str] | None) -> Array:
        return self.motions[place] if ids is None else self.of(self.motions[place], ids)

    def of(self, rows: Array, ids: Sequence[str]) -> Array:
        """Rows (k, n) of all parameters with those of some `ids` only, the others' zero."""
        return np.asarray(rows * np.array([i in ids for i in self.every])[:, None])

    def _spread(self, weights: Array) -> tuple[float, float]:
        return float(weights @ self.values), float(np.sqrt(max(float(weights @ self.covariance @ weights), 0.0)))


def whole_of(final: Fit, effects: Sequence[Effect], numbers: Sequence[int]) -> Whole:
    """The effects of one finding as the final fit has them; `numbers` are their places among the machine's effects."""
    chain, s = final.chain, final.solution
    row = {s.unknowns[j]: k for k, j in enumerate(s.groups.base)}
    ids = tuple(tuple(i for i in chain.effect_ids[n] if i in row) for n in numbers)
    every = tuple(i for own in ids for i in own)
    pick = [row[i] for i in every]
    values = s.values[s.groups.base][pick] if every else np.zeros(0)
    covariance = s.covariance[np.ix_(pick, pick)] * final.inflation**2
    units = {i: chain.parameters[chain.index[i]].unit for i in every}
    motions, levers = _seen(final, every)
    curves = {p: values @ rows for p, rows in motions.items()}
    if not constant(curves.values()):
        curves = {p: c - c.mean() for p, c in curves.items()}
    at_tip = {p: np.einsum("cn,n->cn", levers[p], c) for p, c in curves.items()}
    tip = {p: _rms(move) for p, move in at_tip.items()}
    together: Array = np.array([*at_tip.values()]).sum(axis=0) if at_tip else np.zeros((3, 1))
    return Whole(tuple(effects), ids, units, values, covariance, motions, tip, _rms(together))


def constant(curves: Iterable[Array]) -> bool:
    """Whether motions (n,) change nothing from row to row: a constant that the model left out."""
    return all(float(np.ptp(c)) < ROUNDED for c in curves)


def _rms(vectors: Array) -> float:
    """Root mean square length (um) of vectors (3, n) in mm."""
    return 1e3 * float(np.sqrt(np.mean(np.square(vectors).sum(axis=0))))


def _seen(final: Fit, ids: tuple[str, ...]) -> tuple[dict[tuple[str, Motion], Array], dict[tuple[str, Motion], Array]]:
    """Motions (k, n) per unit of each parameter, and levers (3, n) of those motions, at most `MOST_ROWS` rows.

    Of a reading, at its last pose: an effect's size is that at the tip, whatever was read there.
    """
    chain = final.chain
    motions: dict[tuple[str, Motion], list[Array]] = {}
    levers: dict[tuple[str, Motion], list[Array]] = {}
    elements = [chain.parameters[chain.index[i]].element for i in ids]
    views = [v for v in final.problem.views if isinstance(v, PositionView | ReadingView)]
    share = min(1.0, MOST_ROWS / max(sum(len(v) for v in views), 1))
    for view in views:
        rows = view.part(np.unique(np.linspace(0, len(view) - 1, max(int(share * len(view)), 1)).astype(int))).rows
        rows = rows[-len(chain.channels) :]
        terms = chain.kernel("terms", ids, view.fixed)(rows).reshape(-1, 6, len(rows[0]))
        arms = chain.kernel("levers", (), view.fixed, (0, 1, 2))(rows).reshape(-1, 6, 3, len(rows[0]))
        for element in dict.fromkeys(elements):
            own = np.array([e == element for e in elements])
            for k, motion in enumerate(MOTIONS):
                part = terms[: len(ids), k] * own[:, None]
                motions.setdefault((element, motion), []).append(part)
                levers.setdefault((element, motion), []).append(arms[_place(chain, element), k])
    whole = {p: np.hstack(parts) for p, parts in motions.items()}
    whole = {p: rows for p, rows in whole.items() if rows.any()}
    return whole, {p: np.hstack(levers[p]) for p in whole}


def _place(chain: Chain, element: str) -> int:
    """Number of an element among those that levers are of: the measuring frame, the machine's own, the tool."""
    names = [e.name for e in chain.machine.elements]
    if element in names:
        return 1 + names.index(element)
    return 0 if element.startswith(FRAME) else len(names) + 1
