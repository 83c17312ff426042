"""Which rows of a survey a robust fit leaves out, by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from errormodel.arrays import Array
from errormodel.conventions import MOTIONS
from errormodel.exceptions import InputError
from errormodel.survey import Survey
from errormodel.survey_columns import MEASURED
from identification.estimation.weights import Judgement
from identification.observation.models import View


@dataclass(frozen=True)
class Outlier:
    """A row, or what of it, that takes no part in the fit."""

    index: int  # of the row in the survey
    file: str
    row: int  # data row of the file, from 1
    run: str
    what: str  # "position", "orientation", a component (mx my mz) or an error motion (dx ... ec)
    distance_sigma: float  # of the whole from the fit, in robust standard deviations
    residual_um: float  # length; NaN where it is no position

    def as_json(self) -> dict[str, Any]:
        return {k: v for k, v in vars(self).items() if k != "index"}


@dataclass(frozen=True)
class Sorting:
    """The rows of a survey as a robust fit sorts them.

    Attributes
    ----------
    outliers : what takes no part, in the order of the rows.
    distance, weight : (n,) of each row the largest distance of what it holds, in standard deviations, and the least
        weight (0 of outliers, about 1 of others); NaN where nothing was measured.
    gone : (n, 3) position components that take no part.
    residuals, nominal_residuals : (n, 3) mm, of all rows.
    """

    outliers: tuple[Outlier, ...]
    distance: Array
    weight: Array
    gone: Array
    residuals: Array
    nominal_residuals: Array

    def without(self, residuals: Array) -> Array:
        """Residuals (n, 3) with NaN for what takes no part."""
        return np.where(self.gone, np.nan, residuals)


def sort_rows(
    survey: Survey, views: Sequence[View], judged: Judgement, residuals: Array, nominal_residuals: Array
) -> Sorting:
    """Name what a judgement leaves out.

    Raises
    ------
    InputError
        More than half of the rows would be.
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
    return view.kind if view.kind in ("position", "orientation") else MOTIONS[view.outputs[0]]
