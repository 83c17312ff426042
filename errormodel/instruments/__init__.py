"""Registry of measuring instruments and their noise models: a class in a new file is a new ``type`` in survey.yaml."""

from __future__ import annotations

from functools import cache
from typing import get_args

from errormodel.discovery import by_word, classes
from errormodel.instruments.base import Instrument


@cache
def instruments() -> dict[str, type[Instrument]]:
    """All instrument classes by their ``type``."""
    kinds = classes(__name__, Instrument)  # type: ignore[type-abstract]
    words = ((word, kind) for kind in kinds for word in get_args(kind.model_fields["type"].annotation))
    return dict(sorted(by_word(words).items()))
