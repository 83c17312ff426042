"""The block ``test:`` of a survey.yaml: who tested what, when, where, with which instrument, and against which limits.

It is the head of every report and of the certificate. All of it is optional, and what is missing is said there.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import date
from math import isfinite
from typing import Annotated, Literal, NamedTuple

from pydantic import AfterValidator, Field

from errormodel.units import Quantity, is_unit, to_internal
from errormodel.yamlfile import FileModel, Number

_TURNS_TEXT = re.compile("[\u202a-\u202e\u2066-\u2069]")  # what a page shows is then not what the file says


def _a_text(text: str) -> str:
    found = _TURNS_TEXT.search(text)
    if found is not None:
        raise ValueError(f"Remove the character U+{ord(found[0]):04X}, which turns the order of what is shown")
    return text


Text = Annotated[str, Field(min_length=1), AfterValidator(_a_text)]
Rule = Literal["guard-band", "simple"]

LIMIT_EXAMPLE = "a limit with its unit, such as 8 um, 15 arcsec, 20 um/m or 1.8 um + L/300"
# a number, a unit (two words with a slash: a slope), and for errors of length the part that grows: L in mm, um
_LIMIT = re.compile(r"([0-9.]+(?:[eE][+-]?\d+)?)\s*([^\W\d_]+|[^\W\d_]+/[^\W\d_]+)(?:\s*\+\s*L\s*/\s*([0-9.]+))?")


class Limit(NamedTuple):
    """A limit of the size of a quantity: ``size`` in mm or rad, and per mm of length; `text` as the user wrote it."""

    size: float
    per_length: float
    unit: str
    text: str

    def at(self, length: float | None) -> float:
        """The limit for a length in mm."""
        return self.size + self.per_length * (length or 0.0)


def limit_of(text: str) -> Limit:
    """The limit that a text states.

    Raises
    ------
    ValueError
        It states none.
    """
    found = _LIMIT.fullmatch(text.strip())
    if found is None:
        raise ValueError(f"Write {LIMIT_EXAMPLE}")
    number, unit, divisor = float(found[1]), found[2], found[3]
    size, kind = _in_internal(number, unit)
    slope = 1e-3 / float(divisor) if divisor and float(divisor) > 0 else 0.0
    if not (isfinite(size) and size > 0) or (divisor and (kind != "mm" or not slope)):
        raise ValueError(f"Write {LIMIT_EXAMPLE}")
    return Limit(size, slope, kind, text.strip())


def _in_internal(number: float, unit: str) -> tuple[float, str]:
    import numpy as np

    top, _, bottom = unit.partition("/")
    kinds: tuple[tuple[Quantity, str], ...] = (("length", "mm"), ("angle", "rad"))
    for kind, internal in kinds:
        if is_unit(top, kind) and (not bottom or (kind == "length" and is_unit(bottom, "length"))):
            size = float(to_internal(np.array([number]), top, kind)[0])
            if not bottom:
                return size, internal
            return size / float(to_internal(np.ones(1), bottom, "length")[0]), "rad"
    raise ValueError(f"Write {LIMIT_EXAMPLE}")


def _a_limit(text: str) -> str:
    limit_of(text)
    return text


def _a_day(text: str) -> str:
    try:
        date.fromisoformat(text)
    except ValueError as error:
        raise ValueError("Write a day as 2026-11-20") from error
    return text


Day = Annotated[str, AfterValidator(_a_day)]
LimitText = Annotated[str, AfterValidator(_a_limit)]
NotNegative = Annotated[Number, Field(ge=0)]


class MachineRecord(FileModel):
    """The machine that was tested."""

    maker: Text | None = Field(None, description="the maker's name")
    model: Text | None = Field(None, description="the model's name")
    serial: Text | None = Field(None, description='its serial number, in quotes if it has digits only: "4711"')
    controller: Text | None = Field(None, description="its control, with its version")


class InstrumentRecord(FileModel):
    """The instrument that it was tested with."""

    maker: Text | None = Field(None, description="the maker's name")
    model: Text | None = Field(None, description="the model's name")
    serial: Text | None = Field(None, description='its serial number, in quotes if it has digits only: "4711"')
    certificate: Text | None = Field(None, description="the number of its calibration certificate")
    due: Day | None = Field(None, description="the day until which its calibration is valid, such as 2027-06-30")


class AmbientRecord(FileModel):
    """The surroundings during the test."""

    temperature: Number | None = Field(None, description="mean temperature of the air in degC, such as 20.3")
    temperature_range: NotNegative | None = Field(None, description="highest minus lowest temperature in K")
    machine_temperature: Number | None = Field(None, description="mean temperature of the machine in degC")
    humidity: Number | None = Field(None, description="relative humidity in %, such as 41")
    pressure: Number | None = Field(None, description="pressure of the air in hPa, such as 1013")


class UncertaintyRecord(FileModel):
    """What ISO 230-2, annex A, adds to the uncertainty of the instrument; lengths in mm, temperatures in K."""

    device: NotNegative | None = Field(
        None, description="expanded uncertainty (k = 2) of the instrument over the travel in mm, such as 0.001"
    )
    misalignment: NotNegative = Field(0.0, description="distance of the line of measurement from the axis, in mm")
    temperature: NotNegative = Field(0.0, description="bound (+-) of the error of the machine's temperature in K")
    coefficient: NotNegative = Field(11.5e-6, description="coefficient of expansion of the machine in 1/K")
    coefficient_bound: NotNegative = Field(
        0.0, description="bound (+-) of the coefficient's error in 1/K, such as 2e-6"
    )
    environment: NotNegative = Field(
        0.0, description="range of the reading in a drift test (E_VE) in mm, such as 0.002"
    )


class RecordForm(FileModel):
    """``test:`` of a survey.yaml."""

    number: Text | None = Field(None, description="the number of the certificate")
    operator: Text | None = Field(None, description="who did the test")
    laboratory: Text | None = Field(None, description="the laboratory or company")
    customer: Text | None = Field(None, description="for whom the test was done")
    date: Day | None = Field(None, description="the day of the test, such as 2026-11-20")
    place: Text | None = Field(None, description="where the machine stands")
    machine: MachineRecord = Field(MachineRecord(), description="a block such as {maker: .., model: .., serial: ..}")
    instrument: InstrumentRecord = Field(
        InstrumentRecord(), description="a block such as {model: .., serial: .., certificate: .., due: 2027-06-30}"
    )
    ambient: AmbientRecord = Field(AmbientRecord(), description="a block such as {temperature: 20.3, humidity: 41}")
    standard: Text | None = Field(None, description="what was agreed on, such as ISO 230-2:2014")
    tolerance: dict[str, LimitText] = Field({}, description="limits with units, such as {A: 8 um, X.R: 3 um}")
    decision: Rule = Field("guard-band", description="guard-band (ISO 14253-1) or simple")
    uncertainty: UncertaintyRecord = Field(
        UncertaintyRecord(), description="a block such as {device: 0.001, misalignment: 0.5, environment: 0.001}"
    )
    remarks: Text | None = Field(None, description="what else a reader should know")

    @property
    def limits(self) -> dict[str, Limit]:
        """The limits by the names of quantities."""
        return {name: limit_of(text) for name, text in self.tolerance.items()}

    @property
    def expired(self) -> bool:
        """Whether the instrument's calibration was no longer valid on the day of the test."""
        return bool(self.date and self.instrument.due and self.instrument.due < self.date)

    def lines(self) -> Iterator[tuple[str, str]]:
        """What is known, as a table: what it is, and its value."""
        m, i, a = self.machine, self.instrument, self.ambient
        pairs = [
            ("Certificate", self.number),
            ("Customer", self.customer),
            ("Machine", _joined(m.maker, m.model)),
            ("Serial number of the machine", m.serial),
            ("Control", m.controller),
            ("Place", self.place),
            ("Date of the test", self.date),
            ("Operator", _joined(self.operator, self.laboratory)),
            ("Instrument", _joined(i.maker, i.model)),
            ("Serial number of the instrument", i.serial),
            ("Its calibration", _joined(i.certificate, f"valid until {i.due}" if i.due else None)),
            ("Air", _joined(_with(a.temperature, "°C"), _with(a.humidity, "% RH"), _with(a.pressure, "hPa"))),
            ("Range of temperature", _with(a.temperature_range, "K")),
            ("Temperature of the machine", _with(a.machine_temperature, "°C")),
            ("Agreed standard", self.standard),
            ("Remarks", self.remarks),
        ]
        yield from ((name, value) for name, value in pairs if value)

    def missing(self) -> tuple[str, ...]:
        """What a certificate needs and the block has not, as keys."""
        needed = {
            "operator": self.operator,
            "date": self.date,
            "place": self.place,
            "machine.model": self.machine.model,
            "machine.serial": self.machine.serial,
            "instrument.model": self.instrument.model,
            "instrument.serial": self.instrument.serial,
            "instrument.due": self.instrument.due,
            "ambient.temperature": self.ambient.temperature,
            "standard": self.standard,
            "tolerance": self.tolerance or None,
        }
        return tuple(name for name, value in needed.items() if value is None)


def _joined(*parts: str | None) -> str | None:
    return ", ".join(p for p in parts if p) or None


def _with(value: float | None, unit: str) -> str | None:
    return None if value is None else f"{value:g} {unit}"
