"""A laser interferometer along one line."""

from __future__ import annotations

from typing import Literal

from errormodel.instruments.base import LengthDependent


class Interferometer(LengthDependent):
    """An interferometer; what it does not measure is empty in the survey."""

    type: Literal["interferometer"] = "interferometer"
