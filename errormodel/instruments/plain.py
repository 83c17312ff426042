"""An instrument of which nothing is known."""

from __future__ import annotations

from typing import Literal

from errormodel.instruments.base import Array, Instrument, Source


class Plain(Instrument):
    """Noise equal in all directions and at all places, its size estimated from the data."""

    type: Literal["plain"] = "plain"

    def sources(self, points: Array) -> list[Source]:
        """None: the noise is to be estimated from the data."""
        return []
