"""The contract of an effect, kept by every class of the library: one battery, which a new class joins by itself."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.channels import POINT_CHANNELS, columns, direction
from errormodel.conventions import MOTIONS, ROTATIONS
from errormodel.effects import make, registry
from errormodel.effects.base import Effect, EffectTerm
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.exceptions import InputError
from errormodel.instruments.plain import Plain
from errormodel.machine import Basis, EffectSpec, Joint, Machine, Shape, Vector
from errormodel.machine_file import read_machine, write_machine
from errormodel.simulation import Truth, measured_at
from errormodel.survey import Survey
from identification.estimation.result import Fit
from identification.estimation.run import fit_machine

ROWS = 300
NOISE = 0.001  # mm
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
WORDS = sorted(registry())
PLACES = ("frame", "tool", "instrument")


def _machine(name: str, elements: list[Shape | Joint], tool: Vector) -> Machine:
    linear = {m: Basis("polynomial", 1) for m in MOTIONS}
    free = (replace(e, motions=MOTIONS) if isinstance(e, Shape) else replace(e, models=linear) for e in elements)
    return Machine(name, tuple(free), tool)


GANTRY = _machine(
    "gantry",
    [
        Joint("X", "prismatic", X, (0.0, 2000.0)),
        Shape("T1", (0.0, 0.0, 1400.0)),
        Joint("Y", "prismatic", Y, (0.0, 1500.0)),
        Shape("T2", (180.0, 0.0, 0.0)),
        Joint("Z", "prismatic", Z, (-800.0, 0.0)),
        Shape("T3", (0.0, 0.0, -250.0)),
    ],
    (40.0, 25.0, -180.0),
)
FIVE_AXIS = _machine(
    "five-axis",
    [
        Joint("B", "rotary", Y, (0.0, 2 * math.pi)),
        Shape("T1"),
        Joint("X", "prismatic", X, (-500.0, 500.0)),
        Shape("T2"),
        Joint("Z", "prismatic", Z, (600.0, 1200.0)),
        Shape("T3"),
        Joint("Y", "prismatic", Y, (200.0, 1000.0)),
        Shape("T4"),
        Joint("W", "prismatic", Z, (-400.0, -100.0)),
        Shape("T5"),
    ],
    (0.0, 0.0, -250.0),
)
MACHINES = (GANTRY, FIVE_AXIS)


@cache
def table(name: str) -> pd.DataFrame:
    """Random poses with every channel that a survey may have."""
    machine = next(m for m in MACHINES if m.name == name)
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(35, 55, ROWS))
    given: dict[str, object] = {j.name: rng.uniform(*j.travel, ROWS) for j in machine.joints}
    long = np.where(rng.random(ROWS) < 0.5, 0.0, -90.0)
    given |= dict(zip(("tool_x", "tool_y", "tool_z"), machine.tool, strict=True))
    given |= {"tool_z": machine.tool[2] + long, "time": time}
    given |= {"run": np.repeat(["1", "2"], ROWS // 2), "file": "s.csv", "role": "fit", "row": np.arange(1, ROWS + 1)}
    for k, sensor in enumerate(("T_amb", "T_bed", "T_top", "T_drive", "T_spindle")):
        day = np.sin(2 * math.pi * time / rng.uniform(4e3, 1.5e4) + k)
        given[sensor] = 21 + k + rng.uniform(1, 3) * day + 3 * (1 - np.exp(-time / (1000 + 700 * k)))
    given |= {"feed": rng.choice([1500.0, 3000.0, 6000.0], ROWS), "load": rng.choice([0.0, 350.0], ROWS)}
    given |= {"w_sync": rng.normal(0, 0.02, ROWS), "w_level": rng.normal(0, 1, ROWS)}
    frame = pd.DataFrame(given, index=range(ROWS))
    for joint in machine.joints:
        frame[f"dir_{joint.name}"] = direction(frame, joint.name)
    return frame


@cache
def scene(name: str) -> Scene:
    frame = table(name)
    numbers = frame.select_dtypes("number")
    machine = next(m for m in MACHINES if m.name == name)
    return Scene(machine, {str(c): numbers[c].to_numpy(dtype=float) for c in numbers if not str(c).startswith("tool")})


def example(word: str) -> tuple[Machine, Effect]:
    """A machine of the battery that has what the effect's example names, with it, and the effect."""
    spec = EffectSpec(word, registry()[word].example)
    for machine in MACHINES:
        whole = replace(machine, effects=(spec,))
        try:
            Chain(whole)
        except InputError:
            continue
        return whole, make(spec)
    raise AssertionError(f"the example of {word} fits no machine of the battery")


class Channels(dict[str, Array]):
    """Channels of a table as a chain has them, made when first asked for."""

    def __init__(self, name: str, source: pd.DataFrame) -> None:
        chain = Chain(next(m for m in MACHINES if m.name == name))
        super().__init__(
            zip(POINT_CHANNELS, chain.kernel("nominal", outputs=(0, 1, 2))(chain.columns(source)), strict=True)
        )
        self._source = source

    def __missing__(self, name: str) -> Array:
        (self[name],) = columns(self._source, [name])
        return self[name]


@cache
def arrays(name: str) -> Channels:
    return Channels(name, table(name))


def numeric(effect: Effect, machine: Machine, channels: Channels) -> list[tuple[EffectTerm, Array]]:
    """Each parameter with its motion over the rows, (6, n), in the order in which a chain has them."""
    out = []
    places = ("frame", *(e.name for e in machine.elements), "tool")
    rows = len(channels[machine.joints[0].name])
    for term in sorted(effect.terms(channels.__getitem__, machine), key=lambda t: places.index(t.element)):
        motion = np.zeros((6, rows))
        for name, value in term.motion.items():
            motion[MOTIONS.index(name)] = value
        out.append((term, motion))
    return out


def numeric_many(effect: Effect, machine: Machine, channels: Channels) -> list[Array]:
    """Each parameter's motion, (6, shapes, n), of an effect whose shape is an array."""
    rows = len(channels[machine.joints[0].name])
    terms = effect.terms(channels.__getitem__, machine)
    kind = np.result_type(*(value for t in terms for value in t.motion.values()))
    zero = np.zeros((len(getattr(effect, type(effect).shape)), rows), kind)
    return [np.array([t.motion.get(name, 0.0) + zero for name in MOTIONS]) for t in terms]


def own_ids(machine: Machine) -> tuple[str, ...]:
    """The parameters that the machine's effects bring."""
    without = set(Chain(replace(machine, effects=())).ids)
    return tuple(i for i in Chain(machine).ids if i not in without)


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
    assert effect.cost >= 0
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
        assert proposal.cost >= 0
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


@cache
def base_errors(name: str) -> dict[str, float]:
    """Errors of the geometry of some um and urad."""
    chain = Chain(next(m for m in MACHINES if m.name == name))
    rng = np.random.default_rng(8)
    return {
        i: float(rng.normal(0, 5e-6 if chain.parameters[chain.index[i]].motion in ROTATIONS else 5e-3))
        for i in chain.machine_ids
    }


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
