"""Pure error: the scatter of repeated poses estimates the noise without the model, and tests it for lack of fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Index, Mask
from errormodel.surveys.observations import start_of
from identification.diagnosis.decisions.constants import LEAST_P_VALUE, MISFIT_RATIO
from identification.diagnosis.linear.row_residuals import vectors
from identification.estimation.result import Fit, Spread
from identification.observation.models import PositionView
from identification.observation.normal_equations import view_vector
from identification.observation.readings import ReadingView

SAME_LENGTH, SAME_ANGLE = 0.02, 2e-5  # mm, rad: commands as near as that are one pose; the model takes out the rest
LEAST = 10  # repeats, below which they say nothing


@dataclass(frozen=True)
class Repeats:
    """Visits to poses that were visited before, other poses in between.

    Attributes
    ----------
    poses, count : poses with more than one visit; visits beyond the first of each.
    sigma_um : standard uncertainty of one coordinate by their scatter.
    left_um : root mean square residual of the rows, for the degrees of freedom that the fit has left.
    ratio : variance of the fit's residuals over that of the repeats, in units of each row's uncertainty.
    p_value : chance of as much lack of fit by noise alone: F test, with degrees of freedom for the noise's tails.
    misfit : whether residuals are more than repeats explain.
    points : whether points were measured; else readings.
    observation : of which alone they are; empty for points, and for all rows together.
    """

    poses: int
    count: int
    sigma_um: float
    left_um: float
    ratio: float
    p_value: float
    misfit: bool
    points: bool = True
    observation: str = ""

    @property
    def text(self) -> str:
        """What they say, for a report."""
        words = (
            "the residuals are larger than that: the model lacks something"
            if self.misfit
            else "which is as much as the residuals hold"
        )
        what = "coordinate" if self.points else "reading"
        of = f" of {self.observation}" if self.observation else ""
        return (
            f"{self.poses} poses were visited again ({self.count} rows): one {what}{of} repeats to "
            f"{self.sigma_um:.2f} um, {words}"
        )


def repeats_of(fit: Fit) -> tuple[Repeats, ...]:
    """What repeated poses say of a fit: of its points, and of each observation, beside their own residuals.

    All rows together where none of these has `LEAST` repeats; none where there are fewer than that. Rows that stay at a
    pose are one visit, of which the first counts: readings in a row share most of what is noise. Times, temperatures
    and sides of arrival may differ between visits, so that the scatter is noise at most.
    """
    white, index, what = whitened(fit)
    pose = _alike(_poses(fit)[index], what)
    size = _of_what(vectors(fit)[index], what)
    order = np.argsort(index, kind="stable")
    visit = np.concatenate([[True], np.diff(pose[order]) != 0]) if len(order) else np.zeros(0, dtype=bool)
    first = np.zeros(len(index), dtype=bool)
    first[order[visit]] = True
    labels = ["", *dict.fromkeys(v.label for v in fit.problem.readings)]
    own = [
        _repeats(fit, white[of], size[of], pose[of], first[of], labels[k])
        for k in np.unique(what)
        for of in [what == k]
    ]
    if len(own) > 1 and not any(own):
        own = [_repeats(fit, white, size, pose, first, "")]
    return tuple(r for r in own if r is not None)


def _repeats(fit: Fit, white: Array, size: Array, pose: Index, visit: Mask, observation: str) -> Repeats | None:
    """What the rows of one kind say; `visit`: those with which a visit of a pose begins."""
    first = np.flatnonzero(visit)
    _, group, counts = np.unique(pose[first], return_inverse=True, return_counts=True)
    again = counts[group] > 1
    first, group = first[again], group[again]
    count, poses = int(again.sum() - (counts > 1).sum()), int((counts > 1).sum())
    if count < LEAST:
        return None
    within, dof = _within(white[first], group)
    scatter, measured = _within(1e3 * size[first], group)
    seen = np.isfinite(white)
    square, pure = float(np.nansum(white**2)), float(np.nansum(within**2))
    s = fit.solution
    every = max(sum(x.count for x in s.sums.values()), 1)
    dof_all = int(seen.sum()) * s.dof / every
    if dof <= 0 or dof_all <= dof or pure <= 0:
        return None
    from scipy.special import fdtrc

    ratio = (square / dof_all) / (pure / dof)
    # sums of squares of noise with heavy tails scatter more than Gaussian ones, as if there were fewer rows
    spread = white[seen] - white[seen].mean()
    tails = max(float(np.mean(spread**4) / np.mean(spread**2) ** 2) - 3.0, 0.0) / 2
    rest, m = dof_all - dof, int(np.isfinite(within).sum())
    freedom = rest / (1 + tails * rest / int(seen.sum())), dof / (1 + tails * dof / m)
    p_value = float(fdtrc(*freedom, (square - pure) / rest / (pure / dof)))
    misfit = ratio > MISFIT_RATIO and p_value < LEAST_P_VALUE
    sigma = float(np.sqrt(np.nansum(scatter**2) / max(measured, 1)))
    left = Spread.of(size).rms_um * float(np.sqrt(every / max(s.dof, 1)))
    points = not observation and bool(np.isfinite(fit.residuals).any())
    return Repeats(poses, count, sigma, left, float(ratio), p_value, misfit, points, observation)


def whitened(fit: Fit) -> tuple[Array, Index, Index]:
    """Residuals (m, 3) of points in units of their declared uncertainty (mm where none is), NaN where not measured.

    With the row of the survey that each belongs to, (m,). Where there are single readings, all are in units of the
    noise, a reading in the first column; the last (m,) is the number of its observation, 0 for a point.
    """
    s, zero, place = fit.solution, np.zeros(len(fit.chain.ids)), fit.problem.place()
    parts, index, what = [np.zeros((0, 3))], [np.zeros(0, dtype=np.intp)], [np.zeros(0, dtype=np.intp)]
    labels = list(dict.fromkeys(v.label for v in fit.problem.readings))
    for view in fit.problem.views:
        if not isinstance(view, PositionView | ReadingView):
            continue
        gap = np.hstack([view.whiten(p, g) for p, g in view.gaps(view_vector(view, place, s.values, zero))]).T
        own = np.where(view.components, gap, np.nan)
        if isinstance(view, ReadingView):
            own = np.hstack([own, np.full((len(own), 2), np.nan)])
        parts.append(own / s.sigma[view.kind] if labels else own)
        index.append(view.index)
        what.append(np.full(len(view), 1 + labels.index(view.label) if isinstance(view, ReadingView) else 0))
    return np.vstack(parts), np.concatenate(index), np.concatenate(what)


def _alike(pose: Index, what: Index) -> Index:
    """A number (m,) for each different pose and observation."""
    return pose if not what.any() else pose + (int(pose.max()) + 1) * what


def _of_what(residuals: Array, what: Index) -> Array:
    """Residuals of rows (m, 3 or 4) without those that are of another observation of the row."""
    if residuals.shape[1] > 3:
        return np.where(np.arange(4) == 3, np.where(what[:, None] > 0, residuals, np.nan),
                        np.where(what[:, None] == 0, residuals, np.nan))  # fmt: skip
    return residuals


def _poses(fit: Fit) -> Index:
    """A number for each different command (joints and tool) of the survey's rows."""
    joints = fit.chain.machine.joints
    steps = [SAME_LENGTH if j.type == "prismatic" else SAME_ANGLE for j in joints]
    commands = np.hstack([fit.survey.commands([j.name for j in joints]) / steps, fit.survey.tool / SAME_LENGTH])
    if any(v.observation.poses > 1 for v in fit.problem.readings):
        start = start_of(fit.survey.table, fit.chain.machine)
        commands = np.hstack([commands, start[[j.name for j in joints]].to_numpy(dtype=np.float64) / steps])
    whole = np.rint(commands)
    varied = whole[:, (whole != whole[:1]).any(axis=0)]
    return np.asarray(np.unique(varied, axis=0, return_inverse=True)[1]).reshape(-1)


def _within(values: Array, group: Index) -> tuple[Array, int]:
    """Deviations (m, k) from the mean of each group, component by component, and their degrees of freedom."""
    _, group = np.unique(group, return_inverse=True)
    size = int(group.max()) + 1
    out, dof = np.empty_like(values), 0
    for k in range(values.shape[1]):
        seen = np.isfinite(values[:, k])
        count = np.bincount(group, seen, size)
        mean = np.bincount(group, np.where(seen, values[:, k], 0.0), size) / np.maximum(count, 1)
        out[:, k] = np.where(count[group] > 1, values[:, k] - mean[group], np.nan)
        dof += int((count[count > 1] - 1).sum())
    return out, dof
