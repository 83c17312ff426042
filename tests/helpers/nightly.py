"""Values of a test of which the first are tried in every run, and the others every night (mark `long`)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def first_of(values: Iterable[Any], count: int = 1, *, whole: bool = False) -> list[Any]:
    """The values for `parametrize`; those beyond the first `count` have the mark `long`.

    Parameters
    ----------
    whole : whether a tuple is one argument's value, and not several arguments' values.
    """
    every = list(values)
    several = [v if type(v) is tuple and not whole else (v,) for v in every[count:]]
    return [*every[:count], *(pytest.param(*own, marks=pytest.mark.long) for own in several)]
