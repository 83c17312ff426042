"""Inference on top of ``errormodel``: what a survey says of a machine, and how sure it is.

Public functions, as on the command line: `import_machine`, `import_survey`, `check`, `template`, `describe`, `plan`,
`fit`, `diagnose`, `thermal`, `register`, `predict`, `explain`, `monitor`, `compensate`, `controllers`, `export`,
`machine_formats`, `iso`, `standards`, `fleet`, `load` and `save`; and `fit_stream`, `predict_stream`, `simulate_stream`
and `average_dwells` for surveys larger than memory. They are imported when they are first asked for, so that
``import identification`` costs nothing.
"""

from __future__ import annotations

TYPE_CHECKING = False  # what type checkers take for true; `typing` itself is half of the start of a command

if TYPE_CHECKING:
    from typing import Any

    from identification.api import (
        average_dwells,
        check,
        compensate,
        controllers,
        describe,
        diagnose,
        explain,
        export,
        fit,
        fit_stream,
        fleet,
        import_machine,
        import_survey,
        iso,
        load,
        machine_formats,
        monitor,
        plan,
        predict,
        predict_stream,
        register,
        save,
        simulate_stream,
        standards,
        template,
        thermal,
    )

__all__ = [
    "average_dwells",
    "check",
    "compensate",
    "controllers",
    "describe",
    "diagnose",
    "explain",
    "export",
    "fit",
    "fit_stream",
    "fleet",
    "import_machine",
    "import_survey",
    "iso",
    "load",
    "machine_formats",
    "monitor",
    "plan",
    "predict",
    "predict_stream",
    "register",
    "save",
    "simulate_stream",
    "standards",
    "template",
    "thermal",
]


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in __all__:
        raise AttributeError(f"module 'identification' has no attribute '{name}'")
    return getattr(import_module("identification.api"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
