"""What tables for a temperature suppose: that the machine has had it long enough for all that follows it late."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from errormodel.channels import DERIVED_CHANNEL, channel
from identification.compensation.field import Field
from identification.diagnosis.results.driver_words import duration

if TYPE_CHECKING:
    import pandas as pd

NEAR_K = 0.5  # K beyond the temperatures that were measured: a sensor is no better
SETTLED = 3.0  # time constants of a lag, after which a twentieth of a change is to come


def late_lines(field: Field, own: bool, table: pd.DataFrame, states: Sequence[Mapping[str, float]]) -> Iterator[str]:
    """For each temperature that acts behind a lag, when its tables are right, and which lie beyond what was measured.

    Parameters
    ----------
    own : whether the control corrects by the temperature itself, with a law of its own.
    table : rows of the survey.
    states : temperatures (degC) of the sets of tables.
    """
    lags = dict[str, tuple[float, str]]()
    for late in field.chain.channels:
        if (call := DERIVED_CHANNEL.fullmatch(late)) and call[1] == "lag":
            lags[call[2]] = max(lags.get(call[2], (0.0, "")), (float(call[3]), late))
    for name, (tau, late) in lags.items():
        line = (
            f"errors follow {name} late (behind a lag of {duration(tau)}): what is written for a temperature is "
            f"right once the machine has had it for {duration(SETTLED * tau)}"
        )
        if own:
            line += f". A control that corrects by {name} itself takes it behind that lag: filter it so in the PLC"
        yield line
        had = channel(table, late)
        low, high = float(had.min()), float(had.max())
        beyond = [s[name] for s in states if name in s and not low - NEAR_K <= s[name] <= high + NEAR_K]
        if beyond:
            yield (
                f"what follows {name} late had {low:.1f} to {high:.1f} degC in the survey: the tables for "
                f"{' and '.join(f'{t:.1f}' for t in beyond)} degC are carried on beyond that, and their figures do not "
                "hold what is not known there; predict states it. Measure once the machine has had these temperatures "
                "for long"
            )
