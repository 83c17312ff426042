"""Spindle growth: thermal expansion of the spindle along the tool (ISO 230-3).

Displacement in mm along the tool, per K; of a head also across it, and its tilt in rad. Where no temperature shows how
warm the spindle is, its speed or power does, behind a lag: per unit of that channel.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from itertools import permutations, product
from typing import ClassVar, Literal

from errormodel.conventions import MOTIONS, TOOL, TRANSLATIONS, Motion
from errormodel.effects.base import Channels, Effect, EffectTerm
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import Initial, Lag, each_motion, lags, outward, outward_words, thermal, warmth
from errormodel.machine import Machine, Shape

ASIDE = 2.3  # log prior odds, 10 to 1, against a spindle that grows across its axis; by judgement
PARTS = ("spindle", "spindel", "headstock", "quill")  # a sensor that is named after one measures the spindle
# and so does one at a bearing of no other member, or of the head
BEARING = re.compile(r"t_?(front_|rear_|head_|kopf_?)?(bearing|lager)(_front|_rear|_\d+)?")
# log prior odds against growth by a sensor whose name says that it is elsewhere, or not where: one of some five members
ELSEWHERE, SOMEWHERE = 4.0, math.log(5.0)
WORD = re.compile(r"[^\W\d_]{3}")  # fewer letters beside each other are a number's: T_1, T_ch03
HEATS = frozenset({"spindle", "spindel", "rpm", "speed", "power", "load", "torque", "current", "n", "kw", "w", "pct"})
GROWTH, TILT = 0.005, 5e-6  # usual: mm and rad per K
PER_TURN = 6e-4  # K per rev/min: some 6 K at 10 000 rev/min


def heats(name: str) -> bool:
    """Whether a recorded channel is by its name the spindle's speed or power: ``w_spindle``, ``w_rpm_spindle``."""
    words = {*name.lower().removeprefix("w_").split("_")}
    return name.startswith("w_") and words <= HEATS and bool(words & {"spindle", "spindel", "rpm"})


def of_spindle(sensor: str) -> bool:
    """Whether a temperature is by its name the spindle's or its housing's."""
    name = sensor.lower()
    return any(part in name for part in PARTS) or BEARING.fullmatch(name) is not None


class SpindleGrowth(Effect):
    """``growth * (temperature - 20)`` along the tool, mm/K; positive: outward. `sensor` may be the spindle's speed.

    `element` is the tool or the last member. `motion` replaces the direction of the tool, or with ``all`` a head moves
    and tilts in each of its motions; `tau` (s) is the lag behind the sensor, `initial` (K) how much warmer than it the
    head was in the first row, `minus` a sensor in place of 20 degC.
    """

    effect: ClassVar[str] = "spindle-growth"
    family: ClassVar[str] = "thermal"
    source: ClassVar[str] = "300 mm of steel grow by 3.6 um/K; ISO 230-3"
    alike: ClassVar[tuple[str, ...]] = ("structure-drift", "warm-up")
    separate: ClassVar[str] = "run the spindle warm and cold with the axes at rest; use two tool lengths"
    example: ClassVar[Mapping[str, object]] = {"sensor": "T_spindle"}

    sensor: str
    element: str = TOOL
    motion: Motion | Literal["all"] | None = None
    minus: str | None = None
    tau: Lag = 0.0
    initial: Initial = 0.0

    @property
    def where(self) -> str:
        return self.element

    @property
    def drivers(self) -> tuple[str, ...]:
        return thermal(self.sensor, self.minus)

    def cost(self, scene: Scene) -> float:
        """Natural logarithm of the prior odds against it, unless the sensor is named after it or its housing.

        What moves across the spindle is seldom its growth, and what another sensor drives in all motions is seldom so.
        """
        own = heats(self.sensor) or of_spindle(self.sensor)
        elsewhere = WORD.search(self.sensor.removeprefix("T_")) is not None  # it is named after something else
        aside = self.motion is not None and not (own and self.motion == "all")
        place = 0.0 if own else ELSEWHERE if elsewhere else SOMEWHERE
        return super().cost(scene) + place + (ASIDE if aside else 0.0)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        warm = warmth(channel, self.sensor, self.minus, self.tau, self.initial)
        per, kelvin = (f"/{self.sensor}", PER_TURN) if self.sensor.startswith("w_") else ("/K", 1.0)
        if self.motion == "all":
            motions = TRANSLATIONS if self.element == TOOL else MOTIONS
            return each_motion(self.element, motions, warm, (GROWTH * kelvin, TILT * kelvin), per)
        direction: Mapping[Motion, float] = outward(machine) if self.motion is None else {self.motion: 1.0}
        motion = {name: value * warm for name, value in direction.items()}
        return [EffectTerm(self.element, "", f"mm{per}", motion, GROWTH * kelvin)]

    def positive(self, machine: Machine) -> str:
        return outward_words(machine) if self.motion is None else ""

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        last = scene.machine.elements[-1]
        element = last.name if isinstance(last, Shape) and not any(last.rotation) else TOOL
        sideways = [m for m in TRANSLATIONS if m not in outward(scene.machine)]  # a head grows on one side of its guide
        sensors = (*scene.sensors, *filter(heats, scene.witnesses))
        over = [(own, other) for own, other in permutations(scene.sensors, 2) if of_spindle(own)]
        alone: list[tuple[str, str | None]] = [(s, None) for s in sensors]
        for (sensor, minus), motion, tau in product([*alone, *over], (None, *sideways, "all"), lags(scene)):
            fields = {"sensor": sensor, "minus": minus, "element": element, "motion": motion, "tau": tau}
            yield cls.model_validate(fields)
