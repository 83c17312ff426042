"""Denavit-Hartenberg parameters in the standard convention."""

from __future__ import annotations

from typing import ClassVar

from errormodel.machine import Machine
from errormodel.machine_formats.base import Description, Extras, MachineFormat, Part, Written
from errormodel.machine_formats.dh_table import is_table, read_table, table_text
from errormodel.raw_formats.base import RawFile


class StandardTable(MachineFormat):
    """A table with a row a joint: ``Rz(theta + q) Tz(d) Tx(a) Rx(alpha)``; of a slide q is added to d.

    Columns of a CSV are ``joint``, ``type`` (rotary, prismatic, fixed), ``a``, ``alpha``, ``d``, ``theta``, ``beta``,
    ``low`` and ``high`` (the travel), in mm and degrees or with their unit behind the name: ``a [m]``. A YAML file has
    ``convention``, ``units`` and ``rows``. Nearly parallel axes are written with Hayati's ``Ry(beta)`` behind alpha.
    """

    name: ClassVar = "dh"
    title: ClassVar = "a table of Denavit-Hartenberg parameters"
    source: ClassVar = "Denavit and Hartenberg, J. Appl. Mech. 22 (1955) 215-221; Paul, Robot Manipulators, 1981"

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        return is_table(raw, "standard")

    @classmethod
    def read(cls, raw: RawFile, part: Part) -> Description:
        return read_table(raw, "standard")

    @classmethod
    def write(cls, machine: Machine, suffix: str, extras: Extras) -> Written:
        return Written(table_text(machine, "standard", suffix, extras.heading))
