"""Rows that were left out as outliers, and how far they lie from what the model with all findings predicts there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from errormodel.arrays import Mask
from errormodel.survey import Survey
from errormodel.surveys.columns import MEASURED, ORIENTATION
from identification.diagnosis.data_checks.blunder import listed
from identification.diagnosis.data_checks.outliers import far_turned
from identification.diagnosis.linear.row_residuals import spread, vectors
from identification.diagnosis.results.effect_size import Amount
from identification.diagnosis.results.findings import Finding, HeldOut
from identification.estimation.fit import placed
from identification.estimation.readings import reading_residuals
from identification.estimation.result import Fit, residuals_of
from identification.observation.assembly import build, frame_labels
from identification.observation.readings import ReadingView
from identification.results.terminal import counted


def outlier_finding(bad: Mask, measured: Survey, final: Fit) -> Finding:
    """The finding of the rows `bad` that a diagnosis left out.

    Parameters
    ----------
    bad : mask over the rows to fit.
    measured : these rows with all that was measured in them; in those of `final`, the fit with all findings, what was
        measured in `bad` is missing.
    """
    rows = [int(r) for r in measured.table["row"].to_numpy()[bad]]
    there = beside(final, measured)
    far = np.nansum(np.square(vectors(there)[bad]), axis=1)
    left = np.square(vectors(final, heldout=True)[~bad])
    left = np.nansum(left, axis=1)[np.isfinite(left).any(axis=1)]
    largest, one = f"{1e3 * float(np.sqrt(far.max())):.0f} um{far_turned(there, bad)}", len(rows) == 1
    others = f" (the others {usual:.0f} um, root mean square)" if (usual := spread(final).rms_um) else ""
    return Finding(
        effect="outliers",
        where="instrument",
        statement=(
            f"{counted(len(rows), 'row')} of {len(bad)} {'lies' if one else 'lie up to'} {largest} from what the "
            f"model with all findings predicts there{others} and {'was' if one else 'were'} left out: rows "
            f"{listed(rows)}."
        ),
        parameters=[Amount("rows", float(len(rows)), 0.0, "")],
        probability=0.99,
        p_value=0.0,
        heldout_rms_um=HeldOut(*(1e3 * float(np.sqrt(np.mean(x))) for x in (np.append(left, far), left))),
        next_measurement="measure these rows again",
        brief=f"{counted(len(rows), 'row')} left out as outliers ({'' if one else 'up to '}{largest} off)",
        size_um=1e3 * float(np.sqrt(np.mean(far))),
        rows=rows,
    )


def beside(fit: Fit, measured: Survey) -> Fit:
    """The estimates of a fit, with the residuals of what was measured in the same rows, in those it did not see too.

    Rows of measuring frames, and readings of set-ups, that it does not know have none.
    """
    known = fit.problem.frames
    if known:
        table, strange = measured.table.copy(), ~np.isin(frame_labels(measured).astype(str), [*known])
        table.loc[strange, [*MEASURED, *(c for c in ORIENTATION if c in table)]] = np.nan
        measured = replace(measured, table=table)
    problem = build(fit.chain, measured, mount=fit.problem.mount, poses=known or None)
    problem = placed(problem, {label: known.get(label, pose) for label, pose in problem.frames.items()})
    starts = {c: v for view in fit.problem.readings for c, v in view.starts.items()}
    views = []
    for view in problem.views:
        if not isinstance(view, ReadingView):
            views.append(view)
        elif starts.keys() >= view.starts.keys():
            views.append(view.started(starts))
    problem = replace(problem, views=tuple(views), unknowns=fit.problem.unknowns)
    at = problem.place(), fit.solution.values, np.zeros(len(fit.chain.ids)), len(measured)
    readings = fit.readings and replace(fit.readings, fitted=reading_residuals(problem.views, *at))
    return replace(fit, survey=measured, problem=problem, residuals=residuals_of(problem.views, *at), readings=readings)
