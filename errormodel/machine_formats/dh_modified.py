"""Denavit-Hartenberg parameters in the modified convention, of Craig."""

from __future__ import annotations

from typing import ClassVar

from errormodel.machine import Machine
from errormodel.machine_formats.base import Description, Extras, MachineFormat, Part, Written
from errormodel.machine_formats.dh_table import is_table, read_table, table_text
from errormodel.raw_formats.base import RawFile


class ModifiedTable(MachineFormat):
    """A table with a row a joint: ``Rx(alpha) Tx(a) Rz(theta + q) Tz(d)``; of a slide q is added to d.

    Columns of a CSV are ``joint``, ``type`` (rotary, prismatic, fixed), ``a``, ``alpha``, ``d``, ``theta``, ``beta``,
    ``low`` and ``high`` (the travel), in mm and degrees or with their unit behind the name: ``a [m]``. A YAML file has
    ``convention``, ``units`` and ``rows``. Nearly parallel axes are written with Hayati's ``Ry(beta)`` behind a.
    """

    name: ClassVar = "dh-modified"
    title: ClassVar = "a table of modified (Craig) Denavit-Hartenberg parameters"
    source: ClassVar = "Craig, Introduction to Robotics, 1986, section 3.4"

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        return is_table(raw, "modified")

    @classmethod
    def read(cls, raw: RawFile, part: Part) -> Description:
        return read_table(raw, "modified")

    @classmethod
    def write(cls, machine: Machine, suffix: str, extras: Extras) -> Written:
        return Written(table_text(machine, "modified", suffix, extras.heading))
