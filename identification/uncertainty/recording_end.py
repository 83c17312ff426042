"""What later commands go on with from a recording: temperatures that act late, and its last run.

A first-order lag forgets slowly: what it is at a command depends on temperatures that were recorded before it, and on
those between. What differs from run to run (a station that was moved, an axis that was homed anew) stays in later runs
as it was in the last recorded one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Mask
from errormodel.chain import Chain
from errormodel.channels import DERIVED_CHANNEL, channel, run_of
from errormodel.temperature_courses import clocks

if TYPE_CHECKING:
    import pandas as pd

    from errormodel.survey import Survey

LAST_ROW = 1e9  # number of a row after all that were recorded, where nothing says how many these were
MOST_TIMES = 200  # of a recording that are kept: a time constant is seldom as short as a hundredth of it
Recorded = Mapping[str, Sequence[Sequence[float]]]  # of each sensor that acts late: times (s), temperatures (degC)


def lags(channels: Iterable[str]) -> Iterator[tuple[int, str, str, float]]:
    """Lagged ones among the channels of a model: number, name, base channel and time constant, s."""
    for number, name in enumerate(channels):
        call = DERIVED_CHANNEL.fullmatch(name)
        if call and call[1] in ("lag", "initial"):
            yield number, name, call[2], float(call[3])


def complete(table: pd.DataFrame) -> bool:
    """Whether a table has times in all rows."""
    return "time" in table and bool(table["time"].notna().all())


def late_sensors(chain: Chain) -> list[str]:
    """Base channels that act late in a model, each once."""
    return list(dict.fromkeys(base for _, _, base, _ in lags(chain.channels)))


def temperatures_of(models: Iterable[Iterable[str]], table: pd.DataFrame) -> dict[str, list[list[float]]]:
    """What a recording has of each sensor that acts late; nothing where its rows have several clocks, or one time.

    Parameters
    ----------
    models : the channels of a model, and of others that the recording leaves open.
    """
    out = {}
    for base in dict.fromkeys(base for channels in models for _, _, base, _ in lags(channels)):
        if is_series(table, base):
            time = channel(table, "time")
            kept = np.argsort(time, kind="stable")
            kept = kept[np.unique(np.linspace(0, len(kept) - 1, MOST_TIMES).astype(int))]
            out[base] = [time[kept].tolist(), channel(table, base)[kept].tolist()]
    return out


def is_series(table: pd.DataFrame, base: str) -> bool:
    """Whether a column was recorded on one clock that runs; rows at one time are states, each in equilibrium."""
    if base not in table or "time" not in table or np.ptp(clocks(table, base)):
        return False
    return bool(np.ptp(channel(table, "time")) > 0)


def continued(chain: Chain, recorded: Recorded, table: pd.DataFrame, columns: list[Array]) -> list[Array]:
    """The columns of commands, of which lagged channels go on from what was recorded before each, and between them.

    Between two rows the temperature is taken to change evenly. Of what differed from it in the recording's first row
    nothing is left where the commands have no clock in common with it.
    """
    out, series = list(columns), on_one_clock(chain, recorded, table)
    for number, name, base, _ in lags(chain.channels):
        if base in series:
            out[number] = channel(series[base], name)[-len(table) :]
        elif name.startswith("initial("):
            out[number] = np.zeros(len(table))
    return out


def on_one_clock(chain: Chain, recorded: Recorded, table: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Of each sensor that acts late what was recorded and the commands after it, where they have a clock in common."""
    series = {base: _joined(recorded.get(base), table, base) for base in late_sensors(chain)}
    return {base: both for base, both in series.items() if both is not None}


def _joined(recorded: Sequence[Sequence[float]] | None, table: pd.DataFrame, base: str) -> pd.DataFrame | None:
    """Times and temperatures recorded, and those of the commands after them; None where they have no clock in common.

    Commands that begin before the recording's end have its clock if their temperatures are those that were recorded at
    these times (`clocks`).
    """
    import pandas as pd

    if recorded is None or not is_series(table, base):
        return None
    own = [channel(table, name) for name in ("time", base)]
    time, values = (np.concatenate([before, after]) for before, after in zip(recorded, own, strict=True))
    run = np.repeat(["recorded", "commanded"], [len(recorded[0]), len(table)])
    both = pd.DataFrame({"time": time, base: values, "run": run, "file": ""})
    return None if np.ptp(clocks(both, base)) else both


def started_anew(chain: Chain, recorded: Recorded, table: pd.DataFrame) -> Iterator[str]:
    """A note on lagged channels that do not go on from the recording: they start in equilibrium."""
    series = on_one_clock(chain, recorded, table)
    if not complete(table):
        return
    if names := [base for base in late_sensors(chain) if base not in series]:
        yield (
            f"{', '.join(names)} acts late, and what it was before the first row is not known: it is "
            "taken to have been as in that row for long (in each row, where all have one time). Times on the "
            "recording's clock, within it or after its end, continue what was recorded"
        )


def after_gaps(chain: Chain, recorded: Recorded, table: pd.DataFrame) -> Iterator[str]:
    """Notes on temperatures that act late, and that nothing tells of for longer than they do before the first row."""
    series, longer = on_one_clock(chain, recorded, table), dict[str, tuple[float, float]]()
    for _, _, base, tau in lags(chain.channels):
        if base in series and (gap := channel(table, "time").min() - max(recorded[base][0])) > tau:
            longer.setdefault(base, (gap, tau))
    for base, (gap, tau) in longer.items():
        yield (
            f"{base} acts {tau / 60:.3g} min late, and what it was in the {gap / 3600:.2g} h between the recording "
            "and the first row is not known: it is taken to have changed evenly, and the uncertainty allows for "
            "changes like those that were recorded. Add rows with its temperatures in between"
        )


def runs_of(chain: Chain, table: pd.DataFrame) -> list[str]:
    """Labels of a recording's runs, that of its last row last; none where no channel of the model is a run's."""
    if "run" not in table or not any(map(run_of, chain.channels)):
        return []
    return [*dict.fromkeys(table["run"].astype(str)[::-1])][::-1]


def with_runs(points: Survey) -> pd.DataFrame:
    """The table of commands, of which the runs are empty where the file has none: they are none of those recorded."""
    return points.table if points.labelled else points.table.assign(run="")


def in_last_run(chain: Chain, runs: Sequence[str], table: pd.DataFrame, columns: list[Array]) -> list[Array]:
    """The columns of later commands, of which rows of runs that were not recorded are as in the last recorded one."""
    if not runs:
        return columns
    later = _not_recorded(runs, table)
    return [
        np.where(later, float(label == runs[-1]), column) if (label := run_of(name)) else column
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
    names = ", ".join(filter(None, dict.fromkeys(table["run"].astype(str)[later])))
    what = " and ".join(filter(None, map(run_of, chain.channels)))
    why = f"run {names} was not recorded" if names else "the commands have no column run"
    yield (
        f"{why}: what differs in run {what} is predicted as the recording ended, in run "
        f"{runs[-1]}. Write the label of a recorded run to have it as in that"
    )


def _not_recorded(runs: Sequence[str], table: pd.DataFrame) -> Mask:
    """Rows (n,) of runs that are not among the recorded ones."""
    return ~table["run"].astype(str).isin(runs).to_numpy(dtype=bool)
