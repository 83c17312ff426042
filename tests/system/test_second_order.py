"""A joint that yields so far that the square of its motion shows beside the noise."""

from __future__ import annotations

from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.diagnosis.pipeline import diagnose
from tests.helpers.diagnosed import empty_survey, showing


def test_what_the_square_of_a_large_effect_leaves_is_no_other_effect() -> None:
    """A joint that yields by 3 mm at the tip leaves 5 um of second order, which seemed to be a curve of another one."""
    machine = read_machine("six_axis_arm")
    survey = empty_survey(machine, 300, 5, channels=False, grid=False)
    shown = showing(survey, machine, [(EffectSpec("joint-compliance", {"joint": "J2"}), [5e-6])], 0.002)
    found = diagnose(machine, shown)
    assert [(f.effect, f.where) for f in found.diagnosis.findings] == [("joint-compliance", "J2")]
    decided = [(d.effect, d.outcome) for d in found.log if d.rule == "second-order"]
    assert decided == [("higher-order-geometry", "removed")]
    assert found.final.heldout.rms_um < 1.1 * 3**0.5 * 2
