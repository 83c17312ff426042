"""Corner plot of the posterior: pairwise and marginal draws, compared with the Gaussian approximation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from errormodel.arrays import Array
from identification.bayes.posterior import Posterior
from identification.plots import style
from identification.results.parameter_table import printed

MOST_CORNER_UNKNOWNS = 6  # unknowns in a figure
CONTOUR_LEVELS = (0.95, 0.68)  # probability within a contour


class Drawn(NamedTuple):
    """Draws (chains, draws) of one unknown in display units; mean and deviation of the Gaussian approximation."""

    name: str
    unit: str
    values: Array
    closed: tuple[float, float] | None


def drawn(posterior: Posterior, most: int = MOST_CORNER_UNKNOWNS) -> list[Drawn]:
    """Nonlinear unknowns, then the groups most strongly correlated with them (or with each other)."""
    out = []
    for k, unknown in enumerate(posterior.unknowns[:most]):
        factor, unit = unknown.printed
        out.append(Drawn(unknown.name, unit, factor * posterior.coordinates[:, :, k], None))
    flat = np.hstack([posterior.values.reshape(-1, len(posterior.names)), posterior.coordinates.reshape(
        posterior.values.shape[0] * posterior.values.shape[1], -1)])  # fmt: skip
    spread = flat.std(axis=0)
    link = np.abs(np.corrcoef(flat[:, spread > 0].T)) if (spread > 0).sum() > 1 else np.ones((1, 1))
    strength = np.zeros(len(spread))
    strength[spread > 0] = (link - np.eye(len(link))).max(axis=1)
    own = [k for k, name in enumerate(posterior.names) if not name.startswith(("frame", "zero["))]
    own.sort(key=lambda k: (-round(float(strength[k]), 3), k))
    for k in sorted(own[: most - len(out)]):
        factor, unit = printed(posterior.units[k])
        closed = (factor * float(posterior.closed_mean[k]), factor * float(posterior.closed_std[k]))
        out.append(Drawn(posterior.names[k], unit, factor * posterior.values[:, :, k], closed))
    return out


def draw_posterior_corner(posterior: Posterior) -> Figure:
    """Pairs of :func:`drawn`: contours at 68 and 95 %; on the diagonal, dashed, the Gaussian approximation."""
    shown = drawn(posterior)
    n = len(shown)
    side = 6.6 / max(n, 3)
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, n * side + 0.8), facecolor="white")
    for row, below in enumerate(shown):
        for column, across in enumerate(shown[: row + 1]):
            axes = style.panel(figure, 1.15 + column * side, 0.65 + (n - 1 - row) * side, side - 0.12, side - 0.12)
            style.dress(axes)
            if row == column:
                _alone(axes, across)
            else:
                _pair(axes, across.values.ravel(), below.values.ravel())
            axes.xaxis.set_major_locator(MaxNLocator(3))
            axes.yaxis.set_major_locator(MaxNLocator(3))
            axes.tick_params(labelsize=6.5)
            _label(axes, across, below, row == n - 1, column == 0 and row > 0)
            if row == column:
                axes.set_yticks([])
    return figure


def _label(axes: Axes, across: Drawn, below: Drawn, last: bool, first: bool) -> None:
    for axis, one, wanted in ((axes.xaxis, across, last), (axes.yaxis, below, first)):
        axis.get_major_formatter().set_useOffset(False)  # type: ignore[attr-defined]
        if not wanted:
            axis.set_tick_params(labelbottom=False, labelleft=False)
        else:
            axis.set_label_text(f"{style.plain(one.name, 18)}\n/ {one.unit}", size=7)


def _alone(axes: Axes, one: Drawn) -> None:
    values = one.values.ravel()
    counts, edges = np.histogram(values, bins=36, density=True)
    axes.stairs(counts, edges, fill=True, color=style.FITTED, alpha=0.45, lw=0)
    if one.closed is not None:
        mean, std = one.closed
        x = np.linspace(edges[0], edges[-1], 120)
        axes.plot(x, np.exp(-0.5 * ((x - mean) / std) ** 2) / std / np.sqrt(2 * np.pi), "--", color=style.INK, lw=1)
    axes.set_xlim(edges[0], edges[-1])


def _pair(axes: Axes, x: Array, y: Array) -> None:
    from scipy.ndimage import gaussian_filter

    counts, left, low = np.histogram2d(x, y, bins=30)
    counts = np.asarray(gaussian_filter(counts, 1.2))
    ordered = np.sort(counts.ravel())[::-1]
    share = np.cumsum(ordered) / ordered.sum()
    levels = sorted({float(ordered[np.searchsorted(share, level)]) for level in CONTOUR_LEVELS})
    middle = [(e[1:] + e[:-1]) / 2 for e in (left, low)]
    axes.contourf(*middle, counts.T, [*levels, counts.max() + 1], colors=[style.FITTED], alpha=0.25)
    axes.contour(*middle, counts.T, levels, colors=[style.FITTED], linewidths=0.9)
    axes.set_xlim(left[0], left[-1])
    axes.set_ylim(low[0], low[-1])
