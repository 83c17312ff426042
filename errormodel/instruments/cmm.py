"""A coordinate measuring machine, or a probe in the machine itself."""

from __future__ import annotations

from typing import Literal

from errormodel.instruments.base import LengthDependent


class CoordinateMeasuringMachine(LengthDependent):
    """A coordinate measuring machine."""

    type: Literal["cmm"] = "cmm"
