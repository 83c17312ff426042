"""Monitored quantities over the cycles, with their normal ranges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from identification.monitoring.control_limits import Judged
from identification.monitoring.history import Record
from identification.monitoring.quantities import NOISE_ID, Watched
from identification.plots import style

HISTORY_COLUMNS = 3  # panels in a row
PANEL_HEIGHT_IN, PANEL_WIDTH_IN = 1.75, 2.62  # inches: height and width of a panel
ALARM_COLOUR = style.AXIS_COLOURS[0]
MOST_TICKS = 5  # ticks along the cycles


def draw_history(what: Sequence[Watched], records: Sequence[Record], judged: Judged) -> Figure:
    """One panel per quantity, those nearest to (or beyond) their limits first; bars are twice the standard uncertainty.

    A hollow point is not part of the normal range; one in another colour is outside it. The band is the prediction
    interval for the last of `records`.
    """
    values = np.array([r.cycle.values for r in records])
    shown = [k for k in range(len(what)) if np.isfinite(values[:, k]).any()]
    alarm = judged.flagged
    shown.sort(key=lambda k: (not alarm[k], -judged.reach[k] if np.isfinite(judged.reach[k]) else 1.0))
    down = -(-len(shown) // HISTORY_COLUMNS)
    height = down * PANEL_HEIGHT_IN + 0.45
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, height), facecolor="white")
    for n, k in enumerate(shown):
        row, column = divmod(n, HISTORY_COLUMNS)
        axes = style.panel(
            figure,
            0.58 + column * PANEL_WIDTH_IN,
            height - (row + 1) * PANEL_HEIGHT_IN + 0.18,
            PANEL_WIDTH_IN - 0.68,
            PANEL_HEIGHT_IN - 0.55,
        )
        _draw(axes, what[k], k, records, judged)
        if n + HISTORY_COLUMNS >= len(shown):
            axes.set_xlabel("cycle", size=style.BODY_TEXT, color=style.INK)
    return figure


def _draw(axes: Axes, what: Watched, k: int, records: Sequence[Record], judged: Judged) -> None:
    unit = f" / {what.shown_unit}" if what.shown_unit else ""
    symbol = f" ({what.symbol})" if what.symbol else ""
    name = "scatter" if what.id == NOISE_ID else what.id + symbol
    style.dress(axes, title=style.plain(f"{name}{unit}", 34))
    low, high, mean = (what.shown(float(v[k])) for v in (judged.low, judged.high, judged.mean))
    last = max(r.number for r in records)
    points = [r for r in records if np.isfinite(r.cycle.values[k])]
    numbers = np.array([r.number for r in points])
    values = np.array([r.cycle.values[k] for r in points])
    std = np.sqrt([r.cycle.covariance[k, k] for r in points])
    bottom, here, top = (np.array([what.shown(v) for v in values + s * std]) for s in (-2, 0, 2))
    if np.isfinite(low):
        axes.axhspan(low, high, color=style.FITTED, alpha=0.12, lw=0)
        axes.axhline(mean, color=style.FITTED, lw=0.8, alpha=0.7)
    flagged = np.array([what.id in r.flagged for r in points])
    normal = np.array([r.normal for r in points])
    for colour, marker, some in ((style.FITTED, "o", ~flagged), (ALARM_COLOUR, "D", flagged)):
        axes.vlines(numbers[some], bottom[some], top[some], color=colour, lw=1.0, alpha=0.6)
        for face, which in ((colour, some & normal), ("white", some & ~normal)):
            axes.plot(numbers[which], here[which], marker, ms=3.8, mec=colour, mew=1.0, mfc=face)
    # a range from few cycles is far wider than the values, which would appear as a line
    around = np.array([bottom.min(), top.max()])
    room = np.ptp(around) or 1.0
    if np.isfinite(low):
        around = np.array([min(around[0], max(low, around[0] - room)), max(around[1], min(high, around[1] + room))])
    pad = 0.06 * (np.ptp(around) or 1.0)
    axes.set_ylim(around[0] - pad, around[1] + pad)
    axes.set_xlim(0.5, last + 0.5)
    axes.locator_params(axis="y", nbins=MOST_TICKS)
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
