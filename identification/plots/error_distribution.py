"""Histogram and cumulative distribution of the errors before and after the fit, and on data that was not fitted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from errormodel.arrays import Array
from identification.estimation.result import Fit
from identification.plots import style

MOST_BINS = 32  # bins of the histogram
Curve = tuple[str, str, Array, str, float]  # label, colour, sizes, line style, line width


def draw_error_distribution(fit: Fit) -> Figure:
    """Histogram and cumulative distribution of |e| in um: nominal, fitted, held-out, and each test file."""
    curves = _curves(fit)
    sizes = [size for _, _, size, _, _ in curves]
    largest = max(1e-6, *(float(s[-1]) for s in sizes))
    logarithmic = max(float(np.median(s)) for s in sizes) > 4 * min(float(np.median(s)) for s in sizes)
    smallest = max(min(float(np.quantile(s, 0.005)) for s in sizes), 1e-4 * largest) if logarithmic else 0.0
    bins = int(np.clip(2 * np.sqrt(len(fit.residuals)), 8, MOST_BINS))
    edges = (np.geomspace if logarithmic else np.linspace)(smallest, 1.02 * largest, bins + 1)
    columns = 3 if len(curves) < 7 else 4
    lines = -(-len(curves) // columns)
    height = 3.1 + 0.22 * lines
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, height), facecolor="white")
    left, right = (style.panel(figure, x, 0.52, 3.2, 2.3) for x in (0.6, 4.6))
    scale = ", logarithmic" if logarithmic else ""
    style.dress(left, f"|e| / µm{scale}", "share of the rows / %", "Histogram")
    style.dress(right, f"|e| / µm{scale}", "rows with less / %", "Cumulative")
    levels = np.linspace(0, 1, 401)
    for label, colour, size, line, width in curves:
        share = 100 * np.histogram(np.clip(size, edges[0], edges[-1]), edges)[0] / len(size)
        fill = 0.18 if width > 1.5 else 0.0
        left.stairs(share, edges, fill=True, color=colour, alpha=fill)
        left.stairs(share, edges, color=colour, ls=line, lw=width)
        right.plot(np.quantile(size, levels), 100 * levels, color=colour, ls=line, lw=width, label=label)
    for axes in (left, right):
        axes.set_xlim(edges[0], edges[-1])
        axes.set_ylim(0)
        if logarithmic:
            axes.set_xscale("log")
            style.decades(axes.xaxis, edges[0], edges[-1])
    right.axhline(95, color=style.MUTED, lw=0.8, ls=":")
    right.text(edges[-1], 95, "95 % ", size=style.SMALL_TEXT, color=style.MUTED, va="top", ha="right")
    right.set_ylim(0, 104)
    handles, labels = right.get_legend_handles_labels()
    across = [k for column in range(columns) for k in range(column, len(curves), columns)]  # legends fill by column
    figure.legend(
        [handles[k] for k in across], [labels[k] for k in across], loc="upper left", bbox_to_anchor=(0.065, 1.0),
        ncols=columns, fontsize=style.SMALL_TEXT,
        frameon=False, labelcolor=style.INK, handlelength=2.4, columnspacing=1.6,
    )  # fmt: skip
    return figure


def _curves(fit: Fit) -> list[Curve]:
    """Sorted sizes in um of every non-empty set of rows."""
    sets: list[tuple[str, str, Array, str, float]] = [
        ("nominal", style.NOMINAL, fit.nominal_residuals, "-", 1.8),
        ("fitted", style.FITTED, fit.residuals, "-", 1.8),
        ("held out", style.HELDOUT, fit.heldout_residuals, "--", 1.4),
    ]
    for k, test in enumerate(fit.tests):
        colour = style.OTHERS[k % len(style.OTHERS)]
        sets.append((f"test {style.plain(Path(test.path).name, 24)}", colour, test.residuals, ("-.", ":")[k % 2], 1.4))
    out = []
    for label, colour, errors, line, width in sets:
        rows = errors[np.isfinite(errors).any(axis=1)]
        if len(rows):
            size = np.sort(1e3 * np.sqrt(np.nansum(rows**2, axis=1)))
            out.append((f"{label}: mean {size.mean():.3g} µm", colour, size, line, width))
    return out
