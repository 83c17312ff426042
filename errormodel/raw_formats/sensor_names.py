"""Columns of temperature sensors, by their names and units."""

from __future__ import annotations

import re

from errormodel.units import is_unit

_TEMPERATURE = re.compile(
    r"temp(?:erature?)?[\s_.-]*(.*)|t(?:[\s_.-]+(.+)|(\d+))|(.*?)[\s_.-]*temp(?:erature?)?", re.IGNORECASE
)


def sensor_of(name: str, unit: str) -> str:
    """Column of a sensor in a survey, ``T_<name>``; empty where a column holds no temperature."""
    match = _TEMPERATURE.fullmatch(name.strip())
    if not (unit and is_unit(unit, "temperature")) and (match is None or unit):
        return ""
    bare = next((g for g in match.groups() if g), "") if match else name
    bare = re.sub(r"\W+", "_", bare).strip("_")
    return f"T_{bare or 'air'}"
