"""Travels of a millimetre far from the joints' zeros: some directions are hardly determined, and M changes there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import read_machine, read_survey
from identification.estimation.fit import fit_machine
from tests.helpers.commands import XYZ, write
from tests.helpers.nightly import first_of

NOISE = 2e-5  # mm
MACHINE = """\
errormodel: 1
chain:
  - {{joint: Z, type: prismatic, axis: z, travel: [100, 101]}}
  - {{shape: T1}}
  - {{joint: Y, type: prismatic, axis: y, travel: [100, 101]}}
  - {{shape: T2}}
  - {{joint: X, type: prismatic, axis: x, travel: [100, 101]}}
  - {{shape: T3}}
tool: [0, 0, 200]
errors: {{shapes: all, joints: {{X: {model}, Y: {model}, Z: {model}}}}}
"""


@pytest.mark.long
@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize(
    ("model", "seed"), first_of([("{polynomial: 3}", 4), ("first-order", 17), ("first-order", 28)])
)
def test_the_fit_and_what_it_left_out_are_as_good_as_the_noise(
    model: str, seed: int, robust: bool, tmp_path: Path
) -> None:
    """A machine without errors: no estimate far outside its uncertainty; held-out rows are predicted to the noise."""
    rng = np.random.default_rng(seed)
    commands = 100 + rng.random((150, 3))
    measured = commands + [0, 0, 200] + NOISE * rng.standard_normal(commands.shape)
    table = pd.DataFrame(np.hstack([commands, measured]), columns=["X", "Y", "Z", *XYZ])
    table.to_csv(tmp_path / "s.csv", index=False)
    machine = read_machine(write(tmp_path / "m.yaml", MACHINE.format(model=model)))
    fit = fit_machine(machine, read_survey(tmp_path / "s.csv", machine), robust)
    assert fit.solution.converged
    for residuals in (fit.residuals, fit.heldout_residuals):
        assert np.sqrt(np.nanmean(np.square(residuals))) < 1.5 * NOISE
    solution = fit.solution
    z = solution.values[solution.groups.base] / np.sqrt(np.diag(solution.covariance))
    assert np.abs(z).max() < 5  # of some twenty: once in 10^5 by chance
