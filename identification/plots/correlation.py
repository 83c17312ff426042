"""Heat map of the correlations between identified parameter groups."""

from __future__ import annotations

from math import ceil

import numpy as np
from matplotlib.figure import Figure

from identification.plots import style
from identification.results.analysis import Analysis
from identification.results.correlations import correlation


def draw_correlation(analysis: Analysis) -> Figure:
    """Heat map of :func:`correlation`; groups by name, and by their number in the fit."""
    groups, matrix = correlation(analysis)
    n = len(groups)
    side = float(np.clip(0.135 * n, 3.0, 5.3))
    every = max(1, ceil(0.09 * n / side))  # a name needs 0.09 inches
    height = side + 0.7
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, height), facecolor="white")
    axes = style.panel(figure, 1.4, 0.5, side, side)
    image = axes.imshow(matrix, cmap="RdBu_r", vmin=-1, vmax=1, interpolation="nearest")
    style.dress(axes, "number of the group", "")
    axes.grid(visible=False)
    size = float(np.clip(72 * 0.85 * side * every / max(n, 1), 5.0, style.SMALL_TEXT))
    step = max(every, ceil(size / 72 * 1.9 * n / side))  # a number of two digits and a gap
    names = [f"{style.plain(e.name, 17)}\u2003{e.number}" for e in groups[::every]]
    axes.set_yticks(range(0, n, every), names, size=size)
    axes.set_xticks(range(0, n, step), [str(e.number) for e in groups[::step]], size=size)
    axes.tick_params(length=2)
    bar = figure.colorbar(image, cax=style.panel(figure, side + 1.65, 0.5, 0.16, side))
    bar.set_label("correlation coefficient", size=style.BODY_TEXT, color=style.INK)
    bar.ax.tick_params(labelsize=style.SMALL_TEXT, colors=style.MUTED)
    return figure
