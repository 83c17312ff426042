"""The order in which the rows of a survey were measured, and numbers of their labels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Index

if TYPE_CHECKING:
    import pandas as pd


def measured_order(table: pd.DataFrame) -> Index:
    """Rows in the order in which they were measured: their own or, where a run's times are not in order, theirs."""
    file = label_numbers(table, ["file"])
    order = np.arange(len(table))
    if "time" in table:
        run = label_numbers(table, ["file", "run"])
        by_run = np.argsort(run, kind="stable")
        step = np.diff(table["time"].to_numpy(dtype=np.float64)[by_run])
        back = by_run[1:][(step < 0) & (np.diff(run[by_run]) == 0)]
        shuffled = np.isin(file, file[back])
        time = np.where(shuffled, table["time"], 0.0)
        order = np.lexsort((time, np.where(shuffled, run, 0), file))  # stable: otherwise the rows' own order
    return order


def label_numbers(table: pd.DataFrame, names: list[str]) -> Index:
    """Number of each distinct label of the rows; one number for all rows where the columns do not exist."""
    import pandas as pd

    codes = np.zeros(len(table), dtype=np.intp)
    for name in names:
        if name in table:
            own, labels = pd.factorize(table[name], use_na_sentinel=False)
            codes = codes * len(labels) + own
    return codes
