"""A fleet in figures: a map of its machines by what was found, who is out by what, what is normal, and trends."""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, MaxNLocator

from errormodel.arrays import Array
from identification.fleets.comparison import EFFECT, LEVEL, TREND, Quantity, Test
from identification.plots import style

if TYPE_CHECKING:
    import pandas as pd

    from identification.results.fleet_result import FleetResult

STATES = {  # colour of each state of a machine, and the words beside it
    LEVEL: (style.AXIS_COLOURS[0], "out of the range of its type"),
    TREND: ("#E69F00", "changes as no other of its type"),
    EFFECT: (style.ACCENT, "an effect of its own"),
    "alarm": ("#000000", "in alarm"),
    "normal": ("#BBD6E8", "normal"),
    "not compared": ("#E4E8EC", "not compared"),
    "no result": ("#7B8794", "no result"),
}
MOST_COLUMNS = 60  # machines in a row of the map
TILE_IN = 0.13  # inches, at most
MOST_MACHINES, MOST_QUANTITIES = 30, 14  # rows and columns of the matrix
MOST_TYPES, MOST_RANGES = 6, 10  # panels of ranges, and quantities in each
MOST_TRENDS = 6
FAR = 8.0  # standard deviations at the ends of the colours
BAND = 1.96  # standard deviations: 95 % of machines


def draw_map(machines: pd.DataFrame, order: list[str]) -> Figure:
    """One tile a machine, in the order of the list, in a block for each type; the colour says what was found.

    Parameters
    ----------
    machines : ``id``, ``type``, ``state``.
    order : names of all machines, in the order of the list.
    """
    by_id = machines.set_index("id").loc[order]
    names = list(dict.fromkeys(by_id["type"]))
    sizes = [int((by_id["type"] == name).sum()) for name in names]
    columns = min(MOST_COLUMNS, max(12, *sizes))
    tile = min(TILE_IN if max(sizes) > MOST_COLUMNS else 0.28, (style.REPORT_WIDTH_IN - 0.4) / columns)
    heights = [ceil(s / columns) * tile for s in sizes]
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, sum(heights) + 0.36 * len(names) + 0.5), facecolor="white")
    words = list(STATES)
    colours = ListedColormap([colour for colour, _ in STATES.values()])
    top = figure.get_size_inches()[1] - 0.3
    for name, size, height in zip(names, sizes, heights, strict=True):
        own = [words.index(s) for s in by_id.loc[by_id["type"] == name, "state"]]
        grid = np.full((ceil(size / columns), columns), np.nan)
        grid.flat[:size] = own
        axes = style.panel(figure, 0.2, top - height, columns * tile, height)
        axes.pcolormesh(
            np.ma.masked_invalid(grid[::-1]), cmap=colours, vmin=-0.5, vmax=len(words) - 0.5,
            edgecolors="white", linewidth=0.4 if tile < 0.2 else 1.0,
        )  # fmt: skip
        axes.set_axis_off()
        title = f"{style.plain(name, 60) or 'of no known type'}: {size}"
        axes.set_title(title, size=style.BODY_TEXT, weight="bold", color=style.INK, loc="left", pad=3)
        top -= height + 0.36
    seen = [w for w in words if (by_id["state"] == w).any()]
    patches = [
        Patch(facecolor=STATES[w][0], edgecolor=style.MUTED, lw=0.5,
              label=f"{STATES[w][1]} ({int((by_id['state'] == w).sum())})")
        for w in seen
    ]  # fmt: skip
    figure.legend(
        handles=patches, loc="lower left", ncols=3, frameon=False, fontsize=style.SMALL_TEXT,
        bbox_to_anchor=(0.015, 0.0), handlelength=1.0, columnspacing=1.5,
    )  # fmt: skip
    return figure


def draw_matrix(result: FleetResult) -> Figure:
    """Who is out by what: machines by rank, what was found across, coloured by standard deviations from the others."""
    found = result.found
    rows = [m for m in result.machines["id"] if m in found][:MOST_MACHINES]
    count: dict[str, int] = {}
    for machine in rows:
        for name in {_name(t) for t in found[machine]}:
            count[name] = count.get(name, 0) + 1
    columns = sorted(count, key=lambda n: (-count[n], n))[:MOST_QUANTITIES]
    grid = np.full((len(rows), len(columns)), np.nan)
    for i, machine in enumerate(rows):
        for t in reversed(found[machine]):
            if _name(t) in columns:
                grid[i, columns.index(_name(t))] = _away(t)
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, 0.22 * len(rows) + 1.7), facecolor="white")
    across = min(0.45 * len(columns), style.REPORT_WIDTH_IN - 2.2)
    axes = style.panel(figure, 1.6, 0.15, across, 0.22 * len(rows))
    norm = TwoSlopeNorm(0, -FAR, FAR)
    axes.pcolormesh(np.ma.masked_invalid(np.clip(grid, -FAR, FAR)), cmap="PuOr_r", norm=norm, edgecolors="white", lw=1)
    for (i, j), value in np.ndenumerate(grid):
        if not np.isnan(value):
            colour = "white" if abs(value) > 0.7 * FAR else style.INK
            text = f"{value:+.0f}" if abs(value) < 1000 else "✓"
            axes.text(j + 0.5, i + 0.5, text, ha="center", va="center", size=6.5, color=colour)
    axes.set_facecolor(style.PAPER)
    axes.invert_yaxis()
    axes.set_yticks(np.arange(len(rows)) + 0.5, [style.plain(m, 22) for m in rows], size=style.SMALL_TEXT)
    axes.xaxis.tick_top()
    axes.set_xticks(np.arange(len(columns)) + 0.5, [style.plain(c, 24) for c in columns], size=style.SMALL_TEXT)
    axes.tick_params(axis="x", rotation=60, length=0, pad=1)
    for label in axes.get_xticklabels():
        label.set(ha="left", rotation_mode="anchor")
    axes.tick_params(axis="y", length=0)
    axes.spines[:].set_visible(False)
    return figure


def _name(t: Test) -> str:
    if t.shown is not None:
        return f"{t.shown.effect} {t.shown.where}"
    assert t.quantity is not None
    w = t.quantity.what
    return f"{w.id}{' a year' if t.kind == TREND else ''}"


def _away(t: Test) -> float:
    """Standard deviations from the other machines; of an effect more than any."""
    if t.quantity is None:
        return np.inf
    if t.kind == LEVEL:
        return float(t.quantity.level.t[t.number])
    assert t.quantity.trend is not None
    return float(t.quantity.trend.t[int(np.searchsorted(t.quantity.dated, t.number))])


def ranged(result: FleetResult) -> list[tuple[str, int, list[Quantity]]]:
    """Types whose ranges are drawn: name, number of the first machine, and the quantities that move the tool most."""
    panels = []
    start = 0
    for t in result.compared.types:
        known = [q for q in t.quantities if np.isfinite(q.moves) and not q.what.is_log and np.isfinite(q.level.p).any()]
        known.sort(key=lambda q: -q.moves * (abs(q.level.mean) + BAND * q.level.spread))
        if known:
            panels.append((t.name, start, known[:MOST_RANGES]))
        start += len(t.machines)
    return panels[:MOST_TYPES]


def draw_ranges(result: FleetResult) -> Figure | None:
    """What is normal of each type, at the tool: mean and 95 % of the machines; dots are machines that are out."""
    panels = ranged(result)
    if not panels:
        return None
    out = {(t.machine, id(t.quantity)) for ts in result.found.values() for t in ts if t.kind == LEVEL}
    down = ceil(len(panels) / 2)
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, down * 2.75), facecolor="white")
    for k, (name, first, quantities) in enumerate(panels):
        axes = style.panel(figure, 0.75 + 4.05 * (k % 2), down * 2.75 - 2.75 * (k // 2) - 2.3, 3.05, 1.95)
        _ranges(axes, quantities, first, out)
        style.dress(axes, x="µm at the tool", title=style.plain(name, 36))
        axes.set_yticks(range(len(quantities)), [style.plain(q.what.id, 14) for q in quantities])
        axes.tick_params(axis="y", labelsize=7)
        axes.xaxis.set_major_locator(MaxNLocator(5, steps=style.TICK_STEPS))
        axes.invert_yaxis()
    return figure


def _ranges(axes: Axes, quantities: list[Quantity], first: int, out: set[tuple[int, int]]) -> None:
    axes.use_sticky_edges = False  # a bar at the edge would look cut off
    for y, q in enumerate(quantities):
        scale, level = 1e3 * q.moves, q.level
        axes.barh(
            y, 2 * BAND * level.spread * scale, left=(level.mean - BAND * level.spread) * scale, height=0.62,
            color=STATES["normal"][0],
        )  # fmt: skip
        axes.plot([level.mean * scale] * 2, [y - 0.31, y + 0.31], color=style.INK, lw=1.4)
        odd = [k for k, m in enumerate(q.machines) if (first + int(m), id(q)) in out]
        axes.plot(q.each.values[odd] * scale, [y] * len(odd), "o", ms=3, color=STATES[LEVEL][0], mec="white", mew=0.4)
    axes.axvline(0, color=style.MUTED, lw=0.7)


def draw_trends(result: FleetResult, tests: list[tuple[str, Test]]) -> Figure:
    """Machines that change as no other of their type: each survey, and the line through them."""
    down = ceil(len(tests) / 3)
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, down * 1.95), facecolor="white")
    from identification.results.parameter_table import printed

    for k, (machine, t) in enumerate(tests):
        q = t.quantity
        assert q is not None
        factor, unit = printed(q.what.unit)
        entries = [e for e in result.collected.machines()[machine] if e.data is not None]
        rows = [(1970 + e.row.date, *(float(v[0]) for v in e.estimates.of([q.what])[:2])) for e in entries]
        dates, values, variances = (np.array(c) for c in zip(*rows, strict=True))
        axes = style.panel(figure, 0.55 + 2.65 * (k % 3), down * 1.95 - 1.95 * (k // 3) - 1.6, 2.0, 1.3)
        axes.axhspan(*_band(q, factor), color=STATES["normal"][0], alpha=0.5, lw=0)
        bars = 2 * np.sqrt(variances) * factor
        axes.errorbar(dates, values * factor, bars, fmt="o", ms=3.5, color=STATES[TREND][0], lw=1)
        ends = np.array([np.nanmin(dates), np.nanmax(dates)])
        middle, slope = q.each.values[t.number], q.each.trends[t.number]
        axes.plot(ends, factor * (middle + slope * (ends - np.nanmean(dates))), color=style.INK, lw=1)
        title = f"{style.plain(machine, 14)}: {style.plain(q.what.id, 14)} / {unit}"
        style.dress(axes, title=title)
        axes.xaxis.set_major_locator(MaxNLocator(3, steps=[1, 2, 2.5, 5, 10]))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda year, _: f"{year:.2f}".rstrip("0").rstrip(".")))
    return figure


def _band(q: Quantity, factor: float) -> Array:
    return factor * (q.level.mean + BAND * q.level.spread * np.array([-1.0, 1.0]))


def trends_of(result: FleetResult) -> list[tuple[str, Test]]:
    """The strongest trend of each machine that is out by one, those to visit first before the others."""
    found = result.found
    out = []
    for machine in result.machines["id"]:
        own = [t for t in found.get(machine, []) if t.kind == TREND and not t.quantity.what.is_log]  # type: ignore[union-attr]
        if own:
            out.append((machine, own[0]))
    return out[:MOST_TRENDS]
