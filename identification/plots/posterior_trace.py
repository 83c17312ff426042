"""Trace plot of a Markov chain: its walkers over the steps after the burn-in, to check convergence."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from identification.bayes.posterior import Posterior
from identification.plots import style
from identification.plots.posterior_corner import drawn

MOST_TRACES = 5  # unknowns in a figure
DRAWN_WALKERS = 8  # walkers drawn as lines


def draw_posterior_trace(posterior: Posterior) -> Figure:
    """Some walkers as lines, and the central 68 % of all as a band; a constant band indicates convergence."""
    shown = drawn(posterior, MOST_TRACES)
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, 1.15 * len(shown) + 0.7), facecolor="white")
    for k, one in enumerate(shown):
        axes = style.panel(figure, 1.35, 0.55 + 1.15 * (len(shown) - 1 - k), 6.4, 1.0)
        style.dress(axes, "draw" if k == len(shown) - 1 else "", f"{style.plain(one.name, 16)}\n/ {one.unit}")
        axes.yaxis.label.set_fontsize(7)
        axes.yaxis.get_major_formatter().set_useOffset(False)  # type: ignore[attr-defined]
        draws = np.arange(one.values.shape[1])
        for values in one.values[:: max(1, len(one.values) // DRAWN_WALKERS)][:DRAWN_WALKERS]:
            axes.plot(draws, values, color=style.FAINT, lw=0.5)
        low, middle, high = np.quantile(one.values, (0.16, 0.5, 0.84), axis=0)
        axes.fill_between(draws, low, high, color=style.FITTED, alpha=0.25, lw=0)
        axes.plot(draws, middle, color=style.FITTED, lw=1)
        axes.set_xlim(0, max(len(draws) - 1, 1))
        if k < len(shown) - 1:
            axes.tick_params(labelbottom=False)
    return figure
