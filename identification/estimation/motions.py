"""Residuals of error-motion readings of single joints, each relative to the zero of its instrument.

Error motions are dx, dy, dz (mm) and ea, eb, ec (rad) of one joint; residuals are measured minus predicted.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array
from errormodel.conventions import MOTIONS, TRANSLATIONS, Motion, iso_symbol
from errormodel.survey import Survey
from identification.estimation.weights import Judgement
from identification.observation.models import MotionView, View
from identification.observation.normal_equations import view_vector


@dataclass(frozen=True)
class MotionErrors:
    """Root mean squares of one error motion's residuals, um or urad.

    Attributes
    ----------
    nominal, fitted, heldout : relative to the machine without errors, after the fit, and of blocks left out of it.
    n : number of readings.
    """

    joint: str
    motion: Motion
    nominal: float
    fitted: float
    heldout: float
    n: int

    @property
    def symbol(self) -> str:
        """Symbol of the error motion by ISO 230-1, such as EXY."""
        return iso_symbol(self.joint, self.motion)

    @property
    def unit(self) -> str:
        return "um" if self.motion in TRANSLATIONS else "urad"


@dataclass(frozen=True)
class Motions:
    """Residuals (n, 6) of readings of dx ... ec, mm and rad, measured minus predicted; NaN where nothing was read.

    Attributes
    ----------
    nominal : relative to a machine without errors, less the mean where the zero of the instrument is unknown.
    fitted, heldout : after the fit, and of blocks of rows predicted by fits without them.
    """

    nominal: Array
    fitted: Array
    heldout: Array

    def without(self, views: Sequence[View], judged: Judgement | None) -> Motions:
        """The same residuals with NaN for outliers of a robust fit."""
        gone = np.zeros(self.fitted.shape, dtype=bool)
        for view, own in zip(views, judged.views if judged else (), strict=judged is not None):
            if isinstance(view, MotionView):
                gone[view.index[own.out], view.outputs[0]] = True
        return Motions(*(np.where(gone, np.nan, a) for a in (self.nominal, self.fitted, self.heldout)))

    def errors(self, survey: Survey) -> Iterator[MotionErrors]:
        """Root mean squares of each error motion of each joint that was read, in the order of the survey."""
        joint = survey.table["joint"].to_numpy(dtype=object)
        for name in dict.fromkeys(joint[joint != ""]):
            for k, motion in enumerate(MOTIONS):
                seen = (joint == name) & np.isfinite(self.fitted[:, k])
                if seen.any():
                    factor = 1e3 if motion in TRANSLATIONS else 1e6
                    sizes = [factor * _rms(a[seen, k]) for a in (self.nominal, self.fitted, self.heldout)]
                    yield MotionErrors(str(name), motion, sizes[0], sizes[1], sizes[2], int(seen.sum()))


def motion_residuals(
    views: Sequence[View], unknowns: Mapping[str, int], values: Array, held: Array, rows: int
) -> Array:
    """Measured minus predicted error motions (rows, 6), mm and rad, NaN where nothing was read.

    Parameters
    ----------
    unknowns : index of each unknown in `values`; `held`: (chain parameters,) values of the others, mm and rad.
    rows : number of rows of the survey.
    """
    out = np.full((rows, 6), np.nan)
    for view in views:
        if isinstance(view, MotionView):
            # a motion view lists the joint's parameters first, then the six zeros of the instrument
            vector, k = view_vector(view, unknowns, values, held), view.outputs[0]
            zero = view.columns[len(view.ids) + k]
            offset = float(values[unknowns[zero]]) if zero in unknowns else 0.0
            for part, gap in view.gaps(vector):
                out[view.index[part], k] = gap[0] - offset
    return out


def before_fit(views: Sequence[View], unknowns: Mapping[str, int], held: Array, rows: int) -> Array:
    """Residuals (rows, 6) of a machine without errors: readings, less their mean where the zero is unknown."""
    out = motion_residuals(views, {}, np.zeros(0), held, rows)
    for view in views:
        if isinstance(view, MotionView) and view.columns[len(view.ids) + view.outputs[0]] in unknowns:
            out[view.index, view.outputs[0]] -= out[view.index, view.outputs[0]].mean()
    return out


def _rms(values: Array) -> float:
    """Root mean square of the finite values."""
    seen = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(seen**2))) if len(seen) else float("nan")
