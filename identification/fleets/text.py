"""A fleet in words: why a machine is out, what types have in common, and what the command prints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import floor, log10
from typing import TYPE_CHECKING, Any

import numpy as np

from identification.fleets.comparison import EFFECT, TREND, Test
from identification.fleets.false_alarms import CONFIDENCE
from identification.fleets.partial_pooling import LEAST_MACHINES, Normal
from identification.fleets.remarks import Far, Noted, copies
from identification.monitoring.quantities import Watched
from identification.results.parameter_table import decimals, printed
from identification.results.terminal import counted, table_lines

if TYPE_CHECKING:
    from identification.results.fleet_result import FleetResult

MOST_VISITS, MOST_COMMON, MOST_FAILURES, MOST_NOTES = 12, 8, 8, 12  # lines of what the command prints

FEW_WITHIN = 3  # machines, below which one of them may be all that says how much surveys of one machine differ


def reason(test: Test) -> str:
    """Why a machine is out, by one test."""
    if test.kind == EFFECT:
        s = test.shown
        assert s is not None
        seen = f"in {s.surveys} of {counted(s.of, 'survey')}"
        return f"{s.effect} at {s.where}, {short(s.size_um)} µm at the tool, {seen}"
    q, k = test.quantity, test.number
    assert q is not None
    tool = f", {short(test.size_um)} µm at the tool" if np.isfinite(test.size_um) else ""
    if test.kind == TREND:
        assert q.trend is not None
        at = int(np.searchsorted(q.dated, k))
        rate, std = q.each.trends[k], float(np.sqrt(q.each.trend_variances[k]))
        rest = usual(q.what, q.trend, "a year", difference=True)
        change = amount(q.what, rate, std, "a year", difference=True)
        away = f"{abs(q.trend.t[at]):.1f} standard deviations"
        return f"{q.what.name} changes by {change} (of the type {rest}): {away}{tool}"
    own = amount(q.what, q.each.values[k], float(np.sqrt(q.each.variances[k])))
    rest = usual(q.what, q.level)
    return f"{q.what.name} {own} (of the type {rest}): {abs(q.level.t[k]):.1f} standard deviations{tool}"


def usual(what: Watched, of: Normal, per: str = "", difference: bool = False) -> str:
    """Mean and spread of a type; where no spread is seen, how large it may be."""
    if what.is_log and difference:
        return amount(what, of.mean, of.spread, per, difference=True)
    spread = of.high if np.isfinite(of.high) and of.high > 0 else of.mean_std
    if of.spread > 0.05 * spread:  # it has digits beside the interval's
        return amount(what, of.mean, of.spread, per, difference, min(of.spread, of.mean_std))
    mean, _, rest = amount(what, of.mean, spread, per, difference).partition(" ± ")
    return f"{mean}, spread below {rest}"


def amount(what: Watched, value: float, std: float, per: str = "", difference: bool = False, least: float = 0.0) -> str:
    """A value with its standard deviation, as people read it; of a logarithm the change in per cent.

    Parameters
    ----------
    least : standard deviation that gives the digits where `std` is smaller.
    """
    if what.is_log:
        if difference:
            return f"{100 * np.expm1(value):+.0f} % {per}".rstrip()
        shown = what.shown(value)
        return f"{shown:.{decimals(shown * std)}f} ± {shown * std:.{decimals(shown * std)}f} {what.shown_unit}".rstrip()
    factor, unit = printed(what.unit)
    places = decimals(factor * max(std, least))
    return f"{factor * value:z.{places}f} ± {factor * std:.{places}f} {unit} {per}".rstrip()


def short(value: float) -> str:
    """A number of um in two or three digits."""
    if not np.isfinite(value) or value <= 0:
        return "0" if value == 0 else "–"
    return f"{value:.{max(1 - floor(log10(value)), 0)}f}" if value < 100 else f"{value:.0f}"


def common_text(row: Any) -> str:
    """What a type has in common, in a sentence."""
    if row["kind"] == "effect":
        more = ", far more than" if row["special"] else ","
        rest = "" if np.isnan(row["others"]) else f"{more} {100 * row['others']:.0f} % of the other types"
        return (
            f"{row['type']}: {row['name']} at {row['where']} in {row['machines']} of {row['of']} machines "
            f"({100 * row['low']:.0f} to {100 * row['high']:.0f} %){rest}; {short(row['size_um'])} µm at the tool"
        )
    factor, unit = printed(row["unit"])
    places = decimals(factor * row["mean_std"])
    name = f"{row['symbol']} ({row['name']})" if row["symbol"] else row["name"]
    rest = "" if np.isnan(row["others"]) else f"; of the other types {factor * row['others']:.{places}f}"
    tool = f"; {short(row['size_um'])} µm at the tool" if np.isfinite(row["size_um"]) else ""
    mean = f"{factor * row['mean']:.{places}f} ± {factor * row['mean_std']:.{places}f} {unit}"
    return f"{row['type']}: {name} is {mean} in the mean, of one sign in {100 * row['rate']:.0f} %{rest}{tool}"


def few_lines(result: FleetResult) -> Iterator[str]:
    """Types of which one or two machines say how much surveys of one machine differ."""
    few = {}
    for t in result.compared.types:
        least = min((q.each.shown for q in t.quantities if q.each.shown), default=0)
        if 0 < least < FEW_WITHIN and len(t.machines) > least:
            few[t.name] = f"{least} of {counted(len(t.machines), 'machine')} of {t.name}"
    if few:
        said = ", ".join(few.values())
        yield f"how much surveys of one machine differ beyond their uncertainty is known from few: {said}"


def far_text(far: Far) -> str:
    """A survey that lies apart, in a sentence."""
    e, q = far.entry, far.quantity
    (own,), (variance,), _ = e.estimates.of([q.what])
    value = amount(q.what, float(own), float(np.sqrt(variance)))
    return (
        f"row {e.row.number}, {e.row.id}: {e.row.survey}, {far.quantities} of {far.of} quantities; {q.what.name} "
        f"{value} (of the type {usual(q.what, q.level)})"
    )


def note_text(note: Noted, most: int = 3) -> str:
    """A note with the surveys that have it."""
    who = [f"{e.row.id} ({e.row.survey})" for e in note.entries[:most]]
    more = f" and {len(note.entries) - most} more" if len(note.entries) > most else ""
    return f"{note.text}: {', '.join(who)}{more}"


def listed(lines: Sequence[str], most: int, where: str) -> Iterator[str]:
    """Lines, the first of them, and where the others are."""
    yield from (f"  {line}" for line in lines[:most])
    if len(lines) > most:
        yield f"  and {len(lines) - most} more in {where}"


def headline(result: FleetResult) -> str:
    """The result in a sentence."""
    machines, failed = len(result.machines), len(result.failures)
    types = len(result.compared.types)
    out = len(result.found)
    said = f"{counted(machines, 'machine')} of {counted(types, 'type')}, {counted(len(result.surveys), 'survey')}: "
    said += f"{out} {'is' if out == 1 else 'are'} out"
    common = int(result.common["common"].sum()) if len(result.common) else 0
    said += (
        f"; {common} {'thing that a type has' if common == 1 else 'things that types have'} in common" if common else ""
    )
    alarms = int((result.machines["state"] == "alarm").sum())
    said += f"; {counted(alarms, 'machine')} in alarm" if alarms else ""
    return said + (f"; {failed} of {counted(len(result.surveys), 'survey')} failed" if failed else "")


def fleet_lines(result: FleetResult) -> Iterator[str]:
    """What the command prints."""
    yield headline(result)
    sure = f"with {100 * CONFIDENCE:g} % confidence"
    yield f"of machines called out at most {100 * result.compared.rate:g} % are false alarms, {sure}"
    small = [t.name for t in result.compared.types if not any(np.isfinite(q.level.p).any() for q in t.quantities)]
    if small:
        yield f"fewer than {LEAST_MACHINES} machines, too few to call one out: {', '.join(small[:5])}"
    yield from few_lines(result)
    visit = result.machines[result.machines["out"] | (result.machines["state"] == "alarm")]
    if len(visit):
        yield "\nvisit first"
        rows = [
            [str(row["rank"]), str(row["id"]), str(row["type"]), short(row["effect_um"]), str(row["why"])]
            for _, row in visit.head(MOST_VISITS).iterrows()
        ]
        yield from table_lines([["", "machine", "type", "µm", "why"], *rows], ">< ><".replace(" ", "<"), indent=2)
        if len(visit) > MOST_VISITS:
            yield f"  and {len(visit) - MOST_VISITS} more in machines.csv"
    common = result.common[result.common["common"]] if len(result.common) else result.common
    if len(common):
        yield "\nin common"
        shown = common.sort_values("size_um", ascending=False, kind="stable")
        yield from (f"  {common_text(row)}" for _, row in shown.head(MOST_COMMON).iterrows())
        if len(common) > MOST_COMMON:
            yield f"  and {len(common) - MOST_COMMON} more in common.csv"
    if result.far:
        yield "\nsurveys apart from their machine and its type"
        yield from listed([far_text(f) for f in result.far], MOST_FAILURES, "fleet.json")
    said = [note_text(n) for n in result.notes] + list(copies(result.collected))
    if said:
        yield "\nnotes"
        yield from listed(said, MOST_NOTES, "fleet.json")
    if not result.complete:
        yield "\nfailed"
        for _, row in result.failures.head(MOST_FAILURES).iterrows():
            yield f"  row {row['row']}, {row['id']}: {row['message']}"
        if len(result.failures) > MOST_FAILURES:
            yield f"  and {len(result.failures) - MOST_FAILURES} more in failures.csv"
