"""What has no name is predicted where it was recorded as it is there, and beyond as a smooth process would be."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.effects import make
from errormodel.effects.best_prediction import predicted_terms
from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec, Joint, Machine, Shape
from errormodel.simulation import simulate
from errormodel.survey import read_survey
from identification.diagnosis.results.beyond_recorded import known_where_recorded, later_spread
from identification.diagnosis.search.model import EffectModel
from identification.diagnosis.search.scoring import Step
from identification.estimation.fit import fit_machine
from identification.results import store
from identification.uncertainty.prediction import predict

X = Joint("X", "prismatic", (1.0, 0.0, 0.0), (0.0, 500.0))
LINE = {"element": "X", "motion": "dy", "driver": "time", "center": 50.0, "half_range": 50.0}
LENGTH = 100 / np.sqrt(12)  # of a line over 100 s
WITHIN = {"within": [["time", 0.0, 100.0, LENGTH]], "spread": [["X", "dy", 0.01]]}
MACHINE = Machine("m", (X, Shape("T", (0.0, 0.0, 100.0))))


def matern(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    r = np.abs(a[:, None] - b) / LENGTH
    return (1 + r) * np.exp(-r)


def test_beyond_the_range_it_is_the_best_linear_prediction_of_a_smooth_process() -> None:
    """By the normal equations of a process that was seen close to the end of the range, value and slope."""
    smooth = {"driver": "w_level", "within": [["w_level", 0.0, 100.0, LENGTH]], "spread": WITHIN["spread"]}
    effect = make(EffectSpec("unnamed", LINE | smooth))
    later = np.array([100.0, 103.0, 130.0, 170.0, 300.0])
    line, unknown = predicted_terms(effect, lambda name: later, MACHINE)
    seen = np.array([99.999, 100.0])
    weights = np.linalg.solve(matern(seen, seen), matern(seen, later))
    np.testing.assert_allclose(line.motion["dy"], weights.T @ ((seen - 50) / 50), atol=1e-3)
    variance = 1 - np.einsum("ak,ak->k", matern(seen, later), weights)
    np.testing.assert_allclose(unknown.motion["dy"] ** 2, variance, atol=3e-3)
    assert unknown.size == 0.01
    assert unknown.tied
    early = -np.array([0.0, 3.0, 30.0, 70.0, 200.0])  # and before the first row, mirrored
    np.testing.assert_allclose(
        predicted_terms(effect, lambda name: early, MACHINE)[0].motion["dy"], -line.motion["dy"], atol=1e-9
    )


def test_beyond_the_last_time_it_is_that_of_a_markov_process() -> None:
    """What wanders or switches in time has a covariance exp(-r): by the normal equations, from the last time."""
    effect = make(EffectSpec("unnamed", LINE | WITHIN))
    later = np.array([100.0, 103.0, 130.0, 170.0, 300.0])
    line, unknown = predicted_terms(effect, lambda name: later, MACHINE)
    covariance = np.exp(-(later - 100.0) / LENGTH)
    np.testing.assert_allclose(line.motion["dy"], covariance, atol=1e-6)  # 1 at the end, and 0 in the mean
    np.testing.assert_allclose(unknown.motion["dy"] ** 2, 1 - covariance**2, atol=3e-3)


@pytest.mark.parametrize("form", [{"form": "cubic"}, {"period": 30.0}, {"by": "X", "by_half_range": 250.0}])
def test_inside_nothing_changes(form: dict[str, object]) -> None:
    rows = {"time": np.linspace(0, 100, 11), "X": np.linspace(0, 500, 11)}
    plain, known = (make(EffectSpec("unnamed", LINE | form | more)) for more in ({}, WITHIN))
    terms = predicted_terms(known, rows.__getitem__, MACHINE)
    for one, other in zip(plain.terms(rows.__getitem__, MACHINE), terms, strict=False):
        np.testing.assert_allclose(one.motion["dy"], other.motion["dy"], atol=1e-12)
    assert not np.any(terms[-1].motion["dy"])


def test_a_fit_says_where_it_was_recorded_and_predicts_less_surely_beyond(tmp_path: Path) -> None:
    """A drift to 20 um in 3000 s: an hour later its mean, with the uncertainty of its size."""
    drift = EffectSpec("unnamed", LINE | {"center": 1500.0, "half_range": 1500.0})
    machine = replace(MACHINE, effects=(drift,))
    rng = np.random.default_rng(3)
    poses = pd.DataFrame({"X": rng.uniform(0, 500, 150), "time": np.linspace(0, 3000, 150)})
    simulate(machine, poses, {"X.dy.unnamed-1": 0.01}, noise=0.001, seed=3).to_csv(tmp_path / "s.csv", index=False)
    end = 3000.0
    fit = fit_machine(machine, read_survey(tmp_path / "s.csv", machine))
    model = EffectModel(None, None, (Step(make(drift), 50.0, 100.0, 0.1),))  # type: ignore[arg-type]
    known = known_where_recorded(fit, model, 0, [])
    ((name, low, high, length),) = known.chain.machine.effects[0].options["within"]
    assert (name, low, high) == ("time", 0.0, end)
    assert length == pytest.approx((high - low) / np.sqrt(12), rel=0.01)
    assert known.solution is fit.solution
    commands = tmp_path / "later.csv"
    commands.write_text(f"X,time\n250,{end}\n250,{end + 10 * length}\n")
    where = []
    for k, one in enumerate((fit, known)):
        store.save(one, tmp_path / str(k))
        stored = store.load(tmp_path / str(k))
        where.append(predict(stored, read_survey(commands, stored.chain.machine, measured=False)))
    plain, best = where
    assert best["ey"][0] == pytest.approx(plain["ey"][0], abs=1e-9)
    assert best["uy"][0] == pytest.approx(plain["uy"][0], rel=1e-6)
    middle = fit.solution.named()["X.dy.unnamed-1"] * ((low + high) / 2 - 1500) / 1500
    constant = plain["ey"][0] - fit.solution.named()["X.dy.unnamed-1"] * (end - 1500) / 1500
    assert best["ey"][1] == pytest.approx(constant + middle, abs=1e-5)
    size = known.chain.machine.effects[0].options["spread"][0][2]
    assert best["uy"][1] == pytest.approx(size, rel=0.1)
    assert Chain(known.chain.machine).ids == known.chain.ids


def test_a_range_without_extent_is_refused() -> None:
    wrong = EffectSpec("unnamed", LINE | {"within": [["time", 5.0, 5.0, 1.0]]})
    with pytest.raises(InputError, match="key within: time from 5 to 5"):
        Chain(replace(MACHINE, effects=(wrong,)))


@pytest.mark.parametrize("later", [0.15, 0.5])
@pytest.mark.parametrize("length", [0.03, 0.1, 0.3, 1.0, np.inf])
def test_later_motions_are_as_surely_known_as_they_turn_out(length: float, later: float) -> None:
    """Of Ornstein-Uhlenbeck processes, of which a random walk has no end of length: 95 % lie within 2 sigma."""
    rng, steps, within = np.random.default_rng(3), 257, []
    keeps = np.exp(-1 / (steps * length))
    moves = np.sqrt(1 - keeps**2) if keeps < 1 else 1 / np.sqrt(steps)
    for _ in range(300):
        values = [rng.normal()]
        for new in rng.normal(size=int(steps * (1 + later))):
            values.append(keeps * values[-1] + moves * new)
        seen = np.array(values[:steps])
        within.append(abs(values[-1] - seen.mean()) < 2 * later_spread(seen) * seen.std())
    # of one recording a length is known to a factor of three, and not beyond itself: of walks somewhat fewer
    assert 0.78 < np.mean(within) < 0.995
