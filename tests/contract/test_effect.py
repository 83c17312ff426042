"""What every effect says of itself for others, beyond its motion: shape parameters, causes, reversal values, words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, ClassVar

import numpy as np
import pytest

from errormodel.effects import registry
from errormodel.effects.base import FIXED, PLACE, Effect, JointEffect, ShapeParameter
from errormodel.effects.families import FAMILIES, Traits
from errormodel.effects.shared import Lag
from errormodel.machine import Joint, Machine, Shape
from identification.diagnosis.results.statements import shape
from tests.helpers.effect_battery import MACHINES, arrays, example, numeric, scene

WORDS = list(registry())


@pytest.mark.parametrize("word", WORDS)
def test_shape_parameters_are_fields_with_a_unit_and_bounds(word: str) -> None:
    machine, effect = example(word)
    kind = type(effect)
    for name, meaning in kind.shapes().items():
        assert name in kind.model_fields
        assert effect.unit_of_shape(name, machine) in ("mm", "rad", "s", "1")
        low, high = kind.bounds(name)
        assert low < high
        value = getattr(effect, name)
        assert value is None or isinstance(value, float)
        assert value is None or low <= value <= high
        assert not (meaning.place and low > -math.inf), "a place may lie anywhere along its driver"


@pytest.mark.parametrize("word", [w for w in WORDS if registry()[w].shapes()])
def test_shape_parameters_shape_the_motion(word: str) -> None:
    """Each that a proposal has, moved by a tenth, changes what the effect does: a number that does not is no shape."""
    found: set[str] = set()
    for machine in MACHINES:
        proposals = list(registry()[word].proposals(scene(machine.name)))
        picked = np.unique(np.linspace(0, len(proposals) - 1, 40).astype(int)) if proposals else []
        for proposal in (proposals[k] for k in picked):
            for name in set(proposal.shapes()) - found:
                value = getattr(proposal, name)
                if not value or proposal.random:
                    continue
                low, high = type(proposal).bounds(name)
                other = min(max(1.1 * value, low), high)
                other = other if other != value else 0.9 * value
                moved = proposal.model_copy(update={name: other})
                before, after = (
                    np.array([m for _, m in numeric(e, machine, arrays(machine.name))]) for e in (proposal, moved)
                )
                assert np.isfinite(after).all()
                if np.abs(after - before).max() > 1e-6 * np.abs(before).max():
                    found.add(name)
    _, effect = example(word)
    assert {name for name in effect.shapes() if getattr(effect, name)} <= found


@pytest.mark.parametrize("word", WORDS)
def test_a_cause_that_is_searched_is_a_time(word: str) -> None:
    machine, effect = example(word)
    assert effect.cause <= effect.same_parameter()
    for name in effect.cause & set(effect.shapes()):
        assert effect.unit_of_shape(name, machine) == "s"


@pytest.mark.parametrize("word", WORDS)
def test_family_and_reversal(word: str) -> None:
    machine, effect = example(word)
    traits = effect.traits()
    assert 0 <= traits.form_uncertainty < 0.5
    family = FAMILIES.get(effect.family, Traits())
    # a form may be less sure than those of the others
    assert replace(traits, form_uncertainty=family.form_uncertainty) == family
    assert isinstance(effect.positive(machine), str)
    values = [0.01 * (k + 1) for k in range(len(effect.terms(lambda _: np.ones(1), machine)))]
    ends = effect.reversal(values)
    assert (ends is None) or effect.where in {j.name for j in machine.joints}


@pytest.mark.parametrize("word", [w for w in WORDS if registry()[w].family == "reversal"])
def test_a_reversal_value_is_the_motion_from_one_side_to_the_other(word: str) -> None:
    machine, effect = example(word)
    (joint,) = [j for j in machine.joints if j.name == effect.where]
    terms = sorted(effect.terms(lambda _: np.ones(1), machine), key=lambda t: t.label)
    values = np.linspace(0.02, 0.05, len(terms)).tolist()
    ends = effect.reversal(values)
    if ends is None:
        return

    def position(q: float, side: float) -> float:
        channel = {f"dir_{joint.name}": np.array([side]), joint.name: np.array([q])}
        moved = sum(
            v * next(iter(t.motion.values()))
            for v, t in zip(values, effect.terms(channel.__getitem__, machine), strict=True)
        )
        return float(np.asarray(moved)[0])

    expected = [position(q, 1.0) - position(q, -1.0) for q in joint.travel]
    np.testing.assert_allclose(ends, expected, rtol=1e-9)


class Dent(JointEffect):
    """Of no module: what the defaults of the base make of fields."""

    effect = "dent"
    family = "of a kind not yet seen"
    source = "a test"
    separate = "look"
    example: ClassVar[Mapping[str, object]] = {"joint": "X", "depth": 1.0}
    depth: float
    lag: Lag = 0.0
    place: Annotated[float, PLACE] = 0.0
    origin: Annotated[float, FIXED] = 0.0
    slope: Annotated[float, ShapeParameter("1")] = 2.0
    name: str = ""

    @property
    def drivers(self):
        return (self.joint,)

    def terms(self, channel, machine):
        return []

    @classmethod
    def proposals(cls, scene):
        return iter(())


MACHINE = Machine("m", (Joint("X", "prismatic", (1.0, 0.0, 0.0), (0.0, 500.0)), Shape("T")))


def test_defaults_of_a_new_effect() -> None:
    assert list(Dent.shapes()) == ["depth", "lag", "place", "slope"]
    dent = Dent(joint="X", depth=3.0, place=20.0)
    assert [dent.unit_of_shape(n, MACHINE) for n in Dent.shapes()] == ["mm", "s", "mm", "1"]
    assert Dent.traits() == Traits()
    assert dent.reversal([1.0]) is None
    assert issubclass(Dent, Effect)


def test_a_finding_says_shape_parameters_of_any_name() -> None:
    text = shape(Dent(joint="X", depth=3.0, place=20.0), MACHINE)
    assert text == ", with depth 3 mm, with place 20 mm, with slope 2"
