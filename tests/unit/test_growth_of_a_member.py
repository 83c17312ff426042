"""A member that only grows displaces what it carries, and does not tilt it."""

from __future__ import annotations

import numpy as np

from errormodel.conventions import TRANSLATIONS
from errormodel.effects import make
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.warm_up import WarmUp
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine


def test_the_three_translations_follow_one_settling_curve() -> None:
    machine, time = read_machine("vertical_three_axis"), np.linspace(0, 7200, 9)
    member = machine.shapes[0].name
    growth = make(EffectSpec("warm-up", {"element": member, "motion": "translations", "tau": 1800.0}))
    terms = growth.terms(lambda name: time, machine)
    assert [(*term.motion,) for term in terms] == [(motion,) for motion in TRANSLATIONS]
    assert {term.unit for term in terms} == {"mm"}
    for term in terms:
        np.testing.assert_allclose(next(iter(term.motion.values())), 1 - np.exp(-time / 1800.0), atol=1e-12)


def test_it_is_proposed_where_more_than_one_joint_moves() -> None:
    """In rows of one joint a member's growth is that of the joint."""
    machine, time = read_machine("vertical_three_axis"), np.linspace(0, 7200, 50)
    moved = {j.name: j.travel[0] + (j.travel[1] - j.travel[0]) * np.cos(time / 500.0) ** 2 for j in machine.joints}
    still = {name: np.full(50, values[0]) for name, values in moved.items()}
    one = next(iter(moved))
    for columns, proposed in (moved, True), (still | {one: moved[one]}, False):
        scene = Scene(machine, {**columns, "time": time})
        growing = [e for e in WarmUp.proposals(scene) if isinstance(e, WarmUp) and e.motion == "translations"]
        assert bool(growing) is proposed
