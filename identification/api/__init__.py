"""The functions of notebooks, scripts and the command line: one for each command, with results that hold tables.

Machines are given as a `Machine`, a file, a name of the library or a dict; surveys as a `Survey`, a file, a folder or a
DataFrame. All are in the units of their files: mm, degrees for rotary joints, s, degC.
"""

from identification.api.descriptions import export, import_machine, machine_formats
from identification.api.fleets import fleet
from identification.api.models import describe, diagnose, fit, plan, register, thermal
from identification.api.preparing import check, import_survey, template
from identification.api.standards import iso, standards
from identification.api.streams import average_dwells, fit_stream, predict_stream, simulate_stream
from identification.api.uses import compensate, controllers, explain, load, monitor, predict, save

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
