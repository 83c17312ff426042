"""The contract of an effect, kept by every class of the library: one battery, which a new class joins by itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from errormodel.chain import Chain
from errormodel.effects import make, registry
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.exceptions import InputError
from errormodel.instruments.plain import Plain
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine, write_machine
from errormodel.simulation import measured_at
from errormodel.survey import Survey
from errormodel.truth import Truth
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit
from tests.helpers.effect_battery import (
    GANTRY,
    MACHINES,
    NOISE,
    ROWS,
    WORDS,
    Channels,
    arrays,
    base_errors,
    example,
    numeric,
    numeric_many,
    own_ids,
    scene,
    table,
)

PLACES = ("frame", "tool", "instrument")


@pytest.mark.parametrize("word", WORDS)
def test_says_what_it_is(word: str) -> None:
    kind = registry()[word]
    assert kind.effect == word
    assert kind.__doc__
    for text in (kind.family, kind.source, kind.separate):
        assert text.strip()
    assert set(kind.alike) <= {*WORDS, "outliers"}  # which is a finding, and no effect of a machine
    assert word not in kind.alike


@pytest.mark.parametrize("word", WORDS)
def test_example_is_valid_and_its_parameters_are_physical(word: str) -> None:
    machine, effect = example(word)
    names = {e.name for e in machine.elements}
    assert effect.where in {*names, *PLACES}
    assert all(isinstance(d, str) and d for d in effect.drivers)
    assert effect.cost(scene(machine.name)) >= 0
    hash(effect.key)
    terms = numeric(effect, machine, arrays(machine.name))
    assert len({(t.element, next(iter(t.motion)), t.label) for t, _ in terms}) == len(terms)
    for term, motion in terms:
        assert term.unit.strip()
        assert np.isfinite(term.size)
        assert term.size > 0
        assert term.element in {*names, *PLACES[:2]}
        assert np.isfinite(motion).all()
        assert motion.any(), f"{term.label} moves nothing"


@pytest.mark.parametrize("word", WORDS)
def test_wrong_keys_are_named(word: str) -> None:
    with pytest.raises(InputError, match="nonsense"):
        make(EffectSpec(word, {**registry()[word].example, "nonsense": 1}))


@pytest.mark.parametrize("word", WORDS)
def test_symbolic_terms_are_the_numeric_ones(word: str) -> None:
    machine, effect = example(word)
    chain, ids = Chain(machine), own_ids(machine)
    found = chain.kernel("terms", ids)(chain.columns(table(machine.name)), np.zeros(len(chain.ids)))
    found = found.reshape(-1, 6, ROWS)[: len(ids)]
    expected = numeric(effect, machine, arrays(machine.name))
    assert len(found) == len(expected)
    for column, (term, motion) in zip(found, expected, strict=True):
        np.testing.assert_allclose(column, motion, rtol=1e-10, atol=1e-10 * np.abs(motion).max(), err_msg=term.label)


@pytest.mark.parametrize("word", [w for w in WORDS if registry()[w].shape])
def test_many_shapes_at_once_are_those_one_by_one(word: str) -> None:
    machine, effect = example(word)
    channels, name = arrays(machine.name), type(effect).shape
    values = (getattr(effect, name) or 10.0) * np.array([0.8, 1.0, 1.3])
    many = numeric_many(effect.model_copy(update={name: values[:, None]}), machine, channels)
    for k, value in enumerate(values):
        one = np.array([m for _, m in numeric(effect.model_copy(update={name: float(value)}), machine, channels)])
        swept = np.array([m[:, k] for m in many])
        if swept.dtype == np.float32:  # as candidates are kept: waves are made in it
            np.testing.assert_allclose(swept, one, rtol=0, atol=1e-6 * np.abs(one).max())
        else:
            np.testing.assert_array_equal(swept, one)


@pytest.mark.long
@pytest.mark.parametrize("word", WORDS)
def test_columns_of_m_are_derivatives_and_effects_are_linear(word: str) -> None:
    machine, _ = example(word)
    chain = Chain(machine)
    rows = chain.columns(table(machine.name))
    ids, kernel = own_ids(machine), chain.kernel("actual", outputs=(0, 1, 2))
    if not ids:
        return
    design = chain.kernel("design", ids, outputs=(0, 1, 2))(rows, np.zeros(len(chain.ids))).reshape(-1, 3, ROWS)
    for identity, column in zip(ids, design, strict=True):
        step = 1e-3 / max(float(np.abs(column).max()), 1e-12)  # a motion of 1 um
        up, down, twice = (kernel(rows, chain.vector({identity: f * step})) for f in (1, -1, 2))
        zero = kernel(rows, chain.vector({}))
        largest = np.abs(column).max()
        assert np.abs((up - down) / (2 * step) - column).max() <= 1e-5 * largest + 1e-12, identity
        assert np.abs((twice - zero) - 2 * (up - zero)).max() <= 1e-8, identity  # mm: exact kinematics' second order


@pytest.mark.parametrize("word", WORDS)
def test_machine_file_keeps_it(word: str, tmp_path: Path) -> None:
    machine, effect = example(word)
    write_machine(machine, tmp_path / "machine.yaml")
    again = read_machine(tmp_path / "machine.yaml")
    assert [make(spec) for spec in again.effects] == [effect]
    whole = EffectSpec(word, effect.model_dump(exclude_defaults=True))
    write_machine(replace(machine, effects=(whole,)), tmp_path / "whole.yaml")
    assert [make(spec) for spec in read_machine(tmp_path / "whole.yaml").effects] == [effect]
    assert Chain(again).ids == Chain(machine).ids


@pytest.mark.parametrize("word", WORDS)
@pytest.mark.parametrize("name", [m.name for m in MACHINES])
def test_proposals_are_valid_and_not_too_many(word: str, name: str) -> None:
    here, kind = scene(name), registry()[word]
    channels = arrays(name)
    proposals = list(kind.proposals(here))
    assert len(proposals) <= 5000 * len(here.moving)
    assert len(set(proposals)) == len(proposals)
    names = {e.name for e in here.machine.elements}
    some = np.unique(np.linspace(0, len(proposals) - 1, 25).astype(int)) if proposals else []
    for proposal in (proposals[k] for k in some):
        assert isinstance(proposal, kind)
        assert kind.model_validate(proposal.model_dump()) == proposal
        assert proposal.where in {*names, *PLACES}
        assert proposal.cost(here) >= 0
        hash(proposal.key)
        for term, motion in numeric(proposal, here.machine, channels):
            assert np.isfinite(motion).all(), proposal
            assert term.size > 0


@pytest.mark.parametrize("word", WORDS)
def test_proposals_need_what_the_survey_has(word: str) -> None:
    """Joints that stand still or one that moves, and nothing else recorded."""
    still = {j.name: np.full(60, np.mean(j.travel)) for j in GANTRY.joints}
    for given in (still, still | {"X": np.linspace(0, 2000, 60)}):
        frame = pd.DataFrame(given | dict(zip(("tool_x", "tool_y", "tool_z"), GANTRY.tool, strict=True)))
        channels = Channels(GANTRY.name, frame)
        for proposal in registry()[word].proposals(Scene(GANTRY, given)):
            assert not {d for d in proposal.drivers if d.startswith("dir_")}
            assert all(np.isfinite(motion).all() for _, motion in numeric(proposal, GANTRY, channels))


def recovered(machine: Machine, truth: dict[str, float]) -> Fit:
    """The fit of a machine to its own recording."""
    frame = table(machine.name)
    measured = measured_at(machine, frame, Truth(truth), NOISE, seed=5)[["mx", "my", "mz"]]
    survey = Survey(pd.concat([frame, measured], axis=1), "shared", ("frame",), Plain(), Path("battery.csv"))
    return fit_machine(machine, survey)


def true_frame(fit: Fit) -> dict[str, float]:
    """The frame's small parameters: what leads from where it was aligned to the identity that was simulated."""
    (pose,) = fit.problem.frames.values()
    back = pose.rotation.T
    small = [*(-back @ pose.translation), *Rotation.from_matrix(back).as_euler("XYZ")]
    return dict(zip(fit.chain.frame_ids, small, strict=True))


@pytest.mark.parametrize("word", WORDS)
def test_simulated_effect_is_fitted(word: str) -> None:
    """Each group that holds the effect comes out within 4 standard uncertainties, all geometry being free."""
    machine, effect = example(word)
    ids = own_ids(machine)
    if not ids:
        return
    terms = [term for term, _ in numeric(effect, machine, arrays(machine.name))]
    sizes = [term.size for term in terms]
    sign = np.maximum(np.resize([1.0, -0.7], len(ids)), [0.0 if t.low == 0 else -1.0 for t in terms])
    truth = base_errors(machine.name) | {i: s * z for i, s, z in zip(ids, sign, sizes, strict=True)}
    fit = recovered(machine, truth)
    assert fit.solution.converged
    assert fit.sigma_mm == pytest.approx(NOISE, rel=0.15)
    groups, known = fit.solution.groups, truth | true_frame(fit)
    assert not set(ids) <= set(groups.no_effect)
    values, deviations = fit.solution.values[groups.base], np.sqrt(np.diag(fit.solution.covariance))
    looked_at = 0
    for k in range(groups.rank):
        members = groups.members(k)
        if not set(ids) & set(members):
            continue
        expected = sum(c * known[i] for i, c in members.items())
        assert abs(values[k] - expected) < 4 * deviations[k], groups.name(k)
        looked_at += 1
    assert looked_at
