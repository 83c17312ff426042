"""Noise model of a coordinate measuring machine, or of a probe in the machine itself."""

from __future__ import annotations

from typing import ClassVar, Literal

from errormodel.instruments.base import LengthDependent


class CoordinateMeasuringMachine(LengthDependent):
    """Coordinate measuring machine: isotropic standard uncertainty that grows with length."""

    type: Literal["cmm"] = "cmm"
    usual: ClassVar = (5e-3, 5e-6)  # half of 10 um + 10 um/m: large machines, and probes in machine tools
