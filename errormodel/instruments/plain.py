"""An instrument of which nothing is known."""

from __future__ import annotations

from typing import Literal

from errormodel.instruments.base import Array, Instrument


class Plain(Instrument):
    """Noise equal in all directions and at all places, its size estimated from the data."""

    type: Literal["plain"] = "plain"

    def covariance(self, points: Array) -> None:
        """None: to be estimated from the data."""
        return
