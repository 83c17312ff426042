"""Rows of a survey that hold error motions of a joint."""

from __future__ import annotations

import numpy as np
import pandas as pd

from errormodel.chain import Chain
from errormodel.conventions import MOTIONS
from errormodel.machine import Machine
from tests.helpers.chains import Array


def motion_rows(machine: Machine, p: Array, joint: str, motions: tuple[str, ...], n: int = 25) -> pd.DataFrame:
    """What an interferometer or a level reads of one joint, from a zero of its own."""
    chain = Chain(machine)
    travel = next(j.travel for j in machine.joints if j.name == joint)
    q = np.linspace(*travel, n)
    rows = [q if c == joint else np.zeros(n) for c in chain.channels]
    ids = tuple(i for i in chain.machine_ids if chain.parameters[chain.index[i]].element == joint)
    terms = chain.kernel("terms", ids)(rows, p).reshape(-1, 6, n)[: len(ids)]
    six = np.einsum("p,pim->im", [p[chain.index[i]] for i in ids], terms)
    zeros = {m: 1e-2 * (k + 1) for k, m in enumerate(motions)}
    read = {m: six[MOTIONS.index(m)] + zeros[m] for m in motions}  # type: ignore[arg-type]
    table = pd.DataFrame({**dict(zip(chain.channels, rows, strict=True)), **read, "joint": joint})
    table[[j.name for j in machine.joints if j.name != joint]] = np.nan
    return table.assign(run="1", file="a.csv", role="fit", row=np.arange(1, n + 1), mx=np.nan, my=np.nan, mz=np.nan)
