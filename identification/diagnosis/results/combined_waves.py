"""Waves along two joints together: what is left repeats with a combination of their positions.

Crossed belts, differential gears, coupled wrists and ball screw splines turn one wheel by two joints: its errors repeat
with a sum or a difference of commands, which no function of one joint shows. The residual's two-dimensional periodogram
over each two joints is the energy of its least-squares wave at every wave vector (N. R. Lomb, Astrophysics and Space
Science 39, 1976, of two variables). Under noise twice an ordinate is chi-squared with two degrees of freedom for each
component; where the largest of all exceeds that, it is compared with the largest of each resample of the residual.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise, product

import numpy as np

from errormodel.arrays import Array, Index, Mask
from errormodel.effects.base import Effect
from errormodel.effects.search_space.equivalent_places import places
from errormodel.effects.unnamed import Unnamed
from errormodel.machine import Joint
from identification.diagnosis.decisions.constants import LEAST_P_VALUE
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.results.recorded_functions import Functions
from identification.diagnosis.results.resampling import QUICK_RESAMPLES, clipped, gumbel, left, shifted, signed, thinned
from identification.estimation.noise import series_edges

MOST_WAVES = 64  # over the range of a joint, by judgement: a belt's teeth are finer, its pulleys are not
LEAST_WAVES = 3.0  # over the range of one joint at least: longer ones are smooth functions, which are tested elsewhere
STEP = 0.5  # of a wave over the range: a wave between two of the grid keeps most of its energy
MOST_JOINTS = 8  # of which each two are looked at: time grows with their square
FEWEST_VALUES = 8  # of a joint, that leave waves over it to be seen


@dataclass(frozen=True)
class Wave:
    """A wave along joints: `numbers` of waves over the range of each, whose positions have the `ranges` (mm, rad)."""

    joints: tuple[str, ...]
    numbers: tuple[float, ...]
    ranges: tuple[float, ...]
    p_value: float

    def functions(self, linear: LinearModel) -> Functions:
        """Cosine and sine at the observations of a linear model, by the joints' positions."""
        rows, index = np.unique(linear.index, return_inverse=True)
        parts = zip(self.joints, self.numbers, self.ranges, strict=True)
        positions = linear.scene.columns
        phase = sum((2 * np.pi * n / width * positions[j][rows] for j, n, width in parts), np.zeros(len(rows)))
        return Functions(self.joints, (np.column_stack([np.cos(phase), np.sin(phase)]),), index)

    @property
    def periods(self) -> tuple[float, ...]:
        """The way along each joint after which it repeats, the others at rest; mm, rad."""
        return tuple(width / abs(n) for n, width in zip(self.numbers, self.ranges, strict=True))

    def in_files(self, joints: Sequence[Joint]) -> list[tuple[float, str]]:
        """The periods and their units as files have them."""
        turning = {j.name for j in joints if j.type == "rotary"}
        periods = zip(self.joints, self.periods, strict=True)
        return [(float(np.degrees(p)), "deg") if j in turning else (p, "mm") for j, p in periods]

    def proposals(self, linear: LinearModel) -> Iterator[Effect]:
        """The wave, and the one that runs the other way, in each motion of each place; and neighbours of the grid."""
        lengths = [
            [width / abs(n + d * STEP) for d in (-1, 0, 1) if n + d * STEP]
            for n, width in zip(self.numbers, self.ranges, strict=True)
        ]
        for (element, motion), (period, *further) in product(places(linear.scene, self.joints[0]), product(*lengths)):
            wave = Unnamed(element=element, motion=motion, driver=self.joints[0], period=period)
            yield wave.model_copy(update={"by": self.joints[1], "by_period": further[0]}) if further else wave


def largest_wave(linear: LinearModel, log: DecisionLog = UNRECORDED) -> Wave | None:
    """The wave along two joints, or one, that is left of a linear model's residual; None where there is none."""
    from scipy.special import chdtrc

    if (tested := thinned(linear)) is None:
        return None
    keep, residual, q = tested
    rows, index = np.unique(linear.index[keep], return_inverse=True)
    positions = {j.name: linear.scene.columns[j.name][rows] for j in linear.scene.moving}
    able = {j: q for j, q in positions.items() if np.isfinite(q).all() and len(np.unique(q)) >= FEWEST_VALUES}
    pairs = list(combinations(able, 2)) if len(able) <= MOST_JOINTS else []
    own = clipped(residual, q)
    if own is None or not pairs:
        return None
    series, square = [slice(a, b) for a, b in pairwise(series_edges(index))], float(own @ own)
    waves = {j: _waves(p) for j, p in able.items()}
    found = [_periodogram(own, index, series, waves[a], waves[b]) for a, b in pairs]
    most = [float(f.max()) for f in found]
    best = int(np.argmax(most))
    pair, tried = pairs[best], sum(f.size for f in found)
    p_value = min(1.0, tried * float(chdtrc(2 * len(series), 2 * most[best])))
    for resample in (shifted, signed) if p_value < LEAST_P_VALUE else ():
        null = left(resample(own, series, QUICK_RESAMPLES), q, square)
        largest = np.array([_periodogram(r, index, series, *(waves[j] for j in pair)).max() for r in null.T])
        p_value = max(p_value, min(1.0, len(pairs) * gumbel(most[best], largest)))
    seen = p_value < LEAST_P_VALUE
    beside = " and ".join(pair)
    log.add("wave-of-two-joints", "found" if seen else "passed", "residuals", p_value, LEAST_P_VALUE, beside=beside)
    if not seen:
        return None
    k, n = np.unravel_index(int(found[best].argmax()), found[best].shape)
    numbers = STEP * int(k), STEP * (int(n) - (found[best].shape[1] - 1) // 2)
    along = [(j, number, float(np.ptp(able[j]))) for j, number in zip(pair, numbers, strict=True) if number]
    joints, counts, ranges = zip(*along, strict=True)
    return _between(Wave(joints, counts, ranges, p_value), linear, keep, residual)


def _between(wave: Wave, linear: LinearModel, keep: Mask, residual: Array) -> Wave:
    """The wave with its numbers moved off the grid to where it explains most, over the observations that are kept."""
    from scipy.optimize import minimize

    index = linear.index[keep]
    series = [slice(a, b) for a, b in pairwise(series_edges(index))]

    def explained(numbers: Array) -> float:
        functions = replace(wave, numbers=tuple(numbers)).functions(linear).values[keep]
        return -float(sum(np.square(functions[s].T @ residual[s]).sum() / (s.stop - s.start) for s in series))

    found = minimize(explained, wave.numbers, method="Nelder-Mead", options={"initial_simplex": _simplex(wave.numbers)})
    return replace(wave, numbers=tuple(found.x.tolist()))


def _simplex(numbers: Sequence[float]) -> Array:
    """The numbers, and each of them moved by half a step of the grid."""
    return np.vstack([numbers, np.array(numbers) + STEP / 2 * np.eye(len(numbers))])


def _waves(positions: Array) -> Array:
    """Complex waves (n, grid) along a joint, from no wave over its range to the most that its positions can show.

    Of waves with two positions or fewer in a period (Nyquist), longer ones have the same values, or sines have none.
    """
    part = (positions - positions.min()) / np.ptp(positions)
    most = min(MOST_WAVES, (len(np.unique(positions)) - 1) / 2 - 2 * STEP)  # neighbours of the grid are proposed too
    return np.exp(2j * np.pi * STEP * np.outer(part, np.arange(int(most / STEP) + 1)))


def _periodogram(residual: Array, index: Index, series: Sequence[slice], one: Array, other: Array) -> Array:
    """Ordinates at wave vectors: at least none along the first joint, of either sign along the second."""
    both = np.hstack([other[:, :0:-1].conj(), other])
    out = np.zeros((one.shape[1], both.shape[1]))
    for s in series:
        rows = index[s]
        spectrum = one[rows].T @ (residual[s, None] * both[rows])
        out += np.square(np.abs(spectrum)) / len(rows)
    long = int(np.ceil(LEAST_WAVES / STEP))
    middle = other.shape[1] - 1
    out[:long, max(middle - long + 1, 0) : middle + long] = 0.0
    return np.asarray(out / np.mean(np.square(residual)))
