"""Values of a test of which the first are tried in every run, and the others every night (mark `long`)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def first_of(values: Iterable[Any], count: int = 1) -> list[Any]:
    """The values for `parametrize`; those beyond the first `count` have the mark `long`."""
    every = list(values)
    return [*every[:count], *(_by_night(v) for v in every[count:])]


def _by_night(value: Any) -> Any:
    return pytest.param(*(value if type(value) is tuple else (value,)), marks=pytest.mark.long)
