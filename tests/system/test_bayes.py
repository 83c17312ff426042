"""The posterior: equal to the closed form where that holds, covering the truth, and never half a result."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import kstest, norm
from scipy.stats import t as student

from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import write_machine
from identification.bayes import sampling
from identification.bayes.full_posterior import Whole
from identification.bayes.inference import bayesian, drawn, model_of
from identification.bayes.netcdf import write_netcdf
from identification.bayes.pointwise import prior_draws
from identification.bayes.posterior import Posterior
from identification.bayes.sampling import NotConvergedError, Reference, sample
from identification.bayes.settings import PriorForm
from identification.bayes.shape_parameters import bracket
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit, residuals_of
from tests.benchmarks.bayes_coverage import WAVE, machine, trial
from tests.helpers.chains import Array, errors
from tests.helpers.commands import MILL, Fill, done, run, write
from tests.helpers.surveys import measured, positions, survey

XYZ = ["mx", "my", "mz"]


def fitted(true: Machine, rows: int = 80, declared: bool = False, outliers: int = 0, seed: int = 0) -> Fit:
    from errormodel.chain import Chain

    p = errors(Chain(true), 1)
    table = positions(measured(true, p, rows, 5, noise=2e-3, frame=((0, 0, 0), (0, 0, 0))))
    rng = np.random.default_rng(seed)
    bad = rng.choice(rows, outliers, replace=False)
    table.loc[bad, XYZ] += 10 ** rng.uniform(-1, 2, (outliers, 1)) * rng.normal(size=(outliers, 3))
    if declared:
        table[["sigma_x", "sigma_y", "sigma_z"]] = 2e-3
    data = survey(table, frame="fixed")
    return fit_machine(true, data, robust=outliers > 0)


def least_squares(fit: Fit) -> tuple[Array, Array]:
    """Values of the groups and their covariance, priors aside."""
    return fit.solution.values[fit.solution.groups.base], fit.solution.covariance


def test_a_gaussian_posterior_is_the_closed_form_and_says_so():
    fit = fitted(machine(), declared=True)
    out, _ = drawn(fit, *model_of(fit, {}, None, False)[:2], seed=0)
    values, covariance = least_squares(fit)
    std = np.sqrt(np.diag(covariance))
    assert out.method == "exact"
    assert out.chains is None
    assert "closed form" in out.statement
    assert np.abs((out.mean - values) / std).max() < 0.02  # priors are wide
    np.testing.assert_allclose(out.covariance / np.outer(std, std), covariance / np.outer(std, std), atol=0.02)
    flat = out.values.reshape(-1, len(std))
    for k in range(len(std)):  # draws are draws of it
        assert kstest((flat[:, k] - out.mean[k]) / np.sqrt(out.covariance[k, k]), "norm").pvalue > 1e-4


def test_unknown_noise_gives_students_distribution():
    fit = fitted(machine(), rows=14)
    out, _ = drawn(fit, *model_of(fit, {}, None, False)[:2], seed=0)
    values, covariance = least_squares(fit)
    assert out.method == "quadrature"
    flat = out.values.reshape(-1, len(values))
    for k in range(len(values)):
        z = (flat[:, k] - values[k]) / np.sqrt(covariance[k, k])
        assert kstest(z, student(fit.solution.dof).cdf).pvalue > 1e-4


def test_emcee_in_scaled_groups_equals_the_closed_form():
    fit = fitted(machine(), declared=True)
    linear, _, _ = model_of(fit, {}, None, False)
    whole = Whole.of(linear)
    out, _ = drawn(fit, linear, whole, seed=0)
    (mean,), (covariance,) = linear.closed(linear.start())
    std = np.sqrt(np.diag(covariance))
    assert out.chains is not None
    n = out.chains.effective
    assert n > 500
    assert np.abs((out.mean - mean) / std).max() < 4.5 / np.sqrt(n)
    ratio = np.diag(out.covariance) / std**2
    assert np.abs(ratio - 1).max() < 4.5 * np.sqrt(2 / n)


def test_a_log_probability_is_that_of_the_rows():
    """Statistics, and nodes of a period, against the exact kinematics of another machine each time."""
    fit = fitted(machine((WAVE,)))
    out = bayesian(fit, lambda m: fit_machine(m, fit.survey)).posterior
    assert out is not None
    assert [c.name for c in out.unknowns] == ["noise.position", "X.pitch-cyclic.period"]
    assert out.departure < 0.05  # nats, at draws of parameters and period


def test_a_period_and_its_evidence():
    fit = fitted(machine((EffectSpec("pitch-cyclic", {"joint": "X", "period": 10.01}),)))
    moved = machine((WAVE,))
    data = replace(fitted(moved).survey)
    out = bayesian(fit_machine(fit.chain.machine, data), lambda m: fit_machine(m, data))
    assert out.posterior is not None
    period = out.posterior.coordinates[:, :, 1]
    assert abs(period.mean() - 10) < 4 * period.std()
    spec = out.chain.machine.effects[0]
    assert spec.options["period"] == pytest.approx(period.mean(), rel=1e-4)  # the fit has moved there
    (evidence,) = out.posterior.evidence
    assert evidence.log10_bayes_factor > 2


def test_outliers_of_any_size_are_found_and_do_no_harm():
    fit = fitted(machine(), outliers=8)
    out, _ = drawn(fit, *model_of(fit, {}, None, True)[:2], seed=0)
    clean = fitted(machine())
    values, covariance = least_squares(clean)
    bad = set((np.random.default_rng(0).choice(80, 8, replace=False) + 1).tolist())
    assert bad == {row for _, row, _ in out.outliers}
    std = np.sqrt(np.diag(covariance))
    assert np.abs((out.mean - values) / std).max() < 1.2
    assert (np.sqrt(np.diag(out.covariance)) / std).max() < 1.2
    names = [c.name for c in out.unknowns]
    assert names == ["noise.position", "outliers.share", "outliers.width"]


def test_two_standard_deviations_hold_the_truth():
    """Forty surveys; five hundred, and chains: python -m tests.benchmarks.bayes_coverage."""
    z = np.array([trial("closed", seed).z for seed in range(40)])
    assert 0.91 < np.mean(np.abs(z) <= 2) < 0.98


def test_tied_curves_have_a_scale():
    effect = EffectSpec("higher-order-geometry", {"joint": "X", "motion": "dz", "every": 50.0, "size": 0.01})
    fit = fitted(machine((effect,)), rows=120)
    linear, whole, _ = model_of(fit, {}, None, False)
    assert whole is None
    assert [c.name for c in linear.coordinates] == ["noise.position", "X.higher-order-geometry.scale"]
    points = np.repeat(linear.start(), 2, axis=0)
    points[1, 1] = np.log(1e-2)  # a curve so tied that it vanishes explains less
    first, second = linear.log_prob(points)
    assert first > second


def test_bracket_ends_where_the_misfit_has_risen():
    best, low, high = bracket(lambda x: 100 * (x - 0.3) ** 2, 0.1, -5.0, 5.0)
    assert best == pytest.approx(0.3, abs=1e-3)
    assert 100 * (low - 0.3) ** 2 >= 50 <= 100 * (high - 0.3) ** 2
    assert high - low < 3


class Slow:
    """A target whose walkers hardly move."""

    def log_prob(self, points: Array) -> Array:
        return np.asarray(-0.5 * np.square(points * 1e4).sum(axis=1))


def test_a_chain_that_has_not_converged_is_no_result(tmp_path: Path):
    reference = Reference(np.zeros(2), np.ones(2))
    start = reference.draw(np.random.default_rng(0), 24)
    with pytest.raises(NotConvergedError, match="No posterior is reported"):
        sample(Slow(), reference, start, 0, tmp_path, most=3)
    assert len(list(tmp_path.glob("piece_*.npz"))) == 3  # to go on from


class Normal:
    def __init__(self) -> None:
        self.calls = 0

    def log_prob(self, points: Array) -> Array:
        self.calls += 1
        return np.asarray(-0.5 * np.square(points).sum(axis=1))


@pytest.mark.long
@pytest.mark.parametrize("damage", [None, slice(0), slice(300), slice(-300)], ids=["whole", "empty", "head", "cut"])
def test_a_broken_run_goes_on_and_ends_as_if_never_broken(
    damage: slice | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    reference = Reference(np.zeros(3), np.full(3, 1.5))
    start = reference.draw(np.random.default_rng(0), 24)
    whole = sample(Normal(), reference, start, 0, tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(sampling, "MOST_PIECES", 1)
        with pytest.raises(NotConvergedError):
            sample(Normal(), reference, start, 0, tmp_path, most=1)
    (piece,) = tmp_path.glob("piece_*")
    if damage is not None:
        piece.write_bytes(piece.read_bytes()[damage])
    again = Normal()
    resumed = sample(again, reference, start, 0, tmp_path)
    np.testing.assert_array_equal(whole.points, resumed.points)
    assert not list(tmp_path.glob("piece_*"))
    other = sample(Normal(), reference, start, 1, tmp_path)
    assert not np.array_equal(other.points, whole.points)


@pytest.fixture(scope="module")
def shaped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the machine of a period and a survey of it."""
    folder = tmp_path_factory.mktemp("shaped")
    write_machine(machine((WAVE,)), folder / "m.yaml")
    write(folder / "truth.yaml", "parameters: {X.dx.pitch-cyclic-sin: 0.004, X.ec.1: 3.0e-5}\n")
    done("simulate", folder / "m.yaml", 80, "--parameters", folder / "truth.yaml", "--noise", 0.002,
         "--out", folder / "s.csv")  # fmt: skip
    return folder


def test_a_killed_command_resumes(shaped: Path):
    """Killed once its first piece is written; the second run gives what an unbroken one gives, byte by byte."""
    program = [sys.executable, "-m", "identification.command_line.main"]
    command = [*program, "fit", shaped / "m.yaml", shaped / "s.csv", "--bayes"]
    process = subprocess.Popen([*command, "--out", shaped / "killed"], stdout=subprocess.DEVNULL)
    chain = shaped / "killed" / "chain"
    until = time.monotonic() + 240  # s, on a busy computer
    while not list(chain.glob("piece_*.npz")) and process.poll() is None and time.monotonic() < until:
        time.sleep(0.02)
    process.kill()
    process.wait()
    assert list(chain.glob("piece_*.npz"))
    assert not (shaped / "killed" / "fit.json").exists()
    out = done("fit", shaped / "m.yaml", shaped / "s.csv", "--bayes", "--out", shaped / "killed").out
    done("fit", shaped / "m.yaml", shaped / "s.csv", "--bayes", "--out", shaped / "unbroken")
    for name in ("fit.json", "posterior.nc", "parameters.csv"):
        assert (shaped / "killed" / name).read_bytes() == (shaped / "unbroken" / name).read_bytes()
    assert "autocorrelation times long" in out
    assert not chain.exists()
    written = json.loads((shaped / "unbroken" / "fit.json").read_text(encoding="utf-8"))["posterior"]
    assert written["convergence"]["split_rhat"] < sampling.LARGEST_SPLIT_RHAT
    report = (shaped / "unbroken" / "report.html").read_text(encoding="utf-8")
    for text in ('id="posterior"', 'id="budget"', "Corner plot", "Trace of the walkers", "predictive"):
        assert text in report


def test_arviz_reads_the_draws(tmp_path: Path):
    import arviz_base
    import xarray

    fit = fitted(machine())
    out = bayesian(fit, lambda m: fit)
    assert isinstance(out.posterior, Posterior)
    write_netcdf(out, out.posterior, tmp_path / "posterior.nc")
    with xarray.open_datatree(tmp_path / "posterior.nc", engine="h5netcdf") as tree:
        assert {*tree.children} == {
            "posterior", "prior", "log_likelihood", "posterior_predictive", "observed_data",
        }  # fmt: skip
        parameter = arviz_base.extract(tree, num_samples=None)["parameter"]
        assert parameter.sizes == {"group": len(out.posterior.names), "sample": 4000}
        np.testing.assert_allclose(parameter.mean("sample"), out.posterior.mean, rtol=0.2, atol=1e-4)


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="files of limited size stand for a full disk: POSIX")
def test_a_disk_that_is_full_before_the_draws_are_written(with_mill: Fill, tmp_path: Path):
    """HDF5 itself ends the process with a segmentation fault."""
    import resource

    with_mill(tmp_path)
    most = 500_000  # of 3 MB of draws, larger than all that is written before
    words = ["fit", str(MILL), "s.csv", "--bayes", "--out", "drawn", "--quiet"]
    ended = subprocess.run(
        [sys.executable, "-m", "errormodel", *words],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)),
        check=False,
    )
    assert ended.returncode == 2, ended.stderr
    assert "posterior.nc: cannot be written" in ended.stderr
    assert not (tmp_path / "drawn").exists()


@pytest.mark.long
@pytest.mark.parametrize("outliers", [0, 4])
def test_the_log_likelihood_of_each_row_is_that_of_the_exact_kinematics(outliers: int):
    """At draws of parameters and noise, by SciPy's normal density of what was measured less what is predicted."""
    fit = fitted(machine(), outliers=outliers)
    out = bayesian(fit, lambda m: fit, robust=outliers > 0)
    p = out.posterior
    assert p is not None
    found = p.log_likelihood["position"]
    chains, draws, rows = found.shape
    assert (chains, rows) == (p.values.shape[0], len(fit.survey))
    assert draws == len(range(0, p.values.shape[1], p.every))
    names = [c.name for c in p.unknowns]
    column = {name: p.coordinates[:, :, names.index(name)] for name in names}
    zero = np.zeros(len(fit.chain.ids))
    for chain, draw in ((0, 0), (1, draws - 1)):
        here = (chain, draw * p.every)
        values = np.zeros(len(fit.solution.unknowns))
        values[fit.solution.groups.base] = p.values[here]
        left = residuals_of(fit.problem.views, fit.problem.place(), values, zero, rows)
        sigma = column["noise.position"][here]
        log = norm.logpdf(left, scale=sigma).sum(axis=1)
        if outliers:
            share, width = column["outliers.share"][here], column["outliers.width"][here]
            far = norm.logpdf(left, scale=width * sigma).sum(axis=1)
            log = np.logaddexp(np.log1p(-share) + log, np.log(share) + far)
        np.testing.assert_allclose(found[chain, draw], log, atol=0.02)


def test_draws_from_the_prior_have_its_moments_and_bounds():
    fit = fitted(machine(), rows=30)
    names = [fit.solution.unknowns[j] for j in fit.solution.groups.base]
    k = names.index("X.dx.1")
    value = float(fit.solution.values[fit.solution.groups.base][k])
    given = {"X.dx.1": PriorForm(mean=value, std=0.5), "noise.position": PriorForm(low=1e-3, high=4e-3)}
    linear, _, _ = model_of(fit, given, None, False)
    values, others = prior_draws(linear, linear.coordinates, np.random.default_rng(0))
    assert values.shape == (1000, len(names))
    assert values[:, k].mean() == pytest.approx(value, abs=0.05)
    np.testing.assert_allclose(values.std(axis=0), linear.prior.std, rtol=0.15)
    noise = others[:, [c.name for c in linear.coordinates].index("noise.position")]
    assert (noise.min() >= 1e-3) & (noise.max() <= 4e-3)
    assert np.log(noise).mean() == pytest.approx(np.log(2e-3), abs=0.05)
    linear, _, _ = model_of(fit, {"X.dx.1": PriorForm(mean=value, std=0.5, low=value)}, None, False)
    values, _ = prior_draws(linear, linear.coordinates, np.random.default_rng(0))
    assert values[:, k].min() >= value
    assert values[:, k].mean() - value == pytest.approx(0.5 * np.sqrt(2 / np.pi), rel=0.1)


def priors(folder: Path, text: str) -> Path:
    return write(folder / "priors.yaml", f"errormodel: 1\npriors:\n{text}")


@pytest.mark.parametrize(
    ("text", "found", "cure"),
    [
        ("  X.dx.1: {std: 0}\n", "0", "above 0"),
        ("  X.dx.1: {std: -1.0e-5}\n", "-1e-05", "above 0"),
        ("  X.dx.1: {mean: 1}\n", "no prior", "std"),
        ("  X.dx.1: {low: 2.0e-5, high: 1.0e-5}\n", "no value is possible", "bounds"),
        ("  X.dx.1: {mean: 1.0, std: 1.0e-5, low: 0, high: 1.0e-4}\n", "outside its own bounds", "Move the mean"),
        ("  X.dy.1: {std: 1.0e-5}\n", "no such", "Did you mean"),
        ("  X.dx.1: {mean: 0.1, std: 1.0e-9}\n", "standard deviations apart", "Widen its std"),
        ("  X.dx.1: {low: 0.1}\n", "no walker fits in", "Widen the bounds"),
        ("  X.pitch-cyclic.period: {low: 20}\n", "no walker fits", "Widen the bounds"),
        ("  noise.position: {mean: 1, std: 0.001}\n", "data say", "Widen its std"),
    ],
)
def test_wrong_priors_are_told(shaped: Path, tmp_path: Path, text: str, found: str, cure: str):
    arguments = ("fit", shaped / "m.yaml", shaped / "s.csv", "--bayes", "--priors", priors(tmp_path, text))
    ended = run(*arguments, "--out", tmp_path / "out")
    assert ended.code == 2
    assert found in ended.err
    assert cure in ended.err
    assert not (tmp_path / "out" / "fit.json").exists()


def test_priors_ask_for_bayes(shaped: Path, tmp_path: Path):
    text = priors(tmp_path, "  X.dx.1: {std: 1.0e-5}\n")
    ended = run("fit", shaped / "m.yaml", shaped / "s.csv", "--priors", text, "--out", tmp_path / "out")
    assert ended.code == 2
    assert "--bayes" in ended.err


def test_bounds_and_normal_priors_are_kept():
    fit = fitted(machine(), rows=30)
    k = fit.solution.groups.base.tolist().index(fit.solution.unknowns.index("X.dx.1"))
    value, std = fit.solution.values[fit.solution.groups.base][k], np.sqrt(fit.solution.covariance[k, k])
    given = {"X.dx.1": PriorForm(mean=float(value), std=float(std) / 3)}
    out, _ = drawn(fit, *model_of(fit, given, None, False)[:2], seed=0)
    assert np.sqrt(out.covariance[k, k]) < 0.4 * std
    given = {"X.dx.1": PriorForm(low=float(value))}
    out, _ = drawn(fit, *model_of(fit, given, None, False)[:2], seed=0)
    assert out.values[:, :, k].min() >= value
    assert out.mean[k] - value == pytest.approx(np.sqrt(2 / np.pi) * std, rel=0.15)  # of half a normal distribution


def test_a_prior_of_the_wrong_name_names_the_nearest():
    fit = fitted(machine())
    with pytest.raises(InputError, match=r"noise\.position"):
        model_of(fit, {"noise.positon": PriorForm(std=1.0)}, None, False)
