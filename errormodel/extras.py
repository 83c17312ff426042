"""Packages that not everybody needs, and the extras of this project that install them."""

from __future__ import annotations

import platform
import sys
from importlib import import_module
from typing import Any

from errormodel.exceptions import InputError

# extra of pyproject.toml by the module that it brings
EXTRAS = {
    "pyarrow": "big", "small_gicp": "clouds", "pypcd4": "clouds", "python_calamine": "xlsx", "xarray": "arviz",
}  # fmt: skip


def optional(module: str, where: str, found: str, instead: str = "") -> Any:
    """Import a module that an extra installs.

    Parameters
    ----------
    module : str
        Its full name, such as ``pyarrow.parquet``.
    where, found : str
        The input that needs it, and what it is, for the message.
    instead : str
        What to do without it.

    Raises
    ------
    InputError
        It is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        name = package.replace("_", "-")
        cure = f"Install it with: pip install 'errormodel[{EXTRAS[package]}]'"
        if package == "small_gicp" and (sys.platform, platform.machine()) == ("darwin", "x86_64"):
            cure = "No package of it is made for Macs with Intel processors: use another computer for this step"
        if isinstance(error, ModuleNotFoundError) and (error.name or "").partition(".")[0] == package:
            reason = f"{found}, for which {name} is needed"
        else:  # a damaged package, or one for another system
            reason = f"{found}; {name}, which reads it, cannot be loaded ({error})"
        raise InputError(where, reason, cure + (f"; or {instead}" if instead else "")) from error
