"""Fits under noise that is correlated along the rows: their uncertainties hold the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from errormodel.chain import Chain
from errormodel.machine_file import read_machine
from identification.diagnosis.results.verdict import judge
from identification.estimation.fit import fit_machine
from identification.estimation.noise import Noise
from identification.estimation.result import noise_bounds
from identification.uncertainty.prediction import predict
from tests.helpers.correlated_noise import drawn
from tests.helpers.surveys import measured, positions, stored, survey


@pytest.mark.long
def test_predictions_cover_the_truth_under_correlated_noise() -> None:
    """Positions of neighbouring rows share their error, and the poses of a grid share their neighbours."""
    machine = read_machine("vertical_three_axis")
    rng = np.random.default_rng(2)
    p = np.zeros(len(Chain(machine).ids))
    noise, hits = Noise(20.0, 1.5), []
    for seed in range(12):
        table = measured(machine, p, 240, seed).sort_values(["X", "Y"], ignore_index=True)
        table[["mx", "my", "mz"]] += 0.005 * drawn(noise, rng, 240, 3).reshape(3, 240).T
        fit = fit_machine(machine, survey(table))
        fresh = measured(machine, p, 60, seed + 100)
        out = predict(stored(fit), survey(fresh))
        gap = np.abs((out[["mx", "my", "mz"]] - fresh[["mx", "my", "mz"]]).to_numpy())
        hits.append(np.mean(gap < 2 * out[["ux", "uy", "uz"]].to_numpy()))
        assert any("correlated" in note for note in fit.notes)
    assert 0.90 < np.mean(hits) <= 0.995


SMALL = """
errormodel: 1
name: three axes
chain:
  - {joint: X, type: prismatic, axis: x, travel: [0, 500]}
  - {shape: slide, offset: [0, 0, 0]}
  - {joint: Y, type: prismatic, axis: y, travel: [0, 400]}
  - {shape: head, offset: [0, 0, 0]}
  - {joint: Z, type: prismatic, axis: z, travel: [-300, 0]}
tool: [0, 0, -100]
errors:
  shapes: all
  joints: {X: first-order, Y: first-order, Z: first-order}
"""


@pytest.mark.long
def test_noise_from_few_degrees_of_freedom_is_known_as_well_as_that(tmp_path: Path) -> None:
    """Seven rows and some twenty unknowns: so few degrees of freedom often show a tenth of the noise."""
    (tmp_path / "machine.yaml").write_text(SMALL, encoding="utf-8")
    machine = read_machine(tmp_path / "machine.yaml")
    p = np.zeros(len(Chain(machine).ids))
    fresh, table = measured(machine, p, 20, 999), positions(measured(machine, p, 7, 1))
    known, covered, narrow = [], [], []
    for seed in range(40):
        noisy = table.copy()
        noisy[["mx", "my", "mz"]] += np.random.default_rng(seed).normal(0, 0.002, (7, 3))
        fit = fit_machine(machine, survey(noisy))
        assert 1 <= fit.solution.dof <= 3  # more than one where directions are too uncertain to count
        low, high = noise_bounds(fit.solution.dof)
        known.append(low * fit.sigma_mm < 0.002 < high * fit.sigma_mm)
        out = predict(stored(fit), survey(fresh))
        gap = np.abs((out[["mx", "my", "mz"]] - fresh[["mx", "my", "mz"]]).to_numpy())
        covered.append(np.mean(gap < 2 * out[["ux", "uy", "uz"]].to_numpy()))
        there = predict(stored(fit), survey(table))  # where nothing is open
        gap = np.abs((there[["mx", "my", "mz"]] - table[["mx", "my", "mz"]]).to_numpy())
        narrow.append(np.mean(gap < 2 * there[["ux", "uy", "uz"]].to_numpy() / fit.coverage))
    assert np.mean(known) > 0.85  # three standard deviations below 0.95, as below
    assert 0.85 < np.mean(covered) <= 1
    assert 0.8 < np.mean(narrow) < 0.92  # of three degrees of freedom, two standard deviations hold 86 %
    verdict = judge(fit, found=False)
    assert verdict.word == "unexplained"
    assert verdict.unexplained is not None
    assert verdict.unexplained.startswith("not judged: 21 measured values for 18 unknowns leave 3 degrees of freedom")
    enough = fit_machine(machine, survey(positions(measured(machine, p, 20, 1, 0.002))))
    assert judge(enough, found=False).word == "adequate"


@pytest.mark.long
def test_a_fit_is_never_worse_than_none() -> None:
    """Few levels, a noise of heavy tails: directions that hardly show must not be stepped along."""
    for name in ("six_axis_arm", "trunnion_five_axis", "fork_head_five_axis"):
        machine = read_machine(name)
        for seed in range(3):
            rng = np.random.default_rng(seed)
            table = measured(machine, np.zeros(len(Chain(machine).ids)), 90, seed)
            for joint in machine.joints:
                table[joint.name] = rng.choice(np.linspace(*joint.travel, 3), len(table))
            points = table.drop(columns=["mx", "my", "mz", "mrx", "mry", "mrz"])
            table = measured(machine, np.zeros(len(Chain(machine).ids)), points=points)
            table[["mx", "my", "mz"]] += 0.02 * rng.standard_t(3, (len(table), 3))
            fit = fit_machine(machine, survey(table.drop(columns=["mrx", "mry", "mrz"])))
            assert fit.fitted.rms_um <= fit.nominal.rms_um * (1 + 1e-9)
            assert fit.solution.converged
