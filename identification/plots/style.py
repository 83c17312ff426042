"""Common style of all figures: palette safe for colour-blind readers (Okabe and Ito), text sizes, rendering."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import AutoLocator, FixedLocator, FuncFormatter, MaxNLocator, MultipleLocator, NullLocator
from numpy.typing import NDArray

from errormodel.files import write_bytes_atomic
from errormodel.machine import Joint

# palette of Okabe and Ito for the axes x, y, z: red, green and blue, distinct in every common colour blindness
AXIS_COLOURS = ("#D55E00", "#009E73", "#0072B2")  # x, y, z
ACCENT = "#CC79A7"
INK = "#1F2933"
MUTED = "#57626F"
FAINT = "#D5DBE1"
PAPER = "#F5F7F9"
# a darkened orange, since the palette's own is faint on white
NOMINAL, FITTED, HELDOUT = "#8A6100", "#0072B2", "#009E73"
OTHERS = ("#CC79A7", "#56B4E9", "#D55E00", "#000000")  # colours of test files, in turn

SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")  # digits of exponents
TITLE, HEADING, BODY_TEXT, SMALL_TEXT = 15.0, 11.0, 9.0, 8.0  # points: sizes of text
TICK_STEPS = [1, 2, 2.5, 5, 10]  # permitted steps between ticks, times a power of ten
# inches: width of a report's figure, at which its text has the size of the report's
REPORT_WIDTH_IN = 8.0
TICK_PAD = 3.5  # points between an axis and its labels, as Matplotlib has it
TEXT_HEIGHT, DIGIT_WIDTH = 1.0, 0.64  # in sizes of the text, of Matplotlib's own font
GRID_ZORDER = 0.5  # below the curves


def save(figure: Figure, path: Path) -> None:
    """Write `figure` in the format of the path's suffix; output is reproducible, and text of an SVG stays text."""
    write_bytes_atomic(render(figure, path.suffix.lower().removeprefix(".")), path)


def render(figure: Figure, kind: str, dpi: int = 150) -> bytes:
    """The bytes of `figure` as ``svg``, ``png`` or ``pdf``."""
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind, {})
    out = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "errormodel", "svg.fonttype": "none"}), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font")  # the reader's fonts have what ours lack
        # a PNG packed in the fastest way takes two thirds of the time and is 7 % larger
        packed: dict[str, Any] = {"pil_kwargs": {"compress_level": 1}} if kind == "png" else {}
        for axes in figure.axes:
            if _dressed(axes):
                _draw_ticks(axes)
        figure.savefig(out, format=kind, dpi=dpi, metadata=undated, **packed)
    return out.getvalue()


def _dressed(axes: Axes) -> bool:
    """Whether the ticks of `axes` are those of `dress`: a grid, labels on the left and below, no marks."""
    if axes.name != "rectilinear" or not axes.axison:
        return False
    x, y = axes.xaxis.get_tick_params(), axes.yaxis.get_tick_params()
    bare = not any((x | y).get(key, True) for key in ("bottom", "top", "left", "right", "labeltop", "labelright"))
    return bool(bare and x.get("gridOn") and y.get("gridOn"))


def _draw_ticks(axes: Axes) -> None:
    """Draw grid and labels of all ticks as one line and plain texts.

    A tick is five objects of Matplotlib, which take longer than the curves; what is seen is the same.
    """
    for axis, across, side in (
        (axes.xaxis, axes.get_xaxis_transform(), "labelbottom"),
        (axes.yaxis, axes.get_yaxis_transform(), "labelleft"),
    ):
        params = axis.get_tick_params()
        places = axis.get_majorticklocs()
        texts = axis.get_major_formatter().format_ticks(list(places))
        low, high = sorted(axis.get_view_interval())
        inside = [(place, text) for place, text in zip(places, texts, strict=True) if low <= place <= high]
        axis.set_major_locator(NullLocator())
        axis.set_minor_locator(NullLocator())
        flat = axis is axes.xaxis
        if params.get("gridOn"):
            grid = np.repeat([place for place, _ in inside], 3), np.tile([0.0, 1.0, np.nan], len(inside))
            line = Line2D(*(grid if flat else grid[::-1]), transform=across, color=FAINT, lw=0.6, zorder=GRID_ZORDER)
            axes.add_artist(line)
        look: dict[str, Any] = {
            "ha": "center" if flat else "right", "va": "top" if flat else "center_baseline",
            "size": params.get("labelsize", SMALL_TEXT), "color": params.get("labelcolor", INK),
        }  # fmt: skip
        labels = inside if params.get(side, True) else []
        if labels:  # the axis keeps its own label clear of labels of ticks only
            longest = max(len(text) for _, text in labels)
            axis.labelpad += TICK_PAD + look["size"] * (TEXT_HEIGHT if flat else DIGIT_WIDTH * longest)
        for place, text in labels:
            here, off = ((place, 0), (0, -TICK_PAD)) if flat else ((0, place), (-TICK_PAD, 0))
            axes.annotate(
                text, here, off, across, "offset points", annotation_clip=False, parse_math=False, **look
            )  # fmt: skip


def panel(figure: Figure, left: float, bottom: float, width: float, height: float, **options: Any) -> Axes:
    """Axes of `figure` at a position in inches."""
    across, up = figure.get_size_inches()
    return figure.add_axes((left / across, bottom / up, width / across, height / up), **options)


def dress(axes: Axes, x: str = "", y: str = "", title: str = "") -> None:
    """Set labels with units, a light grid in place of tick marks, no box, and few ticks, which are slow to draw."""
    axes.set_xlabel(x, size=BODY_TEXT, color=INK)
    axes.set_ylabel(y, size=BODY_TEXT, color=INK)
    if title:
        axes.set_title(
            title, size=BODY_TEXT, weight="bold", color=INK, loc="left", y=1.0
        )  # a fixed height avoids a slow layout
    axes.tick_params(labelsize=SMALL_TEXT, labelcolor=INK, left=False, bottom=False)
    for axis in (axes.xaxis, axes.yaxis):
        if isinstance(axis.get_major_locator(), AutoLocator):
            axis.set_major_locator(MaxNLocator(5, steps=TICK_STEPS))
    axes.grid(color=FAINT, lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(MUTED)


def shown(joint: Joint, position: NDArray[np.float64]) -> NDArray[np.float64]:
    """Positions of a joint in display units: mm or degrees."""
    return np.degrees(position) if joint.type == "rotary" else position


def dress_position(axes: Axes, joint: Joint, label: bool = True, ticks: int = 7) -> None:
    """The x axis of a joint's positions, as `shown`."""
    turning = joint.type == "rotary"
    if label:
        axes.set_xlabel(f"{plain(joint.name, 16)} / {'°' if turning else 'mm'}", size=BODY_TEXT, color=INK)
    low, high = axes.get_xlim()
    step = next((s for s in (15, 30, 45, 60, 90, 180, 360) if high // s + -low // s < ticks), 0)
    if turning and high - low >= 90 and step:
        axes.xaxis.set_major_locator(MultipleLocator(step))
    else:
        axes.xaxis.set_major_locator(MaxNLocator(ticks, steps=TICK_STEPS))


def powers(axis: Axis) -> None:
    """Set ticks of a logarithmic axis as plain text: matplotlib's own are formulas, and slow to draw."""
    axis.set_major_formatter(FuncFormatter(lambda x, _: "10" + f"{np.log10(x):.0f}".translate(SUPERSCRIPTS)))
    axis.set_minor_locator(NullLocator())


def decades(axis: Axis, low: float, high: float) -> None:
    """Set few ticks with plain numbers on a logarithmic axis from `low` to `high`."""
    steps = (1, 2, 5) if high < 300 * low else (1,)
    powers_of_ten = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)))
    ticks = [step * power for power in powers_of_ten for step in steps]
    axis.set_major_locator(FixedLocator([t for t in ticks if low <= t <= high]))
    axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axis.set_minor_locator(NullLocator())


def plain(text: str, most: int = 40) -> str:
    """User's text as a figure takes it: printable, no mathematics, its middle omitted beyond `most` characters."""
    word = "".join(c if c.isprintable() else " " for c in text)
    word = word if len(word) <= most else word[: most - 7] + "…" + word[-6:]
    return word.replace("$", r"\$")
