"""Whether measured orientations turn as the commands turn the last frame, and agree with what the points show.

The frame of the positions and one mount of the target are taken out: what is left of right orientations are the angular
errors of the machine.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from errormodel.arrays import MAD_STD, Array
from errormodel.exceptions import InputError
from errormodel.survey import Survey
from errormodel.surveys.columns import ORIENTATION
from identification.diagnosis.data_checks.blunder import listed
from identification.diagnosis.data_checks.orientation_readings import FAR, LEAVE_OUT, reading_notes, ways
from identification.diagnosis.data_checks.outliers import gross_orientations
from identification.estimation.result import Fit, turned_residuals
from identification.observation.assembly import Problem
from identification.observation.frames import mean_rotation
from identification.observation.models import OrientationView

FEWEST = 5  # rows with an orientation, for it to be judged
BETTER = 10.0  # times nearer, read in another way


def orientation_notes(survey: Survey, problem: Problem) -> tuple[str, ...]:
    """Look at all orientations of a survey, and say what may be wrong with them.

    Parameters
    ----------
    survey : whose rows `problem` is of.

    Raises
    ------
    InputError
        They do not follow the commands, or contradict the points: with what fits instead, if anything does.
    """
    seen = [v for v in problem.views if isinstance(v, OrientationView)]
    for view in seen:
        if len(view.index) >= FEWEST and not len(view.pose.undetermined):
            _refuse_foreign(survey, view)
    return reading_notes(survey, problem) if seen else ()


def gross_notes(fit: Fit) -> Iterator[str]:
    """A note on orientations far outside what the others show, which a fit that is not robust takes as they are."""
    gross = gross_orientations(fit)
    if not gross.any():
        return
    gaps = turned_residuals(fit)
    apart = gaps - np.nanmedian(gaps, axis=0)
    usual = MAD_STD * float(np.nanmedian(np.abs(apart)))
    numbers = fit.survey.table["row"].to_numpy()[gross].tolist()
    several = len(numbers) > 1
    yield (
        f"the orientation{'s' if several else ''} of row{'s' if several else ''} {listed(numbers)} "
        f"lie{'' if several else 's'} up to {1e6 * np.linalg.norm(apart[gross], axis=1).max():.3g} urad from what the "
        f"others show, which scatter by {1e6 * usual:.2g} urad: the noise of orientations is estimated too large with "
        "them. Leave mrx mry mrz empty in these rows, or fit with --robust"
    )


def _refuse_foreign(survey: Survey, view: OrientationView) -> None:
    commanded, turn = view.commanded, view.pose.rotation
    vectors = survey.table[list(ORIENTATION)].to_numpy(dtype=float)[view.index]
    off = _misfit(turn, vectors, commanded)
    if off < FAR:
        return
    tried = ((way, _misfit(turn, way.read(vectors), commanded)) for way in ways())
    way, after = min(tried, key=lambda one: one[1])
    fits = after < min(off / BETTER, FAR)
    found = f"measured orientations that lie {np.degrees(off):.3g} deg (median) from those commanded"
    found += (
        f"; {way.words} they lie {np.degrees(after):.2g} deg from them"
        if fits
        else ", in the frame of the points and with any mount"
    )
    cure = f"{way.cure}, or {LEAVE_OUT}" if fits else f"See how the file writes them, or {LEAVE_OUT}"
    raise InputError(f"{survey.table['file'].iloc[view.index[0]]}, columns {' '.join(ORIENTATION)}", found, cure)


def _misfit(turn: Array, vectors: Array, commanded: Array) -> float:
    """Median angle (rad) between measured orientations, as rotation vectors (n, 3), and commanded ones (n, 3, 3)."""
    from scipy.spatial.transform import Rotation

    seen = turn.T @ Rotation.from_rotvec(vectors).as_matrix()
    mount = mean_rotation(commanded.transpose(0, 2, 1) @ seen)
    apart = seen @ mount.T @ commanded.transpose(0, 2, 1)
    return float(np.median(Rotation.from_matrix(apart).magnitude()))
