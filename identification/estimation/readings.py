"""Residuals of single readings (lengths, angles), and their statistics by observation.

Residuals are measured minus predicted, mm or rad.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array
from errormodel.survey import Survey
from errormodel.surveys.observations import observed
from identification.estimation.weights import Judgement
from identification.observation.models import Kind, View
from identification.observation.readings import ReadingView

MOST_MISFIT = 0.5  # of the weighted sum of squares: an observation with more of it draws the fit


@dataclass(frozen=True)
class ReadingErrors:
    """Root mean squares of the residuals of one observation, um or urad.

    Attributes
    ----------
    nominal : of the machine without errors, its unknowns (station, zero) as they fit that best.
    fitted, heldout : after the fit, and of blocks left out of it.
    n : number of readings.
    """

    observation: str
    type: str
    nominal: float
    fitted: float
    heldout: float
    n: int
    unit: str


@dataclass(frozen=True)
class Readings:
    """Residuals (n,) of single readings, mm or rad, measured minus predicted; NaN where nothing was read.

    Attributes
    ----------
    nominal : relative to a machine without errors.
    fitted, heldout : after the fit, and of blocks of rows predicted by fits without them.
    """

    nominal: Array
    fitted: Array
    heldout: Array

    def without(self, views: Sequence[View], judged: Judgement | None) -> Readings:
        """The same residuals with NaN for outliers of a robust fit."""
        gone = np.zeros(self.fitted.shape, dtype=bool)
        for view, own in zip(views, judged.views if judged else (), strict=judged is not None):
            if isinstance(view, ReadingView):
                gone[view.index[own.out]] = True
        return Readings(*(np.where(gone, np.nan, a) for a in (self.nominal, self.fitted, self.heldout)))

    def most_misfit(
        self, views: Sequence[ReadingView], sigma: Mapping[Kind, float], chi2: float
    ) -> tuple[str, float] | None:
        """The observation that most of the misfit is of, and its residuals in standard uncertainties, rms.

        Parameters
        ----------
        sigma : noise level of each kind in units of its whitener; `chi2`: weighted sum of squares of the whole fit.
        """
        parts: dict[str, list[Array]] = {}
        for view in views:
            left = self.fitted[view.index] * view.whitener / sigma[view.kind]
            parts.setdefault(view.label, []).append(left[np.isfinite(left)])
        squares = {label: np.square(np.concatenate(own)) for label, own in parts.items()}
        most = (k for k, square in squares.items() if square.sum() > MOST_MISFIT * chi2)
        return next(((label, float(np.sqrt(squares[label].mean()))) for label in most), None)

    def errors(self, survey: Survey) -> Iterator[ReadingErrors]:
        """Root mean squares of each observation, in the order of the survey."""
        names = observed(survey.table)
        for label, observation in survey.observations.items():
            seen = (names == label) & np.isfinite(self.fitted)
            if seen.any():
                factor, unit = (1e3, "um") if observation.reading == "length" else (1e6, "urad")
                sizes = [factor * _rms(a[seen]) for a in (self.nominal, self.fitted, self.heldout)]
                yield ReadingErrors(label, observation.type, sizes[0], sizes[1], sizes[2], int(seen.sum()), unit)


def reading_residuals(
    views: Sequence[View], unknowns: Mapping[str, int], values: Array, held: Array, rows: int
) -> Array:
    """Measured minus predicted readings (rows,), mm or rad, NaN where nothing was read.

    Parameters
    ----------
    unknowns : index of each unknown in `values`; `held`: (chain parameters,) values of the others, mm and rad.
    rows : number of rows of the survey.
    """
    out = np.full(rows, np.nan)
    for view in views:
        if isinstance(view, ReadingView):
            for part, gap in view.gaps(view.vector(unknowns, values, held)):
                out[view.index[part]] = gap[0]
    return out


def _rms(values: Array) -> float:
    """Root mean square of the finite values."""
    seen = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(seen**2))) if len(seen) else float("nan")
