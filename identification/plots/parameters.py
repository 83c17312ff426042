"""Fitted parameters with their uncertainty, the most significant first, each unit in a panel of its own."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from identification.plots import style
from identification.results.analysis import Analysis
from identification.results.parameter_table import Estimate

BAR_HEIGHT_IN = 0.19  # inches per parameter
LABEL_WIDTH_IN = 1.5  # inches for the longest label
# titles of the panels by unit
UNIT_TITLES = {"µm": "Lengths", "µm/m": "Scale errors", "µrad": "Angles", "µrad/m": "Angles for a metre of travel"}


def draw_parameters(analysis: Analysis) -> Figure:
    """Dots with bars of twice the standard uncertainty; hollow where the bar holds zero.

    Frames and zeros of instruments are left out, since they are no properties of the machine.
    """
    shown = [e for e in analysis.estimates if e.kind in ("member", "joint", "effect")]
    shown.sort(key=lambda e: -e.significance)
    order = {unit: k for k, unit in enumerate(UNIT_TITLES)}
    units = sorted({e.unit for e in shown}, key=lambda unit: (order.get(unit, len(order)), unit))
    panels = [(unit, [e for e in shown if e.unit == unit]) for unit in units]
    stacks = [[p for p in panels if p[0].startswith("µm") == lengths] for lengths in (True, False)]
    height = max([sum(len(some) * BAR_HEIGHT_IN + 0.95 for _, some in stack) for stack in stacks] + [1.0])
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, height), facecolor="white")
    for side, stack in enumerate(stacks):
        top = height
        for unit, some in stack:
            tall = len(some) * BAR_HEIGHT_IN + 0.1
            _draw(
                style.panel(figure, LABEL_WIDTH_IN + 4.0 * side, top - 0.3 - tall, 3.8 - LABEL_WIDTH_IN, tall),
                unit,
                some,
            )
            top -= tall + 0.85
    return figure


def _draw(axes: Axes, unit: str, some: list[Estimate]) -> None:
    style.dress(axes, f"value ± 2 standard uncertainties / {unit}", "", UNIT_TITLES.get(unit, "Effects"))
    axes.axvline(0, color=style.MUTED, lw=0.8)
    clear = np.array([e.significance >= 2 for e in some])
    place, value, reach = np.array([(y, e.value, 2 * e.std) for y, e in enumerate(some)]).T
    for which, alpha, face in ((clear, 1.0, style.FITTED), (~clear, 0.6, "white")):
        if which.any():  # one line and one marker for all: each artist costs as much as a hundred dots
            y, x, r = place[which], value[which], reach[which]
            axes.hlines(y, x - r, x + r, color=style.FITTED, lw=1.6, alpha=alpha, capstyle="projecting")
            axes.plot(x, y, "o", ms=4.5, mfc=face, mec=style.FITTED, mew=1.1)
    axes.set_yticks(range(len(some)), [_name(e) for e in some])
    axes.set_ylim(len(some) - 0.4, -0.6)
    axes.grid(axis="y", visible=False)
    axes.locator_params(axis="x", nbins=6)


def _name(e: Estimate) -> str:
    symbol = style.plain(f" ({e.symbol.removesuffix(' …')})", 12) if e.symbol else ""
    return style.plain(e.name, 21 - len(symbol)) + symbol
