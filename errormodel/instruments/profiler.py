"""Noise model of a laser profile sensor that measures artefacts of known shape."""

from __future__ import annotations

from typing import Literal

from errormodel.instruments.base import LengthDependent


class Profiler(LengthDependent):
    """Laser profile sensor: isotropic standard uncertainty that grows with length."""

    type: Literal["profiler"] = "profiler"
