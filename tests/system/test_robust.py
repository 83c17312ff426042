"""Robust fits: outliers of any size, wherever they stand, hardly move a parameter, and are named."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import binom, chi

from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.instruments.laser_tracker import LaserTracker
from errormodel.machine_file import read_machine
from identification.estimation import fit as estimation
from identification.estimation.bisquare import BISQUARE_CUT_SIGMA, normal, pull
from identification.estimation.result import Fit
from identification.estimation.robust import first_judgement
from identification.observation.assembly import build
from identification.plots.distances import draw_distances
from tests.helpers.chains import Array, errors
from tests.helpers.commands import MILL, XYZ, done
from tests.helpers.commands import run as command
from tests.helpers.nightly import first_of
from tests.helpers.pages import Page
from tests.helpers.surveys import FAR, TURNED, measured, positions, prediction_error, survey

MACHINE = read_machine("horizontal_three_axis")
CHAIN = Chain(MACHINE)
P = errors(CHAIN, 1)
N, SIGMA = 100, 5e-3
POINTS = measured(MACHINE, P, N, 0)
TRACKER = LaserTracker(type="laser-tracker", station=[2500, -1500, 600], range=[1e-3, 1e-6], angle=5e-6)


@pytest.fixture(autouse=True)
def one_chain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimation, "Chain", lambda machine: CHAIN if machine is MACHINE else Chain(machine))


def noisy(seed: int = 0) -> pd.DataFrame:
    table = positions(POINTS.copy())
    table[XYZ] += np.random.default_rng(seed).normal(0, SIGMA, (N, 3))
    return table


def spoilt(table: pd.DataFrame, rows: Array, size: float, way: Array | None = None, seed: int = 9) -> pd.DataFrame:
    """Rows out by `size` mm: all one way, or each its own."""
    away = np.random.default_rng(seed).normal(size=(len(rows), 3)) if way is None else np.tile(way, (len(rows), 1))
    table = table.copy()
    table.loc[rows, XYZ] += size * away / np.linalg.norm(away, axis=1)[:, None]
    return table


def named(fit: Fit) -> set[int]:
    return {o.index for o in fit.outliers}


def deviations(fit: Fit) -> Array:
    return np.asarray(np.sqrt(np.diag(fit.solution.covariance)) * fit.inflation)


def group_errors(fit: Fit) -> Array:
    pose = fit.problem.frames[""]
    turn = pose.rotation.T @ Rotation.from_euler("XYZ", TURNED).as_matrix()
    shift = pose.rotation.T @ (np.array(FAR) - pose.translation)
    frame = dict(zip(CHAIN.frame_ids, [*shift, *Rotation.from_matrix(turn).as_euler("XYZ")], strict=True))
    truth = np.array([frame[u] if u in frame else P[CHAIN.index[u]] for u in fit.solution.unknowns])
    return np.asarray(fit.solution.values[fit.solution.groups.base] - fit.solution.groups.coefficients @ truth)


WHERE = {
    "scattered": np.random.default_rng(3).permutation(N)[:10],
    "a block": np.arange(40, 50),
    "a region": np.argsort(POINTS[MACHINE.joints[0].name].to_numpy())[-10:],
}


@pytest.mark.parametrize("where", first_of(WHERE))
@pytest.mark.parametrize(("size", "way"), first_of([(0.1, (0.6, 0.0, -0.8)), (50.0, None), (1e6, (0.6, 0.0, -0.8))], 2))
def test_gross_outliers_move_nothing_and_are_named(where: str, way: Array | None, size: float) -> None:
    """The answer is that of the other ninety rows, whatever the ten say, and nobody else is accused."""
    rows = WHERE[where]
    fit = estimation.fit_machine(MACHINE, survey(spoilt(noisy(), rows, size, way)), robust=True)
    rest = estimation.fit_machine(MACHINE, survey(noisy()).rows(~np.isin(np.arange(N), rows)), robust=True)
    assert named(fit) == set(rows.tolist())
    assert {o.what for o in fit.outliers} == {"position"}  # no direction is so near an axis that the rest is sound
    assert fit.solution.converged
    assert fit.fitted.n == N - 10
    assert prediction_error(fit, P) == pytest.approx(prediction_error(rest, P), abs=0.3)
    assert fit.solution.sigma["position"] == pytest.approx(rest.solution.sigma["position"], rel=0.03)


@pytest.mark.long
def test_a_tenth_of_gross_outliers_costs_less_than_a_fifth_of_the_uncertainty() -> None:
    """Over seeds: errors at most 1.2 times those that clean data and least squares would have."""
    seeds, scaled, own, clean = 15, [], [], []
    for seed in range(seeds):
        plain = estimation.fit_machine(MACHINE, survey(noisy(seed)))
        rng = np.random.default_rng(100 + seed)
        table = noisy(seed)
        rows = rng.permutation(N)[:10]
        table.loc[rows, XYZ] += rng.normal(size=(10, 3)) * 10 ** rng.uniform(-1, 6, (10, 1))
        fit = estimation.fit_machine(MACHINE, survey(table), robust=True)
        assert named(fit) <= set(rows.tolist()) | {k for k in range(N) if fit.sorting and fit.sorting.distance[k] > 4}
        scaled.append(group_errors(fit) / deviations(plain))
        clean.append(group_errors(plain) / deviations(plain))
        own.append(group_errors(fit) / deviations(fit))
    z = np.array(own)
    assert np.sqrt(np.mean(np.square(scaled)) / np.mean(np.square(clean))) < 1.2
    assert np.sqrt(np.mean(np.square(np.subtract(scaled, clean)), axis=0)).max() < 0.9
    assert ((np.abs(z) > 2).sum(axis=0) <= binom.ppf(1 - 1e-4, seeds, 0.0455)).all()
    assert 0.85 < np.sqrt(np.mean(z**2)) < 1.15


@pytest.mark.long
def test_on_clean_data_it_is_nearly_least_squares() -> None:
    shifts, ratios = [], []
    for seed in range(6):
        plain, robust = (estimation.fit_machine(MACHINE, survey(noisy(seed)), robust=r) for r in (False, True))
        assert len(robust.outliers) <= 1
        shifts.append((robust.solution.values - plain.solution.values)[plain.solution.groups.base] / deviations(plain))
        ratios.append(deviations(robust) / deviations(plain))
    assert np.sqrt(np.mean(np.square(shifts))) < 0.35  # 93 % efficient: sqrt(1/0.93 - 1) = 0.25
    assert np.mean(ratios) == pytest.approx(1.03, abs=0.03)


@pytest.mark.parametrize("size", first_of([0.1, 1e4]))
def test_one_wrong_component_leaves_the_others(size: float) -> None:
    """A third of all heights is wrong: x and y of these rows stay, which leaving out a third of the rows would lose."""
    rows = np.random.default_rng(1).permutation(N)[: N // 3]
    fit = estimation.fit_machine(MACHINE, survey(spoilt(noisy(), rows, size, np.array([0.0, 0.0, 1.0]))), robust=True)
    assert named(fit) == set(rows.tolist())
    single = [o.index for o in fit.outliers if o.what == "mz"]  # of some the rest is not that near either
    assert len(single) >= 0.85 * len(rows)
    assert np.isfinite(fit.residuals[single]).tolist() == [[True, True, False]] * len(single)
    assert prediction_error(fit, P) < 4


def test_with_a_tracker_that_declares_its_uncertainty() -> None:
    """Range five times better than angles: distances are those of its own ellipsoids, also of a bad component."""
    table = positions(POINTS.copy())
    table[XYZ] += TRACKER.draw_noise(table[XYZ].to_numpy(), np.random.default_rng(2))
    bad = spoilt(table, np.arange(20, 30), 2.0)
    bad.loc[[50, 51], "my"] -= 300.0
    fit = estimation.fit_machine(MACHINE, survey(bad, instrument=TRACKER), robust=True)
    assert {o.index: o.what for o in fit.outliers} == dict.fromkeys(range(20, 30), "position") | {50: "my", 51: "my"}
    assert fit.solution.sigma["position"] == 1.0
    assert fit.solution.chi2 / fit.solution.dof == pytest.approx(1, abs=0.25)
    assert fit.inflation == 1.0
    assert prediction_error(fit, P) < 4


def test_runs_with_frames_of_their_own_and_missing_components() -> None:
    first, second = noisy(1), noisy(2).assign(run="2")
    second[XYZ] = Rotation.from_rotvec([0.1, 0.5, -2.0]).apply(second[XYZ]) + np.array([3e3, 0, 10])
    first.loc[:9, "mx"], second.loc[:9, ["my", "mz"]] = np.nan, np.nan
    bad = np.arange(30, 50)  # all of them in the second run
    fit = estimation.fit_machine(MACHINE, survey(first, spoilt(second, bad, 500.0), frame="per-run"), robust=True)
    assert named(fit) == {N + k for k in bad.tolist()}
    assert {o.run for o in fit.outliers} == {"2"}
    assert prediction_error(fit, P, run="1") < 4


def test_orientations_and_error_motions_have_outliers_of_their_own() -> None:
    table = POINTS.copy()
    rng = np.random.default_rng(4)
    table[XYZ] += rng.normal(0, SIGMA, (N, 3))
    table[["mrx", "mry", "mrz"]] += rng.normal(0, 5e-6, (N, 3))
    table.loc[[3, 4], "mry"] += 0.01
    table.loc[[60], XYZ] += 9.0
    q = np.linspace(*MACHINE.joints[0].travel, 40)
    motion = pd.DataFrame({MACHINE.joints[0].name: q, "joint": MACHINE.joints[0].name, "dy": rng.normal(0, 1e-3, 40)})
    motion = motion.assign(run="1", file="b.csv", role="fit", row=np.arange(1, 41), tool_x=0.0, tool_y=0.0, tool_z=0.0)
    motion.loc[7, "dy"] += 5.0
    fit = estimation.fit_machine(MACHINE, survey(table.assign(joint=""), motion), robust=True)
    found = {(o.file, o.row, o.what) for o in fit.outliers}
    assert found == {
        ("a.csv", 4, "orientation"),
        ("a.csv", 5, "orientation"),
        ("a.csv", 61, "position"),
        ("b.csv", 8, "dy"),
    }
    assert fit.solution.sigma["orientation"] == pytest.approx(5e-6, rel=0.15)


def test_a_test_file_with_outliers_still_finds_its_frame() -> None:
    other = spoilt(noisy(5).assign(file="b.csv", role="test"), np.arange(10), 1e3, np.array([1.0, 0, 0]))
    fit = estimation.fit_machine(MACHINE, survey(noisy(), other, frame="per-file"), robust=True)
    assert np.abs(fit.tests[0].residuals[10:]).max() < 6 * SIGMA
    assert np.abs(fit.tests[0].residuals[:10]).max() > 900


def test_data_without_noise() -> None:
    """Round-off is no noise to judge by: the outliers are named, and nobody else."""
    fit = estimation.fit_machine(MACHINE, survey(spoilt(positions(POINTS), np.arange(10), 1.0)), robust=True)
    assert named(fit) == set(range(10))
    assert fit.fitted.rms_um < 1e-3


@pytest.mark.parametrize("share", first_of([0.55, 0.7]))
def test_more_than_half_is_an_error(share: float) -> None:
    rows = np.random.default_rng(0).permutation(N)[: int(share * N)]
    with pytest.raises(InputError, match="more than half") as error:
        estimation.fit_machine(MACHINE, survey(spoilt(noisy(), rows, 100.0)), robust=True)
    assert "diagnose" in str(error.value)


def test_forty_per_cent_are_survived() -> None:
    rows = np.random.default_rng(0).permutation(N)[:40]
    fit = estimation.fit_machine(MACHINE, survey(spoilt(noisy(), rows, 100.0)), robust=True)
    assert named(fit) == set(rows.tolist())
    assert prediction_error(fit, P) < 6


def test_a_large_survey_starts_from_a_sample() -> None:
    table = positions(measured(MACHINE, P, 5000, 1, noise=SIGMA))
    bad = np.arange(2000, 2500)
    fit = estimation.fit_machine(MACHINE, survey(spoilt(table, bad, 1e5, np.array([0.0, 1.0, 0.0]))), robust=True)
    assert set(bad.tolist()) <= named(fit)
    assert len(named(fit)) < 505
    assert prediction_error(fit, P) < 1


@pytest.mark.parametrize("m", [1, 2, 3])
def test_the_pull_of_normal_rows(m: int) -> None:
    """By quadrature: psi's divergence is what Stein's identity says, and 93 to 95 % of the information is kept."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(40)
    u = np.vstack([*(a.ravel() for a in np.meshgrid(*[nodes] * m)), *np.zeros((3 - m, len(nodes) ** m))])
    w = np.prod([a.ravel() for a in np.meshgrid(*[weights / weights.sum()] * m)], axis=0)
    axes = np.repeat((np.eye(3) * (np.arange(3) < m))[:, :, None], len(w), axis=2)
    rows = pull(u, np.full(len(w), m), axes)
    mean = w @ rows.slope / m
    assert mean == pytest.approx(w @ rows.along / m, rel=5e-3)  # but for faint explanations, which are cut off
    assert 0.925 < mean**2 / (w @ rows.square / m) < 0.955
    assert normal()[m] == pytest.approx(w @ rows.along / (w @ rows.live), rel=2e-3)
    assert chi.sf(BISQUARE_CUT_SIGMA[m], m) < 3e-6


def test_the_slope_is_the_derivative() -> None:
    rng = np.random.default_rng(0)
    u = rng.normal(0, 2.2, (3, 400))
    axes = rng.normal(size=(3, 3, 400))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    m = np.full(400, 3)

    def psi(v: Array) -> Array:
        rows = pull(v, m, axes)
        out = np.sqrt(rows.bare[0]) ** 2 * v
        some = rows.mixed
        out[:, some] = np.einsum("nab,nbc,cn->an", rows.roots(1.0), rows.roots(1.0), v[:, some])
        return out

    step = 1e-6
    slope = sum((psi(u + step * e)[k] - psi(u - step * e)[k]) / (2 * step) for k, e in enumerate(np.eye(3)[:, :, None]))
    np.testing.assert_allclose(pull(u, m, axes).slope, slope, atol=2e-3)


def test_the_start_is_the_smallest_sum_of_distances() -> None:
    problem = build(CHAIN, survey(spoilt(noisy(), np.arange(10), 50.0)))
    judged = first_judgement(CHAIN, problem.views, problem.unknowns)
    assert np.flatnonzero(judged.views[0].out).tolist() == list(range(10))
    assert judged.sigma["position"] == pytest.approx(SIGMA, rel=0.3)


@pytest.mark.long
def test_command(tmp_path: Path) -> None:
    """Named on the terminal, in fit.json, residuals.csv and the report; the same bytes again."""
    done("simulate", MILL, 80, "--noise", 0.002, "--out", tmp_path / "s.csv")
    table = pd.read_csv(tmp_path / "s.csv")
    table.loc[[10, 20], XYZ] += 5.0
    table.loc[30, "my"] += 1.0
    table.to_csv(tmp_path / "s.csv", index=False)
    out = done("fit", MILL, tmp_path / "s.csv", "--robust", "--out", tmp_path / "fit").out
    assert "3 of 80 rows take no part" in out
    assert "row 31: my" in out
    data = json.loads((tmp_path / "fit" / "fit.json").read_text())
    assert data["robust"] is True
    assert [(o["row"], o["what"]) for o in data["outliers"]] == [(11, "position"), (21, "position"), (31, "my")]
    assert data["outliers"][0]["residual_um"] == pytest.approx(5000 * np.sqrt(3), rel=0.01)
    assert data["fitted"]["n"] == 78
    rows = pd.read_csv(tmp_path / "fit" / "residuals.csv", keep_default_na=False)
    assert rows["outlier"][[10, 20, 30, 31]].tolist() == ["position", "position", "my", ""]
    assert float(rows["residual_x_um"][10]) == pytest.approx(5000, rel=0.01)
    assert float(rows["weight"][10]) == 0 < float(rows["weight"][31])
    page = Page((tmp_path / "fit" / "report.html").read_text(encoding="utf-8"))
    assert sorted(cells[1] for cells in page.tables["left-out"][1:]) == ["11", "21", "31"]
    before = (tmp_path / "fit" / "fit.json").read_bytes()
    done("fit", MILL, tmp_path / "s.csv", "--robust", "--out", tmp_path / "again")
    assert (tmp_path / "again" / "fit.json").read_bytes() == before
    table[XYZ] += np.random.default_rng(0).normal(0, 300, (80, 3)) * (np.arange(80) < 50)[:, None]
    table.to_csv(tmp_path / "s.csv", index=False)
    wrong = command("fit", MILL, tmp_path / "s.csv", "--robust", "--out", tmp_path / "wrong")
    assert wrong.code == 2
    assert "more than half" in wrong.err
    assert not (tmp_path / "wrong").exists()


def test_a_figure_of_distances_needs_a_robust_fit() -> None:
    fit = estimation.fit_machine(MACHINE, survey(noisy()), robust=True)
    assert draw_distances(fit).axes[0].get_yscale() == "log"
    with pytest.raises(ValueError, match="not robust"):
        draw_distances(replace(fit, sorting=None))
