"""Instruments and their noise, one file each, found by themselves: a new file here is a new ``type`` in survey.yaml."""

from __future__ import annotations

import pkgutil
from functools import cache
from importlib import import_module
from typing import get_args

from errormodel.instruments.base import Instrument


@cache
def instruments() -> dict[str, type[Instrument]]:
    """All instruments by their ``type``."""
    modules = [import_module(f"{__name__}.{info.name}") for info in pkgutil.iter_modules(__path__)]
    found: dict[str, type[Instrument]] = {}
    for module in modules:
        for cls in vars(module).values():
            if isinstance(cls, type) and issubclass(cls, Instrument) and cls.__module__ == module.__name__:
                found |= dict.fromkeys(get_args(cls.model_fields["type"].annotation), cls)
    return dict(sorted(found.items()))
