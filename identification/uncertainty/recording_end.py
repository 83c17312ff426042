"""What later commands go on with from the recording's end: lagged temperatures on one clock, and its last run.

A first-order lag forgets: of its state before only one number is left. What follows differs from a lag that starts in
equilibrium by ``(state - temperature) exp(-t/tau)``. What differs from run to run (a station that was moved, an axis
that was homed anew) stays in later runs as it was in the last recorded one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Mask
from errormodel.chain import Chain
from errormodel.channels import DERIVED_CHANNEL, channel, clocks, lagged

if TYPE_CHECKING:
    import pandas as pd

LAST_ROW = 1e9  # number of a row after all that were recorded, where nothing says how many these were
History = Mapping[str, Sequence[float]]  # of each lagged channel: time (s), temperature and lagged temperature (degC)


def _lags(chain: Chain) -> Iterator[tuple[int, str, str, float]]:
    """Lagged channels of a model: number, name, base channel and time constant, s."""
    for number, name in enumerate(chain.channels):
        call = DERIVED_CHANNEL.fullmatch(name)
        if call and call[1] == "lag":
            yield number, name, call[2], float(call[3])


def history_of(chain: Chain, table: pd.DataFrame) -> dict[str, list[float]]:
    """State of each lagged channel at the end of a recording; none of a channel whose rows have several clocks."""
    out = {}
    for _, name, base, _ in _lags(chain):
        if base not in table or "time" not in table or np.ptp(clocks(table, base)):
            continue
        time = channel(table, "time")
        last = int(np.argmax(time))
        if time[last] > time.min():
            out[name] = [float(values[last]) for values in (time, channel(table, base), channel(table, name))]
    return out


def continued(chain: Chain, history: History, table: pd.DataFrame, columns: list[Array]) -> list[Array]:
    """The columns of later commands, of which lagged channels go on from the recording's end.

    Between the end and the first row the temperature is taken to change evenly. Rows at one time are states, each in
    equilibrium; rows that begin before the recording's end have another clock, or other temperatures.
    """
    out = list(columns)
    for number, name, base, tau in _lags(chain):
        if not _goes_on(history.get(name), table, base):
            continue
        end, warm, state = history[name]
        time, values = channel(table, "time"), channel(table, base)
        first = int(np.argmin(time))
        start = lagged(np.array([end, time[first]]), np.array([warm, values[first]]), tau)[1]
        start += (state - warm) * np.exp(-(time[first] - end) / tau)
        out[number] = columns[number] + (start - values[first]) * np.exp(-(time - time[first]) / tau)
    return out


def _goes_on(state: Sequence[float] | None, table: pd.DataFrame, base: str) -> bool:
    """Whether commands have one clock, and come after the recording's end."""
    if state is None or np.ptp(clocks(table, base)):
        return False
    time = channel(table, "time")
    return bool(time.min() >= state[0] and np.ptp(time) > 0)


def started_anew(chain: Chain, history: History, table: pd.DataFrame) -> Iterator[str]:
    """A note on lagged channels that do not go on from the recording: they start in equilibrium."""
    names = [base for _, name, base, _ in _lags(chain) if not _goes_on(history.get(name), table, base)]
    if names:
        yield (
            f"{', '.join(dict.fromkeys(names))} acts late, and what it was before the first row is not known: it is "
            "taken to have been as in that row for long (in each row, where all have one time). Times that go on after "
            "the recording's end, on its clock, continue it"
        )


def runs_of(chain: Chain, table: pd.DataFrame) -> list[str]:
    """Labels of a recording's runs, that of its last row last; none where no channel of the model is a run's."""
    if "run" not in table or not any(map(_run_of, chain.channels)):
        return []
    return [*dict.fromkeys(table["run"].astype(str)[::-1])][::-1]


def in_last_run(chain: Chain, runs: Sequence[str], table: pd.DataFrame, columns: list[Array]) -> list[Array]:
    """The columns of later commands, of which rows of runs that were not recorded are as in the last recorded one."""
    if not runs:
        return columns
    later = _not_recorded(runs, table)
    return [
        np.where(later, float(label == runs[-1]), column) if (label := _run_of(name)) else column
        for name, column in zip(chain.channels, columns, strict=True)
    ]


def after_last_row(chain: Chain, columns: list[Array]) -> list[Array]:
    """The columns of later commands, whose rows follow those of the recording: no clock says how much later."""
    within = [limits for e in chain.machine.effects for limits in e.options.get("within", ())]
    last = max((high for name, _, high, _ in within if name == "row"), default=LAST_ROW)
    return [
        last + np.arange(1.0, len(c) + 1) if name == "row" else c
        for name, c in zip(chain.channels, columns, strict=True)
    ]


def as_in_last_run(chain: Chain, runs: Sequence[str], table: pd.DataFrame) -> Iterator[str]:
    """Notes on what is predicted as the recording ended: in runs that were not recorded, or without a clock."""
    if "row" in chain.channels:
        yield (
            "the recording has no column time: rows are predicted as if they followed its last one. What a name "
            "explains stays as it was there; what has no name returns to its mean as they go on, and its uncertainty "
            "grows to its size"
        )
    if not runs or not (later := _not_recorded(runs, table)).any():
        return
    names = ", ".join(dict.fromkeys(table["run"].astype(str)[later]))
    what = " and ".join(filter(None, map(_run_of, chain.channels)))
    yield (
        f"run {names} was not recorded: what differs in run {what} is predicted as the recording ended, in run "
        f"{runs[-1]}. Write the label of a recorded run to have it as in that"
    )


def _run_of(name: str) -> str:
    """Label of the run whose rows a channel marks; else empty."""
    return name[4:-1] if name.startswith("run(") else ""


def _not_recorded(runs: Sequence[str], table: pd.DataFrame) -> Mask:
    """Rows (n,) of runs that are not among the recorded ones."""
    return ~table["run"].astype(str).isin(runs).to_numpy(dtype=bool)
