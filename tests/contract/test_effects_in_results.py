"""What results keep of an effect: any that a diagnosis may have proposed is the same when its entry is read again."""

from __future__ import annotations

import json

import pytest

from errormodel.effects import make, registry
from errormodel.effects.base import Effect
from errormodel.machine import EffectSpec
from identification.results.fit_file import _OtherEffect
from identification.uncertainty.other_effects import OtherEffect
from tests.helpers.effect_battery import WORDS, example, scene

RESTS = {"joint": "X", "motion": "dx", "tau": 900.0, "rests": [[4000.0, 6000.0], [8000.0, 9000.0]], "until": 20000.0}
WITH_RESTS = make(EffectSpec("warm-up", RESTS))


@pytest.mark.parametrize("word", WORDS)
def test_an_effect_that_may_be_in_its_place(word: str) -> None:
    machine, effect = example(word)
    for proposal in (effect, *registry()[word].proposals(scene(machine.name))):
        assert _read_again(proposal) == proposal


def test_one_with_rests() -> None:
    """Pairs of times: intervals in which the machine stood."""
    assert _read_again(WITH_RESTS) == WITH_RESTS


def _read_again(effect: Effect) -> Effect:
    """The effect as ``fit.json`` gives it back, where it may be in the place of another."""
    written = {"effect": 0, "options": effect.spec.options, "weight": 0.2, "parameters": {}, "name": effect.effect}
    read = _OtherEffect.model_validate(json.loads(json.dumps(written)))
    return make(OtherEffect(0, read.options, 0.2, {}, read.name).spec(EffectSpec("ram-sag")))
