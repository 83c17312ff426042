"""Units of the input files, and their conversion into mm, rad, s, degC, mm/min and kg."""

from __future__ import annotations

import re
from functools import cache
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator
from pydantic_core.core_schema import ValidationInfo

from errormodel.yamlfile import FileModel

if TYPE_CHECKING:
    import pint

Quantity = Literal["length", "angle", "time", "temperature", "speed", "mass"]

# units in which the toolkit computes
INTERNAL_UNITS: dict[str, str] = {
    "length": "mm", "angle": "rad", "time": "s", "temperature": "degC", "speed": "mm/min", "mass": "kg",
}  # fmt: skip
# units to name in messages
UNIT_EXAMPLES: dict[str, str] = {
    "length": "mm, um, m or inch",
    "angle": "deg, rad, mrad, urad, um/m, mm/m or arcsec",
    "time": "s, ms, min or h",
    "temperature": "degC, K or degF",
    "speed": "mm/min, mm/s or m/min",
    "mass": "kg, g or lb",
}
# before a unit of length, or alone for mm: of a joint across the axis of a turned part, which moves by half of it
DIAMETER = "diameter"


def of_diameters(unit: str, within: str) -> str:
    """A unit as it is; of ``diameter`` alone with the unit `within` which the numbers stand."""
    return f"{DIAMETER} {within}" if unit == DIAMETER and within not in ("", "mm") else unit


def _of_radius(unit: str) -> str:
    """The unit of length of a diameter."""
    return unit.removeprefix(DIAMETER).strip() or "mm"


@cache
def _registry() -> pint.UnitRegistry[float]:
    import pint

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


def is_unit(unit: str, quantity: str) -> bool:
    """Whether a word (for speeds and slopes two words with a slash) is a unit of that quantity.

    Angles are slopes as well: 1 um/m is 1 urad, to a third of the cube of the angle. ``diameter`` and ``diameter inch``
    are lengths, twice the way of a joint across the axis of a turned part.
    """
    if quantity == "length" and unit.split(" ", maxsplit=1)[0] == DIAMETER:
        return _of_radius(unit).split(" ")[0] != DIAMETER and is_unit(_of_radius(unit), "length")
    if unit == INTERNAL_UNITS[quantity] or unit == "deg":  # usual units, without loading Pint
        return unit != "deg" or quantity == "angle"
    if not re.fullmatch(r"[^\W\d_]+(/[^\W\d_]+)?|°C?", unit):  # Pint would evaluate an expression such as 10**10**10
        return False
    import pint

    root = _registry().get_root_units  # the dimension is not enough: in Pint percentages and angles share it
    try:
        if quantity == "angle" and "/" in unit:
            kind = root(unit)[1]
            return bool(kind == root("mm/m")[1] and _registry().Quantity(1.0, unit).to("rad").magnitude < 1)  # not m/mm
        return bool(root(unit)[1] == root(INTERNAL_UNITS[quantity])[1])
    except pint.PintError:
        return False


class UnitsBlock(FileModel):
    """``units: {length: mm, angle: deg}``; each is a single unit that Pint knows."""

    length: str = Field("mm", description=f"a unit of length, such as {UNIT_EXAMPLES['length']}")
    angle: str = Field("deg", description=f"a unit of angle, such as {UNIT_EXAMPLES['angle']}")

    @field_validator("*")
    @classmethod
    def _fits(cls, unit: str, info: ValidationInfo) -> str:
        quantity = {"reading": "angle"}.get(str(info.field_name), str(info.field_name))
        if not is_unit(unit, quantity) or unit.startswith(DIAMETER):  # which single columns are
            raise ValueError(f"Write a unit of {quantity}, such as {UNIT_EXAMPLES[quantity]}")
        return unit


def to_internal(values: NDArray[np.float64], unit: str, quantity: Quantity) -> NDArray[np.float64]:
    """Convert an array from `unit` into mm (of diameters: of radius), rad, s, degC, mm/min or kg; NaN stays NaN."""
    if unit == INTERNAL_UNITS[quantity]:
        return values
    if unit == "deg":
        return np.deg2rad(values)
    if unit.startswith(DIAMETER):
        return to_internal(values, _of_radius(unit), quantity) / 2
    converted: NDArray[np.float64] = _registry().Quantity(values, unit).to(INTERNAL_UNITS[quantity]).magnitude
    return converted


def factor(unit: str, quantity: Literal["length", "angle"]) -> float:
    """One `unit` in mm or rad: ``factor("m", "length") == 1000``."""
    return float(to_internal(np.ones(1), unit, quantity)[0])
