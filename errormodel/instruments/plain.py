"""Default noise model: isotropic, with a standard uncertainty estimated from the data."""

from __future__ import annotations

from typing import Literal

from errormodel.instruments.base import Array, Instrument, Source


class Plain(Instrument):
    """Noise equal in all directions and at all points, its size estimated from the data."""

    type: Literal["plain"] = "plain"

    def sources(self, points: Array) -> list[Source]:
        """No sources: the noise is estimated from the data."""
        return []
