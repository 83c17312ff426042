"""Page of a fleet: the map of its machines, those to visit first, what is common and what is normal, failures."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel import __version__
from identification.fleets.comparison import EFFECT, LEVEL
from identification.fleets.false_alarms import CONFIDENCE
from identification.fleets.remarks import copies
from identification.fleets.text import amount, common_text, far_text, few_lines, headline, note_text, short, usual
from identification.plots.fleet import (
    MOST_RANGES,
    MOST_TYPES,
    STATES,
    draw_map,
    draw_matrix,
    draw_ranges,
    draw_trends,
    ranged,
    trends_of,
)  # fmt: skip
from identification.report.page import page
from identification.report.pictures import Picture, picture

if TYPE_CHECKING:
    from identification.fleets.collecting import Collected
    from identification.results.fleet_result import FleetResult

MOST_VISITS, MOST_COMMON, MOST_FAILURES, MOST_NORMAL = 40, 20, 40, 12  # rows of the tables; CSV and Parquet have all
MOST_TILES = 5000  # that have a tooltip and a link each; with more machines the map is a picture
MOST_NAMED = 60  # machines of a type whose tiles have room for their names
TILE_CHARACTERS = 11  # of a name; of a longer one the end, where names of one type differ
MOST_LINKS = 6  # parts of a machine
MOST_NOTES = 40

DARK = {STATES[s][0] for s in (LEVEL, EFFECT, "alarm", "no result")}  # that bear white letters


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
        confidence=f"{100 * CONFIDENCE:g}",
        check=bool(len(visit)) or not result.complete,
        map=[] if len(machines) <= MOST_TILES else [_map(result)],
        tiles=_tiles(result) if len(machines) <= MOST_TILES else [],
        states=[
            (colour, f"{words} ({n})")
            for s, (colour, words) in STATES.items()
            if (n := int((machines["state"] == s).sum()))
        ],
        matrix=[_matrix(result)] if result.found else [],
        ranges=_ranges(result),
        trends=_trends(result),
        visit=[_visit(result, row) for _, row in visit.head(MOST_VISITS).iterrows()],
        more_visits=max(len(visit) - MOST_VISITS, 0),
        common=[common_text(row) for _, row in common.head(MOST_COMMON).iterrows()],
        more_common=max(len(common) - MOST_COMMON, 0),
        types=_types(result),
        few=list(few_lines(result)),
        far=[far_text(f) for f in result.far[:MOST_NOTES]],
        more_far=max(len(result.far) - MOST_NOTES, 0),
        notes=[note_text(n, MOST_NOTES) for n in result.notes[:MOST_NOTES]]
        + list(copies(result.collected))[:MOST_NOTES],
        more_notes=max(len(result.notes) - MOST_NOTES, 0),
        failures=[list(map(str, row)) for row in _failures(result)],
        more_failures=max(len(result.failures) - MOST_FAILURES, 0),
        version=__version__,
    )


def _failures(result: FleetResult) -> list[Any]:
    return list(result.failures[["row", "id", "survey", "message"]].head(MOST_FAILURES).itertuples(index=False))


def _visit(result: FleetResult, row: Any) -> dict[str, Any]:
    q = "–" if not np.isfinite(row["q"]) else f"{row['q']:.1g}"
    collected = result.collected
    entries = [e for e in collected.machines()[row["id"]] if e.part][:MOST_LINKS]
    return {
        "rank": row["rank"], "id": row["id"], "type": row["type"], "um": short(row["effect_um"]), "q": q,
        "why": row["why"], "labels": _labels(result, row),
        "parts": [(_link(e.part, collected), e.row.dated or f"row {e.row.number}") for e in entries],
    }  # fmt: skip


def _labels(result: FleetResult, row: Any) -> str:
    return ", ".join(f"{c} {row[c]}" for c in result.collected.listing.labels if row[c])


def _link(part: str, collected: Collected) -> str:
    """Address of a part from the page: its report where it has one, else its folder."""
    from urllib.parse import quote

    report = collected.reports and collected.command in ("fit", "diagnose")
    return quote(f"{part}/{'report.html' if report else ''}")


def _tiles(result: FleetResult) -> list[tuple[str, bool, list[dict[str, str]]]]:
    """Of each type its name, whether tiles show names, and a tile for each machine in the order of the list."""
    rows = result.machines.set_index("id")
    by_type: dict[str, list[dict[str, str]]] = {}
    for identity, entries in result.collected.machines().items():
        row = rows.loc[identity]
        colour, words = STATES[str(row["state"])]
        parts = [e.part for e in entries if e.part]
        link = _link(parts[0], result.collected) if len(parts) == 1 else parts[0].rpartition("/")[0] if parts else ""
        failed = f"{row['failed']} of {row['surveys']} surveys failed" if row["failed"] and parts else ""
        said = ". ".join(filter(None, (f"{identity}: {words}", _labels(result, row), failed, str(row["why"]))))
        short = identity if len(identity) <= TILE_CHARACTERS else f"…{identity[1 - TILE_CHARACTERS :]}"
        tile = {
            "name": identity,
            "short": short,
            "title": said,
            "colour": colour,
            "link": link,
            "dark": "y" * (colour in DARK),
        }
        by_type.setdefault(str(row["type"]), []).append(tile)
    return [(name, len(own) <= MOST_NAMED, own) for name, own in by_type.items()]


def _map(result: FleetResult) -> Picture:
    order = list(result.collected.machines())
    return picture(
        partial(draw_map, result.machines, order),
        "Every machine is a tile, in the order of the list and a block for each type; its colour is what was found.",
        f"Map of {len(order)} machines by what was found of them",
        "png",
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
    drawn = {id(q) for _, _, quantities in ranged(result) for q in quantities}
    bare = [
        m for m, tests in result.found.items() if not any(t.kind == LEVEL and id(t.quantity) in drawn for t in tests)
    ]
    more = f" Out by something else, and without a dot here: {', '.join(bare[:MOST_VISITS])}." if bare else ""
    return [
        picture(
            lambda: figure,
            "What is normal of each type, root mean square at the tool over a survey: the line is the mean, the band "
            "holds 95 % of the machines, dots are machines that are out. Of each of "
            f"{MOST_TYPES} types at most, the {MOST_RANGES} quantities that move the tool most.{more}",
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
                [q.what.id, q.what.symbol, usual(q.what, q.level),
                 within.partition(" ±")[0], trend, str(int(q.level.kept.sum()))]
            )  # fmt: skip
        found = sum(m in result.found for m in t.machines)
        counts = f"{len(t.machines)} machines with results, {found} out"
        out.append((t.name, counts, rows, max(len(t.quantities) - MOST_NORMAL, 0)))
    return out
