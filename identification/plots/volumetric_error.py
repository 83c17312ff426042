"""Volumetric error in space before and after the fit, at one magnification."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from errormodel.arrays import Array, as_rows
from identification.estimation.result import Fit
from identification.plots import style

MOST_ARROWS = 300  # arrows drawn
# without the palest colours, since arrows are thin
ARROW_COLOURS = ListedColormap(mpl.colormaps["viridis_r"](np.linspace(0.15, 1, 128)))
ELEVATION, AZIMUTH = 22.0, -58.0  # degrees
# inches: largest width and height of a volume's drawing
BOX_IN = (2.6, 2.7)
SQUARE_SIDE_IN = 3.4  # of the square that Matplotlib draws it in; it fills 1.03 of it at zoom 1, see `_shadow`


def draw_volumetric_error(fit: Fit) -> Figure:
    """Arrows from the nominal positions along the error, in the axes of the machine's reference.

    The magnification is given above the panels; unmeasured coordinates of a row count as zero error.
    """
    points, before, after = _arrows(fit)
    low, high = points.min(axis=0), points.max(axis=0)
    span = np.maximum(high - low, 0.2 * max(float((high - low).max()), 1.0))
    large = max(float(np.quantile(np.linalg.norm(before, axis=1), 0.95)), 1e-9)
    factor = _round_down(0.13 * float(np.linalg.norm(span)) / large)
    scale = Normalize(0, 1e3 * large)
    wide, tall = _shadow(span)
    zoom = min(BOX_IN[0] / wide, BOX_IN[1] / tall)
    height = zoom * tall + 1.5
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, height), facecolor="white")
    for k, (title, errors) in enumerate((("Nominal", before), ("Fitted", after))):
        x = 1.62 + 3.55 * k  # the middle of the panel, inches
        axes: Any = style.panel(
            figure, x - SQUARE_SIDE_IN / 2, 0.62 + (zoom * tall - SQUARE_SIDE_IN) / 2, SQUARE_SIDE_IN, SQUARE_SIDE_IN,
            projection="3d", proj_type="ortho", elev=ELEVATION, azim=AZIMUTH,
        )  # fmt: skip
        axes.patch.set_visible(False)
        size = 1e3 * np.linalg.norm(errors, axis=1)
        shades = ARROW_COLOURS(scale(size))
        axes.scatter(*points.T, s=2.5, c=shades, lw=0, depthshade=False)
        some = size > 0
        axes.quiver(  # shafts, then each head's two strokes
            *points[some].T, *(factor * errors[some]).T, lw=0.8, arrow_length_ratio=0.25,
            colors=np.tile(shades[some], (3, 1)),
        )  # fmt: skip
        for name, middle, reach in zip("xyz", (low + high) / 2, span / 2, strict=True):
            axes.set(**{f"{name}lim": (middle - reach, middle + reach)})
            axis = getattr(axes, f"{name}axis")
            axis.set_label_text(f"{name} / mm", size=style.SMALL_TEXT, color=style.INK)
            axis.labelpad = 6
            ticks = MaxNLocator(2 if reach < 0.2 * span.max() else 4).tick_values(middle - reach, middle + reach)
            axis.set_ticks(ticks[np.abs(ticks - middle) < 0.85 * reach])  # none at the corners, where two axes meet
        axes.tick_params(labelsize=7, pad=-1, colors=style.MUTED)
        axes.tick_params(axis="z", pad=3)
        axes.set_box_aspect(tuple(span), zoom=zoom / (1.03 * SQUARE_SIDE_IN))
        heading: dict[str, Any] = {"size": style.HEADING, "weight": "bold", "color": style.INK, "ha": "center"}
        figure.text(x / style.REPORT_WIDTH_IN, 1 - 0.58 / height, title, **heading)
    note = f"errors drawn {factor:g} × their size, {len(points)} of {len(fit.survey)} rows"
    figure.text(0.43, 1 - 0.25 / height, note, size=style.BODY_TEXT, color=style.MUTED, ha="center")
    place = style.panel(figure, 7.32, 0.6, 0.14, height - 1.5)
    bar = figure.colorbar(ScalarMappable(scale, ARROW_COLOURS), cax=place, extend="max")
    bar.set_label("|e| / µm", size=style.BODY_TEXT, color=style.INK)
    bar.ax.tick_params(labelsize=style.SMALL_TEXT, colors=style.MUTED)
    return figure


def _arrows(fit: Fit) -> tuple[Array, Array, Array]:
    """Nominal points and errors before and after, (m, 3) in mm, in the axes of the machine's reference."""
    seen = np.flatnonzero(np.isfinite(fit.residuals).any(axis=1))
    seen = seen[np.unique(np.linspace(0, len(seen) - 1, MOST_ARROWS).astype(int))]
    rows = as_rows(*(c[seen] for c in fit.chain.columns(fit.survey.table)))
    points = fit.chain.kernel("nominal", outputs=(0, 1, 2))(rows).T
    before, after = (np.nan_to_num(errors[seen]) for errors in (fit.nominal_residuals, fit.residuals))
    labels = fit.problem.labels[seen]
    for label, pose in fit.problem.frames.items():
        here = labels == label
        before[here], after[here] = before[here] @ pose.rotation, after[here] @ pose.rotation
    return points, before, after


def _round_down(value: float) -> float:
    """Largest 1, 2, 3, 5 or 7 times a power of ten that is not above `value`."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(m for m in (1, 2, 3, 5, 7) if m * power <= value * (1 + 1e-9)))


def _shadow(span: Array) -> tuple[float, float]:
    """Width and height of a box in parallel projection, relative to its diagonal."""
    x, y, z = span / np.linalg.norm(span)
    up, turn = np.radians(ELEVATION), np.radians(AZIMUTH)
    depth = abs(x * np.cos(turn)) + abs(y * np.sin(turn))
    return float(abs(x * np.sin(turn)) + abs(y * np.cos(turn))), float(z * np.cos(up) + depth * np.sin(up))
