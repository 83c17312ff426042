"""How far the uncertainties of the identified groups hang together."""

from __future__ import annotations

from math import ceil

import numpy as np
from matplotlib.figure import Figure

from errormodel.kernel import Array
from identification.estimates import estimates
from identification.fit.result import Fit
from identification.plots import style


def correlation(fit: Fit) -> Array:
    """Correlation coefficients of the groups, (rank, rank)."""
    std = np.sqrt(np.diag(fit.solution.covariance))
    return np.asarray(fit.solution.covariance / np.outer(std, std))


def draw_correlation(fit: Fit) -> Figure:
    """Heat map of :func:`correlation`, groups by name and number."""
    matrix = correlation(fit)
    names = [style.plain(e.name, 24) for e in estimates(fit)]
    n = len(names)
    side = float(np.clip(0.135 * n, 3.0, 5.3))
    every = max(1, ceil(0.09 * n / side))  # a name needs 0.09 inches
    height = side + 0.7
    figure = Figure(figsize=(style.WIDTH, height), facecolor="white")
    axes = figure.add_axes((1.4 / style.WIDTH, 0.5 / height, side / style.WIDTH, side / height))
    image = axes.imshow(matrix, cmap="RdBu_r", vmin=-1, vmax=1, interpolation="nearest")
    style.dress(axes, "number of the group", "")
    axes.grid(visible=False)
    size = float(np.clip(72 * 0.85 * side * every / max(n, 1), 5.0, style.SMALL))
    step = max(every, ceil(size / 72 * 1.9 * n / side))  # a number of two digits and a gap
    axes.set_yticks(range(0, n, every), [f"{names[k]}  {k + 1}" for k in range(0, n, every)], size=size)
    axes.set_xticks(range(0, n, step), [str(k + 1) for k in range(0, n, step)], size=size)
    axes.tick_params(length=2)
    left = (1.4 + side + 0.25) / style.WIDTH
    bar = figure.colorbar(image, cax=figure.add_axes((left, 0.5 / height, 0.02, side / height)))
    bar.set_label("correlation coefficient", size=style.BODY, color=style.INK)
    bar.ax.tick_params(labelsize=style.SMALL, colors=style.MUTED)
    return figure
