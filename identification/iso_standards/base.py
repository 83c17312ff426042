"""What a standard is, and what its evaluation returns: quantities, tables and charts.

Lengths in mm, angles in rad; expanded uncertainties with k = 2.
"""

from __future__ import annotations

from abc import ABC
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from errormodel.arrays import Array
from errormodel.exceptions import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from errormodel.machine import Machine
    from errormodel.survey import Survey
    from identification.iso_standards.fitted import FittedMachine

COVERAGE_FACTOR = 2.0  # of the expanded uncertainties, as ISO 230 states them


@dataclass(frozen=True)
class Quantity:
    """One figure of a standard.

    Attributes
    ----------
    symbol : as the standard writes it, such as ``A`` or ``EC(0X)Y``.
    of : the axis, pair of axes, line or diagonal that it is of; may be empty.
    words : what it is.
    value : in `unit`; a range is positive, a deviation is actual minus nominal; NaN where it is not determined.
    unit : mm, rad, or another internal unit.
    expanded : expanded uncertainty (k = 2) in `unit`; None where it is not known.
    basis : where the uncertainty comes from, or why there is none; of what is not determined, why.
    length : mm, where a limit may depend on one.
    """

    symbol: str
    of: str
    words: str
    value: float
    unit: str
    expanded: float | None = None
    basis: str = ""
    length: float | None = None

    @property
    def name(self) -> str:
        """Name in tolerances and tables: ``X.A``."""
        return f"{self.of}.{self.symbol}" if self.of else self.symbol

    def as_json(self) -> dict[str, Any]:
        more = {} if self.length is None else {"length": self.length}
        return {
            "name": self.name, "symbol": self.symbol, "of": self.of, "words": self.words, "value": self.value,
            "unit": self.unit, "expanded_uncertainty": self.expanded, "k": COVERAGE_FACTOR, "basis": self.basis, **more,
        }  # fmt: skip


class Sheet(NamedTuple):
    """A table: the first column names the row, the others are figures or words."""

    name: str
    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    @property
    def numbers(self) -> set[int]:
        """Columns behind the first that hold figures only, which are set to the right."""
        return {k for k in range(1, len(self.head)) if all(_is_number(row[k]) for row in self.rows)}


def _is_number(cell: str) -> bool:
    try:
        float(cell or "0")
    except ValueError:
        return False
    return True


class Chart(NamedTuple):
    """A chart, drawn when it is wanted."""

    name: str
    caption: str
    alt: str
    draw: Callable[[], Figure]


@dataclass(frozen=True)
class Evaluation:
    """What a standard says of a survey or of a fitted model.

    Attributes
    ----------
    title : number and edition of the standard, and what it is about.
    source : what was evaluated, in words.
    data : the values behind tables and charts, for JSON.
    """

    number: str
    title: str
    source: str
    quantities: tuple[Quantity, ...]
    sheets: tuple[Sheet, ...] = ()
    charts: tuple[Chart, ...] = ()
    notes: tuple[str, ...] = ()
    data: dict[str, Any] = field(default_factory=dict)


class Standard(ABC):
    """Base class of standards; a subclass in a file of this package is found by its `number`.

    A subclass overrides `of_survey`, `of_fit`, or both.

    Attributes
    ----------
    number : word on the command line, such as ``230-2``.
    title : number with edition, and the subject.
    needs : what its survey has to hold, in words; empty where it takes fitted models only.
    """

    number: ClassVar[str]
    title: ClassVar[str]
    needs: ClassVar[str] = ""

    def of_survey(self, survey: Survey, machine: Machine) -> Evaluation:
        """Evaluate measured rows.

        Raises
        ------
        InputError
            The rows do not hold what the standard needs.
        """
        cure = f"Fit the survey (errormodel fit MACHINE SURVEY --out DIR) and write errormodel iso {self.number} DIR"
        raise InputError(str(survey.source), f"{self.title} is evaluated from a fitted model", cure)

    def of_fit(self, model: FittedMachine) -> Evaluation:
        """Evaluate a fitted model.

        Raises
        ------
        InputError
            The machine has not what the standard is about.
        """
        found = f"{self.title} is evaluated from measured rows, not from a fitted model"
        raise InputError(str(model.folder), found, f"Write errormodel iso {self.number} MACHINE SURVEY: {self.needs}")

    @classmethod
    def takes(cls) -> tuple[bool, bool]:
        """Whether it takes a survey, and whether a fitted model."""
        return cls.of_survey is not Standard.of_survey, cls.of_fit is not Standard.of_fit

    def lacking(self, survey: Survey, found: str) -> InputError:
        """Error for a survey that does not hold what the standard needs."""
        return InputError(str(survey.source), found, f"{self.title} needs {self.needs}")


def spread(values: Array) -> tuple[float, float | None]:
    """Estimate and expanded uncertainty (k = 2) of values (1 + draws,), of which the first is the estimate.

    The root mean square about the estimate, not about the mean: it contains the bias that a range of noisy values has.
    """
    first = float(values[0])
    if len(values) == 1:
        return first, None
    return first, COVERAGE_FACTOR * float(np.sqrt(np.mean(np.square(values[1:] - first))))


def text(value: float | None, unit: str, decimals: int = 2) -> str:
    """Value in its display unit, without the unit."""
    from identification.results.parameter_table import printed

    if value is None or not np.isfinite(value):
        return ""
    return rounded(printed(unit)[0] * value, decimals)


def rounded(value: float, decimals: int) -> str:
    """A number with so many decimals; what rounds to zero has no sign."""
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def shown_unit(unit: str) -> str:
    """Display unit of an internal unit."""
    from identification.results.parameter_table import printed

    return printed(unit)[1]
