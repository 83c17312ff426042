"""Drawing of a machine's kinematic chain: a row of symbols from workpiece to tool, and the machine in space."""

from __future__ import annotations

import math
import textwrap
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from errormodel.chain import Chain
from errormodel.conventions import MOTIONS, TRANSLATIONS
from errormodel.joint_models import registry
from errormodel.machine import Joint, Machine, Shape, Vector
from identification.plots import style, symbols
from identification.plots.space import VIEW, draw_machine
from identification.results.terminal import counted

CELL_WIDTH_IN, LINE_HEIGHT_IN = 1.3, 0.175  # inches: width of an element in the row, height of a line of text
SPACE_HEIGHT_IN = 6.6  # inches: height of the drawing in space
LEGEND_WIDTH_IN = 3.7  # inches: width of the legend

Symbol = Callable[[Axes, float, float], None]


class _Column(NamedTuple):
    name: str
    geometry: list[str]
    model: list[str]
    symbol: Symbol


def draw_chain(machine: Machine) -> Figure:
    """Drawing of the chain of `machine`, in mm and degrees.

    Above, the elements in order with offsets, travels, error motions (ISO 230-1) and numbers of parameters; below, the
    nominal machine in space, linear axes at mid-travel and rotary axes at zero (or as near as they get).
    """
    chain = Chain(machine)
    columns = _columns(chain)
    geometry_lines = max(len(column.geometry) for column in columns)
    model_lines = max(len(column.model) for column in columns)
    row = 1.05 + LINE_HEIGHT_IN * (geometry_lines + model_lines) + 0.45
    width, height = max(12.5, CELL_WIDTH_IN * len(columns) + 0.8), SPACE_HEIGHT_IN + row + 1.25
    figure = Figure(figsize=(width, height), facecolor="white")
    page = figure.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(0, height))
    page.axis("off")
    page.text(0.5, height - 0.55, machine.name, size=style.TITLE, weight="bold", color=style.INK, parse_math=False)
    counts = {"joint": len(machine.joints), "shape": len(machine.shapes), "error parameter": len(chain.machine_ids)}
    summary = ", ".join(counted(n, what) for what, n in counts.items())
    page.text(0.5, height - 0.92, summary, size=style.HEADING, color=style.MUTED)
    page.add_patch(Rectangle((0, SPACE_HEIGHT_IN), width, row, fc=style.PAPER, ec="none", zorder=0))
    _draw_row(page, columns, SPACE_HEIGHT_IN + row - 0.85, LINE_HEIGHT_IN * geometry_lines)
    scale = draw_machine(page, chain, (0.3, 0.1, width - LEGEND_WIDTH_IN - 0.3, SPACE_HEIGHT_IN - 0.2))
    _draw_legend(page, width - LEGEND_WIDTH_IN + 0.7, SPACE_HEIGHT_IN - 0.75, scale)
    return figure


def _columns(chain: Chain) -> list[_Column]:
    counts = Counter(p.element for p in chain.parameters)
    columns: list[_Column] = [_Column("workpiece", ["chain starts", "here"], [], symbols.workpiece)]
    for element in chain.machine.elements:
        if isinstance(element, Shape):
            model = (
                [f"{counts[element.name]} constant{'s' * (counts[element.name] > 1)}"]
                if element.motions
                else ["no errors"]
            )
            columns.append(_Column(element.name, _dimensions(element.offset, element.rotation), model, symbols.shape))
        else:
            symbol = partial(symbols.prismatic if element.type == "prismatic" else symbols.rotary, axis=element.axis)
            model = _model(chain, element, counts[element.name])
            columns.append(_Column(element.name, _travel(element), model, symbol))
    return [*columns, _Column("tool point", _dimensions(chain.machine.tool), [], symbols.tool)]


def _dimensions(offset: Vector, rotation: Vector = (0.0, 0.0, 0.0)) -> list[str]:
    parts = [f"{axis} {_number(v)} mm" for axis, v in zip("xyz", offset, strict=True) if v]
    turns = [f"{_number(math.degrees(v))}° about {axis}" for axis, v in zip("xyz", rotation, strict=True) if v]
    return [*(parts or ["no offset"]), *turns]


def _travel(joint: Joint) -> list[str]:
    linear = joint.type == "prismatic"
    low, high = (_number(t if linear else math.degrees(t)) for t in joint.travel)
    span = f"±{high}" if low == f"−{high}" else f"{low} … {high}"
    axis = symbols.axis_name(joint.axis) or "(" + ", ".join(f"{v:.2g}" for v in joint.axis) + ")"
    return [f"{'along' if linear else 'about'} {axis}", f"{span}{' mm' if linear else '°'}"]


def _model(chain: Chain, joint: Joint, count: int) -> list[str]:
    if not count:
        return ["no error", "motions"]
    symbol = {p.motion: p.symbol for p in chain.parameters if p.element == joint.name}
    halves = (TRANSLATIONS, MOTIONS[len(TRANSLATIONS) :])
    names = [line for half in halves for line in textwrap.wrap(" ".join(symbol[m] for m in half if m in symbol), 18)]
    counted = {word for word, model in registry().items() if model.counts}
    bases = dict.fromkeys(f"{b.kind} {b.n}" if b.kind in counted else b.kind for b in joint.models.values())
    return [*names, *bases, f"{count} parameter{'s' * (count > 1)}"]


def _number(value: float) -> str:
    return f"{round(value, 3) + 0.0:.8g}".replace("-", "−")


def _draw_row(page: Axes, columns: list[_Column], y: float, geometry_height: float) -> None:
    places = page.get_xlim()[1] / 2 + CELL_WIDTH_IN * (np.arange(len(columns)) - (len(columns) - 1) / 2)
    page.plot(places[[0, -1]], [y, y], color=style.FAINT, lw=3, zorder=1)
    for x, column in zip(places, columns, strict=True):
        column.symbol(page, x, y)
        heading = style.HEADING * min(1, 13 / len(column.name))
        page.text(x, y + 0.46, column.name, size=heading, weight="bold", color=style.INK, ha="center")
        for top, lines, size, colour in (
            (y - 0.45, column.geometry, style.BODY_TEXT, style.INK),
            (y - 0.6 - geometry_height, column.model, style.SMALL_TEXT, style.MUTED),
        ):
            text = "\n".join(lines)
            page.text(x, top, text, size=size, color=colour, ha="center", va="top", linespacing=1.35)


def _draw_legend(page: Axes, x: float, y: float, scale: float) -> None:
    entries: list[tuple[Symbol, str]] = [
        (partial(symbols.prismatic, axis=(1, 0, 0)), "linear joint: moves along\nthe axis named on it"),
        (partial(symbols.rotary, axis=(0, 0, 1)), "rotary joint: turns about\nthe axis named on it"),
        (symbols.shape, "shape: a rigid member,\noffset to the next joint"),
        (symbols.tool, "tool with its functional\npoint"),
    ]
    for k, (symbol, meaning) in enumerate(entries):
        symbol(page, x, y - 0.78 * k)
        page.text(x + 0.75, y - 0.78 * k, meaning, size=style.BODY_TEXT, color=style.INK, va="center", linespacing=1.35)
    length = next(m * 10**e for e in range(6, -4, -1) for m in (5, 2, 1) if m * 10**e * scale < 0.8)  # mm
    origin = np.array([x, y - 4.05])
    for name, colour, along in zip("xyz", style.AXIS_COLOURS, VIEW.T, strict=True):
        tip = origin + length * scale * along
        page.plot(*np.array([origin, tip]).T, color=colour, lw=2)
        symbols.head(page, tip, along, 0.13, colour)
        letter = tip + 0.27 * along / np.hypot(*along)
        page.text(letter[0], letter[1], name, size=style.HEADING, weight="bold", color=colour, ha="center", va="center")
    scale_note = f"directions, colours\nand scale: each\narrow {length:g} mm"
    page.text(x + 1.05, y - 4.05, scale_note, size=style.BODY_TEXT, color=style.INK, va="center", linespacing=1.35)
    note = (
        "Linear axes stand at mid-travel (dotted: from\ntheir zero), rotary axes at 0; z is drawn upwards.\n"
        "EXY is the error along x of joint Y, EAY its tilt\nabout x (B: about y, C: about z), after ISO 230-1."
    )
    page.text(x - 0.5, y - 4.75, note, size=style.SMALL_TEXT, color=style.MUTED, va="top", linespacing=1.4)
