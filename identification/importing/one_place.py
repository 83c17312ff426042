"""Readings at one place (an R-test on one ball): what joins prove by distances, a linear fit has to prove here.

All commands take the functional point to one place, so that every order, sign and hand of the points fits the nominal
machine alike. Errors that the machine declares make a pattern over the poses; the readings are fitted to it (linear
least squares) as they stand, shifted by rows, and with columns turned or exchanged. All signs turned at once make the
pattern of all errors turned, and can never be known.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.survey import Survey
from errormodel.surveys.columns import MEASURED
from identification.diagnosis.data_checks.blunder import Points
from identification.importing.exchanged_rows import places_changed
from identification.observation.assembly import build
from identification.observation.models import PositionView

FEWEST = 8  # rows, to fit anything
BESIDE = 2.0  # readings a determined group of parameters: fewer let any order fit; by judgement
CLEAR = 3.0  # times the residual as they stand: what fits so much worse is excluded; so much better, the truth
MOST_SHIFTED = 10  # rows
RANK = 1e-7  # of the largest singular value, columns of equal norm
ROUNDS = 4  # of a fit without rows far off
FAR = 6.0  # times the distance of four in five rows
CURE = "Give each reading with the command at which it was read, or names of points on both sides"


@dataclass(frozen=True)
class OnePlace:
    """Residuals (um, per degree of freedom) of a linear fit: as they stand, of the best shift, of other columns.

    NaN where there are too few readings for a fit.
    """

    left_um: float
    shifted_um: float
    turned_um: float

    @property
    def text(self) -> str:
        """What is known and what is not, as sentences."""
        if np.isfinite(self.left_um):
            said = f"a fit of the declared errors leaves {self.left_um:.3g} um as they stand"
            said += _beside("shifted by rows", self.shifted_um, self.left_um)
            said += _beside("with one column's sign turned or two exchanged", self.turned_um, self.left_um)
        else:
            said = "too few for a fit of the declared errors to say more"
        return (
            f"all commands take the functional point to one place: the points prove neither the order of the rows nor "
            f"signs or hand; {said}. Whether all signs are turned cannot be known: they are read as the place of the "
            "functional point (the tool) in the measuring frame, positive where it stands too far along an axis. If "
            "they are of the workpiece beside the tool, give mx=-.., my=-.., mz=-.. in --columns"
        )


def _beside(words: str, other: float, own: float) -> str:
    doubt = "" if other > CLEAR * own else ", which excludes nothing"
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
    found = [_proved(view, rows, survey, problem.unknowns) for rows in own for view in views if _holds(view, rows)]
    return max(found, key=lambda f: f.left_um if np.isfinite(f.left_um) else np.inf) if found else None


def _holds(view: PositionView, rows: Index) -> bool:
    return bool(np.isin(rows, view.index).all())


def _proved(whole: PositionView, rows: Index, survey: Survey, unknowns: tuple[str, ...]) -> OnePlace:
    view = whole.part(np.flatnonzero(np.isin(whole.index, rows)))
    design = _design(view, unknowns)
    nominal = view.pose.invert(view.measured) - np.hstack([gap for _, gap in view.gaps(view.at_zero)]).T
    seen = view.measured - view.measured.mean(axis=0)

    def gap(points: Array, first: int = 0) -> Array:
        return points @ view.pose.rotation - nominal[first : first + len(points)]

    n = len(rows)
    left, rank = _left(design, gap(seen))
    if n < FEWEST or 3 * n < BESIDE * rank:
        return OnePlace(np.nan, np.nan, np.nan)
    file = str(survey.table["file"].iloc[rows[0]])
    shifts: list[tuple[float, int]] = []
    for k in range(1, min(MOST_SHIFTED, n // 4) + 1):
        shifts.append((_left(design[: n - k], gap(seen[k:]))[0], k))
        shifts.append((_left(design[k:], gap(seen[: n - k], k))[0], -k))
    shifted, rows_late = min(shifts)
    turned, columns = min((_left(design, gap(points))[0], words) for words, points in _columns(seen))
    best = min(shifted, turned)
    if best * CLEAR < left:
        by = f"a fit of the declared errors leaves {1e3 * left:.3g} um as they stand, {1e3 * best:.3g} um"
        if shifted <= turned:
            late = f"{abs(rows_late)} row{'s' * (abs(rows_late) > 1)} too {'late' if rows_late > 0 else 'early'}"
            raise InputError(file, f"readings at one place that stand {late}: {by} with it put right", CURE)
        found = f"readings at one place of other columns than stated: {by} with {columns}"
        raise InputError(file, found, "If that is how they were measured, turn or exchange these columns in --columns")
    at = Points(_predicted(design, gap(seen)) + nominal, gap(seen) + nominal, fixed=True)
    if text := places_changed(at, [int(k) for k in survey.table["row"].iloc[rows]], np.inf):
        raise InputError(file, f"{text}, in a fit of the declared errors", CURE)
    return OnePlace(1e3 * left, 1e3 * shifted, 1e3 * turned)


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
