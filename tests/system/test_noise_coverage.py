"""Fits under noise that is correlated along the rows: their uncertainties hold the truth."""

from __future__ import annotations

import numpy as np

from errormodel.chain import Chain
from errormodel.machine_file import read_machine
from identification.estimation.fit import fit_machine
from identification.estimation.noise import Noise
from identification.uncertainty.prediction import predict
from tests.helpers.correlated_noise import drawn
from tests.helpers.surveys import measured, stored, survey


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
