"""Noise that is correlated along the rows: its model, and what it does to standard uncertainties."""

from __future__ import annotations

import numpy as np
import pytest

from errormodel.chain import Chain
from errormodel.machine_file import read_machine
from identification.estimation.noise import Noise, likeliest
from identification.estimation.run import fit_machine
from identification.uncertainty.prediction import predict
from tests.chains import Array
from tests.surveys import measured, stored, survey

EDGES = np.array([0, 300, 600])


def drawn(noise: Noise, rng: np.random.Generator, n: int = 300, series: int = 2) -> Array:
    """Series of unit total variance, one after another."""
    correlated = np.empty((series, n))
    correlated[:, 0] = rng.normal(size=series)
    steps = rng.normal(size=(series, n)) * np.sqrt(1 - noise.kept**2)
    for k in range(1, n):
        correlated[:, k] = noise.kept * correlated[:, k - 1] + steps[:, k]
    whole = rng.normal(size=(series, n)) + np.sqrt(noise.part) * correlated
    return np.asarray(whole / np.sqrt(1 + noise.part)).ravel()


@pytest.mark.parametrize("noise", [Noise(6.0, 0.4), Noise(60.0, 1.5)])
def test_covariance_is_the_dense_one_and_whitening_its_inverse_root(noise: Noise) -> None:
    n = 300
    gap = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    dense = (np.eye(n) + noise.part * noise.kept**gap) / (1 + noise.part)
    edges = np.array([0, n])
    np.testing.assert_allclose(noise.spread(np.eye(n), edges), dense, atol=1e-12)
    white = noise.whitened(np.linalg.cholesky(dense).T, edges).T
    product = white @ white.T
    scale = np.trace(product) / n
    # the filter forgets its start after some rows: identity from there on
    np.testing.assert_allclose(product[200:, 200:] / scale, np.eye(100), atol=0.02)


def test_white_noise_is_taken_as_white_and_correlated_noise_is_recognised() -> None:
    rng = np.random.default_rng(5)
    some = rng.normal(size=(3, 600))
    assert sum(likeliest(rng.normal(size=600), some, EDGES)[0] is not None for _ in range(100)) <= 2
    for truth in (Noise(6.0, 1.5), Noise(20.0, 0.4)):
        found = [likeliest(drawn(truth, rng), some, EDGES)[0] for _ in range(20)]
        assert sum(f is not None for f in found) >= 19
        lengths = [f.length for f in found if f is not None]
        assert truth.length / 3.5 < np.median(lengths) < truth.length * 3.5


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
