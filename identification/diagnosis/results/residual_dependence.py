"""Test of independence: whether anything that was recorded predicts what is left after all findings.

Residuals are compared with smooth functions of every channel and of every two channels, alone and times the effect of
every motion (`recorded`): commands, the path before, directions of approach, sensors, time. The statistic is the energy
of the residual's projections on them (a kernel score test, or Hilbert-Schmidt independence criterion, with a cosine
basis of ranks). Its null distribution comes from two kinds of resampling: circular shifts of the residual along the
rows, which keep its autocorrelation, and random signs of short blocks, which keep where its variance is large (wild
bootstrap). The larger p-value counts. The largest standardised statistic is compared with the largest of each resample
(max-T of Westfall and Young, 1993), its tail by a Gumbel law.
No shape is assumed, and no name is given: all known physics has been tried before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.conventions import FRAME, MOTIONS
from identification.diagnosis.decisions.constants import LEAST_P_VALUE, LEAST_SHARE
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.results.combined_waves import Wave
from identification.diagnosis.results.nameless_evidence import best_of, evidence_in_any_noise
from identification.diagnosis.results.non_repeatable_motion import (
    NonRepeatable,
    independent_along_rows,
    non_repeatable_motion,
)
from identification.diagnosis.results.recorded_functions import CLOCK, ROW, Functions, in_turns, only, recorded
from identification.diagnosis.results.resampling import QUICK_RESAMPLES, clipped, gumbel, left, shifted, signed, thinned
from identification.diagnosis.search.criteria import heldout_rms
from identification.estimation.noise import Noise, likeliest, series_edges
from identification.estimation.orthonormal_basis import orthonormal_basis

AT_ONCE = 1000  # functions whose statistics are kept at a time
RESAMPLES = 199  # of each kind; the tail beyond is extrapolated
FIRST_P_VALUE = 0.05  # of a quick look, which ends nearly all tests of noise


@dataclass(frozen=True)
class Dependence:
    """What the residuals depend on.

    Attributes
    ----------
    channels : one or two, by name; ``before(X)`` is the position of X commanded before; none of what varies from row to
        row.
    p_value : of independence.
    axis : x, y or z of the reference, along which a function of the channels predicts most of the rows that were left
        out.
    size_um : root mean square of what it predicts of them, um; of what wanders in time, of what it explains.
    element, motion : what moves as it, where that shows most; else "".
    periods, units : of a wave along joints, "mm" or "deg" of each; else none.
    """

    channels: tuple[str, ...]
    p_value: float
    axis: str
    size_um: float
    element: str = ""
    motion: str = ""
    periods: tuple[float, ...] = ()
    units: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """The dependence in words, and what to measure."""
        return f"{self.statement}. {self.next_measurement}"

    @property
    def statement(self) -> str:
        """The dependence in words."""
        if not self.channels:
            return (
                f"what is left varies from row to row as {self.motion} of {self.element} would "
                f"(p = {self.p_value:.0e}), by {self.size_um:.1f} um rms, most along {self.axis}: a motion that does "
                "not repeat, one of several joints together, states that no column shows, or an instrument that is "
                "worse this way"
            )
        on = " and ".join(map(_words, self.channels))
        moves = f", most of it {self.motion} of {self.element}," if self.motion else ""
        every = [f"{p:.3g} {u} of {c}" for p, u, c in zip(self.periods, self.units, self.channels, strict=False)]
        depends = f"repeats every {' and every '.join(every)}" if every else f"depends on {on}"
        return (
            f"what is left{moves} {depends} (p = {self.p_value:.0e}), in a form that no effect with a name has; "
            f"along {self.axis} this explains {self.size_um:.1f} um rms"
        )

    @property
    def next_measurement(self) -> str:
        """What to measure: time cannot be set."""
        if not self.channels:
            return "Return to one position again and again from elsewhere, and look whether it repeats"
        if any(c.startswith("cycle(") for c in self.channels):
            return "Look what takes turns from row to row: nests, styli, targets, a stop, and record which it was"
        if self.channels in ((CLOCK,), (ROW,)):
            return f"Measure {FIXED_TARGETS}"
        if any(c.rpartition("(")[0] in PATH for c in self.channels):
            return "Measure the same positions again, coming to each from several others"
        on = " and ".join(map(_words, self.channels))
        return f"Measure again with {on} at many values, in random order"

    def as_json(self) -> dict[str, object]:
        """The key ``dependence`` of ``diagnosis.json``."""
        return asdict(self) | {"channels": [*self.channels]}


FIXED_TARGETS = "fixed targets again and again between the positions"
PATH = {
    "before(before": "where {} had been two rows before",
    "before": "where {} had been before",
    "turn": "where {} last turned round",
    "recent": "where {} had been in the last rows",
    "play": "the path of {} (a play)",
    "relay": "the end of its travel that {} was last near",
    "travel": "the distance travelled in the last rows",
    "cycle": "which of every {} rows it is",
}


def _words(channel: str) -> str:
    """A channel's name in words."""
    kind, _, joint = channel.rpartition("(")
    if kind in PATH:
        return PATH[kind].format(joint.rstrip(")"))
    if channel == ROW:
        return "the order of the rows"
    return f"the direction of {channel[4:]}" if channel.startswith("dir_") else channel


def dependence_of(
    linear: LinearModel,
    sigma_um: float,
    log: DecisionLog = UNRECORDED,
    components: int = 3,
    wave: Wave | None = None,
) -> Dependence | None:
    """What the residual of a linear model depends on; None where it is independent of all channels.

    Parameters
    ----------
    linear : geometry and all findings fitted.
    sigma_um : standard deviation of one whitened observation, um.
    components : observations of a row: three coordinates, or one reading.
    wave : along joints, that is left in the residual.
    """
    if (tested := thinned(linear)) is None:
        return None
    (keep, residual, basis), index = tested, linear.index
    parts = recorded(linear, np.unique(index))
    if not parts:
        return None
    kept = only(parts, keep)
    p_value, best = _tested(residual, basis, index[keep], kept, QUICK_RESAMPLES)
    if p_value < FIRST_P_VALUE:
        # a drift depends on all that changes slowly: what correlated noise explains is filtered out of both sides
        edges = series_edges(index[keep])
        noise, _ = likeliest(residual, basis.T, edges)
        if noise is not None:
            residual, basis = noise.whitened(residual[None], edges)[0], noise.whitened(basis.T, edges).T
            kept = [replace(part, filtered=partial(_filtered, noise, edges)) for part in kept]
        p_value, best = _tested(residual, basis, index[keep], kept, RESAMPLES)
    seen, part = p_value < LEAST_P_VALUE, parts[best]
    beside = " and ".join(part.channels)
    log.add(
        "dependence-of-residuals", "found" if seen else "passed", "residuals", p_value, LEAST_P_VALUE, beside=beside
    )
    if seen and part.motion and wave is None:
        # a motion that takes another value in every row is seen as what follows quick functions of anything
        varies = non_repeatable_motion(linear, log, left=True)
        if varies is not None and varies.gain > best_of(linear, [part])[0]:
            return _varying(linear, sigma_um, varies)
    if not seen:
        quick = [part for part in parts if part.motion and part.channels == (CLOCK,)]
        found = [own for own in (_wandering(linear, quick, log), _in_turns(linear, index, log)) if own is not None]
        wanders = max(found, key=lambda own: own[2], default=None)
        varies = non_repeatable_motion(linear, log, wanders is not None) if wave is None else None
        if varies is not None and (wanders is None or varies.gain > wanders[2] or _alone(linear, wanders[1], log)):
            return _varying(linear, sigma_um, varies)
        if wanders is not None:
            (p_value, part, _), seen = wanders, True
    if not seen and wave is not None:
        part = wave.functions(linear)
    elif seen:
        wave = None
    else:
        return None
    axis, share = predicted(linear, part)
    if not share:
        return None
    size = sigma_um * float(np.sqrt(components * share))
    if wave is not None:
        periods, units = zip(*wave.in_files(linear.scene.moving), strict=True)
        return Dependence(wave.joints, wave.p_value, axis, size, periods=periods, units=units)
    rows = CLOCK not in linear.scene.columns  # their order stands for the clock
    channels = tuple(ROW if rows and c == CLOCK else c for c in part.channels)
    return Dependence(channels, p_value, axis, size, part.element, part.motion)


def _alone(linear: LinearModel, part: Functions, log: DecisionLog) -> bool:
    """Whether a motion that follows the clock does not go on from row to row: quick functions follow anything."""
    if part.channels != (CLOCK,):
        return False
    p_value, what = independent_along_rows(linear, part.element, part.motion), f"{part.motion} of {part.element}"
    goes_on = p_value < LEAST_P_VALUE
    log.add("goes-on", "found" if goes_on else "passed", "residuals", p_value, LEAST_P_VALUE, beside=what)
    return not goes_on


def _varying(linear: LinearModel, sigma_um: float, found: NonRepeatable) -> Dependence:
    """The motion that varies from row to row, on nothing that was recorded."""
    size = sigma_um * float(np.sqrt(found.variance))
    axis = _main_axis(linear, found.element, found.motion)
    return Dependence((), found.p_value, axis, size, found.element, found.motion)


def _wandering(
    linear: LinearModel, quick: Sequence[Functions], log: DecisionLog
) -> tuple[float, Functions, float] | None:
    """The motion that wanders or switches in time with most evidence (`_by_evidence`); None where nothing is seen."""
    found = _by_evidence(linear, quick)
    if found is None:
        return None
    p_value, best, _ = found
    seen, what = p_value < LEAST_P_VALUE, f"{best.motion} of {best.element}"
    log.add("wandering-motion", "found" if seen else "passed", "residuals", p_value, LEAST_P_VALUE, beside=what)
    return found if seen else None


def _in_turns(linear: LinearModel, index: Index, log: DecisionLog) -> tuple[float, Functions, float] | None:
    """The motion that repeats after a few rows with most evidence (`_by_evidence`); None where nothing is seen."""
    found = _by_evidence(linear, in_turns(linear, np.unique(index)))
    if found is None:
        return None
    p_value, best, _ = found
    seen, what = p_value < LEAST_P_VALUE, f"{best.motion} of {best.element} by {best.channels[0]}"
    log.add("motion-in-turns", "found" if seen else "passed", "residuals", p_value, LEAST_P_VALUE, beside=what)
    return found if seen else None


def _by_evidence(linear: LinearModel, parts: Sequence[Functions]) -> tuple[float, Functions, float] | None:
    """Of some motions that with most evidence, where correlated noise explains less of it.

    The test by resamples cannot see what wanders or repeats after some rows: shifts along the rows keep it. Noise is
    alike in all directions, a motion is not. One over its Bayes factor, times how many were tried, bounds its p-value.

    Returns
    -------
    That p-value, the functions of the motion, and the log Bayes factor to white noise; None where there is none.
    """
    own = clipped(linear.residual, linear.basis)
    if own is None:
        return None
    linear = linear.of_residual(own)
    evidence, _, best = best_of(linear, parts)
    if best is None:
        return None
    p_value = float(np.exp(min(np.log(len(parts)) - evidence_in_any_noise(linear, best), 0.0)))
    return p_value, best, evidence


def _filtered(noise: Noise, edges: Index, functions: Array) -> Array:
    """Functions (N, k) of which the correlation of the noise along the rows is taken out, as of the residual."""
    return np.asarray(noise.whitened(functions.T, edges).T)


def _tested(residual: Array, basis: Array, index: Index, parts: Sequence[Functions], count: int) -> tuple[float, int]:
    """The p-value of independence by `count` resamples of each kind, and the number of the most dependent part."""
    q = orthonormal_basis(basis)
    own = clipped(residual, q)
    if own is None:
        return 1.0, 0
    series = [slice(a, b) for a, b in pairwise(series_edges(index))]
    p_value, best = _largest(parts, own, left(shifted(own, series, count), q, float(own @ own)), series)
    if p_value >= FIRST_P_VALUE:
        return p_value, best  # the larger one counts
    # without what it predicts, the residual's size along the rows is that of the noise: signs of it are the null
    noise, used = own.copy(), 0
    functions = parts[best].values
    for s in _series_of(parts[best], series):
        fitted = orthonormal_basis(functions[s])
        noise[s] -= fitted @ (fitted.T @ noise[s])
        used += fitted.shape[1]
    square = float(noise @ noise) * len(noise) / max(len(noise) - used, 1)
    by_signs, _ = _largest(parts, own, left(signed(noise, series, count), q, square), series)
    return max(p_value, by_signs), best


def _largest(parts: Sequence[Functions], residual: Array, resamples: Array, series: list[slice]) -> tuple[float, int]:
    """The p-value of the largest standardised statistic among the `parts`, and the number of its part."""
    whole, summed = np.hstack([residual[:, None], resamples]), dict[tuple[str, str], Array]()
    scores, largest = np.empty(len(parts)), np.full(resamples.shape[1], -np.inf)
    for first in range(0, len(parts), AT_ONCE):
        some = parts[first : first + AT_ONCE]
        energy = np.empty((len(some), whole.shape[1]))
        for k, part in enumerate(some):
            if part.motion and part.filtered is None:  # over rows, of which there are fewer than observations
                key = part.element, part.motion
                if key not in summed:
                    summed[key] = part.summed(whole)
                energy[k] = _energy(part.by_row, summed[key], [slice(None)])
            else:
                energy[k] = _energy(part.values, whole, _series_of(part, series))
        normal = np.cbrt(energy)  # of Wilson and Hilferty: sums of squares become nearly normal
        null = normal[:, 1:]
        mean, spread = null.mean(axis=1, keepdims=True), null.std(axis=1, ddof=1, keepdims=True)
        scores[first : first + AT_ONCE] = (normal[:, 0] - mean[:, 0]) / spread[:, 0]
        largest = np.maximum(largest, ((null - mean) / spread).max(axis=0))
    return gumbel(float(scores.max()), largest), int(scores.argmax())


def _series_of(part: Functions, series: list[slice]) -> list[slice]:
    """Where functions have coefficients of their own: in each component, or those of a motion in all together."""
    return [slice(None)] if part.motion else series


def _energy(functions: Array, whole: Array, series: list[slice]) -> Array:
    """Squared projections of residuals (N, r) on functions (N, k), each series (component) by itself, summed: (r,)."""
    return np.asarray(sum(np.square(functions[s].T @ whole[s]).sum(axis=0) for s in series))


def _main_axis(linear: LinearModel, element: str, motion: str) -> str:
    """Axis of the reference along which a motion moves the point most."""
    own = linear.levers[element][MOTIONS.index(motion)]
    alike = [abs(float(lever @ own)) for lever in linear.levers[FRAME][:3]]
    return "xyz"[int(np.argmax(alike))]


def predicted(linear: LinearModel, part: Functions) -> tuple[str, float]:
    """Axis of the reference along which functions predict left-out blocks best, and the variance of what is left of it.

    Those of a motion act as this moves the point: the axis is that along which it moves most. What wanders in time
    predicts no row that was left out: its variance is then that of the fitted rows, less what the noise gives it.
    """
    before, whole, seen = heldout_rms(linear) ** 2, linear.square / linear.freedom, len(linear.index)
    levers, functions = linear.levers[FRAME], part.values
    if part.motion:
        trials = {_main_axis(linear, part.element, part.motion): functions}
    else:
        trials = {a: lever[:, None] * functions for a, lever in zip("xyz", levers, strict=False) if lever.any()}
    shares = list[tuple[float, float, str]]()
    for axis, values in trials.items():
        columns = np.zeros((values.shape[1], linear.size))
        columns[:, :seen] = values.T
        after = linear.with_columns(columns)
        left = after.square / max(after.freedom, 1) / whole
        shares.append((1 - heldout_rms(after) ** 2 / before, 1 - left, axis))
    predicted, _, axis = max(shares)
    if predicted > LEAST_SHARE:
        return axis, predicted * whole
    _, fitted, axis = max(shares, key=lambda s: s[1])
    return axis, fitted * whole if fitted > LEAST_SHARE else 0.0
