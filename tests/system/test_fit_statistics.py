"""Are uncertainties what they say? Forty surveys of one machine, each with other noise, for every way to state it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import binom, chi2

from errormodel.chain import Chain
from errormodel.instruments.laser_tracker import LaserTracker
from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from identification.estimation import fit as estimation
from identification.estimation.result import Fit
from identification.uncertainty.prediction import predict
from tests.helpers.chains import Array, errors
from tests.helpers.commands import MILL, done
from tests.helpers.nightly import first_of
from tests.helpers.surveys import FAR, TURNED, measured, positions, stored, survey

SEEDS = 40
MACHINE = read_machine("horizontal_three_axis")
CHAIN = Chain(MACHINE)  # traced once for all surveys
P = errors(CHAIN, 1)
POINTS, FRESH = (positions(measured(MACHINE, P, n, seed)) for n, seed in ((70, 0), (40, 99)))
XYZ = ["mx", "my", "mz"]
TRACKER = LaserTracker(type="laser-tracker", station=[2500, -1500, 600], range=[1e-3, 1e-6], angle=5e-6)

Noisy = Callable[[pd.DataFrame, np.random.Generator], Survey]


@pytest.fixture(autouse=True)
def one_chain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimation, "Chain", lambda machine: CHAIN)


def undeclared(table: pd.DataFrame, rng: np.random.Generator) -> Survey:
    table[XYZ] += rng.normal(0, 5e-3, (len(table), 3))
    return survey(table)


def declared(table: pd.DataFrame, rng: np.random.Generator) -> Survey:
    """Another uncertainty for each row and direction, stated."""
    sigma = 10 ** np.random.default_rng(7).uniform(-3, -2, (len(table), 3))
    table[XYZ] += rng.normal(0, sigma)
    table[["sigma_x", "sigma_y", "sigma_z"]] = sigma
    return survey(table)


def tracked(table: pd.DataFrame, rng: np.random.Generator) -> Survey:
    table[XYZ] += TRACKER.draw_noise(table[XYZ].to_numpy(), rng)
    return survey(table, instrument=TRACKER)


def group_truth(fit: Fit) -> Array:
    """True values of the groups: the measuring frame's small parameters count from where it was put."""
    pose = fit.problem.frames[""]
    turn = pose.rotation.T @ Rotation.from_euler("XYZ", TURNED).as_matrix()
    shift = pose.rotation.T @ (np.array(FAR) - pose.translation)
    frame = dict(zip(fit.chain.frame_ids, [*shift, *Rotation.from_matrix(turn).as_euler("XYZ")], strict=True))
    truth = [frame[u] if u in frame else P[fit.chain.index[u]] for u in fit.solution.unknowns]
    return fit.solution.groups.coefficients @ np.array(truth)


@dataclass(frozen=True)
class Campaign:
    """What forty surveys gave; z are errors over their standard uncertainties."""

    groups: Array  # (seeds, groups) z
    together: Array  # (seeds,) chi2 of all groups with their covariance
    predicted: Array  # (seeds, poses, 3) z
    errors: Array  # (seeds, poses, 3) mm
    reduced: Array  # (seeds,) reduced chi2
    sigma: Array  # (seeds,) mm


def campaign(noisy: Noisy, seeds: int = SEEDS) -> Campaign:
    out = []
    for seed in range(seeds):
        fit = estimation.fit_machine(MACHINE, noisy(POINTS.copy(), np.random.default_rng(seed)))
        s = fit.solution
        gap = s.values[s.groups.base] - group_truth(fit)
        covariance = s.covariance * fit.inflation**2
        z = gap / np.sqrt(np.diag(covariance))
        scale = np.sqrt(np.diag(covariance))
        together = z @ np.linalg.solve(covariance / np.outer(scale, scale), z)
        told = predict(stored(fit), survey(FRESH))
        wrong = told[XYZ].to_numpy() - FRESH[XYZ].to_numpy()
        out.append((z, together, wrong / told[["ux", "uy", "uz"]].to_numpy(), wrong, s.chi2 / s.dof, fit.sigma_mm))
    return Campaign(*(np.array(column) for column in zip(*out, strict=True)))


def assert_covers(z: Array) -> None:
    """Each within two sigma as often as it should; z (seeds, quantities), those of one seed not independent."""
    outside = (np.abs(z) > 2).sum(axis=0)
    expected = 0.0455
    assert (outside <= binom.ppf(1 - 1e-5, SEEDS, expected)).all()
    assert 0.4 * expected < outside.mean() / SEEDS < 1.8 * expected
    assert 0.85 < np.sqrt(np.mean(z**2)) < 1.15


@pytest.mark.long
@pytest.mark.parametrize("noisy", first_of([undeclared, declared, tracked]))
def test_uncertainties_hold(noisy: Noisy) -> None:
    found = campaign(noisy)
    assert_covers(found.groups)
    assert_covers(found.predicted.reshape(SEEDS, -1))
    # the covariance as a whole: with sigma estimated from 180 degrees of freedom a little wider than chi2
    rank = found.groups.shape[1]
    low, high = chi2.ppf([1e-4, 1 - 1e-4], rank * SEEDS) / (rank * SEEDS)
    assert low < np.mean(found.together) / rank < 1.03 * high
    # uncorrelated with each other's sign: no systematic error hides below the noise
    assert np.abs(found.groups.mean(axis=0)).max() < 4.5 / np.sqrt(SEEDS)
    if noisy is undeclared:
        np.testing.assert_allclose(found.reduced, 1, atol=1e-9)
        assert np.mean(found.sigma) == pytest.approx(5e-3, rel=0.02)
    else:
        assert np.mean(found.reduced) == pytest.approx(1, abs=4 * np.sqrt(2 / 180 / SEEDS))


@pytest.mark.long
def test_knowing_the_tracker_helps() -> None:
    """Its range is five times as good as its angles are here: weights by direction use that."""

    def blind(table: pd.DataFrame, rng: np.random.Generator) -> Survey:
        return survey(tracked(table, rng).table)

    informed, ignorant = campaign(tracked, 25), campaign(blind, 25)
    gain = np.sqrt(np.mean(ignorant.errors**2) / np.mean(informed.errors**2))
    assert gain > 1.15
    wins = (informed.errors**2).sum(axis=(1, 2)) < (ignorant.errors**2).sum(axis=(1, 2))
    assert wins.mean() > 0.7


def test_wrong_declarations_are_taken_at_the_residuals_word() -> None:
    table = POINTS.copy()
    rng = np.random.default_rng(0)
    table[XYZ] += rng.normal(0, 9e-3, (len(table), 3))
    fit = estimation.fit_machine(MACHINE, survey(table.assign(sigma_x=3e-3, sigma_y=3e-3, sigma_z=3e-3)))
    assert fit.inflation == pytest.approx(3, rel=0.15)
    assert fit.sigma_mm == pytest.approx(9e-3, rel=0.15)
    honest = estimation.fit_machine(MACHINE, survey(table.assign(sigma_x=9e-3, sigma_y=9e-3, sigma_z=9e-3)))
    assert honest.inflation == 1.0


def test_uniform_sigmas_change_nothing_but_the_covariance() -> None:
    table = undeclared(POINTS.copy(), np.random.default_rng(1)).table
    plain = estimation.fit_machine(MACHINE, survey(table))
    stated = estimation.fit_machine(MACHINE, survey(table.assign(sigma_x=5e-3, sigma_y=5e-3, sigma_z=5e-3)))
    std = np.sqrt(np.diag(plain.solution.covariance))
    assert (np.abs(plain.solution.values - stated.solution.values)[plain.solution.groups.base] < 1e-6 * std).all()
    ratio = np.sqrt(np.diag(stated.solution.covariance)) / std
    np.testing.assert_allclose(ratio, 5e-3 / plain.solution.sigma["position"], rtol=1e-9)


def test_noise_of_a_coordinate_where_rows_have_only_one() -> None:
    """An interferometer along a line: what was not measured does not count as a component of the mean precision."""
    table = POINTS.copy()
    table[XYZ] += np.random.default_rng(2).normal(0, 4e-3, (len(table), 3))
    table.loc[::2, ["mx", "my"]] = np.nan
    fit = estimation.fit_machine(MACHINE, survey(table.assign(sigma_x=4e-3, sigma_y=4e-3, sigma_z=4e-3)))
    assert fit.sigma_mm == pytest.approx(4e-3 * np.sqrt(fit.solution.chi2 / fit.solution.dof), rel=1e-9)


def test_orientation_noise_is_estimated_beside_that_of_positions() -> None:
    table = measured(MACHINE, P, 120, 3)
    rng = np.random.default_rng(2)
    table[XYZ] += rng.normal(0, 4e-3, (120, 3))
    small = Rotation.from_rotvec(rng.normal(0, 8e-6, (120, 3)))
    turned = (small * Rotation.from_rotvec(np.array(table[["mrx", "mry", "mrz"]]))).as_rotvec()
    table[["mrx", "mry", "mrz"]] = turned
    fit = estimation.fit_machine(MACHINE, survey(table))
    assert fit.solution.sigma["position"] == pytest.approx(4e-3, rel=0.12)
    assert fit.solution.sigma["orientation"] == pytest.approx(8e-6, rel=0.12)
    stated = estimation.fit_machine(MACHINE, survey(table.assign(sigma_x=4e-3, sigma_y=4e-3, sigma_z=4e-3)))
    assert stated.solution.sigma["orientation"] == pytest.approx(8e-6, rel=0.12)


def test_weak_directions_stay_as_long_as_they_mean_something() -> None:
    """Ordinary noise drops no group; noise beyond any machine drops those it hides, and nothing breaks."""
    exact = estimation.fit_machine(MACHINE, survey(POINTS)).solution.groups.rank
    quiet = estimation.fit_machine(MACHINE, undeclared(POINTS.copy(), np.random.default_rng(3))).solution.groups.rank
    table = POINTS.copy()
    table[XYZ] += np.random.default_rng(3).normal(0, 50.0, (len(table), 3))
    loud = estimation.fit_machine(MACHINE, survey(table))
    assert quiet == exact
    assert loud.solution.groups.rank <= quiet
    assert np.isfinite(loud.solution.values).all()
    assert loud.heldout.rms_um < 5 * loud.fitted.rms_um


@pytest.mark.parametrize(
    ("factor", "said"), [(1e3, "times as large as the residuals show"), (1e-3, "declared"), (2, "")]
)
def test_a_declared_uncertainty_in_another_unit_is_said(tmp_path: Path, factor: float, said: str) -> None:
    """Micrometres in the column sigma would make every stated uncertainty a thousand times too large."""
    done("simulate", MILL, 60, "--noise", 0.002, "--out", tmp_path / "s.csv")
    pd.read_csv(tmp_path / "s.csv").assign(sigma=0.002 * factor).to_csv(tmp_path / "d.csv", index=False)
    err = done("fit", MILL, tmp_path / "d.csv", "--out", tmp_path / "fit").err
    assert (said in err and "look for another unit" in err) if said else not err
