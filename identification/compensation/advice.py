"""Mechanical adjustments (squareness, twist of guideways) to make before compensating, largest effect first.

Advised is only what clearly exceeds its standard uncertainty (GUM, propagation through the actual positions, with all
covariances): an error that the survey did not determine is no reason to touch a machine.

Angles in rad, actual minus nominal; effects in um at the tool tip over the surveyed travel.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.base import Target
from errormodel.controllers.setup import Setup
from errormodel.location_errors import LINE_TARGETS, squareness
from identification.compensation.assessment import Correct
from identification.compensation.model_uncertainty import sensitivities_at
from identification.compensation.volume import Volume, best_frame
from identification.estimation.estimate import Estimate
from identification.results.stored_fit import StoredFit

LEAST_EFFECT_UM = 5.0  # um over the volume: smaller effects are not listed; by judgement
LEAST_EFFECT_SHARE = 0.2  # of the RMS error before compensation: smaller effects are not listed; by judgement


@dataclass(frozen=True)
class Advice:
    """One adjustment.

    Attributes
    ----------
    what : the geometric error in words.
    angle : rad, actual minus nominal.
    effect_um : displacement that the angle causes over the measured travel, um.
    std : standard uncertainty of the angle (k = 1), rad; 0 of parameters that are known.
    """

    what: str
    angle: float
    effect_um: float
    std: float = 0.0

    def line(self) -> str:
        angle = f"{1e6 * self.angle:+.0f}{_beside(1e6 * self.std)} urad"
        return f"{self.what}: {angle}, {self.effect_um:.0f} um over the measured travel"


@dataclass(frozen=True)
class Scale:
    """Scale error of a linear joint that no table of the target holds.

    Attributes
    ----------
    scale : mm too far per commanded mm; `effect_um` : over the measured travel, um.
    setting : where it is set, in the target's own words.
    std : standard uncertainty of the scale (k = 1).
    """

    joint: str
    scale: float
    effect_um: float
    setting: str
    std: float = 0.0

    def line(self) -> str:
        way = "too far" if self.scale > 0 else "too short"
        return (
            f"scale of {self.joint} (goes {way}): {1e3 * self.scale:+.3f}{_beside(1e3 * self.std)} per mille, "
            f"{self.effect_um:.0f} um over the measured travel: {self.setting} (where each motor moves one axis)"
        )


def _beside(std: float) -> str:
    """A standard uncertainty beside its value; nothing of what is known."""
    return f" +- {std:.2g}" if std else ""


def _by_points(
    volume: Volume, q: Array, came: Array, number: Callable[[Array], float], fit: StoredFit | None
) -> Estimate:
    """A number of actual positions (n, 3), and its standard uncertainty by all parameters of the fit.

    What was identified counts with its covariance, what was not with its plausible size, as in predictions.
    """
    actual = volume.field.actual(q, came)
    value = number(actual)
    if fit is None:
        return Estimate(value, 0.0)
    found = sensitivities_at(fit, volume.field, q, came, [(1.0, None)])

    def changes(columns: Array) -> Array:
        return np.array([number(actual + column.reshape(-1, 3)) - value for column in columns.T])

    sizes = np.sqrt(np.diag(found.covariance))
    by_base = changes(found.base * sizes) / np.where(sizes > 0, sizes, 1.0)
    variance = by_base @ found.covariance @ by_base + np.sum(changes(found.unseen) ** 2)
    return Estimate(value, float(np.sqrt(variance)))


def scale_advice(volume: Volume, setup: Setup, target: Target, fit: StoredFit | None = None) -> list[Scale]:
    """Scale of each linear joint along its nominal path, by a straight line, where the target sets it beside tables."""
    if not target.scale_setting:
        return []
    out = []
    for k, joint in enumerate(volume.field.joints):
        if joint.type != "prismatic" or volume.high[k] <= volume.low[k]:
            continue
        q, came = _line(volume, k)
        nominal = volume.field.nominal(q)
        way = _slope(nominal)

        def slope(actual: Array, along: Array = nominal @ way, way: Array = way) -> float:
            return float(np.polyfit(along, actual @ way, 1)[0]) - 1

        found = _by_points(volume, q, came, slope, fit)
        scale = found.value
        effect = 1e3 * abs(scale) * float(volume.high[k] - volume.low[k])
        axis = next(a.name for a in setup.axes if a.joint == joint.name)
        # an axis that goes too far wants fewer steps a mm, which is a longer distance a turn
        words = target.scale_setting.format(axis=axis, lower=axis.lower(), steps=1 / (1 + scale), distance=1 + scale)
        if effect >= LEAST_EFFECT_UM and found.significant:
            out.append(Scale(joint.name, scale, effect, words, found.std))
    return sorted(out, key=lambda found: -found.effect_um)


def with_scales(correct: Correct, scales: Sequence[Scale], volume: Volume) -> Correct:
    """Commands as the axes carry them out once `scales` are set: each travels less far by the scale that it had."""
    names = [j.name for j in volume.field.joints]

    def scaled(q: Array, came: Array, tool: Array | None) -> Array:
        out = correct(q, came, tool).copy()
        for found in scales:
            out[:, names.index(found.joint)] /= 1 + found.scale
        return out

    return scaled


def mechanical_advice(volume: Volume, before_um: float, fit: StoredFit | None = None) -> list[Advice]:
    """Squareness errors of linear axes and twist along them that exceed the thresholds, largest effect first.

    Parameters
    ----------
    volume : the surveyed volume with the fitted errors.
    before_um : RMS error without compensation, um; it sets the threshold.
    fit : the fit that the errors are from; None: they are known.
    """
    # where error motions were measured joint by joint, the slope of a straightness is that of the straightedge
    found = [*(_squareness(volume, fit) if volume.turns else ()), *_twist(volume, fit)]
    least = max(LEAST_EFFECT_UM, LEAST_EFFECT_SHARE * before_um)
    kept = (a for a in found if a.effect_um >= least and Estimate(a.angle, a.std).significant)
    return sorted(kept, key=lambda a: -a.effect_um)


def _line(volume: Volume, k: int) -> tuple[Array, Array]:
    """Commands (n, joints) along joint k with the others at mid-travel, and directions of approach, all positive."""
    middle = (volume.low + volume.high) / 2
    q = np.tile(middle, (LINE_TARGETS, 1))
    q[:, k] = np.linspace(volume.low[k], volume.high[k], LINE_TARGETS)
    return q, np.ones_like(q)


def _squareness(volume: Volume, fit: StoredFit | None) -> list[Advice]:
    """Squareness of each pair of linear joints that are nominally square, from straight lines fitted to their paths."""
    field = volume.field
    lines = {
        k: _line(volume, k)
        for k, joint in enumerate(field.joints)
        if joint.type == "prismatic" and volume.high[k] > volume.low[k]
    }
    out = []
    for i, j in combinations(lines, 2):
        q, came = (np.vstack(both) for both in zip(lines[i], lines[j], strict=True))
        nominal = _between(field.nominal(q))
        if abs(np.cos(nominal)) > 0.1:
            continue

        def angle(actual: Array, nominal: float = nominal) -> float:
            return _between(actual) - nominal

        found = _by_points(volume, q, came, angle, fit)
        span = min(volume.high[k] - volume.low[k] for k in (i, j))
        name = squareness(field.joints[j].name, field.joints[i].name)
        more = "wider" if found.value > 0 else "narrower"
        effect = 1e3 * abs(found.value) * float(span)
        out.append(Advice(f"{name} ({more} than square)", found.value, effect, found.std))
    return out


def _between(points: Array) -> float:
    """Angle between the straight lines through the first and the second half of some points, rad."""
    first, second = map(_slope, np.split(points, 2))
    return float(np.arccos(np.clip(first @ second, -1, 1)))


def _slope(points: Array) -> Array:
    centred = points - points.mean(axis=0)
    t = np.linspace(-1, 1, len(points))
    direction = t @ centred
    unit: Array = direction / np.linalg.norm(direction)
    return unit


def _twist(volume: Volume, fit: StoredFit | None) -> list[Advice]:
    """Roll of the tip from end to end of each linear joint: a twisted bed, which levelling removes.

    Over positions of the other linear joints, with rotary ones at mid-travel: the errors of a rotary joint turn with
    it, so that over its positions they are no motion of a rigid body, and a roll fitted to them is none of a guideway.
    """
    field = volume.field
    out = []
    q0, came0 = volume.poses(128, 17)
    q0 = np.where(field.rotary, (volume.low + volume.high) / 2, q0)
    for k, joint in enumerate(field.joints):
        if joint.type != "prismatic" or volume.high[k] <= volume.low[k]:
            continue
        ends = [q0.copy(), q0.copy()]
        ends[0][:, k], ends[1][:, k] = volume.low[k], volume.high[k]
        q, came = np.vstack(ends), np.vstack([came0, came0])
        nominal, axis = field.nominal(q), _slope(field.nominal(_line(volume, k)[0]))

        def roll(actual: Array, nominal: Array = nominal, axis: Array = axis) -> float:
            low, high = (
                best_frame(a - n, n).rotation for a, n in zip(np.split(actual, 2), np.split(nominal, 2), strict=True)
            )
            turn = high @ low.T
            return float(np.array([turn[2, 1], turn[0, 2], turn[1, 0]]) @ axis)

        found = _by_points(volume, q, came, roll, fit)
        others = [volume.high[i] - volume.low[i] for i in field.movers if i != k]
        effect = 1e3 * abs(found.value) * float(max(others, default=0.0)) / 2
        what = f"twist along {joint.name} (roll from end to end: level the bed)"
        out.append(Advice(what, found.value, effect, found.std))
    return out
