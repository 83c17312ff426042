"""Parameters that a prior ties to zero: in the fit, beyond what was measured, and when an effect is looked for."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from errormodel.chain import Chain
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from errormodel.simulation import random_points
from identification.diagnosis.linear.random_effects import RandomEffects
from identification.diagnosis.pipeline import diagnose
from identification.estimation.fit import fit_machine
from identification.uncertainty.prediction import predict
from tests.helpers.surveys import measured, positions, stored, survey

SIZE = 4e-4  # rad
CURVE = EffectSpec("higher-order-geometry", {"joint": "J2", "motion": "eb", "every": math.radians(6.0), "size": SIZE})


def test_scale_is_recovered_and_many_columns_cost_nothing_where_there_is_nothing() -> None:
    rng = np.random.default_rng(1)
    columns = rng.normal(size=(60, 900))
    basis = np.linalg.qr(rng.normal(size=(900, 20)))[0]
    for size in (0.3, 1.0):
        y = columns.T @ rng.normal(0, size, 60) + rng.normal(size=900)
        left = y - basis @ (basis.T @ y)
        ratio, evidence, noise = RandomEffects.of(columns, columns @ basis, left, 880).best()
        assert math.sqrt(ratio * noise) == pytest.approx(size, rel=0.25)
        assert noise == pytest.approx(1.0, rel=0.15)
        assert evidence > 50
    y = rng.normal(size=900)
    assert RandomEffects.of(columns, columns @ basis, y - basis @ (basis.T @ y), 880).best()[1] < 2.0


def test_curve_of_a_joint_is_fitted_and_returns_to_zero_where_nothing_was_measured() -> None:
    plain = read_machine("six_axis_arm")
    machine = replace(plain, effects=(CURVE,))
    chain = Chain(machine)
    own = chain.effect_ids[0]
    rng = np.random.default_rng(3)
    p = np.zeros(len(chain.ids))
    p[[chain.index[i] for i in own]] = rng.normal(0, SIZE, len(own))
    points = random_points(machine, 500, 4)
    points["J2"] = rng.uniform(-1.2, 0.4, len(points))
    points["J3"] = rng.uniform(0.5, 2.0, len(points))
    fit = fit_machine(machine, survey(positions(measured(machine, p, noise=0.01, points=points))))
    assert fit.fitted.rms_um < 25 < 5 * fit.fitted.rms_um
    inside, outside = points.iloc[:80].copy(), points.iloc[:80].copy()
    outside["J2"] = 2.0  # 90 degrees from anything measured: what is known there is the size alone
    for table, least, most in ((inside, 0.0, 12.0), (outside, 150.0, 900.0)):
        fresh = survey(measured(machine, p, points=table))
        out = predict(stored(fit), fresh)
        u = 1e3 * out[["ux", "uy", "uz"]].to_numpy()
        assert least < np.sqrt(np.mean(np.sum(u**2, axis=1))) < most
        gap = np.abs(out[["mx", "my", "mz"]].to_numpy() - fresh.measured)
        assert np.mean(gap < 2 * out[["ux", "uy", "uz"]].to_numpy()) > 0.85
    bare = fit_machine(plain, survey(positions(measured(machine, p, noise=0.01, points=points))))
    assert bare.heldout.rms_um > 3 * fit.heldout.rms_um


@pytest.mark.long
def test_curve_is_found() -> None:
    plain = read_machine("six_axis_arm")
    machine = replace(plain, effects=(CURVE,))
    chain = Chain(machine)
    p = np.zeros(len(chain.ids))
    own = [chain.index[i] for i in chain.effect_ids[0]]
    p[own] = np.random.default_rng(8).normal(0, SIZE / 2, len(own))
    result = diagnose(plain, survey(positions(measured(machine, p, 400, noise=0.02))))
    (finding,) = result.diagnosis.findings
    assert (finding.effect, finding.where) == ("higher-order-geometry", "J2")
    (step,) = result.model.findings[0][:1]
    assert step.effect.random
    assert getattr(step.effect, "size", 0.0) == pytest.approx(SIZE / 2, rel=0.5)
    assert result.final.heldout.rms_um < 0.5 * result.baseline.heldout.rms_um
