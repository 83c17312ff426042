"""What every joint error model keeps to: its terms, its motions, its form in a machine's file."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path
from typing import Literal

import casadi as ca
import numpy as np
import pytest

from errormodel.chain import Chain
from errormodel.conventions import MOTIONS, Motion
from errormodel.joint_models import registry
from errormodel.joint_models.base import JointModel
from errormodel.machine import Basis, Joint, Machine, Shape
from errormodel.machine_file import read_machine, write_machine
from errormodel.simulation import random_points
from identification.estimation.fit import fit_machine
from tests.helpers.surveys import measured, positions, survey

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Kind = Literal["prismatic", "rotary"]
WORDS = list(registry())
TRAVEL: dict[str, tuple[float, float]] = {"prismatic": (-150.0, 400.0), "rotary": (-2.0, 3.0)}
CASES = [(word, kind) for word in WORDS for kind in registry()[word].joints]


def number(model: type[JointModel]) -> int:
    return model.example if model.counts else 1


def joint_with(word: str, kind: Kind) -> Joint:
    """A joint all of whose motions that can have the model have it."""
    model = registry()[word]
    bare = Joint("Q", kind, (1.0, 0.0, 0.0), TRAVEL[kind])
    return replace(bare, models=dict.fromkeys(model.motions(bare), Basis(word, number(model))))


def motion_over(joint: Joint, motion: Motion, q: Array) -> dict[str, Array]:
    """Of each parameter of an error motion, by label, what the joint does (6, n)."""
    basis = joint.models[motion]
    out = {}
    for term in registry()[basis.kind].terms(joint, motion, basis.n, q):
        out[term.label] = np.array([np.broadcast_to(term.motion.get(m, 0.0), q.shape) for m in MOTIONS], float)
    return out


@pytest.mark.parametrize("word", WORDS)
def test_says_what_it_is(word: str) -> None:
    model = registry()[word]
    assert model.word == word
    assert model.__doc__
    assert model.source.strip()
    assert word not in ("none", "all", *MOTIONS)
    assert 1 <= model.example <= 50
    assert model.joints


@pytest.mark.parametrize(("word", "kind"), CASES)
def test_terms_are_finite_distinct_and_independent(word: str, kind: Kind) -> None:
    joint = joint_with(word, kind)
    q = np.linspace(*joint.travel, 400)
    for motion in joint.models:
        found = motion_over(joint, motion, q)
        count = len(list(registry()[word].terms(joint, motion, joint.models[motion].n, q)))
        assert len(found) == count, "labels tell the parameters apart"
        columns = np.array([value.ravel() for value in found.values()])
        assert np.isfinite(columns).all()
        columns /= np.linalg.norm(columns, axis=1)[:, None]
        assert np.linalg.matrix_rank(columns, tol=1e-6) == len(columns)
        assert all(value[MOTIONS.index(motion)].any() or np.abs(value).max() > 0 for value in found.values())


@pytest.mark.parametrize(("word", "kind"), CASES)
def test_nothing_is_added_at_zero(word: str, kind: Kind) -> None:
    """Constants belong to the shapes: where the joint stands at zero a model moves nothing."""
    joint = joint_with(word, kind)
    for motion in joint.models:
        for label, value in motion_over(joint, motion, np.zeros(1)).items():
            assert np.abs(value).max() < 1e-12, f"{motion} {label}"


@pytest.mark.parametrize(("word", "kind"), CASES)
def test_symbols_give_what_arrays_give(word: str, kind: Kind) -> None:
    joint, model = joint_with(word, kind), registry()[word]
    q, symbol = np.linspace(*joint.travel, 50), ca.SX.sym("q")
    for motion in joint.models:
        expected = motion_over(joint, motion, q)
        for term in model.terms(joint, motion, joint.models[motion].n, symbol):
            column = ca.vertcat(*(term.motion.get(m, 0.0) for m in MOTIONS))
            values = ca.Function("f", [symbol], [column]).map(len(q))(q)
            np.testing.assert_allclose(np.array(values), expected[term.label], rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize(("word", "kind"), CASES)
def test_a_file_keeps_it(word: str, kind: Kind, tmp_path: Path) -> None:
    joint = joint_with(word, kind)
    some = replace(joint, name="R", models=dict(itertools.islice(joint.models.items(), 2)))
    machine = Machine("m", (Shape("T", (0.0, 0.0, 10.0)), joint, some), (0.0, 0.0, 5.0))
    write_machine(machine, tmp_path / "machine.yaml")
    again = read_machine(tmp_path / "machine.yaml")
    assert [dict(j.models) for j in again.joints] == [dict(j.models) for j in machine.joints]
    assert Chain(again).ids == Chain(machine).ids


@pytest.mark.parametrize(("word", "kind"), CASES)
def test_units_and_what_diagnosis_asks(word: str, kind: Kind) -> None:
    joint, model = joint_with(word, kind), registry()[word]
    chain = Chain(Machine("m", (joint,)))
    own = [p for p in chain.parameters if p.element == "Q"]
    assert own
    assert all(p.unit.strip() for p in own)
    for n in (1, number(model)):
        assert model.order(joint, n) >= 0
        assert isinstance(model.doubt(n, "dx"), str)
    alone = model.rotation_alone(joint, number(model))
    assert joint.type in registry()[alone.kind].joints
    for motion in set(MOTIONS) - set(model.motions(joint)):
        found, cure = model.refused(joint, motion)
        assert found.strip()
        assert cure.strip()


@pytest.mark.parametrize(("word", "kind"), CASES)
def test_what_was_simulated_is_fitted(word: str, kind: Kind) -> None:
    """Each group of the joint's parameters comes out within four standard uncertainties."""
    joint = joint_with(word, kind)
    arm = Shape("T", (80.0, 150.0, -60.0))
    machine = Machine("m", (joint, arm), (0.0, 40.0, 30.0))
    chain, rng = Chain(machine), np.random.default_rng(4)
    own = [p.id for p in chain.parameters if p.element == "Q"]
    # a motion of five micrometres at the tip, whatever the parameter's unit
    points = random_points(machine, 400, 1)
    design = chain.kernel("design", tuple(own), outputs=(0, 1, 2))
    columns = design(chain.columns(points), np.zeros(len(chain.ids))).reshape(len(own), -1)
    sizes = 0.005 / np.maximum(np.abs(columns).max(axis=1), 1e-9)
    truth = dict.fromkeys(chain.ids, 0.0)
    truth |= dict(zip(own, (sizes * rng.choice([-1.0, 1.0], len(own))).tolist(), strict=True))
    zero = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    table = measured(machine, chain.vector(truth), 400, 3, noise=1e-3, frame=zero)
    solution = fit_machine(machine, survey(positions(table), frame="fixed")).solution
    std = np.sqrt(np.diag(solution.covariance))
    looked_at = 0
    for k in range(solution.groups.rank):
        members = solution.groups.members(k)
        if set(members) & set(own):
            expected = sum(c * truth[i] for i, c in members.items())
            assert abs(solution.values[solution.groups.base[k]] - expected) < 4.5 * std[k], members
            looked_at += 1
    assert looked_at >= len(joint.models) / 2
