"""What all drawings share: a palette that colour-blind readers tell apart, sizes of text, and how a figure is saved."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

# Okabe and Ito's palette: red, green and blue in spirit, and distinct in every common colour blindness
AXIS_COLOURS = ("#D55E00", "#009E73", "#0072B2")  # x, y, z
ACCENT = "#CC79A7"
INK = "#1F2933"
MUTED = "#57626F"
FAINT = "#D5DBE1"
PAPER = "#F5F7F9"

TITLE, HEADING, BODY, SMALL = 15.0, 11.0, 9.0, 8.0  # points


def save(figure: Figure, path: Path) -> None:
    """Write `figure` in the format of the path's suffix; same figure, same bytes; the text of an SVG stays text."""
    undated = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(path.suffix.lower(), {})
    with mpl.rc_context({"svg.hashsalt": "errormodel", "svg.fonttype": "none"}):
        figure.savefig(path, dpi=150, metadata=undated)
