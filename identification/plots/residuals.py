"""Residuals of a fit against positions of the joints, and against time or row."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from errormodel.arrays import Array
from identification.estimation.result import Fit
from identification.plots import style

MOST_RESIDUAL_DOTS = 1500  # dots of a panel
RESIDUAL_PANEL_IN = 1.25  # inches: height of a panel


def draw_residuals_by_position(fit: Fit) -> Figure:
    """Residuals x, y, z (um, measuring frame) against the position of each joint: one column per joint."""
    joints = [j for j in fit.chain.machine.joints if np.ptp(_finite(fit, j.name)) > 0]
    lines = max(-(-len(joints) // 6), 1)
    wide = max(-(-len(joints) // lines), 1)
    height = lines * (3 * RESIDUAL_PANEL_IN + 0.75) + 0.1
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, height), facecolor="white")
    limit = _limit(fit)
    column = 7.3 / max(wide, 3)
    for k, joint in enumerate(joints):
        line, place = divmod(k, wide)
        position = fit.survey.table[joint.name].to_numpy(dtype=float)
        for component, axis in enumerate("xyz"):
            bottom = height - 0.3 - line * (3 * RESIDUAL_PANEL_IN + 0.75) - (component + 1) * RESIDUAL_PANEL_IN
            axes = style.panel(figure, 0.65 + place * column, bottom, column - 0.2, RESIDUAL_PANEL_IN - 0.12)
            style.dress(axes, "", f"{axis} / µm" if place == 0 else "")
            _panel(fit, axes, style.shown(joint, position), component, limit)
            axes.tick_params(labelbottom=component == 2, labelleft=place == 0)
            style.dress_position(axes, joint, label=component == 2, ticks=max(3, int(1.9 * column)))
    _legend(figure)
    return figure


def draw_residuals_by_order(fit: Fit) -> Figure:
    """Residuals x, y, z (um, measuring frame) against time, or against the row where no time was recorded."""
    when, label = _when(fit)
    height = 3 * RESIDUAL_PANEL_IN + 0.85
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, height), facecolor="white")
    limit = _limit(fit)
    for component, axis in enumerate("xyz"):
        axes = style.panel(
            figure, 0.65, height - 0.3 - (component + 1) * RESIDUAL_PANEL_IN, 7.2, RESIDUAL_PANEL_IN - 0.12
        )
        style.dress(axes, label if component == 2 else "", f"{axis} / µm")
        axes.margins(x=0.01)
        _panel(fit, axes, when, component, limit)
        axes.tick_params(labelbottom=component == 2)
    _legend(figure)
    return figure


def _finite(fit: Fit, name: str) -> Array:
    seen = np.isfinite(fit.residuals).any(axis=1)
    values = fit.survey.table[name].to_numpy(dtype=float)[seen]
    return values if len(values) else np.zeros(1)


def _when(fit: Fit) -> tuple[Array, str]:
    table = fit.survey.table
    if "time" in table:
        time = table["time"].to_numpy(dtype=float)
        if np.isfinite(time).sum() > 1 and np.nanmax(time) > np.nanmin(time):
            hours = np.nanmax(time) - np.nanmin(time) > 3 * 3600
            return time / (3600 if hours else 60), f"time / {'h' if hours else 'min'}"
    return np.arange(1.0, len(table) + 1), "row, in the order of the survey"


def _limit(fit: Fit) -> float:
    """Half the height of every panel: a high quantile of the residuals, um; larger ones are drawn at the edge."""
    sizes = np.abs(fit.residuals[np.isfinite(fit.residuals)])
    if not len(sizes):
        return 1.0
    return 1e3 * max(1.15 * float(np.quantile(sizes, 0.997)), 2.4 * fit.sigma_mm, 1e-6)


def _panel(fit: Fit, axes: Axes, x: Array, component: int, limit: float) -> None:
    """Dots, medians and central 90 % in bins of equal counts, and twice the noise."""
    y = 1e3 * fit.residuals[:, component]
    use = np.isfinite(x) & np.isfinite(y)
    x, y = x[use], y[use]
    colour = style.AXIS_COLOURS[component]
    axes.axhspan(-2e3 * fit.sigma_mm, 2e3 * fit.sigma_mm, color=style.FAINT, alpha=0.55, lw=0, zorder=0)
    axes.axhline(0, color=style.MUTED, lw=0.7)
    axes.set_ylim(-limit, limit)
    if not len(x):
        axes.text(
            0.5, 0.6, "not measured", transform=axes.transAxes, size=style.SMALL_TEXT, color=style.MUTED, ha="center"
        )
        return
    some = np.unique(np.linspace(0, len(x) - 1, MOST_RESIDUAL_DOTS).astype(int))
    size, alpha = (4.5, 0.55) if len(some) < 600 else (2.5, 0.4)
    inside = np.clip(y[some], -limit, limit)
    axes.plot(x[some], inside, ".", ms=size, mew=0, color=colour, alpha=alpha, rasterized=True, clip_on=False)
    middle, low, median, high = _quantiles(x, y)
    if len(middle) > 1:
        axes.plot(middle, low, middle, high, color=colour, lw=0.9, ls=(0, (3, 1.5)))
        axes.plot(middle, median, color=style.INK, lw=1.6)


def _quantiles(x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
    """Per bin of equal counts (equal x stay together): mean x, and the 5, 50 and 95 % quantiles of y."""
    bins = int(np.clip(len(x) // 25, 3, 24))
    edges = np.unique(np.quantile(x, np.linspace(0, 1, bins + 1)))
    bin_of = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, max(len(edges) - 2, 0))
    order = np.argsort(bin_of, kind="stable")
    out = [
        (x[part].mean(), *np.quantile(y[part], (0.05, 0.5, 0.95)))
        for part in np.split(order, np.flatnonzero(np.diff(bin_of[order])) + 1)
        if len(part) >= 5
    ]
    columns = np.array(out).reshape(-1, 4).T
    return columns[0], columns[1], columns[2], columns[3]


def _legend(figure: Figure) -> None:
    height = figure.get_figheight()
    text = "dark line: median  ·  dashed: 9 of 10 residuals lie between  ·  grey: ± 2 standard deviations of the noise"
    figure.text(0.65 / style.REPORT_WIDTH_IN, 1 - 0.2 / height, text, size=style.SMALL_TEXT, color=style.MUTED)
