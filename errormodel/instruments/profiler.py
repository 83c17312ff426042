"""A laser profile sensor that sees artefacts of known shape."""

from __future__ import annotations

from typing import Literal

from errormodel.instruments.base import LengthDependent


class Profiler(LengthDependent):
    """A profile sensor."""

    type: Literal["profiler"] = "profiler"
