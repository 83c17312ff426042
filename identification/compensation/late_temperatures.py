"""What tables for a temperature suppose: that the machine has had it long enough for all that follows it late."""

from __future__ import annotations

from collections.abc import Iterator

from errormodel.channels import DERIVED_CHANNEL
from identification.compensation.field import Field
from identification.diagnosis.results.driver_words import duration

SETTLED = 3.0  # time constants of a lag, after which a twentieth of a change is to come


def late_lines(field: Field, own: bool) -> Iterator[str]:
    """For each temperature that acts behind a lag, when its tables are right.

    Parameters
    ----------
    own : whether the control corrects by the temperature itself, with a law of its own.
    """
    lags = dict[str, float]()
    for channel in field.chain.channels:
        if (call := DERIVED_CHANNEL.fullmatch(channel)) and call[1] == "lag":
            lags[call[2]] = max(lags.get(call[2], 0.0), float(call[3]))
    for name, tau in lags.items():
        line = (
            f"errors follow {name} late (behind a lag of {duration(tau)}): what is written for a temperature is "
            f"right once the machine has had it for {duration(SETTLED * tau)}"
        )
        if own:
            line += f". A control that corrects by {name} itself takes it behind that lag: filter it so in the PLC"
        yield line
