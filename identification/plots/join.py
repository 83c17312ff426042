"""Measured points on the commanded ones, after alignment, or lengths beside nominal ones: the picture of a join."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from identification.plots import style

if TYPE_CHECKING:
    from collections.abc import Sequence

    from identification.diagnosis.data_checks.readings import Lengths
    from identification.importing.importing import Imported

MOST_POINTS = 4000  # in a panel
PLANES = ((0, 1), (0, 2))  # of the measuring frame
PANEL_IN = 2.9
MOST_PANELS = 8
LENGTHS_IN = 1.3  # height of a panel
SPREAD_LEAST = 1e-9  # mm: all points at one place


def draw_join(imported: Imported) -> Figure:
    """Two views of the points in the measuring frame (mm), and the distance of each row from its command (um)."""
    proof = imported.proof
    every = slice(None, None, max(1, len(proof.rows) // MOST_POINTS))
    nominal, measured = proof.nominal[every], proof.measured[every]
    height = PANEL_IN + 2.6
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, height), facecolor="white")
    for place, (i, j) in enumerate(PLANES):
        axes = style.panel(figure, 0.75 + 4.0 * place, 2.35, 3.1, PANEL_IN - 0.1)
        axes.plot(
            nominal[:, i], nominal[:, j], "o", mfc="none", mec=style.MUTED, ms=6, mew=0.9, label="commanded, aligned"
        )
        axes.plot(measured[:, i], measured[:, j], ".", color=style.FITTED, ms=4, label="measured")
        style.dress(axes, f"{'xyz'[i]} / mm", f"{'xyz'[j]} / mm")
        axes.set_aspect("equal", adjustable="datalim")
        axes.xaxis.set_major_locator(MaxNLocator(4, steps=style.TICK_STEPS))
        if not place:
            figure.legend(*axes.get_legend_handles_labels(), loc="upper left", ncols=2, frameon=False,
                          fontsize=style.BODY_TEXT, bbox_to_anchor=(0.08, 1.0))  # fmt: skip
    axes = style.panel(figure, 0.75, 0.5, 7.1, 1.35)
    um = 1e3 * proof.distance
    axes.vlines(np.arange(1, len(um) + 1), 0, um, color=style.FITTED, lw=0.8)
    style.dress(axes, "row of the survey", "distance / µm")
    axes.set_ylim(0, max(1.08 * float(um.max()), SPREAD_LEAST))
    axes.margins(x=0.01)
    return figure


def draw_lengths(lengths: Sequence[Lengths]) -> Figure:
    """What lengths are longer than those of a machine without errors (um), by reading, a panel an observation."""
    shown = lengths[:MOST_PANELS]
    step = LENGTHS_IN + 0.75
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, step * len(shown) + 0.2), facecolor="white")
    for place, own in enumerate(reversed(shown)):
        axes = style.panel(figure, 0.9, 0.55 + step * place, 6.9, LENGTHS_IN)
        um = 1e3 * own.gap
        axes.vlines(np.arange(1, len(um) + 1), 0, um, color=style.FITTED, lw=0.8)
        axes.axhline(0, color=style.MUTED, lw=0.8)
        style.dress(axes, "reading" if place == 0 else "", f"{own.label} / µm")
        axes.margins(x=0.01)
        if not um.any():
            axes.set_ylim(-SPREAD_LEAST, SPREAD_LEAST)
    return figure
