"""Mechanical adjustments (squareness, twist of guideways) to make before compensating, largest effect first.

Angles in rad, actual minus nominal; effects in um at the tool tip over the surveyed travel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.base import Target
from errormodel.controllers.setup import Setup
from errormodel.location_errors import LINE_TARGETS, squareness
from identification.compensation.assessment import Correct
from identification.compensation.volume import Volume, best_frame

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
    """

    what: str
    angle: float
    effect_um: float

    def line(self) -> str:
        return f"{self.what}: {1e6 * self.angle:+.0f} urad, {self.effect_um:.0f} um over the measured travel"


@dataclass(frozen=True)
class Scale:
    """Scale error of a linear joint that no table of the target holds.

    Attributes
    ----------
    scale : mm too far per commanded mm; `effect_um` : over the measured travel, um.
    setting : where it is set, in the target's own words.
    """

    joint: str
    scale: float
    effect_um: float
    setting: str

    def line(self) -> str:
        way = "too far" if self.scale > 0 else "too short"
        return (
            f"scale of {self.joint} (goes {way}): {1e3 * self.scale:+.3f} per mille, {self.effect_um:.0f} um over the "
            f"measured travel: {self.setting} (where each motor moves one axis)"
        )


def scale_advice(volume: Volume, setup: Setup, target: Target) -> list[Scale]:
    """Scale of each linear joint along its nominal path, by a straight line, where the target sets it beside tables."""
    if not target.scale_setting:
        return []
    out = []
    for k, joint in enumerate(volume.field.joints):
        if joint.type != "prismatic" or volume.high[k] <= volume.low[k]:
            continue
        q, came = _line(volume, k)
        nominal, actual = volume.field.nominal(q), volume.field.actual(q, came)
        way = _slope(nominal)
        scale = float(np.polyfit(nominal @ way, actual @ way, 1)[0]) - 1
        effect = 1e3 * abs(scale) * float(volume.high[k] - volume.low[k])
        axis = next(a.name for a in setup.axes if a.joint == joint.name)
        # an axis that goes too far wants fewer steps a mm, which is a longer distance a turn
        words = target.scale_setting.format(axis=axis, lower=axis.lower(), steps=1 / (1 + scale), distance=1 + scale)
        if effect >= LEAST_EFFECT_UM:
            out.append(Scale(joint.name, scale, effect, words))
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


def mechanical_advice(volume: Volume, before_um: float) -> list[Advice]:
    """Squareness errors of linear axes and twist along them that exceed the thresholds, largest effect first.

    Parameters
    ----------
    volume : the surveyed volume with the fitted errors.
    before_um : RMS error without compensation, um; it sets the threshold.
    """
    # where error motions were measured joint by joint, the slope of a straightness is that of the straightedge
    found = [*(_squareness(volume) if volume.turns else ()), *_twist(volume)]
    least = max(LEAST_EFFECT_UM, LEAST_EFFECT_SHARE * before_um)
    return sorted((a for a in found if a.effect_um >= least), key=lambda a: -a.effect_um)


def _line(volume: Volume, k: int) -> tuple[Array, Array]:
    """Commands (n, joints) along joint k with the others at mid-travel, and directions of approach, all positive."""
    middle = (volume.low + volume.high) / 2
    q = np.tile(middle, (LINE_TARGETS, 1))
    q[:, k] = np.linspace(volume.low[k], volume.high[k], LINE_TARGETS)
    return q, np.ones_like(q)


def _squareness(volume: Volume) -> list[Advice]:
    """Squareness of each pair of linear joints that are nominally square, from straight lines fitted to their paths."""
    field, lines = volume.field, {}
    for k, joint in enumerate(field.joints):
        if joint.type == "prismatic" and volume.high[k] > volume.low[k]:
            q, came = _line(volume, k)
            lines[k] = [_slope(p) for p in (field.nominal(q), field.actual(q, came))]
    out = []
    for i, (ni, ai) in lines.items():
        for j, (nj, aj) in lines.items():
            if j <= i:
                continue
            if abs(ni @ nj) > 0.1:
                continue
            angle = float(np.arccos(np.clip(ai @ aj, -1, 1)) - np.arccos(np.clip(ni @ nj, -1, 1)))
            span = min(volume.high[k] - volume.low[k] for k in (i, j))
            name = squareness(field.joints[j].name, field.joints[i].name)
            more = "wider" if angle > 0 else "narrower"
            out.append(Advice(f"{name} ({more} than square)", angle, 1e3 * abs(angle) * span))
    return out


def _slope(points: Array) -> Array:
    centred = points - points.mean(axis=0)
    t = np.linspace(-1, 1, len(points))
    direction = t @ centred
    unit: Array = direction / np.linalg.norm(direction)
    return unit


def _twist(volume: Volume) -> list[Advice]:
    """Roll of the tip from end to end of each linear joint: a twisted bed, which levelling removes."""
    field = volume.field
    out = []
    q0, came0 = volume.poses(128, 17)
    for k, joint in enumerate(field.joints):
        if joint.type != "prismatic" or volume.high[k] <= volume.low[k]:
            continue
        ends = []
        for value in (volume.low[k], volume.high[k]):
            q = q0.copy()
            q[:, k] = value
            nominal = field.nominal(q)
            ends.append(best_frame(field.actual(q, came0) - nominal, nominal))
        turn = ends[1].rotation @ ends[0].rotation.T
        vector = np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
        axis = _slope(field.nominal(_line(volume, k)[0]))
        roll = float(vector @ axis)
        others = [volume.high[i] - volume.low[i] for i in field.movers if i != k]
        out.append(
            Advice(
                f"twist along {joint.name} (roll from end to end: level the bed)",
                roll,
                1e3 * abs(roll) * max(others, default=0.0) / 2,
            )
        )
    return out
