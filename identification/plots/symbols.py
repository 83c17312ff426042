"""Symbols of a kinematic chain, drawn at (x, y) on axes whose unit is the inch."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyBboxPatch, Polygon, Rectangle

from errormodel.machine import Vector
from identification.plots import style


def axis_colour(axis: Vector) -> str:
    """Colour of the coordinate axis closest to `axis`."""
    return style.AXIS_COLOURS[int(np.argmax(np.abs(axis)))]


def axis_name(axis: Vector) -> str:
    """``x``, ``−x``, ... or nothing for an oblique axis."""
    largest = int(np.argmax(np.abs(axis)))
    if abs(axis[largest]) < 1 - 1e-12:
        return ""
    return ("−" if axis[largest] < 0 else "") + "xyz"[largest]


def workpiece(axes: Axes, x: float, y: float) -> None:
    """A hatched block."""
    block = Rectangle((x - 0.27, y - 0.2), 0.54, 0.4, fc="white", ec=style.INK, hatch="////", lw=1.2, zorder=3)
    axes.add_patch(block)


def shape(axes: Axes, x: float, y: float) -> None:
    """A bar."""
    outline = "round,pad=0,rounding_size=0.06"
    axes.add_patch(FancyBboxPatch((x - 0.4, y - 0.08), 0.8, 0.16, outline, fc=style.MUTED, ec="none", zorder=3))


def prismatic(axes: Axes, x: float, y: float, axis: Vector) -> None:
    """A carriage on its rail, under a double arrow."""
    colour = axis_colour(axis)
    axes.add_patch(Rectangle((x - 0.5, y - 0.2), 1.0, 0.08, fc=style.FAINT, ec=style.MUTED, lw=0.8, zorder=3))
    axes.add_patch(Rectangle((x - 0.22, y - 0.12), 0.44, 0.26, fc=colour, ec="none", zorder=4))
    arrow = {"arrowstyle": "<|-|>", "color": colour, "lw": 1.4, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (x + 0.5, y + 0.25), (x - 0.5, y + 0.25), arrowprops=arrow, zorder=4)
    _letter(axes, x, y + 0.005, axis)


def rotary(axes: Axes, x: float, y: float, axis: Vector) -> None:
    """A disc within a circular arrow."""
    colour = axis_colour(axis)
    axes.add_patch(Circle((x, y), 0.36, fc="white", ec="none", zorder=3))
    axes.add_patch(Circle((x, y), 0.19, fc=colour, ec="none", zorder=4))
    turn = np.radians(np.linspace(-50, 225, 80))
    circle = np.array([x + 0.3 * np.cos(turn), y + 0.3 * np.sin(turn)])
    axes.plot(*circle, color=colour, lw=1.6, zorder=4)
    head(axes, circle[:, -1], circle[:, -1] - circle[:, -2], 0.13, colour)
    _letter(axes, x, y - 0.005, axis)


def tool(axes: Axes, x: float, y: float) -> None:
    """A tapered tool with its functional point marked."""
    outline = [(x - 0.15, y + 0.24), (x + 0.15, y + 0.24), (x + 0.1, y + 0.02), (x, y - 0.18), (x - 0.1, y + 0.02)]
    axes.add_patch(Polygon(outline, fc=style.INK, ec="none", zorder=3))
    axes.plot(x, y - 0.18, "o", color=style.ACCENT, ms=7, mec="white", mew=1, zorder=5)


def head(axes: Axes, tip: np.ndarray, direction: np.ndarray, size: float, colour: str) -> None:
    """An arrow's head with its base's middle at `tip`."""
    along = np.asarray(direction) / np.hypot(*direction) * size
    across = np.array([-along[1], along[0]]) * 0.42
    axes.add_patch(Polygon([tip + along, tip + across, tip - across], fc=colour, ec="none", zorder=6))


def _letter(axes: Axes, x: float, y: float, axis: Vector) -> None:
    axes.text(
        x, y, axis_name(axis), color="white", size=style.BODY_TEXT, weight="bold", ha="center", va="center", zorder=5
    )
