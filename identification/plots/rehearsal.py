"""A figure of a little of everything, so that the first real one finds all loaded."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from identification.plots import style


def rehearsal() -> Figure:
    """Dots, lines, bars, bands, an image, arrows in space, a legend and text."""
    figure = Figure(figsize=(style.WIDTH, 3.0), facecolor="white")
    flat = style.panel(figure, 0.5, 0.5, 3.0, 2.0)
    style.dress(flat, "x / mm", "y / µm", "title")
    x = np.linspace(0, 1, 20)
    flat.plot(x, x, ".", rasterized=True)
    flat.errorbar(x, x, x, label="bar")
    flat.fill_between(x, x, 2 * x)
    flat.axhspan(0, 0.1)
    flat.imshow(np.eye(2), aspect="auto")
    flat.legend()
    space: Any = style.panel(figure, 4.0, 0.5, 3.0, 2.0, projection="3d")
    space.scatter(x, x, x)
    space.quiver(x, x, x, x, x, x)
    return figure
