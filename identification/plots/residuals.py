"""Residuals of a fit against positions of the joints, and against time or row."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, MaxNLocator

from errormodel.arrays import Array
from identification.estimation.result import Fit
from identification.plots import style

MOST_RESIDUAL_DOTS = 1500  # dots of a lane
RESIDUAL_PANEL_IN = (
    1.25  # height of a lane, inches: x, y and z lie above each other in one panel, which is drawn in a third of the
)
GAP = 0.12  # time that three take; between two lanes, inches


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
        bottom = height - 0.3 - line * (3 * RESIDUAL_PANEL_IN + 0.75) - 3 * RESIDUAL_PANEL_IN
        axes = style.panel(figure, 0.65 + place * column, bottom, column - 0.2, 3 * RESIDUAL_PANEL_IN - GAP)
        _lanes(fit, axes, style.shown(joint, position), limit, labels=place == 0)
        style.dress_position(axes, joint, ticks=max(3, int(1.9 * column)))
    _legend(figure)
    return figure


def draw_residuals_by_order(fit: Fit) -> Figure:
    """Residuals x, y, z (um, measuring frame) against time, or against the row where no time was recorded."""
    when, label = _when(fit)
    height = 3 * RESIDUAL_PANEL_IN + 0.85
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, height), facecolor="white")
    axes = style.panel(figure, 0.65, height - 0.3 - 3 * RESIDUAL_PANEL_IN, 7.2, 3 * RESIDUAL_PANEL_IN - GAP)
    axes.margins(x=0.01)
    _lanes(fit, axes, when, _limit(fit), labels=True)
    axes.set_xlabel(label, size=style.BODY_TEXT, color=style.INK)
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
    """Half the height of every lane: nearly all residuals, um; what lies beyond is drawn at the edge."""
    sizes = np.abs(fit.residuals[np.isfinite(fit.residuals)])
    if not len(sizes):
        return 1.0
    return 1e3 * max(1.15 * float(np.quantile(sizes, 0.997)), 2.4 * fit.sigma_mm, 1e-6)


def _lanes(fit: Fit, axes: Axes, x: Array, limit: float, labels: bool) -> None:
    """Residuals x, y, z above each other, each lane from -`limit` to `limit` with a scale of its own."""
    style.dress(axes)
    pitch = 2 * limit * RESIDUAL_PANEL_IN / (RESIDUAL_PANEL_IN - GAP)
    middles = [0.0, -pitch, -2 * pitch]
    for component, middle in enumerate(middles):
        _lane(fit, axes, x, component, limit, middle)
        if labels:
            axes.annotate(
                f"{'xyz'[component]} / µm", (0, middle), (-0.55 * 72, 0), axes.get_yaxis_transform(), "offset points",
                rotation=90, size=style.BODY_TEXT, color=style.INK, va="center", annotation_clip=False,
            )  # fmt: skip
    axes.set_ylim(middles[-1] - limit, limit)
    ticks = MaxNLocator(5, steps=style.TICK_STEPS).tick_values(-limit, limit)
    ticks = [t for t in ticks if abs(t) <= limit]
    axes.yaxis.set_major_locator(FixedLocator([m + t for m in middles for t in ticks]))
    axes.yaxis.set_major_formatter(FixedFormatter([f"{t:.10g}".replace("-", "−") for t in ticks] * len(middles)))
    axes.tick_params(labelleft=labels)


def _lane(fit: Fit, axes: Axes, x: Array, component: int, limit: float, at: float) -> None:
    """Dots, the median and the middle nine tenths in bins of equally many rows, and twice the noise; zero is `at`."""
    y = 1e3 * fit.residuals[:, component]
    use = np.isfinite(x) & np.isfinite(y)
    x, y = x[use], y[use]
    colour = style.AXIS_COLOURS[component]
    noise = min(2e3 * fit.sigma_mm, limit)
    axes.axhspan(at - noise, at + noise, color=style.FAINT, alpha=0.55, lw=0, zorder=0)
    axes.axhline(at, color=style.MUTED, lw=0.7)
    axes.axhline(at - limit, color=style.MUTED, lw=0.8, clip_on=False)
    if not len(x):
        there = axes.get_yaxis_transform()
        style_of: dict[str, Any] = {"size": style.SMALL_TEXT, "color": style.MUTED, "ha": "center"}
        axes.text(0.5, at + 0.2 * limit, "not measured", transform=there, **style_of)
        return
    some = np.unique(np.linspace(0, len(x) - 1, MOST_RESIDUAL_DOTS).astype(int))
    size, alpha = (4.5, 0.55) if len(some) < 600 else (2.5, 0.4)
    inside = at + np.clip(y[some], -limit, limit)
    axes.plot(x[some], inside, ".", ms=size, mew=0, color=colour, alpha=alpha, rasterized=True, clip_on=False)
    middle, low, median, high = _quantiles(x, y)
    if len(middle) > 1:
        axes.plot(middle, at + low, middle, at + high, color=colour, lw=0.9, ls=(0, (3, 1.5)))
        axes.plot(middle, at + median, color=style.INK, lw=1.6)


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
