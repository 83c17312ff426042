"""Singular values of the scaled design matrix: the number of identifiable combinations of parameters."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from errormodel.arrays import Array
from identification.estimation.result import Fit
from identification.observation.identifiability import DEPENDENCE_TOLERANCE, Groups
from identification.plots import style

SINGULAR_VALUE_FLOOR = 1e-17  # value at which computed zeros are drawn


def draw_singular_values(fit: Fit) -> Figure:
    """Singular values in descending order, and the threshold that decides the rank."""
    groups = fit.solution.groups
    values = visible(groups)
    place = np.arange(1, len(values) + 1)
    kept = place <= groups.rank
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, 2.7), facecolor="white")
    axes = style.panel(figure, 0.7, 0.5, 7.1, 2.05)
    style.dress(axes, "number of the singular value", "singular value, logarithmic")
    axes.set_yscale("log")
    style.powers(axes.yaxis)
    axes.plot(place[kept], values[kept], "o", ms=5, color=style.FITTED, label=f"identified: {groups.rank}")
    if not kept.all():
        axes.plot(place[~kept], values[~kept], "o", ms=5, mfc="white", mec=style.NOMINAL, mew=1.3,
                  label=f"not identifiable: {int((~kept).sum())}")  # fmt: skip
    limit = threshold(groups)
    axes.axhline(limit, color=style.INK, lw=1.1, ls="--")
    hidden = "hidden by the noise" if limit > DEPENDENCE_TOLERANCE else "not identifiable in these poses"
    there = axes.get_yaxis_transform()
    axes.text(
        0.012, limit, f"below the line: {hidden}", transform=there, size=style.SMALL_TEXT, color=style.INK, va="bottom"
    )
    axes.set_xlim(0.2, len(values) + 0.8)
    axes.set_ylim(top=5 * float(values.max()) if len(values) else 1.0)
    axes.legend(loc="lower left", fontsize=style.BODY_TEXT, frameon=False, labelcolor=style.INK)
    return figure


def visible(groups: Groups) -> Array:
    """Singular values that have a logarithm, falling."""
    return np.maximum(groups.singular_values, SINGULAR_VALUE_FLOOR)


def threshold(groups: Groups) -> float:
    """What lies between identified and other singular values: the tolerance of a dependence, or the noise."""
    values = visible(groups)
    dropped = values[groups.rank :]
    by_noise = len(dropped) and dropped[0] > DEPENDENCE_TOLERANCE
    return float(np.sqrt(dropped[0] * values[groups.rank - 1])) if by_noise and groups.rank else DEPENDENCE_TOLERANCE
