"""Base class of observation models: one reading (a length or an angle) as a function of the tool's pose.

A reading depends on the actual pose of the functional point at one command or two, and on quantities of the set-up (a
station, a dead path, a zero) that are known or estimated with the machine's parameters. mm and rad.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from errormodel.arrays import Array
from errormodel.instruments.base import Pair
from errormodel.yamlfile import FileModel, Number


class StepError(ValueError):
    """Readings that change by a step for good, such as behind a lost beam: their order may be right all the same."""


class LineError(ValueError):
    """Readings at points on a straight line, which do not show where their instrument stands: displacements along it.

    `start`: values of the unknown quantities with the instrument on that line, from which readings would be those.
    """

    def __init__(self, text: str, start: dict[str, float]) -> None:
        super().__init__(text)
        self.start = start


Reading = Literal["length", "angle"]
Unit = Literal["mm", "rad", "1"]

NumberOrUnknown = Annotated[Number | Literal["unknown", "per-run"], Field(union_mode="smart")]
"""A known number, one unknown for all rows of the observation, or one unknown a run."""

if TYPE_CHECKING:
    import casadi as ca


class Tip(NamedTuple):
    """Pose of the tool at a command, as CasADi symbols in the axes of the machine's reference.

    Attributes
    ----------
    point : (3, 1) position of the functional point, mm.
    rotation : (3, 3) orientation of the last frame.
    turned : (3, 1) small rotation of the last frame from its nominal orientation, rad.
    """

    point: ca.SX
    rotation: ca.SX
    turned: ca.SX


class Quantity(NamedTuple):
    """A number of the set-up that the reading depends on.

    Attributes
    ----------
    name : such as ``x`` or ``dead_path``; unknowns are called ``observation[<name of the observation>].<name>``.
    unit : mm, rad or 1.
    value : None where it is estimated.
    per_run : whether each run has a value of its own.
    """

    name: str
    unit: Unit
    value: float | None
    per_run: bool = False


class Observation(FileModel, ABC):
    """Base class of observation models; a subclass in a file of this package is found by its ``type``.

    A subclass declares ``type: Literal["its-name"]`` and, as pydantic fields, the keys of an entry of ``observations:``
    in a survey.yaml.

    Attributes
    ----------
    reading : column that holds what was read: ``length`` (mm) or ``angle`` (rad).
    poses : number of commands that a reading depends on; with two, the first is in the columns ``from_<joint>``.
    anywhere : whether the set-up allows readings at any pose; else the poses are bound to a circle, a line, a face.
    point : names of three quantities that are a point of the measuring frame where they are known; empty: none.
    trace : kind of raw trace that holds its readings, such as ``circle``; empty: none.
    along_line : whether it reads, along the way of a joint, displacements v_x .. across a line u_x .. with a `slope`,
        or angles about u_x ..: quantities of these names.
    example : keys of an example, besides ``type``.
    source : where the model is from.
    sees : what it shows and what not, in a sentence.
    sign : what makes its readings positive, as the end of a sentence: "write it so that ...".
    """

    reading: ClassVar[Reading] = "length"
    poses: ClassVar[int] = 1
    anywhere: ClassVar[bool] = True
    point: ClassVar[tuple[str, ...]] = ()
    trace: ClassVar[str] = ""
    along_line: ClassVar[bool] = False
    example: ClassVar[dict[str, Any]] = {}
    source: ClassVar[str] = ""
    sees: ClassVar[str] = ""
    sign: ClassVar[str] = ""

    type: str
    sigma: Pair | None = Field(
        None,
        description="[a, b] of the standard uncertainty hypot(a, b L) of a reading in mm and mm/mm (rad and 1/mm of an "
        "angle; k = 1), such as [0.2e-3, 0.3e-6]; left out: estimated from the residuals",
    )

    @abstractmethod
    def quantities(self) -> tuple[Quantity, ...]:
        """Numbers of the set-up, known and unknown, always in the same order."""

    @staticmethod
    @abstractmethod
    def value(tips: Sequence[Tip], of: Mapping[str, Any]) -> ca.SX:
        """The reading, mm or rad, from the poses and the quantities by name, as a CasADi expression."""

    def start(self, points: Sequence[Array], readings: Array, known: Mapping[str, float]) -> dict[str, float]:
        """Values of the unknown quantities from which their estimation starts; 0 where none is given.

        Parameters
        ----------
        points : (n, 3) nominal positions in the machine's reference, mm; one array a pose.
        readings : (n,) mm or rad.
        known : known quantities by name, points in the machine's reference.

        Raises
        ------
        ValueError
            The readings do not determine them; the text says what to write.
        """
        return {}

    def assumed(self, points: Sequence[Array], known: Mapping[str, float]) -> dict[str, float]:
        """Values of unknown quantities for a simulation that states none; 0 where none is given.

        Parameters
        ----------
        points : (n, 3) nominal positions in the machine's reference, mm; one array a pose.
        known : the other quantities by name.

        Raises
        ------
        ValueError
            One must be stated; the text says how.
        """
        return {}

    def uncertainty(self, readings: Array) -> Array | None:
        """Standard uncertainty (n,) of readings as declared (k = 1); None where it is to be estimated."""
        if self.sigma is None:
            return None
        a, b = self.sigma
        return np.asarray(np.hypot(a, b * readings))

    @classmethod
    def traced(cls, reach: float) -> dict[str, Any]:
        """Keys of the entry for a raw trace of deviations from a length (mm)."""
        return {}

    @classmethod
    def listed(cls) -> dict[str, Any]:
        """Keys of the entry for a raw list of readings of which no more is said than its type."""
        return {}

    @property
    def free(self) -> tuple[Quantity, ...]:
        """The unknown quantities."""
        return tuple(q for q in self.quantities() if q.value is None)

    @property
    def by_run(self) -> bool:
        """Whether an unknown quantity has a value a run."""
        return any(q.per_run for q in self.free)


def quantity(name: str, unit: Unit, value: float | str) -> Quantity:
    """A quantity from the number, ``unknown`` or ``per-run`` that a file has for it."""
    return Quantity(name, unit, None, value == "per-run") if isinstance(value, str) else Quantity(name, unit, value)


def coordinates(value: Sequence[float] | str) -> tuple[Quantity, ...]:
    """Quantities x, y, z of a point, mm, from the three numbers, ``unknown`` or ``per-run`` that a file has for it."""
    each: Sequence[float | str] = [value] * 3 if isinstance(value, str) else value
    return tuple(quantity(name, "mm", v) for name, v in zip("xyz", each, strict=True))
