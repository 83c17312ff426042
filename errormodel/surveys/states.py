"""Columns of states for a prediction: those of the joints, and those that effects of the machine need."""

from __future__ import annotations

from collections.abc import Mapping

from errormodel.channels import lacking, needed_by_effects
from errormodel.exceptions import InputError
from errormodel.formats.base import Table
from errormodel.machine import Machine
from errormodel.surveys.columns import TOOL_COLUMNS, MissingJointsError, Plan, plan_columns


def planned(table: Table, machine: Machine, columns: Mapping[str, str], measured: bool) -> Plan:
    """As `plan_columns`; of states for a prediction a refusal names all columns that are missing.

    Raises
    ------
    InputError
        A column appears twice, or required ones are missing.
    """
    try:
        return plan_columns(table, machine, columns, measured)
    except MissingJointsError as error:
        if measured:
            raise
        from errormodel.chain import Chain

        joints = {name for joint in machine.joints for name in joint.columns}
        absent = lacking({*error.there, *joints, *TOOL_COLUMNS}, Chain(machine).channels)
        if not absent:
            raise
        raise InputError(error.where, f"{error.found}; and {needed_by_effects(absent)}", error.cure) from error
