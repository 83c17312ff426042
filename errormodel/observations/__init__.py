"""Registry of observation models of single readings: a class in a new file is a new ``type`` of ``observations:``."""

from __future__ import annotations

from functools import cache
from typing import get_args

from errormodel.discovery import by_word, classes
from errormodel.observations.base import Observation


@cache
def registry() -> dict[str, type[Observation]]:
    """All observation models by their ``type``."""
    kinds = classes(__name__, Observation)  # type: ignore[type-abstract]
    words = ((word, kind) for kind in kinds for word in get_args(kind.model_fields["type"].annotation))
    return dict(sorted(by_word(words).items()))
