"""The first of two poses that single readings depend on: channels and levers there, beside those of the second."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from errormodel.arrays import Array, Index


@dataclass(frozen=True, eq=False)
class FirstPoses:
    """First poses of those observations of a linear model that have two.

    Attributes
    ----------
    at : (f,) number of each one's observation.
    levers : element -> (6, f) whitened effect of each motion of the element there.
    table : channel -> (f,) its value there.
    """

    at: Index
    levers: Mapping[str, Array]
    table: Mapping[str, Array]
