"""Page of a fleet."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from identification.results.fleet_result import FleetResult


def fleet_page(result: FleetResult) -> str:
    """Stub."""
    return result.summary()
