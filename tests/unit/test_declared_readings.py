"""Readings that hardly change beside what is declared of them are in another unit."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from errormodel.machine_file import read_machine
from identification.estimation.checks import noise_notes
from identification.estimation.fit import fit_machine
from tests.helpers.lengths import entry, survey

MILL = read_machine("vertical_three_axis")
NAMES = {"x_in_y": [0, 1, 0], "x_in_z": [0, 0, 1]}


@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_straightness_in_metres_is_doubted(unit: float) -> None:
    """Of two straightnesses of 0.8 um declared, one is written in m; the other had hidden it in the whole."""
    rng, at = np.random.default_rng(3), np.linspace(*MILL.joints[0].travel, 15)
    still = {j.name: float(np.mean(j.travel)) for j in MILL.joints}
    parts = [
        pd.DataFrame({**still, MILL.joints[0].name: at, "observation": name, "length": rng.normal(0, 8e-4, len(at))})
        for name in NAMES
    ]
    parts[1]["length"] *= unit
    entries = {
        name: entry(type="line-straightness", along=[1, 0, 0], across=across, sigma=[8e-4, 0.0])
        for name, across in NAMES.items()
    }
    notes = list(noise_notes(fit_machine(MILL, survey(MILL, pd.concat(parts, ignore_index=True), entries))))
    found = [note for note in notes if note.startswith("readings of x_in_z lie within 0.0")]
    assert len(found) == (unit != 1.0)
    assert not any(note.startswith("readings of x_in_y") for note in notes)
