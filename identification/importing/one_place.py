"""Readings at one place (an R-test on one ball): what joins prove by distances, a linear fit has to prove here.

All commands take the functional point to one place, so that every order, sign and hand of the points fits the nominal
machine alike. Errors that the machine declares make a pattern over the poses; the readings are fitted to it (linear
least squares) as they stand, shifted by rows, with columns turned or exchanged, and along other axes. All signs turned
at once make the pattern of all errors turned, and can never be known.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.nominal import Nominal
from errormodel.simulation import outward
from errormodel.survey import Survey
from errormodel.surveys.columns import MEASURED
from errormodel.surveys.file import Axes
from identification.diagnosis.data_checks.blunder import Points
from identification.importing.exchanged_rows import places_changed
from identification.observation.assembly import build
from identification.observation.models import PositionView

FEWEST = 8  # rows, to fit anything
BESIDE = 2.0  # readings a determined group of parameters: fewer let any order fit; by judgement
CLEAR = 3.0  # times the residual as they stand: what fits so much worse is excluded; so much better, the truth
BETTER = 1.2  # times the residual as they stand: what fits so much better is said
MOST_SHIFTED = 10  # rows
RANK = 1e-3  # of the largest singular value, columns of equal norm: beyond it errors were a thousand times what is seen
ROUNDS = 4  # of a fit without rows far off
FAR = 6.0  # times the distance of four in five rows
CURE = "Give each reading with the command at which it was read, or names of points on both sides"


AXES: dict[Axes, str] = {
    "reference": "the axes of the machine's reference (a table at the beginning of the chain turns them)",
    "tool": "the axes of the tool (a nest in the spindle)",
}
OTHER: dict[Axes, Axes] = {"reference": "tool", "tool": "reference"}


@dataclass(frozen=True)
class OnePlace:
    """Residuals (um, per degree of freedom) of a linear fit: as they stand, of the best shift, columns, other axes.

    NaN where there are too few readings for a fit.
    """

    left_um: float
    shifted_um: float
    turned_um: float
    turned: str = ""  # these columns
    other_axes_um: float = np.inf  # where the tool turns against the reference
    axes: Axes = "reference"  # as they stand

    @property
    def better(self) -> list[str]:
        """What fits clearly better than the readings as they stand."""
        tried = (
            (f"columns turned or exchanged: {self.turned}", self.turned_um), ("rows shifted", self.shifted_um),
            (f"along {AXES[OTHER[self.axes]]}: --axes {OTHER[self.axes]}", self.other_axes_um),
        )  # fmt: skip
        return [f"{words} ({um:.3g} um)" for words, um in tried if BETTER * um < self.left_um]

    @property
    def note(self) -> str:
        """What every command repeats."""
        text = (
            "all commands take the functional point to one place: order, signs, hand and axes of its readings are not "
            f"proved; they are read along {AXES[self.axes]}, positive where the tool stands too far"
        )
        if not self.better:
            return text
        return f"{text}. FITS BETTER than as they stand ({self.left_um:.3g} um): {'; '.join(self.better)}"

    @property
    def text(self) -> str:
        """What is known and what is not, as sentences."""
        if np.isfinite(self.left_um):
            said = f"a fit of the declared errors leaves {self.left_um:.3g} um as they stand"
            said += _beside("shifted by rows", self.shifted_um, self.left_um)
            said += _beside(f"with columns turned or exchanged ({self.turned})", self.turned_um, self.left_um)
            if np.isfinite(self.other_axes_um):
                said += _beside(f"along {AXES[OTHER[self.axes]]}", self.other_axes_um, self.left_um)
        else:
            said = "too few for a fit of the declared errors to say more"
        return (
            "all commands take the functional point to one place: the points prove neither the order of the rows nor "
            f"signs, hand or axes; {said}. Whether all signs are turned cannot be known: they are read as the place of "
            "the functional point (the tool), positive where it stands too far along an axis, along "
            f"{AXES[self.axes]}. If they are of the workpiece beside the tool, give mx=-.., my=-.., mz=-.. in "
            f"--columns; if they are along {AXES[OTHER[self.axes]]}, --axes {OTHER[self.axes]}"
        )


def _beside(words: str, other: float, own: float) -> str:
    doubt = "" if other > CLEAR * own else ", which fits better" if BETTER * other < own else ", which excludes nothing"
    return f", {words} {other:.3g} um at least{doubt}"


def at_one_place(part: Points) -> bool:
    """Whether nominal points lie within what errors of a machine make."""
    return len(part) > 1 and part.spread < part.largest


def prove_one_place(chain: Chain, survey: Survey, parts: list[tuple[Index, Points]]) -> OnePlace | None:
    """What a fit says of files whose commands are all at one place; None where there are none, or nothing moves.

    Parameters
    ----------
    parts : rows of the survey that share a file and a frame, with their points.

    Raises
    ------
    InputError
        Another order of the rows, sign or exchange of columns fits clearly better.
    """
    joints = survey.table[[j.name for j in chain.machine.joints]].to_numpy(dtype=np.float64)
    own = [rows for rows, part in parts if at_one_place(part) and np.ptp(joints[rows], axis=0).any()]
    if not own:
        return None
    problem = build(chain, survey)
    views = [view for view in problem.views if isinstance(view, PositionView)]
    found = [
        _proved(chain, view, rows, survey, problem.unknowns) for rows in own for view in views if _holds(view, rows)
    ]
    return max(found, key=lambda f: f.left_um if np.isfinite(f.left_um) else np.inf) if found else None


def _holds(view: PositionView, rows: Index) -> bool:
    return bool(np.isin(rows, view.index).all())


def _proved(chain: Chain, whole: PositionView, rows: Index, survey: Survey, unknowns: tuple[str, ...]) -> OnePlace:
    axes: Axes = "tool" if str(survey.table["file"].iloc[rows[0]]) in survey.of_tool else "reference"
    view = whole.part(np.flatnonzero(np.isin(whole.index, rows)))
    design = _design(view, unknowns)
    nominal = view.pose.invert(view.measured) - np.hstack([gap for _, gap in view.gaps(view.at_zero)]).T
    nominal -= nominal.mean(axis=0)
    seen = view.measured - view.measured.mean(axis=0)

    def gap(points: Array, first: int = 0) -> Array:
        return points @ view.pose.rotation - nominal[first : first + len(points)]

    n = len(rows)
    left, rank = _left(design, gap(seen))
    if n < FEWEST or 3 * n < BESIDE * rank:
        return OnePlace(np.nan, np.nan, np.nan, axes=axes)
    file = str(survey.table["file"].iloc[rows[0]])
    shifts: list[tuple[float, int]] = []
    for k in range(1, min(MOST_SHIFTED, n // 4) + 1):
        shifts.append((_left(design[: n - k], gap(seen[k:]))[0], k))
        shifts.append((_left(design[k:], gap(seen[: n - k], k))[0], -k))
    shifted, rows_late = min(shifts)
    turned, columns = min((_left(design, gap(points))[0], words) for words, points in _columns(seen))
    other = _left(design, gap(_along_other_axes(chain, survey, rows, view.measured, axes)))[0]
    best = min(shifted, turned, other)
    if best * CLEAR < left:
        by = f"a fit of the declared errors leaves {1e3 * left:.3g} um as they stand, {1e3 * best:.3g} um"
        if other == best:
            found = f"readings at one place along {AXES[axes]}: {by} along {AXES[OTHER[axes]]}"
            raise InputError(file, found, f"If that is how they were measured, say --axes {OTHER[axes]}")
        if shifted == best:
            late = f"{abs(rows_late)} row{'s' * (abs(rows_late) > 1)} too {'late' if rows_late > 0 else 'early'}"
            raise InputError(file, f"readings at one place that stand {late}: {by} with it put right", CURE)
        found = f"readings at one place of other columns than stated: {by} with {columns}"
        raise InputError(file, found, "If that is how they were measured, turn or exchange these columns in --columns")
    at = Points(_predicted(design, gap(seen)) + nominal, gap(seen) + nominal, fixed=True)
    if text := places_changed(at, [int(k) for k in survey.table["row"].iloc[rows]], np.inf):
        raise InputError(file, f"{text}, in a fit of the declared errors", CURE)
    return OnePlace(1e3 * left, 1e3 * shifted, 1e3 * turned, columns, 1e3 * other, axes)


def _along_other_axes(chain: Chain, survey: Survey, rows: Index, measured: Array, axes: Axes) -> Array:
    """Readings (n, 3) mm as they would be, about their mean, had they been along the other axes than is stated."""
    turns, _ = Nominal(chain, outward(survey.table.iloc[rows], chain.machine)).flanges()
    other = np.einsum("nij,nj->ni" if axes == "reference" else "nji,nj->ni", turns, measured)
    return np.asarray(other - other.mean(axis=0))


def _design(view: PositionView, unknowns: tuple[str, ...]) -> Array:
    """Displacements (n, 3, parameters) by each unknown, columns of equal norm."""
    kernel = view.design(False)
    blocks = [kernel.expand(f) for _, f in kernel.blocks(view.rows, view.at_zero)]
    out = np.hstack(blocks).reshape(len(view.ids), 3, len(view)).transpose(2, 1, 0)
    out = out[:, :, [k for k, column in enumerate(view.columns) if column in unknowns]]
    size = np.sqrt(np.sum(out**2, axis=(0, 1)))
    return np.asarray(out[:, :, size > 0] / size[size > 0])


def _left(design: Array, gap: Array) -> tuple[float, int]:
    """Root mean square residual of a coordinate (mm, per degree of freedom) of a linear fit, and its rank."""
    u, s, _ = np.linalg.svd(design.reshape(-1, design.shape[2]), full_matrices=False)
    u, y = u[:, s > RANK * s[0]], gap.ravel()
    rest = float(y @ y - np.sum((u.T @ y) ** 2))
    return float(np.sqrt(max(rest, 0.0) / max(len(y) - u.shape[1], 1))), u.shape[1]


def _predicted(design: Array, gap: Array) -> Array:
    """What a fit without the rows far off it predicts of all rows, (n, 3) mm."""
    kept = np.ones(len(gap), dtype=bool)
    fit = np.zeros_like(gap)
    for _ in range(ROUNDS):
        x = np.linalg.lstsq(design[kept].reshape(-1, design.shape[2]), gap[kept].ravel(), rcond=RANK)[0]
        fit = design @ x
        distance = np.linalg.norm(gap - fit, axis=1)
        kept = distance <= FAR * float(np.quantile(distance, 0.8))
    return np.asarray(fit)


def _columns(seen: Array) -> list[tuple[str, Array]]:
    """Readings (n, 3) with the sign of one column turned, and with two exchanged, by what to say of them."""
    out = [(f"{name}=-{name}", seen * np.where(np.arange(3) == k, -1.0, 1.0)) for k, name in enumerate(MEASURED)]
    for i, j in (*pairwise(range(3)), (2, 0)):
        order = np.arange(3)
        order[[i, j]] = j, i
        out.append((f"{MEASURED[i]}={MEASURED[j]},{MEASURED[j]}={MEASURED[i]}", seen[:, order]))
    return out
