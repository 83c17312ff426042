"""Whether commands with times are taken as read on the fly, where a delay or a servo lag follows the speed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.path_speed import RATE_CHANNEL, in_motion
from errormodel.row_order import measured_order
from identification.uncertainty.other_assumption import Predict, half_change

if TYPE_CHECKING:
    import pandas as pd

AT_REST = (
    "the times of these rows would be those of a machine that moves ({said}), but their path does not run on: they are "
    "taken as poses at rest, and half of what that changes is in the uncertainty. Give poses at rest one and the same "
    "time, and those of a path all of its rows"
)
ON_THE_FLY = (
    "by their times these rows are taken as read on the fly ({said}): an effect of this machine follows their speed. "
    "If they are poses at rest, give every row one and the same time"
)


def on_the_fly(chain: Chain, table: pd.DataFrame) -> Iterator[str]:
    """A note on commands whose times say that the machine moved while they were measured, and how fast."""
    channels = chain.columns(table) if _speeds(chain) else []
    turning = {j.name for j in chain.machine.joints if j.type == "rotary"}
    said = []
    for number, joint in _speeds(chain):
        fastest = float(np.abs(channels[number]).max())
        rate = f"{np.degrees(fastest):.3g} deg/s" if joint in turning else f"{fastest:.3g} mm/s"
        said += [f"{joint} up to {rate}"] if fastest > 0 else []
    if len(table) == 1 and channels:
        yield "a single row has no speed: it is taken as a pose at rest. Give those of a path all of its rows"
    if said:
        yield (ON_THE_FLY if _in_motion(chain, table) else AT_REST).format(said=", ".join(said))


def perhaps_at_rest(
    chain: Chain, table: pd.DataFrame, channels: list[Array], labels: Array, predicted: Array, predict: Predict
) -> Array:
    """Predictions (n, 9), as of poses at rest where the path of the rows does not run on; half of that is uncertain.

    Parameters
    ----------
    channels : each (n,); `labels` (n,): of the rows' frames.
    predicted : (n, 9)
        Position, error and standard uncertainty in mm.
    predict : such predictions of other rows, from their channels and labels.
    """
    at_rest = {number: np.zeros(len(table)) for number, _ in _speeds(chain)}
    if not at_rest or _in_motion(chain, table):
        return predicted
    half = half_change(channels, labels, predicted, predict, np.arange(len(table)), at_rest)
    return np.hstack([predicted[:, :6] + 2 * half, np.hypot(predicted[:, 6:], half[:, :3])])


def _speeds(chain: Chain) -> list[tuple[int, str]]:
    """Channels of a speed by the clock: their numbers and joints."""
    found = ((number, RATE_CHANNEL.fullmatch(name)) for number, name in enumerate(chain.channels))
    return [(number, call[1]) for number, call in found if call]


def _in_motion(chain: Chain, table: pd.DataFrame) -> bool:
    order = measured_order(table)
    time = table["time"].to_numpy(dtype=np.float64)[order] if "time" in table else None
    return in_motion([table[j.name].to_numpy(dtype=np.float64)[order] for j in chain.machine.joints], time)
