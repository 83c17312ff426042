"""What a controller may add to the readings of a probe that stands beside the tool and feels the angles of the axes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from errormodel.arrays import Array

Gap = Callable[[Array], Array]
"""How much too high (n,) a probe's tip stands over the nozzle's, mm, at places of the bed as positions (n, axes)."""


@dataclass(frozen=True)
class Probing:
    """Files, and what is left of a probe's error: root mean square and worst, um, before and after, mean taken off."""

    files: Mapping[str, str]
    before_um: tuple[float, float]
    after_um: tuple[float, float]
