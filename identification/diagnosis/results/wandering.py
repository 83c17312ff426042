"""Residuals that wander along the rows, more than instruments do: serial correlation as a lack of fit."""

from __future__ import annotations

import numpy as np

from identification.diagnosis.decisions.constants import STEADY_UM
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog
from identification.estimation.noise import CORRELATION_LENGTHS_ROWS
from identification.estimation.result import Fit

# variance of what is correlated along the rows, over that of the rest: half of it wanders; of 113 empty recordings by
# three simulators one had more than 0.4
MOST = 1.0


def wandering_um(fit: Fit, log: DecisionLog = UNRECORDED) -> float:
    """Standard deviation of what goes on from row to row in a coordinate, um; 0 where instruments do as much."""
    noise = fit.serial
    if noise is None or noise.part < MOST or noise.length <= CORRELATION_LENGTHS_ROWS[0]:
        return 0.0  # what only neighbouring rows share is noise of the air or of averaging
    size = 1e3 * fit.sigma_mm * float(np.sqrt(noise.part / (1 + noise.part)))
    log.add("serial-correlation", "found" if size > STEADY_UM else "passed", "residuals", size, STEADY_UM)
    return size if size > STEADY_UM else 0.0


def wandering_text(fit: Fit, log: DecisionLog = UNRECORDED) -> str:
    """The same in words; "" where nothing wanders."""
    size = wandering_um(fit, log)
    if not size or fit.serial is None:
        return ""
    return (
        f"what is left wanders: {size:.1f} um of {1e3 * fit.sigma_mm:.1f} um a coordinate go on over about "
        f"{fit.serial.length:.0f} rows, which is more than instruments do. Something moves that no channel shows: the "
        "machine, the instrument or its stand. Measure fixed targets again and again between the positions"
    )
