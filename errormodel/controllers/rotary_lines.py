"""Rotary axes as they lie, for the kinematic descriptions of controllers, and how uncertain what is made of them is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.text import Comment
from errormodel.machine import Vector


@dataclass(frozen=True)
class Line:
    """A rotary axis as it lies: actual minus nominal, all axes at zero, in the reference's axes.

    Attributes
    ----------
    shift, tilt : across the axis, mm and rad; `along` : its nominal direction.
    side : ``table`` if it carries the workpiece, ``head`` if it carries the tool, empty between linear axes.
    at : the point of the axis that is shifted by `shift`, from the tool's tip, mm: a tilt shifts others otherwise.
    spread : changes of shift and tilt (6) by each of some independent causes, of one standard uncertainty. All lines of
        a machine have the same causes, so that differences of lines are known as well as they are; empty: not known.
    confounded : parameters that the survey does not tell from it, and that may move it by more than that.
    """

    axis: str
    shift: Vector
    tilt: Vector
    along: Vector
    side: str
    at: Vector = (0.0, 0.0, 0.0)
    spread: tuple[tuple[float, ...], ...] = ()
    confounded: tuple[str, ...] = ()

    @property
    def slope(self) -> Vector:
        """Further shift per mm along the axis, by its tilt."""
        (a, b, c), (x, y, z) = self.tilt, self.along
        return (b * z - c * y, c * x - a * z, a * y - b * x)

    @property
    def std(self) -> Array:
        """Standard uncertainties (6) of shift and tilt, mm and rad; zero where they are not known."""
        return np.asarray(np.linalg.norm(np.reshape(self.spread, (-1, 6)), axis=0), np.float64)


def uncertainties(made: Callable[[Sequence[Line]], Mapping[str, Array]], lines: Sequence[Line]) -> dict[str, Array]:
    """Standard uncertainties of values that `made` makes of shifts and tilts, in which they must be linear.

    It makes them of each cause's change alone; empty where the changes are not known.
    """
    causes = zip(*(x.spread for x in lines), strict=True)
    parts = [
        made([replace(x, shift=by[:3], tilt=by[3:]) for x, by in zip(lines, change, strict=True)]) for change in causes
    ]
    return {k: np.linalg.norm([p[k] for p in parts], axis=0) for k in (parts[0] if parts else ())}


def remark(std: Sequence[float] | Array | None, digits: int, comment: Comment | None) -> str:
    """The comment, with a space before it, that follows values of so many digits; empty where nothing is known."""
    if std is None or comment is None:
        return ""
    numbers = " ".join(f"{v:.{digits + 1}f}" if v > 0 else "0" for v in std)
    return f" {comment.line(f'standard uncertainty {numbers}')}"
