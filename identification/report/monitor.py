"""Report of a monitored machine: status of the cycle, every quantity over the cycles, and the table of ranges."""

from __future__ import annotations

from functools import partial

import numpy as np

from errormodel import __version__
from identification.monitoring.alarms import alarm_text, value_text
from identification.monitoring.control_limits import MIN_CYCLES, USEFUL_CYCLES
from identification.monitoring.monitor import Monitored
from identification.plots.history import draw_history
from identification.report.page import page
from identification.report.pictures import Picture, picture
from identification.report.record_head import head_of


def monitor_page(result: Monitored) -> str:
    """``monitor.html``: a self-contained HTML page."""
    return page(
        "monitor.html",
        machine=result.stored.chain.machine.name,
        result=result,
        headline=_headline(result),
        history=_history(result),
        rows=_rows(result),
        head=head_of(result.test),
        version=__version__,
    )


def _headline(result: Monitored) -> str:
    number, judged = result.record.number, result.judged
    if judged.learning:
        return (
            f"Cycle {number}: learning. {result.learned} earlier cycles; "
            f"a range needs {MIN_CYCLES}, a useful one {USEFUL_CYCLES}."
        )
    if result.record.status == "alarm":
        taken = ", accepted as normal all the same" if result.record.accepted else ""
        return f"Cycle {number}: alarm{taken}. {alarm_text(result.alarms, capital=True)}."
    return f"Cycle {number}: within the normal range of {result.learned} cycles."


def _history(result: Monitored) -> Picture:
    return picture(
        partial(draw_history, result.what, result.records, result.judged),
        "Every watched quantity over the cycles, with bars of ± 2 standard uncertainties; the band is the range that "
        f"cycle {result.record.number} was judged by, cut where it is far wider than the values. Diamonds left their "
        "range; hollow marks are cycles that do not belong to it.",
        "A panel for each quantity: its value against the number of the cycle, the normal range shaded",
    )


def _rows(result: Monitored) -> list[tuple[list[str], bool]]:
    """Cells of the table and alarm state of each quantity; those nearest to their limits first."""
    judged, cycle = result.judged, result.record.cycle
    flagged = judged.flagged
    order = np.lexsort((-np.nan_to_num(judged.reach, nan=-1.0), ~flagged))
    out = []
    for k in order:
        w, std = result.what[k], cycle.std[k]
        values = (cycle.values[k], judged.mean[k], judged.low[k], judged.high[k])
        now, mean, low, high = (value_text(w, v, std) for v in values)
        p, drift = judged.p[k], judged.drift[k]
        cells = [w.group, w.symbol, now, mean, low, high, w.shown_unit, _chance(p), _drift(drift)]
        out.append((cells, bool(flagged[k])))
    return out


def _chance(p: float) -> str:
    if not np.isfinite(p):
        return "-"
    return f"{p:.2f}" if p >= 0.01 else f"{p:.1g}"


def _drift(value: float) -> str:
    return f"{value:+.1f}" if np.isfinite(value) else "-"
