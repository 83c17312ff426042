"""Lines that `monitor` prints."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from identification.monitoring.alarms import alarm_text, value_text
from identification.monitoring.control_limits import MIN_CYCLES, USEFUL_CYCLES
from identification.monitoring.monitor import Monitored
from identification.results.terminal import table_lines

MOST_QUANTITIES = 6  # quantities listed, those nearest to their limits; by judgement


def monitor_lines(result: Monitored) -> Iterator[str]:
    """The status, each alarm, and the quantities nearest to leaving their range."""
    record, judged = result.record, result.judged
    again = ", which the history has already" if result.before else ""
    yield f"{result.stored.chain.machine.name}: cycle {record.number}{again}"
    if judged.learning:
        yield f"learning: {result.learned} earlier cycles; a range needs {MIN_CYCLES}, and a useful one {USEFUL_CYCLES}"
    elif record.status == "alarm":
        taken = "accepted into the normal range" if record.accepted else "not taken into the normal range (--accept)"
        yield f"ALARM, {taken}: {alarm_text(result.alarms)}"
    else:
        yield f"normal, beside {result.learned} cycles; false alarms in {100 * judged.rate:g} % of cycles at most"
    for number, alarm in enumerate(result.alarms, start=1):
        yield f"\n{number}. {alarm['statement']}"
    near = [k for k in np.argsort(-judged.reach) if np.isfinite(judged.reach[k])][:MOST_QUANTITIES]
    rows = [["nearest to their limits", "now", "from", "to", ""]]
    for k in near:
        w, std = result.what[k], record.cycle.std[k]
        cells = (value_text(w, v, std) for v in (record.cycle.values[k], judged.low[k], judged.high[k]))
        rows.append([f"  {w.name}", *cells, w.shown_unit.replace("µ", "u")])
    if near:
        yield ""
        yield from table_lines(rows, "<>>><", least=8)
    if result.unseen:
        names = ", ".join(w.id for w in result.unseen[:4]) + (" ..." if len(result.unseen) > 4 else "")
        yield f"\nnot shown by this cycle: {len(result.unseen)} of {len(result.what)} quantities ({names})"
