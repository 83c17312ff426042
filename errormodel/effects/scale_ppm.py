"""Scale of the instrument: a wrong refractive index or wavelength makes every distance longer by the same fraction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from errormodel.conventions import FRAME, TRANSLATIONS
from errormodel.effects.base import Channels, Effect, EffectTerm
from errormodel.effects.scene import Scene
from errormodel.effects.shared import warmth
from errormodel.features import POINT
from errormodel.machine import Machine


class ScalePpm(Effect):
    """All lengths longer by one fraction (1); with a `sensor`, per K of its temperature over 20 degC (1/K)."""

    effect: ClassVar[str] = "scale-ppm"
    family: ClassVar[str] = "instrument"
    source: ClassVar[str] = "refractive index of air: 0.95 ppm/K, 0.27 ppm/hPa; uncompensated up to 10 ppm"
    alike: ClassVar[tuple[str, ...]] = ("scale-expansion", "higher-order-geometry")
    separate: ClassVar[str] = "a known length, or a second station at another distance"
    example: ClassVar[Mapping[str, object]] = {"sensor": "T_amb"}

    sensor: str | None = None  # of the air

    @property
    def where(self) -> str:
        return FRAME

    @property
    def drivers(self) -> tuple[str, ...]:
        return (*POINT, self.sensor) if self.sensor else POINT

    @property
    def cost(self) -> float:
        """Instruments measure the weather: what looks like their scale is most often the machine's, or the tool's."""
        return 0.0 if self.sensor else 4.0

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        factor = warmth(channel, self.sensor) if self.sensor else 1.0
        motion = {name: factor * channel(p) for name, p in zip(TRANSLATIONS, POINT, strict=True)}
        return [EffectTerm(FRAME, "", "1/K" if self.sensor else "1", motion, 1e-6 if self.sensor else 5e-6)]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        return (cls(sensor=sensor) for sensor in (None, *scene.sensors))
