"""Noise model of a laser interferometer along one line."""

from __future__ import annotations

from typing import Literal

from errormodel.instruments.base import LengthDependent


class Interferometer(LengthDependent):
    """Laser interferometer; components that it does not measure are empty in the survey."""

    type: Literal["interferometer"] = "interferometer"
