"""Volumetric error models of machine tools, CMMs, gantries and arms, from homogeneous transformations (forward model).

Data path: ``machine.yaml`` -> :class:`~errormodel.machine.Machine` -> :class:`~errormodel.chain.Chain` (CasADi) ->
:class:`~errormodel.kernel.Kernel` (NumPy). Parameters are estimated by the package ``identification``, which imports
this one.

Public names: `read_machine`, `write_machine`, `machine_names`, `library`, `read_survey`, `simulate`, and the types
`Machine`, `Survey` and `InputError`. They are imported when they are first asked for, so that ``import errormodel``
costs nothing.
"""

from __future__ import annotations

TYPE_CHECKING = False  # what type checkers take for true; `typing` itself is half of the start of a command

if TYPE_CHECKING:
    from typing import Any

    from errormodel.exceptions import InputError
    from errormodel.machine import Machine
    from errormodel.machine_file import read_machine, write_machine
    from errormodel.machine_library import library, machine_names
    from errormodel.simulation import simulate
    from errormodel.survey import Survey, read_survey

__version__ = "0.1.0"

# module of each public name
_WHERE = {
    "InputError": "exceptions",
    "Machine": "machine",
    "library": "machine_library",
    "machine_names": "machine_library",
    "read_machine": "machine_file",
    "write_machine": "machine_file",
    "simulate": "simulation",
    "Survey": "survey",
    "read_survey": "survey",
}

__all__ = [
    "InputError",
    "Machine",
    "Survey",
    "library",
    "machine_names",
    "read_machine",
    "read_survey",
    "simulate",
    "write_machine",
]


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in _WHERE:
        raise AttributeError(f"module 'errormodel' has no attribute '{name}'")
    return getattr(import_module(f"errormodel.{_WHERE[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_WHERE])
