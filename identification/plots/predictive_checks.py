"""Posterior predictive checks: statistics of the residuals compared with data drawn from the model."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from identification.bayes.posterior import Posterior
from identification.plots import style


def draw_predictive_checks(posterior: Posterior) -> Figure:
    """One panel per check: distribution under the model (grey), value of this survey (a line with its spread)."""
    n = len(posterior.checks)
    width = (style.REPORT_WIDTH_IN - 0.4) / n
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, 2.0), facecolor="white")
    for k, check in enumerate(posterior.checks):
        axes = style.panel(figure, 0.2 + k * width, 0.62, width - 0.16, 1.0)
        style.dress(axes, title=f"{check.name}")
        axes.hist(check.replicated, bins=28, color=style.FAINT)
        low, high = np.quantile(check.observed, (0.16, 0.84))
        colour = style.FITTED if check.p_value > 0.01 else style.AXIS_COLOURS[0]
        axes.axvspan(low, high, color=colour, alpha=0.25, lw=0)
        axes.axvline(float(np.median(check.observed)), color=colour, lw=1.5)
        axes.set_xlabel(f"p = {check.p_value:.2g}", size=style.SMALL_TEXT, color=style.INK)
        axes.set_yticks([])
        axes.tick_params(labelsize=6.5)
        axes.locator_params(axis="x", nbins=4)
    return figure
