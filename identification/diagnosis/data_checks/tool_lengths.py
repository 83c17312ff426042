"""Tools that the rows show elsewhere than their columns say: a length that was never entered, or is another tool's.

Rows of one tool in the place of another lie beside them by one vector of the last frame, at all positions alike.
Parameters and effects would follow it: a fit would call its half noise, a diagnosis a target that was put on anew.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.survey import Survey
from errormodel.surveys.columns import MEASURED, TOOL_COLUMNS
from identification.diagnosis.data_checks.blunder import Points, groups, length, listed, sheet
from identification.diagnosis.data_checks.rows import FEWEST_OF_TARGET
from identification.diagnosis.data_checks.steps import GAIN, smooth_basis
from identification.observation.stated_tip import tip_is_stated

NOTED_MM = 0.05  # less is how well tools are known; what an effect or a prior may describe is said, and not refused
WRONG_MM = 1.0  # tools are measured to some hundredths, seats of reflectors made to tenths: more is a wrong entry
MOST_TOOLS = 12  # more are positions of a probe, and no set of tools
MOST_ROWS = 3000  # that are looked at, evenly
SURE = 10.0  # standard errors
OWN = 0.1  # of a displacement's length must not follow from positions, sides of arrival and what all tools share
ROUNDED = 1e-6  # of a column's length: what is left of it is round-off


@dataclass(frozen=True)
class OtherTool:
    """A tool whose rows lie elsewhere than those of another one let expect.

    Attributes
    ----------
    rows : numbers of its rows in the file.
    place, shown : its functional point (mm) as written, and where these rows show it if `beside` is right.
    beside : the functional point (mm) of the other rows.
    """

    file: str
    rows: tuple[int, ...]
    place: Array
    shown: Array
    beside: Array

    @property
    def size_mm(self) -> float:
        return float(np.linalg.norm(self.shown - self.place))

    @property
    def found(self) -> str:
        some = f"row {self.rows[0]}" if len(self.rows) == 1 else f"the {len(self.rows)} rows {listed(self.rows)}"
        return (
            f"{some} with the tool at {_point(self.place)} mm lie {length(1e3 * self.size_mm)} from where those with "
            f"the tool at {_point(self.beside)} let expect: if these are right, it is at {_point(self.shown)}"
        )


CURE = (
    "See which of both tools is entered wrongly, and write in each row the tool that was measured with; what nobody "
    "measured is an unknown of the fit with targets: {A: {near: [x, y, z]}} in survey.yaml"
)


def refuse_other_tools(chain: Chain, survey: Survey, largest_mm: float = WRONG_MM) -> None:
    """InputError where rows of one tool lie beside those of another by more than so much."""
    if (found := other_tool(chain, survey, largest_mm)) is not None:
        raise InputError(f"{found.file}, columns {' '.join(TOOL_COLUMNS)}", found.found, CURE)


def tool_notes(chain: Chain, survey: Survey, largest_mm: float = WRONG_MM) -> Iterator[str]:
    """A note on a tool that is probably entered wrongly by more than so much, where nothing refuses it."""
    if (found := other_tool(chain, survey, largest_mm)) is not None:
        yield f"{found.file}: {found.found}. {CURE}"


def other_tool(chain: Chain, survey: Survey, largest_mm: float = WRONG_MM) -> OtherTool | None:
    """The tool that lies furthest from where it is written, beside that of most rows; None where none lies so far.

    Least squares of the displacements of the tools in the last frame, beside a frame, a common displacement, a common
    turn of the last member (which displaces two tools against each other across the line between them, as the zero of
    a wrist does) and a model of second degree in the joints' positions and sides of arrival. A tool is named where all
    displacements together leave a quarter of that model's variance at most: errors of a machine are no displacement of
    one tool. Directions that the common ones make as well are not known, and count as right.
    """
    if not tip_is_stated(chain.machine):  # its places are known to so much, or not at all
        return None
    for rows in groups(survey):
        every = max(-(-len(rows) // MOST_ROWS), 1)
        if (found := _of_file(chain, survey, rows[::every], largest_mm)) is not None:
            return found
    return None


def _of_file(chain: Chain, survey: Survey, rows: Index, largest_mm: float) -> OtherTool | None:
    written = survey.tool[rows]
    if not len(rows) or (written == written[0]).all():
        return None
    places, target, counts = np.unique(np.round(written, 4), axis=0, return_inverse=True, return_counts=True)
    known = np.flatnonzero(counts >= FEWEST_OF_TARGET)
    if not 2 <= len(known) <= len(places) <= MOST_TOOLS:
        return None
    columns = sheet(chain, survey.table.iloc[rows])
    points = Points.of(chain, columns, survey.frame == "fixed")
    pose = points.pose()
    at = pose.apply(points.nominal)
    residual = survey.table[list(MEASURED)].to_numpy(dtype=np.float64)[rows] - at
    axes = [pose.apply(_moved(chain, columns, axis)) - at for axis in np.eye(3)]  # of the last frame, each (n, 3)
    first, *others = known[np.argsort(-counts[known], kind="stable")]
    # a turn of the frame, as that of one tool for all rows: beside two tools it would look like a displacement
    of_first = at - np.einsum("kni,nk->ni", axes, written - places[first])
    turns = [np.cross(axis, of_first - of_first.mean(axis=0)) for axis in np.eye(3)]
    few = np.setdiff1d(np.arange(len(places)), known)  # rows of which nothing is said
    tilts = [np.einsum("kni,nk->ni", axes, np.cross(turn, written - places[first])) for turn in np.eye(3)]
    common = [*turns, *axes, *(axis * (target == k)[:, None] for k in few for axis in axes)]
    own = [axis * (target == k)[:, None] for k in others for axis in axes]
    base = smooth_basis(chain.machine, survey, rows)
    # a turn of the last member may do a part of it, but not all
    sure = _shifts(base, [*common, *tilts], own, residual, largest_mm)
    if sure is None or (shifts := _shifts(base, common, own, residual, largest_mm)) is None:
        return None
    k = int(np.argmax(np.linalg.norm(shifts, axis=1)))
    place, table = places[others[k]], survey.table.iloc[rows]
    numbers = tuple(table["row"].to_numpy()[target == others[k]].tolist())
    return OtherTool(str(table["file"].iloc[0]), numbers, place, place + shifts[k], places[first])


def _shifts(base: Array, common: list[Array], own: list[Array], residual: Array, largest_mm: float) -> Array | None:
    """Displacements (tools, 3) in the last frame, mm; None where none is surely so large, or more is left beside them.

    Parameters
    ----------
    base : (n, k) orthonormal, of what may be in each coordinate.
    common : vectors (n, 3) that all rows may have; `own` those of the displacement of each tool along each axis.
    """

    def left(vectors: list[Array]) -> Array:
        stacked = np.array(vectors)
        return np.reshape(stacked - base @ (base.T @ stacked), (len(vectors), -1))

    kept = left(common)
    seen = np.linalg.norm(kept, axis=1) > ROUNDED * np.linalg.norm(np.reshape(common, (len(common), -1)), axis=1)
    basis = _orthonormal(kept[seen])
    design, [aim] = left(own), left([residual])
    norms = np.linalg.norm(design, axis=1)
    if (norms == 0).any():
        return None
    design, aim = design - design @ basis @ basis.T, aim - basis @ (basis.T @ aim)
    # of unit columns: a direction of which less is left is common to all tools, or has a part of the travels to itself
    u, scale, v = np.linalg.svd(design / norms[:, None], full_matrices=False)
    known = scale > OWN
    u, scale, v = u[:, known], scale[known], v[known]
    amounts = v @ aim
    rest = aim - v.T @ amounts
    free = len(aim) - 3 * base.shape[1] - basis.shape[1] - len(scale)
    if not len(scale) or free <= 0 or float(rest @ rest) * GAIN > float(aim @ aim):
        return None
    shifts = (u @ (amounts / scale) / norms).reshape(-1, 3)
    errors = np.sqrt(np.sum((u / scale) ** 2, axis=1) / norms**2 * float(rest @ rest) / free).reshape(-1, 3)
    sizes, least = np.linalg.norm(shifts, axis=1), SURE * np.linalg.norm(errors, axis=1)
    return shifts if (sizes >= np.maximum(largest_mm, least)).any() else None


def _moved(chain: Chain, columns: dict[str, Array], by: Array) -> Array:
    """Nominal points (n, 3) with the functional point displaced (mm) in the last frame."""
    tool = {name: columns[name] + step for name, step in zip(TOOL_COLUMNS, by, strict=True)}
    return Points.of(chain, columns | tool, fixed=True).nominal


def _orthonormal(columns: Array) -> Array:
    """Orthonormal basis (n, k) of what some columns (m, n) span."""
    u, s, _ = np.linalg.svd(columns.T, full_matrices=False)
    return np.asarray(u[:, s > ROUNDED * s.max(initial=0.0)])


def _point(place: Array) -> str:
    return f"({', '.join(f'{v:g}' for v in np.round(place, 2) + 0.0)})"
