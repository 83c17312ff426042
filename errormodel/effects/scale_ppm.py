"""Scale error of the instrument: one relative error of all lengths, from the refractive index or the wavelength.

Dimensionless, or in 1/K of the air temperature.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar

from errormodel.channels import POINT_CHANNELS
from errormodel.conventions import FRAME, TRANSLATIONS
from errormodel.effects.base import Channels, Effect, EffectTerm
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import in_runs, only, run_channels, switched, warmth
from errormodel.machine import Machine, Vector

LIKE_SCALES = 5e-6  # 1/K, between the refractive index of air and the expansion of glass


class ScalePpm(Effect):
    """Relative error of all lengths (1), or of those of a `run`, or several; with a `sensor` per K over 20 degC (1/K).

    Lengths are those from the `station`: about another point a scale that changes would leave a shift. `of` is the
    observation that it acts on, or ``points``; without it all of them.
    """

    effect: ClassVar[str] = "scale-ppm"
    family: ClassVar[str] = "instrument"
    source: ClassVar[str] = "refractive index of air: 0.95 ppm/K, 0.27 ppm/hPa; uncompensated up to 10 ppm"
    alike: ClassVar[tuple[str, ...]] = ("scale-expansion", "higher-order-geometry")
    separate: ClassVar[str] = "a known length, or a second station at another distance"
    example: ClassVar[Mapping[str, object]] = {"sensor": "T_amb"}

    station: Vector = (0.0, 0.0, 0.0)  # mm, in the reference's axes
    sensor: str | None = None  # temperature of the air
    run: str | tuple[str, ...] | None = None
    of: str | None = None

    @property
    def where(self) -> str:
        return FRAME

    @property
    def drivers(self) -> tuple[str, ...]:
        return (*POINT_CHANNELS, *filter(None, (self.sensor,)), *run_channels(self.run))

    def cost(self, scene: Scene) -> float:
        """Natural logarithm of the prior odds against it: instruments correct for the weather, unlike machines."""
        return 0.0 if self.sensor or self.run else 4.0

    def meaning_of_sign(self, values: Sequence[float]) -> str:
        if not self.sensor or values[0] < LIKE_SCALES:
            return ""
        return (
            "as scales of glass or steel do that expand alike along all axes (8 to 12 um/m/K): look at these first, no "
            "instrument is so wrong by a temperature"
        )

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        factor = warmth(channel, self.sensor) if self.sensor else 1.0
        factor = factor * in_runs(channel, self.run) if self.run else factor
        factor = factor * only(channel, self.of)
        lengths = (channel(p) - s for p, s in zip(POINT_CHANNELS, self.station, strict=True))
        motion = {name: factor * length for name, length in zip(TRANSLATIONS, lengths, strict=True)}
        return [EffectTerm(FRAME, "", "1/K" if self.sensor else "1", motion, 1e-6 if self.sensor else 5e-6)]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        yield cls(of=scene.of)  # about the station it is the same: the measuring frame takes the shift
        for station in scene.stations:
            yield from (cls(station=station, sensor=sensor, of=scene.of) for sensor in scene.sensors)
            yield from (cls(station=station, run=run, of=scene.of) for run in switched(scene.runs))
