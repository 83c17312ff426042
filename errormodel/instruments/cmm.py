"""Noise model of a coordinate measuring machine, or of a probe in the machine itself."""

from __future__ import annotations

from typing import Literal

from errormodel.instruments.base import LengthDependent


class CoordinateMeasuringMachine(LengthDependent):
    """Coordinate measuring machine: isotropic standard uncertainty that grows with length."""

    type: Literal["cmm"] = "cmm"
