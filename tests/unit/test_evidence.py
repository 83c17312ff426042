"""Closed-form evidence of effects against integrals over their parameters, geometry and noise, by quadrature."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.special import logsumexp

from identification.diagnosis.decisions.constants import SIZES
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.random_effects import RandomEffects
from identification.diagnosis.search import correlated_noise as coloured
from identification.diagnosis.search.candidates import Block, Candidates
from identification.estimation.noise import noises
from tests.helpers.chains import Array

N = 14
SLACK = 1e-4  # log_bayes: the quadrature is good to 1e-6; candidates' columns are kept in single precision where many


def problem(seed: int, geometry: int, truth: float = 1.0) -> tuple[LinearModel, Array, Array]:
    """Data of a geometry of so many columns and an effect of two: the linear model, the data, the effect's columns."""
    rng = np.random.default_rng(seed)
    basis = np.linalg.qr(rng.normal(size=(N, max(geometry, 1))))[0][:, :geometry]
    columns = rng.normal(size=(2, N))
    data = basis @ np.full(geometry, 2.0) + truth * columns[0] + rng.normal(0, 0.8, N)
    residual = data - basis @ (basis.T @ data)
    linear = LinearModel(None, residual, basis, {}, {}, np.arange(N), None)  # type: ignore[arg-type]
    return linear, data, columns


def integral(data: Array, basis: Array, columns: Array, deviations: Array) -> float:
    """Log of the data's density, integrated over all unknowns by the trapezoidal rule on a grid.

    The geometry's coefficients are uniform, the effect's parameters normal with `deviations` in units of the noise,
    the noise's logarithm uniform. At most three unknowns beside the noise.
    """
    design = np.vstack([basis.T, columns])
    best = np.linalg.lstsq(design.T, data, rcond=None)[0] if len(design) else np.zeros(0)
    level = np.std(data - best @ design)
    spread = np.sqrt(np.diag(np.linalg.inv(design @ design.T))) if len(design) else np.zeros(0)
    log_noise = np.log(level) + np.linspace(-1.3, 2.2, 71)
    # around the best fit, and as far as nothing: a prior draws towards it
    grids = [
        np.linspace(min(b - 14 * level * s, -4 * level * s), max(b + 14 * level * s, 4 * level * s), 81)
        for b, s in zip(best, spread, strict=True)
    ]
    mesh = np.array(np.meshgrid(*grids, indexing="ij")).reshape(len(grids), -1) if grids else np.zeros((0, 1))
    square = np.sum((data[:, None] - design.T @ mesh) ** 2, axis=0)
    own = mesh[basis.shape[1] :]
    shrunk = np.sum((own / np.asarray(deviations)[:, None]) ** 2, axis=0)
    terms = []
    for u in log_noise:
        density = -(square + shrunk) / (2 * np.exp(2 * u)) - (len(data) + len(own)) * u
        terms.append(logsumexp(density))
    steps = sum(np.log(g[1] - g[0]) for g in grids) + np.log(log_noise[1] - log_noise[0])
    constant = -(len(data) + len(own)) / 2 * np.log(2 * np.pi) - np.sum(np.log(deviations))
    return float(logsumexp(terms) + steps + constant)


def bayes_factor(linear: LinearModel, data: Array, columns: Array, deviations: Array) -> float:
    nothing = integral(data, linear.basis, np.zeros((0, N)), np.zeros(0))
    return integral(data, linear.basis, columns, deviations) - nothing


def stub(empirical: bool = False, cost: float = 0.0) -> SimpleNamespace:
    """What a score asks an effect for."""
    name = {"effect": "effect", "drivers": (), "key": ("effect",)}
    odds = {"cost": lambda scene: cost, "changing": lambda scene: 1.0}
    return SimpleNamespace(random=False, empirical=empirical, **name, **odds)


def evidence(linear: LinearModel, columns: Array, *, empirical: bool = False, cost: float = 0.0) -> float:
    """Of an effect whose columns (k, N) are those of parameters of their usual size."""
    effect = stub(empirical, cost)
    block = Block.of(linear, np.arange(1), columns[None].copy(), np.ones((1, len(columns))))
    scores = Candidates([effect], [block], [effect.key]).scores(linear)  # type: ignore[list-item]
    return float(scores.evidence[0])


def noise_of(linear: LinearModel, columns: Array | None = None) -> float:
    """Standard deviation of the noise, of all that is left or of what columns (k, N) leave of it.

    In units of the latter the closed form has the usual size: what the effect explains is no noise.
    """
    left, residual = linear.project(np.zeros((0, N)) if columns is None else columns), linear.residual
    beside = residual - np.linalg.lstsq(left.T, residual, rcond=None)[0] @ left
    return float(np.sqrt(beside @ beside / linear.freedom))


@pytest.mark.parametrize("truth", [0.0, 1.5])
@pytest.mark.parametrize("geometry", [0, 1])
def test_one_parameter_of_physical_size(geometry: int, truth: float) -> None:
    """The mean of the densities at sizes from a tenth to ten times the usual one, each as likely as is said."""
    linear, data, columns = problem(1, geometry, truth)
    one = columns[:1]
    each = [bayes_factor(linear, data, one, np.array([s / noise_of(linear, one)])) for s in SIZES]
    assert sum(SIZES.values()) == pytest.approx(1)
    assert [*SIZES.values()] == [*reversed(SIZES.values())]  # a machine is as often three times smaller as larger
    assert evidence(linear, one) == pytest.approx(logsumexp(each, b=[*SIZES.values()]), abs=SLACK)


def test_two_parameters_that_are_correlated() -> None:
    linear, data, columns = problem(2, 0)
    columns[1] += 0.8 * columns[0]
    columns /= np.linalg.norm(columns, axis=1)[:, None] / 3.0
    each = [bayes_factor(linear, data, columns, np.full(2, s / noise_of(linear, columns))) for s in SIZES]
    assert evidence(linear, columns) == pytest.approx(logsumexp(each, b=[*SIZES.values()]), abs=SLACK)


def test_a_form_without_a_size_has_the_one_that_suits_it_and_pays_a_nat_for_it() -> None:
    linear, data, columns = problem(3, 1, 2.0)
    one = columns[:1]
    left = linear.project(one)
    length = float(np.linalg.norm(left))
    drop = float((left @ linear.residual)[0] / length / noise_of(linear)) ** 2
    assert drop > 2
    # the likeliest prior deviation, in units of the noise that is left beside it
    suits = np.sqrt(drop - 1) / length * noise_of(linear) / noise_of(linear, one)

    def at(deviation: float) -> float:
        return bayes_factor(linear, data, one, np.array([deviation]))

    assert evidence(linear, one, empirical=True) == pytest.approx(at(suits) - 1.0, abs=SLACK)
    assert at(suits) > max(at(suits / 1.3), at(suits * 1.3))


def test_places_that_were_looked_at_and_what_nothing_can_tell_from_the_geometry() -> None:
    linear, _, columns = problem(4, 1)
    assert evidence(linear, columns[:1]) - evidence(linear, columns[:1], cost=2.5) == pytest.approx(2.5)
    assert evidence(linear, linear.basis.T) == -np.inf


@pytest.mark.parametrize(("geometry", "count"), [(1, 1), (0, 2)])
def test_parameters_with_one_unknown_deviation(geometry: int, count: int) -> None:
    """The deviation with most evidence is taken, a nat is paid for the choice; others nearby have less."""
    linear, data, columns = problem(5, geometry, 1.2)
    some = columns[:count]
    group = linear.random(some)
    ratio, log_bayes, noise = group.best()

    def at(r: float) -> float:
        return bayes_factor(linear, data, some, np.full(count, np.sqrt(r)))

    assert log_bayes == pytest.approx(at(ratio) - 1.0, abs=SLACK)
    assert at(ratio) > max(at(ratio / 1.6), at(ratio * 1.6))
    left = linear.project(some)
    mean = np.linalg.solve(left @ left.T + np.eye(count) / ratio, left @ linear.residual)
    square = np.sum((linear.residual - mean @ left) ** 2) + np.sum(mean**2) / ratio
    assert noise == pytest.approx(square / linear.freedom)


def test_parameters_with_a_known_deviation() -> None:
    linear, data, columns = problem(6, 1, 1.2)
    size = 0.9
    group = linear.random(columns[:1])
    noise = group.noise(size)
    assert noise == pytest.approx(float(group.left(size**2 / noise)) / linear.freedom, rel=1e-4)  # eight rounds
    log_bayes = group.evidence(size)
    assert log_bayes == pytest.approx(
        bayes_factor(linear, data, columns[:1], np.array([size / np.sqrt(noise)])), abs=SLACK
    )


def test_deviations_of_no_columns() -> None:
    assert RandomEffects.of(np.zeros((1, N)), np.zeros((1, 0)), np.ones(N), N).best()[1] == -np.inf


def test_evidence_in_noise_that_may_be_correlated() -> None:
    """Against dense matrices: each noise's density with and without the effect, each noise as likely as it is."""
    rng = np.random.default_rng(7)
    n = 40
    basis = np.linalg.qr(np.vstack([np.ones((1, 2 * n)), rng.normal(size=(1, 2 * n))]).T)[0]
    column = np.tile(np.linspace(-1, 1, n), 2)
    data = 0.8 * column + rng.normal(0, 1, 2 * n)
    residual = data - basis @ (basis.T @ data)
    index = np.tile(np.arange(n), 2)  # two components of one view: two series
    effect = stub()

    class One(LinearModel):
        def columns(self, effect: object) -> tuple[Array, Array]:
            return column[None].copy(), np.ones(1)

    linear = One(None, residual, basis, {}, {}, index, None)  # type: ignore[arg-type]
    [(white, any_noise)] = coloured.evidence(linear, [[effect]])  # type: ignore[list-item]
    assert white == pytest.approx(evidence(linear, column[None]), abs=1e-9)

    densities = []
    for noise in (None, *(m for m in noises() if m.length <= 20 and m.part <= 2)):
        whiten = np.eye(2 * n)
        if noise is not None:
            # the recursion of an ARMA(1,1) process' innovations, as a matrix
            autoregressive = np.eye(n) - noise.kept * np.eye(n, k=-1)
            one = np.linalg.solve(np.eye(n) - noise.moving * np.eye(n, k=-1), autoregressive)
            one[0] *= np.sqrt(noise.news)
            whiten = block_diag(one, one)
        design, y = whiten @ basis, whiten @ residual
        y = y - design @ np.linalg.lstsq(design, y, rcond=None)[0]
        free = 2 * n - 2
        without = -free / 2 * np.log(y @ y) - 0.5 * np.linalg.slogdet(design.T @ design)[1]
        x = whiten @ column
        x = x - design @ np.linalg.lstsq(design, x, rcond=None)[0]
        variance = (y @ y - (x @ y) ** 2 / (x @ x)) / free
        gains = []
        for s, p in SIZES.items():
            # y without the geometry: normal with covariance 1 + s^2/variance x x'
            k = s**2 / variance * (x @ x)
            square = y @ y - s**2 / variance * (x @ y) ** 2 / (1 + k)
            gains.append(np.log(p) - free / 2 * np.log(square / (y @ y)) - 0.5 * np.log1p(k))
        densities.append((without, without + logsumexp(gains)))
    prior = np.array([0.5, *[0.5 / (len(densities) - 1)] * (len(densities) - 1)])
    without, with_it = logsumexp(densities, axis=0, b=prior[:, None])
    assert any_noise == pytest.approx(with_it - without, abs=1e-6)
    assert any_noise < white  # a drift is worth less where noise may drift
