"""Residuals along the driving channel of a finding, of a fit without it and with it."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from errormodel.arrays import Array
from identification.plots import style
from identification.results.residual_projection import Evidence, bin_of

MOST_DRIVER_DOTS = 1500  # dots of a panel
DRIVER_BINS = 20  # bins along the channel
# share of the range without a bin that interrupts the line; number of bins, up to which it is never interrupted
GAP_SHARE, FEW_BINS = 0.12, 8
DRIVER_PANEL_IN = 2.0  # inches: height of a panel


def draw_residuals_along_driver(evidence: Evidence, sigma: float) -> Figure:
    """Residuals (um) along the main motion, each row a dot, with bin means and their standard errors.

    On the left everything but the finding is fitted, on the right the finding as well; `sigma` is the noise, mm.
    """
    height = DRIVER_PANEL_IN + 1.0
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, height), facecolor="white")
    x = evidence.abscissa.shown(evidence.channel(evidence.abscissa.name))
    bins = min(max(DRIVER_BINS, round(8 * evidence.waves)), len(x) // 15)
    sizes = np.abs(np.concatenate([evidence.before, evidence.after]))
    limit = max(1.15 * float(np.quantile(sizes, 0.995)), 2.4e3 * sigma)
    for side, residual in enumerate((evidence.before, evidence.after)):
        axes = style.panel(figure, 0.7 + 3.75 * side, 0.5, 3.45, DRIVER_PANEL_IN)
        title = ("Without the finding", "With it")[side]
        style.dress(axes, evidence.abscissa.label, "" if side else f"along {evidence.symbol} / µm", title)
        axes.axhspan(-2e3 * sigma, 2e3 * sigma, color=style.FAINT, alpha=0.55, lw=0, zorder=0)
        axes.axhline(0, color=style.MUTED, lw=0.7)
        axes.set_ylim(-limit, limit)
        axes.tick_params(labelleft=side == 0)
        split = evidence.split
        for level, (colour, line) in enumerate(evidence.looks):
            rows = np.arange(len(x)) if split is None else np.flatnonzero(split.member == level)
            label = split.labels[level] if split else "mean of a bin ± standard error"
            _draw(axes, x[rows], residual[rows], limit, colour, line, label, (len(x), bins))
    figure.legend(
        *figure.axes[0].get_legend_handles_labels(), loc="upper left", bbox_to_anchor=(0.07, 1.0), ncols=3,
        frameon=False, fontsize=style.SMALL_TEXT, labelcolor=style.INK, handlelength=2.4, columnspacing=1.6,
    )  # fmt: skip
    return figure


def _draw(
    axes: Axes, x: Array, y: Array, limit: float, colour: str, line: str, label: str, of: tuple[int, int]
) -> None:
    if not len(x):  # no rows from this direction of approach
        return
    whole, bins = of
    most = max(MOST_DRIVER_DOTS * len(x) // whole, 1)
    some = np.unique(np.linspace(0, len(x) - 1, most).astype(int))
    size, alpha = (4.5, 0.45) if whole < 600 else (2.5, 0.3)
    axes.plot(
        x[some], np.clip(y[some], -limit, limit), ".", ms=size, mew=0, color=colour, alpha=alpha, rasterized=True
    )  # fmt: skip
    columns = np.array(binned(x, y, bins))
    gaps = np.flatnonzero(np.diff(columns[0]) > GAP_SHARE * np.ptp(x)) + 1
    if columns.shape[1] > FEW_BINS:
        columns = np.insert(columns, gaps, np.nan, axis=1)
    middle, mean, error = columns
    axes.errorbar(
        middle, mean, error, color=colour, ls=line, lw=1.5, marker="o", ms=3.2, elinewidth=1.2, capsize=1.8, label=label
    )  # fmt: skip


def binned(x: Array, y: Array, bins: int) -> tuple[Array, Array, Array]:
    """Per bin of equal counts (equal x stay together): mean x, mean y, and its standard error."""
    place = bin_of(x, max(bins, 3))
    parts = [np.flatnonzero(place == k) for k in np.unique(place)]
    rows = [(x[p].mean(), y[p].mean(), y[p].std(ddof=1) / np.sqrt(len(p))) for p in parts if len(p) > 2]
    columns = np.array(rows).reshape(-1, 3).T
    return columns[0], columns[1], columns[2]
