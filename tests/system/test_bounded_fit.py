"""Fits within bounds: what physics allows and what a user knows; what is held at one is said, and honest."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import lsq_linear

from errormodel.chain import Chain
from errormodel.effects.servo_lag import ServoLag
from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine, write_machine
from errormodel.survey import Survey
from identification.bayes.applied import with_posterior
from identification.bayes.inference import drawn, model_of
from identification.bayes.settings import PriorForm
from identification.estimation import fit as stage
from identification.estimation.bounded import bounded, limits
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit
from identification.observation.normal_equations import total
from tests.benchmarks.bayes_coverage import machine as two_axes
from tests.helpers.chains import Array, errors
from tests.helpers.commands import done, run, write
from tests.helpers.surveys import measured, positions, survey

ARM = read_machine("six_axis_arm")
SPEC = EffectSpec("joint-compliance", {"joint": "J2"})
NOISE = 0.03  # mm: what hides the weights of the outer members


@pytest.fixture(scope="module")
def arm() -> tuple[Machine, Array, Survey]:
    """An arm whose shoulder gives way under two of its members only, and a noisy survey of it."""
    machine = Machine(ARM.name, ARM.elements, ARM.tool, (SPEC,))
    chain = Chain(machine)
    p = errors(chain, 1)
    weights = [i for i in chain.effect_ids[0] if not i.endswith("hardening")]
    p[[chain.index[i] for i in chain.effect_ids[0]]] = 0.0
    p[[chain.index[i] for i in weights[:2]]] = 1e-6
    return machine, p, survey(positions(measured(machine, p, 90, noise=NOISE)))


def weights_of(fit: Fit) -> dict[str, float]:
    """Values of the groups that hold weights and nothing else."""
    s = fit.solution
    low, _ = limits(fit.chain, s.unknowns, s.groups, {}, None)
    return {s.unknowns[j]: float(s.values[j]) for j, least in zip(s.groups.base, low, strict=True) if least == 0}


def with_effect(machine: Machine, value: float) -> tuple[Machine, Chain, Array, str]:
    """The two axes with errors, and an effect of one parameter at a value."""
    chain, plain = Chain(machine), Chain(two_axes())
    (name,) = chain.effect_ids[0]
    known = dict(zip(plain.ids, errors(plain, 1), strict=True)) | {name: value}
    return machine, chain, np.array([known[i] for i in chain.ids]), name


def test_a_weight_never_lifts(arm: tuple[Machine, Array, Survey]) -> None:
    """Without bounds some weights come out negative; with them none does, and the fit says which are held."""
    machine, _, data = arm
    loose = {i: PriorForm(low=-1.0) for i in weights_of(fit_machine(machine, data))}
    free = fit_machine(machine, data, bounds=loose)
    fit = fit_machine(machine, data)
    assert min(weights_of(free).values()) < 0 <= min(weights_of(fit).values())
    assert not free.at_bound
    assert {b.id for b in fit.at_bound} >= {i for i, v in weights_of(fit).items() if v == 0}
    for told in fit.at_bound:
        assert told.free == free.solution.named()[told.id]
        assert any(told.id in note and "physics" in note for note in fit.notes)
    np.testing.assert_array_equal(fit.solution.covariance, free.solution.covariance)
    assert fit.solution.chi2 > free.solution.chi2
    assert fit.solution.dof == free.solution.dof + len(fit.at_bound)
    assert fit.heldout.rms_um < 1.02 * free.heldout.rms_um


def test_what_the_data_contradict_is_dropped(arm: tuple[Machine, Array, Survey]) -> None:
    """A weight that lifts, beyond all doubt: no bound of physics bends the fit, and it is said."""
    machine, p, _ = arm
    chain, lifts = Chain(machine), p.copy()
    name = chain.effect_ids[0][0]
    lifts[chain.index[name]] = -1e-5
    data = survey(positions(measured(machine, lifts, 90, noise=NOISE)))
    fit = fit_machine(machine, data)
    assert fit.solution.named()[name] == pytest.approx(-1e-5, rel=0.3)
    assert not fit.at_bound
    assert any(name in note and "beyond what physics allows" in note for note in fit.notes)
    held = fit_machine(machine, data, bounds={name: PriorForm(low=0.0)})  # a user knows what he says
    assert held.solution.named()[name] == 0
    assert name in {b.id for b in held.at_bound}


def test_it_is_the_optimum_of_the_convex_problem(arm: tuple[Machine, Array, Survey]) -> None:
    """Against an active-set solver of another library on the same normal equations."""
    machine, _, data = arm
    loose = {i: PriorForm(low=-1.0) for i in weights_of(fit_machine(machine, data))}
    s = fit_machine(machine, data, bounds=loose).solution
    base = s.groups.base
    low, high = limits(Chain(machine), s.unknowns, s.groups, {}, None)
    gram = total(s.sums, s.sigma)[0][np.ix_(base, base)]
    root = np.linalg.cholesky(gram).T
    scale = np.linalg.norm(root, axis=0)
    found = lsq_linear(root / scale, root @ s.values[base], (low * scale, high * scale), method="bvls", tol=1e-14)
    ours, _, _ = bounded(Chain(machine), s, {}, None)
    std = np.sqrt(np.diag(s.covariance))
    np.testing.assert_allclose((ours.values[base] - found.x / scale) / std, 0, atol=1e-6)


@pytest.mark.long
def test_bounds_come_nearer_to_the_truth_and_uncertainties_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    """Over seeds: a reversal that is known to be no lead."""
    machine, chain, p, name = with_effect(two_axes((EffectSpec("backlash", {"joint": "X"}),)), 2e-4)
    monkeypatch.setattr(stage, "Chain", lambda _: chain)  # traced once for all surveys
    clean = positions(measured(machine, p, 60, frame=((0, 0, 0), (0, 0, 0))))
    z = []
    for seed in range(40):
        table = clean.copy()
        table[["mx", "my", "mz"]] += np.random.default_rng(seed).normal(0, 2e-3, (60, 3))
        fits = [fit_machine(machine, survey(table, frame="fixed"), bounds=b) for b in ({}, {name: PriorForm(low=0.0)})]
        rows = []
        for fit in fits:
            s = fit.solution
            truth = s.groups.coefficients @ np.array([p[chain.index[u]] for u in s.unknowns])
            rows.append((s.values[s.groups.base] - truth) / np.sqrt(np.diag(s.covariance)))
        z.append(rows)
    free, within = np.array(z).transpose(1, 0, 2)
    k = fits[0].solution.groups.base.tolist().index(fits[0].solution.unknowns.index(name))
    assert np.mean(within[:, k] ** 2) < 0.8 * np.mean(free[:, k] ** 2)
    assert np.mean(within**2) < np.mean(free**2)
    assert np.mean(np.abs(within) <= 2) >= np.mean(np.abs(free) <= 2) > 0.92


def test_a_group_has_what_its_members_leave(arm: tuple[Machine, Array, Survey]) -> None:
    machine, _, data = arm
    chain = Chain(machine)
    s = fit_machine(machine, data).solution
    low, high = limits(chain, s.unknowns, s.groups, {}, None)
    for k in range(s.groups.rank):
        members = s.groups.members(k)
        signed = all(
            c > 0 and i in chain.index and chain.parameters[chain.index[i]].low == 0 for i, c in members.items()
        )
        assert (low[k] == 0) == signed
    assert np.isinf(high).all()
    with pytest.raises(InputError, match=r"J2\.dx"):
        limits(chain, s.unknowns, s.groups, {"J2.dxx": PriorForm(low=0.0)}, None)


def test_the_posterior_keeps_what_physics_allows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the data leave doubt; elsewhere a bound changes nothing and the closed form stays."""
    free = ServoLag.terms  # as if a lag could not be negative
    monkeypatch.setattr(ServoLag, "terms", lambda *of: [replace(term, low=0.0) for term in free(*of)])
    for lag, sampled in ((6e-6, True), (6e-4, False)):  # s
        machine, _, p, name = with_effect(two_axes((EffectSpec("servo-lag", {"joint": "X"}),)), lag)
        rng = np.random.default_rng(0)
        points = measured(machine, p, 60, points=feeds(machine, rng), frame=((0, 0, 0), (0, 0, 0)))
        points[["mx", "my", "mz"]] += rng.normal(0, 2e-3, (60, 3))
        fit = fit_machine(machine, survey(positions(points), frame="fixed"))
        linear, whole, _ = model_of(fit, {}, None, False)
        assert (whole is not None) is sampled
        if whole is not None:
            out, _ = drawn(fit, linear, whole, seed=0)
            assert out.values[:, :, out.names.index(name)].min() >= 0
            after = with_posterior(fit, out)
            assert after.solution.named()[name] > 0
            assert not after.at_bound
            assert not any("held at" in note for note in after.notes)


def feeds(machine: Machine, rng: np.random.Generator) -> pd.DataFrame:
    rows = {j.name: rng.uniform(*j.travel, 60) for j in machine.joints}
    tool = dict(zip(("tool_x", "tool_y", "tool_z"), machine.tool, strict=True))
    return pd.DataFrame(rows | tool | {"feed": rng.choice([500.0, 3000.0], 60)})


def test_command(tmp_path: Path) -> None:
    """Bounds need no --bayes; what is at one is on the terminal, in fit.json and the report."""
    machine = two_axes((EffectSpec("backlash", {"joint": "X"}),))
    write_machine(machine, tmp_path / "m.yaml")
    (name,) = Chain(machine).effect_ids[0]
    write(tmp_path / "t.yaml", f"parameters: {{{name}: -0.02}}\n")
    done("simulate", tmp_path / "m.yaml", 60, "--noise", 0.002, "--parameters", tmp_path / "t.yaml",
         "--out", tmp_path / "s.csv")  # fmt: skip
    text = write(tmp_path / "p.yaml", f"errormodel: 1\npriors:\n  {name}: {{low: 0}}\n")
    fit = ("fit", tmp_path / "m.yaml", tmp_path / "s.csv", "--priors", text, "--out")
    out = done(*fit, tmp_path / "fit").err
    assert f"{name} is held at 0 mm" in out
    assert "no chance: look for a wrong sign" in out  # the truth lies far beyond
    data = json.loads((tmp_path / "fit" / "fit.json").read_text())
    assert [b["id"] for b in data["at_bound"]] == [name]
    assert data["at_bound"][0]["free"] == pytest.approx(-0.02, abs=3e-3)
    assert next(p["value"] for p in data["parameters"] if p["id"] == name) == 0
    assert f"{name} is held at 0 mm" in (tmp_path / "fit" / "report.html").read_text(encoding="utf-8")
    write(text, f"errormodel: 1\npriors:\n  {name}: {{std: 0.01}}\n")
    wrong = run(*fit, tmp_path / "no")
    assert wrong.code == 2
    assert "p.yaml, line 3" in wrong.err
    assert "Add --bayes" in wrong.err
