"""Directions in entries of ``observations:``: unit vectors, and one across another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import AfterValidator

from errormodel.yamlfile import Vector3

ALIGNED = 0.9  # cosine between two directions from which one is not across the other, by judgement


def _some(vector: list[float]) -> list[float]:
    if not any(vector):
        raise ValueError("Write a direction, such as [0, 0, 1]")
    return vector


Direction = Annotated[Vector3, AfterValidator(_some)]
"""Three components of a direction, of any length but 0."""


def unit(vector: Sequence[float]) -> tuple[float, float, float]:
    """The unit vector of a direction."""
    v = np.array(vector, dtype=np.float64)
    x, y, z = (v / np.linalg.norm(v)).tolist()
    return x, y, z


def crossing(vector: Sequence[float], along: Sequence[float]) -> tuple[float, float, float]:
    """The part of a direction across another, as a unit vector."""
    v, u = np.array(unit(vector)), np.array(unit(along))
    return unit((v - (v @ u) * u).tolist())


def is_across(vector: Sequence[float], along: Sequence[float]) -> bool:
    """Whether a direction lies across another rather than along it."""
    return abs(float(np.dot(unit(vector), unit(along)))) < ALIGNED
