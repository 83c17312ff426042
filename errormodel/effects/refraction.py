"""Refraction: curvature of the line of sight in a vertical temperature gradient of the air.

Displacement in mm, quadratic in the horizontal distance from the instrument.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import combinations, product
from typing import ClassVar

from errormodel.channels import POINT_CHANNELS
from errormodel.conventions import FRAME, TRANSLATIONS
from errormodel.effects.base import Channels, Effect, EffectTerm
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import Lag, lags, only, thermal, warmth
from errormodel.effects.travel import Translation
from errormodel.machine import Machine, Vector

# words in the name of a sensor that hangs in the air, or where it begins and ends
AIR = re.compile(r"_(air|amb(ient)?|room|hall|ceiling|roof|floor|luft|raum|halle|decke|boden)(?![a-z])")
LAYER_MM = 2000.0  # height over which the gradient of lying air changes by as much as it is; by judgement


class Refraction(Effect):
    """``curvature * distance^2 / 2`` along `motion` (mm), with the distance from `station` and the curvature in 1/mm.

    With a `sensor` the curvature is per K of that temperature over 20 degC, or over the sensor `minus`. `layered`: the
    gradient changes with the height over the station, as air does that lies in layers (in 1/mm per mm of height). `of`
    is the observation that it acts on, or ``points``; without it all of them.
    """

    effect: ClassVar[str] = "refraction"
    family: ClassVar[str] = "instrument"
    source: ClassVar[str] = "dn/dT = -0.93e-6 1/K: a gradient of 1 K/m curves by 1e-9 1/mm, 47 um over 10 m"
    alike: ClassVar[tuple[str, ...]] = ("higher-order-geometry", "thermal-bending", "scale-ppm")
    separate: ClassVar[str] = "a second station at the other end of the machine, or the same lines with the air stirred"
    example: ClassVar[Mapping[str, object]] = {"motion": "dz"}

    motion: Translation = "dz"  # vertical
    station: Vector = (0.0, 0.0, 0.0)  # mm, in the reference's axes
    sensor: str | None = None
    minus: str | None = None
    tau: Lag = 0.0
    layered: bool = False
    of: str | None = None

    @property
    def where(self) -> str:
        return FRAME

    def cost(self, scene: Scene) -> float:
        """Natural logarithm of the prior odds against it: sensors of the machine seldom follow the air's gradient.

        Two in the air, by their names, are there to show it.
        """
        in_air = self.minus and all(n and AIR.search(n.lower()) for n in (self.sensor, self.minus))
        return 4.0 if self.sensor and not in_air else 0.0

    @property
    def drivers(self) -> tuple[str, ...]:
        level = (p for p, m in zip(POINT_CHANNELS, TRANSLATIONS, strict=True) if self.layered or m != self.motion)
        return (*level, *(thermal(self.sensor, self.minus) if self.sensor else ()))

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        level = [k for k in range(3) if TRANSLATIONS[k] != self.motion]
        bend = sum((channel(POINT_CHANNELS[k]) - self.station[k]) ** 2 for k in level) / 2
        bend = bend * only(channel, self.of)
        if self.sensor:
            bend = bend * warmth(channel, self.sensor, self.minus, self.tau)
        unit, of_height = ("1/(mm K)", "1/(mm2 K)") if self.sensor else ("1/mm", "1/mm2")
        terms = [EffectTerm(FRAME, "", unit, {self.motion: bend}, 1e-9)]
        if self.layered:
            up = TRANSLATIONS.index(self.motion)
            height = channel(POINT_CHANNELS[up]) - self.station[up]
            terms.append(EffectTerm(FRAME, "height", of_height, {self.motion: bend * height}, 1e-9 / LAYER_MM))
        return terms

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        pairs = [(None, None), *((s, None) for s in scene.sensors), *combinations(scene.sensors, 2)]
        for motion, station, (sensor, minus) in product(TRANSLATIONS, scene.stations, pairs):
            fields = {"motion": motion, "station": station, "sensor": sensor, "minus": minus, "of": scene.of}
            for tau in lags(scene)[::2] if sensor else (0.0,):
                yield cls.model_validate({**fields, "tau": tau})
            if not sensor:
                yield cls.model_validate({**fields, "layered": True})
