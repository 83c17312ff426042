"""Readings along the axes of the tool (a nest in the spindle) in the axes of the machine's reference."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from errormodel.exceptions import InputError
from errormodel.machine import Machine
from errormodel.surveys.columns import MEASURED, SIGMA_COLUMNS

if TYPE_CHECKING:
    import pandas as pd


def in_reference(table: pd.DataFrame, machine: Machine, name: str) -> pd.DataFrame:
    """Rows whose ``mx my mz`` are turned from the axes of the last frame into those of the reference.

    They are turned by the nominal rotation of the last frame at each command: errors of a machine turn a displacement
    of tenths of a millimetre by less than its last digit.

    Parameters
    ----------
    table : joints (mm, degrees) and ``mx my mz`` (mm); standard uncertainties of single axes are turned as variances.
    name : of the file, for messages.

    Raises
    ------
    InputError
        A component is missing.
    """
    from errormodel.chain import Chain
    from errormodel.nominal import Nominal

    lacking = [c for c in MEASURED if c not in table]
    if lacking:
        found = f"readings along the axes of the tool without {', '.join(lacking)}"
        raise InputError(f"{name}, axes", found, "Give all three of mx, my, mz")
    turns, _ = Nominal(Chain(machine), table).flanges()
    out = table.copy()
    out[[*MEASURED]] = np.einsum("nij,nj->ni", turns, table[[*MEASURED]].to_numpy(dtype=np.float64))
    if {*SIGMA_COLUMNS} <= {*table}:
        variance = np.square(table[[*SIGMA_COLUMNS]].to_numpy(dtype=np.float64))
        out[[*SIGMA_COLUMNS]] = np.sqrt(np.einsum("nij,nj->ni", np.square(turns), variance))
    return out
