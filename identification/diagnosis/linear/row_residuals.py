"""Sizes of what a fit leaves in rows of any kind: three coordinates of a point, a length, an angle.

A row's size is the length of its residual vector: the distance of a measured point, or the gap of a length. Angles have
no length; they count where nothing else was read, at a metre's distance, where a microradian is a micrometre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array
from identification.estimation.result import Fit, Spread
from identification.observation.readings import ReadingView

METRE = 1e3  # mm: the distance at which angles count as lengths


def noise_mm(fit: Fit) -> float:
    """Standard uncertainty of one coordinate; without points, of one length, or of one angle at a metre; mm.

    Of several observations the root mean square over their readings.
    """
    if any(v.kind == "position" for v in fit.problem.views):
        return fit.sigma_mm
    s, arm = fit.solution, _arm(fit)
    ratio = max(s.chi2 / max(s.dof, 1), 0.0)  # of variances: found over declared
    parts = [
        np.square(s.sigma[v.kind] / v.whitener) * (ratio if v.kind in s.declared else 1.0)
        for v in fit.problem.readings
        if not v.turns or arm
    ]
    return (arm or 1.0) * float(np.sqrt(np.mean(np.concatenate(parts)))) if parts else float("nan")


def vectors(fit: Fit, heldout: bool = False) -> Array:
    """Residuals (rows, 3) of points, mm, NaN where not measured; (rows, 4) with the gap of a single reading last."""
    points = fit.heldout_residuals if heldout else fit.residuals
    if fit.readings is None:
        return points
    gaps = (fit.readings.heldout if heldout else fit.readings.fitted).copy()
    arm = _arm(fit)
    for view in fit.problem.readings:
        if view.turns:
            gaps[view.index] *= arm or np.nan
    return np.column_stack([points, gaps])


def spread(fit: Fit, heldout: bool = False) -> Spread:
    """Statistics of the sizes of all rows, um."""
    if fit.readings is None:
        return fit.heldout if heldout else fit.fitted
    return Spread.of(vectors(fit, heldout))


@dataclass(frozen=True)
class ReadingSizes:
    """Sizes of what a diagnosis leaves of one observation, in `unit` (um or urad).

    Attributes
    ----------
    noise : standard uncertainty of a reading, from the residuals, or as declared.
    before, after : root mean square residual of the machine as given, and with the findings.
    heldout_before, heldout_after : the same of blocks of rows that were left out of the fit.
    n : number of readings.
    """

    observation: str
    type: str
    unit: str
    noise: float
    before: float
    after: float
    heldout_before: float
    heldout_after: float
    n: int


def by_observation(before: Fit, after: Fit) -> tuple[ReadingSizes, ...]:
    """Sizes of each observation in two fits of the same rows."""
    if before.readings is None or after.readings is None:
        return ()
    whiteners: dict[str, list[Array]] = {}
    for view in after.problem.readings:
        whiteners.setdefault(view.label, []).append(view.whitener)
    first = {e.observation: e for e in before.readings.errors(before.survey)}
    out = []
    for e in after.readings.errors(after.survey):
        one = first.get(e.observation, e)
        level = after.solution.sigma[e.type] * float(np.sqrt(np.mean(np.concatenate(whiteners[e.observation]) ** -2.0)))
        noise = (1e6 if e.unit == "urad" else 1e3) * level
        out.append(
            ReadingSizes(e.observation, e.type, e.unit, noise, one.fitted, e.fitted, one.heldout, e.heldout, e.n)
        )
    return tuple(out)


def _arm(fit: Fit) -> float:
    """The distance (mm) at which angles count; 0 where something was read that is a length."""
    lengths = any(not v.turns for v in fit.problem.readings) or any(v.kind == "position" for v in fit.problem.views)
    return 0.0 if lengths else METRE


def counts(view: ReadingView, fit: Fit) -> float:
    """Factor from a view's readings to mm in sizes; 0 where they do not count."""
    return _arm(fit) if view.turns else 1.0
