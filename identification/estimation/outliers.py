"""Outliers of a robust fit by file, row and component, and the weight of every row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from errormodel.arrays import Array
from errormodel.conventions import MOTIONS
from errormodel.exceptions import InputError
from errormodel.survey import Survey
from errormodel.surveys.columns import MEASURED
from identification.estimation.weights import Judgement
from identification.observation.models import MotionView, View
from identification.observation.readings import ReadingView


@dataclass(frozen=True)
class Outlier:
    """A row, or one component of it, that has weight zero in the fit."""

    index: int  # row number in the survey, from 0
    file: str
    row: int  # data row of the file, from 1
    run: str
    what: str  # "position", "orientation", a component (mx my mz), an error motion (dx ... ec) or a reading
    distance_sigma: float  # of the whole row from the fit, in robust standard deviations
    residual_um: float  # length of the residual; NaN for angles and error motions

    def as_json(self) -> dict[str, Any]:
        return {k: v for k, v in vars(self).items() if k != "index"}


@dataclass(frozen=True)
class Sorting:
    """The rows of a survey by their weight in a robust fit.

    Attributes
    ----------
    outliers : rows or components with weight zero, in the order of the rows.
    distance : (n,) largest distance of each row's observations from the fit, in standard deviations.
    weight : (n,) smallest weight of them, 0 for outliers, about 1 for others. Both NaN where nothing was measured.
    gone : (n, 3) position components with weight zero.
    residuals, nominal_residuals : (n, 3) mm, of all rows.
    """

    outliers: tuple[Outlier, ...]
    distance: Array
    weight: Array
    gone: Array
    residuals: Array
    nominal_residuals: Array

    def without(self, residuals: Array) -> Array:
        """Residuals (n, 3) with NaN for components with weight zero."""
        return np.where(self.gone, np.nan, residuals)


def sort_rows(
    survey: Survey, views: Sequence[View], judged: Judgement, residuals: Array, nominal_residuals: Array
) -> Sorting:
    """List the outliers of a robust fit.

    Parameters
    ----------
    judged : weights of the rows of each of `views`.
    residuals, nominal_residuals : (n, 3) mm of all rows, NaN where not measured.

    Raises
    ------
    InputError
        More than half of the rows are outliers.
    """
    n, table = len(survey), survey.table
    distance, weight = np.full(n, np.nan), np.full(n, np.nan)
    gone = np.zeros((n, 3), dtype=bool)
    found: list[tuple[int, str, float]] = []
    for view, own in zip(views, judged.views, strict=True):
        distance[view.index] = np.fmax(distance[view.index], own.distance)
        weight[view.index] = np.fmin(weight[view.index], own.weight)
        whole = own.out & (own.wrong < 0)
        for k in np.flatnonzero(own.out):
            what = MEASURED[own.wrong[k]] if own.wrong[k] >= 0 else _kind(view)
            found.append((int(view.index[k]), what, float(own.distance[k])))
        if view.kind == "position":
            gone[view.index[whole]] = True
            single = np.flatnonzero(own.wrong >= 0)
            gone[view.index[single], own.wrong[single]] = True
    lengths = 1e3 * np.sqrt(np.nansum(np.square(residuals), axis=1))
    lengths = np.where(np.isfinite(residuals).any(axis=1), lengths, np.nan)
    files, rows, runs = (table[c].to_numpy() for c in ("file", "row", "run"))
    outliers = tuple(
        Outlier(
            k, str(files[k]), int(rows[k]), str(runs[k]), what, d,
            float(lengths[k]) if what in ("position", *MEASURED) else float("nan"),
        )
        for k, what, d in sorted(found)
    )  # fmt: skip
    measured, bad = int(np.isfinite(distance).sum()), len({o.index for o in outliers})
    if 2 * bad > measured:
        raise InputError(
            str(survey.source),
            f"{bad} of {measured} rows lie far outside what the other {measured - bad} agree on: more than half, so "
            "that nobody can say which are wrong",
            "Look for a wrong unit, sign, column or frame (`errormodel diagnose` does), or fit without --robust",
        )
    return Sorting(outliers, distance, weight, gone, residuals, nominal_residuals)


def _kind(view: View) -> str:
    """Name of the observation for the list of outliers."""
    if isinstance(view, ReadingView):
        return f"{view.observation.reading} of {view.label}"
    return MOTIONS[view.outputs[0]] if isinstance(view, MotionView) else view.kind
