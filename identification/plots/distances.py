"""Distance of each row from a robust fit, and the rows that are outliers."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from identification.estimation.bisquare import BISQUARE_CUT_SIGMA
from identification.estimation.result import Fit
from identification.plots import style

MOST_INLIERS = 4000  # inlying rows drawn; outliers are all drawn


def draw_distances(fit: Fit) -> Figure:
    """Distances in robust standard deviations, logarithmic, in the order of the survey.

    Raises
    ------
    ValueError
        The fit is not robust.
    """
    if fit.sorting is None:
        raise ValueError("the fit is not robust")
    distance = np.maximum(fit.sorting.distance, 0.05)
    out = np.zeros(len(distance), dtype=bool)
    out[[o.index for o in fit.outliers]] = True
    inside = np.flatnonzero(np.isfinite(distance) & ~out)
    some = inside[np.unique(np.linspace(0, len(inside) - 1, min(MOST_INLIERS, len(inside))).astype(int))]
    figure = Figure((style.REPORT_WIDTH_IN, 3.2))
    axes = style.panel(figure, 0.75, 0.6, style.REPORT_WIDTH_IN - 1.0, 2.2)
    axes.set_yscale("log")
    style.powers(axes.yaxis)
    axes.axhspan(BISQUARE_CUT_SIGMA[1], BISQUARE_CUT_SIGMA[3], color=style.FAINT, alpha=0.7, lw=0, zorder=0)
    axes.plot(some + 1, distance[some], ".", ms=3.5, mew=0, color=style.FITTED, alpha=0.6, rasterized=True)
    axes.plot(np.flatnonzero(out) + 1, distance[out], "x", ms=6, mew=1.4, color=style.AXIS_COLOURS[0])
    axes.set_xlim(0, len(distance) + 1)
    top = float(np.nanmax(distance, initial=BISQUARE_CUT_SIGMA[3]))
    axes.set_ylim(0.1, 2 * max(top, 2 * BISQUARE_CUT_SIGMA[3]))
    style.dress(axes, "row, in the order of the survey", "distance / standard deviations")
    text = "dots: rows that take part  ·  crosses: outliers  ·  grey: from where a row is usually out"
    figure.text(0.75 / style.REPORT_WIDTH_IN, 1 - 0.25 / 3.2, text, size=style.SMALL_TEXT, color=style.MUTED)
    return figure
