"""Map of candidate effects: share of the residuals that each motion of each element explains, by driving channel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from errormodel.arrays import Array
from errormodel.channels import root
from errormodel.conventions import MOTIONS, Motion, iso_symbol
from identification.diagnosis.search.candidates import Ranked
from identification.diagnosis.search.model import EffectModel
from identification.diagnosis.search.scoring import Step
from identification.plots import style
from identification.results.residual_projection import motions

MOST_MAP_ROWS = 42  # rows of the map; beyond, those with the smallest shares are left out
CELL_HEIGHT_IN, MOST_CELL_WIDTH_IN = 0.21, 0.5  # inches: height and largest width of a cell
LEAST_ADDED_SHARE = 0.03  # share that a channel must add to the others of its proposal to be shown; by judgement
LABELLED_SHARE = 0.095  # share from which a cell shows its number; rows and columns with nothing above it are left out
FINDING_COLOUR = "#B84300"  # colour of the frames around findings
Cell = tuple[str, Motion]


@dataclass(frozen=True)
class WhereMap:
    """Shares (rows, columns) of the excess, NaN where nothing exceeds noise; `marks`: cells of findings, by number."""

    rows: list[Cell]
    columns: list[str]
    share: Array
    marks: dict[tuple[int, int], list[int]]


def where_map(
    model: EffectModel, ranking: Sequence[Ranked], numbered: Sequence[tuple[int, Sequence[Step]]]
) -> WhereMap:
    """Best candidate of each cell before any effect is accepted, as a share of the excess of residuals over noise.

    `ranking` is that of the candidates before selection, `numbered` the findings by their number in the report. A
    candidate with several motions or channels counts in all their cells; a channel that adds nothing to the others of
    the candidate does not count.
    """
    start, end = model.start, model.linear
    excess = start.square - start.freedom * end.square / end.freedom
    unit = start.square / start.freedom
    shares: dict[Cell, dict[frozenset[str], float]] = {}
    for effect, _, delta_chi2 in ranking:
        share = float(np.clip(delta_chi2 * unit / max(excess, 1e-300), 0.0, 1.0))
        drivers = frozenset(map(root, effect.drivers))
        for cell in motions(start, [effect]):
            here = shares.setdefault(cell, {})
            here[drivers] = max(here.get(drivers, 0.0), share)
    best: dict[tuple[Cell, str], float] = {}
    for cell, here in shares.items():
        for drivers, share in here.items():
            for driver in drivers:
                if share > here.get(drivers - {driver}, 0.0) + LEAST_ADDED_SHARE:
                    best[cell, driver] = max(best.get((cell, driver), 0.0), share)
    marked: dict[tuple[Cell, str], list[int]] = {}
    for number, group in numbered:
        for cell in motions(start, [group[0].effect]):
            for driver in dict.fromkeys(map(root, group[0].effect.drivers)):
                marked.setdefault((cell, driver), []).append(number)
    return _laid_out(model, best, marked)


def _laid_out(
    model: EffectModel, best: Mapping[tuple[Cell, str], float], marked: Mapping[tuple[Cell, str], list[int]]
) -> WhereMap:
    """Rows in the order of the chain, at most `MOST_MAP_ROWS`; columns: joints, directions, other channels."""
    strongest: dict[Cell, float] = {}
    for (cell, _), share in best.items():
        strongest[cell] = max(strongest.get(cell, 0.0), share)
    strongest |= {cell: 2.0 for cell, _ in marked}  # findings are always shown
    kept = [c for c in sorted(strongest, key=lambda cell: -strongest[cell]) if strongest[c] >= LABELLED_SHARE][
        :MOST_MAP_ROWS
    ]
    names = model.start.chain.element_names
    rows = sorted(kept, key=lambda cell: (names.index(cell[0]), MOTIONS.index(cell[1])))
    joints = [j.name for j in model.start.chain.machine.joints]
    order = [*joints, *(f"dir_{j}" for j in joints)]
    labelled = [key for key, share in best.items() if share >= LABELLED_SHARE and key[0] in kept]
    used = {driver for _, driver in (*labelled, *marked)}
    columns = sorted(used, key=lambda c: (order.index(c) if c in order else len(order), c))
    shares = np.array([[best.get((cell, column), np.nan) for column in columns] for cell in rows])
    marks = {(rows.index(cell), columns.index(driver)): numbers for (cell, driver), numbers in marked.items()}
    return WhereMap(rows, columns, shares.reshape(len(rows), len(columns)), marks)


def draw_where_map(
    model: EffectModel, ranking: Sequence[Ranked], numbered: Sequence[tuple[int, Sequence[Step]]]
) -> Figure:
    """Heat map of :func:`where_map`: darker cells explain more as a single effect; findings are framed."""
    found = where_map(model, ranking, numbered)
    n, m = found.share.shape
    left, wide = 1.55, min(MOST_CELL_WIDTH_IN, 4.7 / m)
    tall = n * CELL_HEIGHT_IN
    names = [_column(c) for c in found.columns]
    slanted = max(map(len, names)) > 3
    top = 0.95 if slanted else 0.35
    height = max(tall, 1.0) + top + 0.1
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, height), facecolor="white")
    axes = style.panel(figure, left, height - top - tall, m * wide, tall)
    style.dress(axes)
    image = axes.imshow(found.share, cmap="Blues", vmin=0, vmax=1, aspect="auto", interpolation="nearest")
    axes.grid(visible=False)
    axes.vlines(np.arange(m + 1) - 0.5, -0.5, n - 0.5, color=style.FAINT, lw=0.6)
    axes.hlines(np.arange(n + 1) - 0.5, -0.5, m - 0.5, color=style.FAINT, lw=0.6)
    axes.tick_params(length=0, labeltop=True, labelbottom=False)
    axes.set_yticks(range(n), [_row(model, cell) for cell in found.rows], size=style.SMALL_TEXT)
    turned: dict[str, Any] = {"rotation": 40, "ha": "left", "rotation_mode": "anchor"} if slanted else {}
    axes.set_xticks(range(m), names, size=style.SMALL_TEXT, **turned)
    axes.spines[:].set_visible(False)
    for (i, j), share in np.ndenumerate(found.share):
        if share >= LABELLED_SHARE and wide > 0.24:
            colour = "white" if share > 0.55 else style.INK
            axes.text(j, i, f"{100 * share:.0f}", size=7, color=colour, ha="center", va="center_baseline")
    by_row: dict[int, list[int]] = {}
    for (i, j), numbers in found.marks.items():
        axes.add_patch(
            Rectangle((j - 0.5, i - 0.5), 1, 1, fill=False, ec=FINDING_COLOUR, lw=2, clip_on=False, zorder=4)
        )
        by_row[i] = sorted({*by_row.get(i, ()), *numbers})
    for i, numbers in by_row.items():
        word = "finding " + ", ".join(map(str, numbers))
        axes.text(m - 0.4, i, word, size=style.SMALL_TEXT, weight="bold", color=FINDING_COLOUR, va="center")
    bar = figure.colorbar(image, cax=style.panel(figure, left + m * wide + 0.75, height - top - 1.0, 0.13, 1.0))
    bar.set_label("share of the\nexcess explained", size=style.SMALL_TEXT, color=style.INK)
    bar.set_ticks([0, 0.5, 1], labels=["0", "50 %", "100 %"])
    bar.ax.tick_params(labelsize=style.SMALL_TEXT, colors=style.MUTED, labelcolor=style.INK, length=2)
    bar.outline.set_visible(False)
    return figure


def _row(model: EffectModel, cell: Cell) -> str:
    element, motion = cell
    joint = any(j.name == element for j in model.start.chain.machine.joints)
    iso = f"  {iso_symbol(element, motion)}" if joint else ""
    return style.plain(f"{element}.{motion}{iso}", 24)


def _column(name: str) -> str:
    return style.plain(f"{name[4:]}, side" if name.startswith("dir_") else name, 18)
