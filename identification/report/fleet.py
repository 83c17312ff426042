"""Page of a fleet: the map of its machines, those to visit first, what is common and what is normal, failures."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel import __version__
from identification.fleets.text import amount, common_text, headline, short
from identification.plots.fleet import draw_map, draw_matrix, draw_ranges, draw_trends, trends_of
from identification.report.page import page
from identification.report.pictures import Picture, picture

if TYPE_CHECKING:
    from identification.results.fleet_result import FleetResult

MOST_VISITS, MOST_COMMON, MOST_FAILURES, MOST_NORMAL = 40, 20, 40, 12  # rows of the tables; CSV and Parquet have all
MOST_TILES = 400  # of an SVG: with more a PNG is smaller


def fleet_page(result: FleetResult) -> str:
    """``fleet.html``: a self-contained HTML page; same input, same text."""
    machines = result.machines
    visit = machines[machines["out"] | (machines["state"] == "alarm")]
    common = result.common[result.common["common"]] if len(result.common) else result.common
    common = common.sort_values("size_um", ascending=False, kind="stable") if len(common) else common
    return page(
        "fleet.html",
        name=result.collected.listing.name,
        command=result.collected.command,
        headline=headline(result),
        rate=f"{100 * result.compared.rate:g}",
        check=bool(len(visit)) or not result.complete,
        map=_map(result),
        matrix=[_matrix(result)] if result.found else [],
        ranges=_ranges(result),
        trends=_trends(result),
        visit=[_visit(row) for _, row in visit.head(MOST_VISITS).iterrows()],
        more_visits=max(len(visit) - MOST_VISITS, 0),
        common=[common_text(row) for _, row in common.head(MOST_COMMON).iterrows()],
        more_common=max(len(common) - MOST_COMMON, 0),
        types=_types(result),
        failures=[list(map(str, row)) for row in _failures(result)],
        more_failures=max(len(result.failures) - MOST_FAILURES, 0),
        version=__version__,
    )


def _failures(result: FleetResult) -> list[Any]:
    return list(result.failures[["row", "id", "survey", "message"]].head(MOST_FAILURES).itertuples(index=False))


def _visit(row: Any) -> list[str]:
    q = "–" if not np.isfinite(row["q"]) else f"{row['q']:.1g}"
    return [str(row["rank"]), str(row["id"]), str(row["type"]), short(row["effect_um"]), q, str(row["why"])]


def _map(result: FleetResult) -> Picture:
    order = list(result.collected.machines())
    return picture(
        partial(draw_map, result.machines, order),
        "Every machine is a tile, in the order of the list and a block for each type; its colour is what was found.",
        f"Map of {len(order)} machines by what was found of them",
        "png" if len(order) > MOST_TILES else "svg",
    )


def _matrix(result: FleetResult) -> Picture:
    return picture(
        partial(draw_matrix, result),
        "Machines to visit first, and by what they are out: numbers are standard deviations from the other machines of "
        "the type, ✓ an effect of the machine's own.",
        "Table of machines and quantities, coloured by the distance from the other machines",
    )


def _ranges(result: FleetResult) -> list[Picture]:
    figure = draw_ranges(result)
    if figure is None:
        return []
    return [
        picture(
            lambda: figure,
            "What is normal of each type, root mean square at the tool over a survey: the line is the mean, the band "
            "holds 95 % of the machines, dots are machines that are out.",
            "Bars of the normal range of each quantity, a panel a type",
        )
    ]


def _trends(result: FleetResult) -> list[Picture]:
    tests = trends_of(result)
    if not tests:
        return []
    return [
        picture(
            partial(draw_trends, result, tests),
            "Machines that change as no other of their type: surveys with two standard uncertainties, the line through "
            "them, and the range of the type.",
            "Values of single machines over the years",
        )
    ]


def _types(result: FleetResult) -> list[tuple[str, str, list[list[str]], int]]:
    """Name, counts and rows of each type: the quantities that differ most between its machines."""
    out = []
    for t in result.compared.types:
        order = sorted(t.quantities, key=lambda q: -np.nan_to_num(q.moves * (abs(q.level.mean) + q.level.spread)))
        rows = []
        for q in order[:MOST_NORMAL]:
            trend = "–"
            if q.trend is not None and not q.what.is_log:
                trend = amount(q.what, q.trend.mean, q.trend.mean_std)
            within = (
                "–"
                if np.isnan(q.each.within) or q.what.is_log
                else amount(q.what, q.each.within, q.each.within, least=q.level.mean_std)
            )
            rows.append(
                [q.what.id, q.what.symbol, amount(q.what, q.level.mean, q.level.spread, least=q.level.mean_std),
                 within.partition(" ±")[0], trend, str(int(q.level.kept.sum()))]
            )  # fmt: skip
        found = sum(m in result.found for m in t.machines)
        counts = f"{len(t.machines)} machines with results, {found} out"
        out.append((t.name, counts, rows, max(len(t.quantities) - MOST_NORMAL, 0)))
    return out
