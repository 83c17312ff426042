"""Sections of the report on outlying rows and on the uncertainties that further poses would give."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from identification.estimation.result import Fit
from identification.plots.distances import draw_distances
from identification.report.pictures import Picture, picture
from identification.report.tables import number
from identification.report.wording import file_name, three
from identification.results.analysis import Analysis

MOST_OUTLIERS = 40  # outliers listed
MOST_GAIN_GROUPS = 15  # parameter groups listed


class OutliersPart(NamedTuple):
    """A sentence, the figure of all rows' distances, and a table row per outlier."""

    statement: str
    pictures: list[Picture]
    rows: list[list[str]]
    more: int


def outliers_part(fit: Fit) -> OutliersPart | None:
    """Section of a robust fit."""
    if fit.sorting is None:
        return None
    farthest = sorted(fit.outliers, key=lambda o: -o.distance_sigma)
    count, n = len({o.index for o in farthest}), int(np.isfinite(fit.sorting.distance).sum())
    text = (
        f"The fit is robust: each of {n} rows counts the less the farther it lies from what the others agree on, and "
        f"{f'{count} of them take' if count != 1 else 'one of them takes'} no part at all, in whole or with the "
        "component that is named. Residuals, their statistics and figures elsewhere are of what takes part."
        if count
        else f"The fit is robust: each of {n} rows counts the less the farther it lies from what the others agree on. "
        "None is so far that it takes no part."
    )
    drawn = picture(
        partial(draw_distances, fit),
        "How far each row lies from the fit, in robust standard deviations, in the order of measuring: marked rows "
        "take no part. Marks in a row are a jump or a lost beam, a cloud that thins out upwards is a noise with "
        "heavy tails, and a curve that climbs to the marks is an error of the machine that the model does not have.",
        "Distances of all rows from the fit on a logarithmic scale, outliers marked",
    )
    rows = [
        [
            file_name(o.file), str(o.row), o.run, o.what, three(o.distance_sigma),
            three(o.residual_um) if np.isfinite(o.residual_um) else "–",
        ]
        for o in farthest[:MOST_OUTLIERS]
    ]  # fmt: skip
    return OutliersPart(text, [drawn], rows, max(len(farthest) - MOST_OUTLIERS, 0))


class GainPart(NamedTuple):
    """Uncertainties of the groups that improve most, and the poses that achieve it."""

    groups: list[list[str]]
    more: int
    joints: list[str]
    poses: list[list[str]]
    repeated: bool


def gain_part(analysis: Analysis) -> GainPart | None:
    """What ten more poses would bring to the machine's groups; None where no position was measured."""
    fit, gain = analysis.fit, analysis.gain
    if gain.best is None or gain.poses is None:
        return None
    std = np.sqrt(np.diag(fit.solution.covariance)) * fit.inflation
    own = [e for e in analysis.estimates if e.kind not in ("frame", "zero", "observation")]
    own.sort(key=lambda e: gain.best[e.number - 1] / std[e.number - 1])  # type: ignore[index]
    rows = []
    for e in own[:MOST_GAIN_GROUPS]:
        ratios = (values[e.number - 1] / std[e.number - 1] for values in (gain.like_these, gain.best))
        rows.append([e.name, three(e.std), *(three(e.std * r) for r in ratios), e.unit])
    poses = [[number(v, 3) for v in row] for row in gain.poses.to_numpy()]
    return GainPart(
        rows,
        max(len(own) - MOST_GAIN_GROUPS, 0),
        list(gain.poses.columns),
        poses,
        len(set(map(tuple, poses))) < len(poses),
    )
