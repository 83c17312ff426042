"""Which sensors are taken for the spindle's own."""

from __future__ import annotations

import pytest

from errormodel.effects import make
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.spindle_growth import heats, of_spindle
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.diagnosis.linear.of_fit import set_up
from identification.estimation.fit import fit_machine
from tests.helpers.diagnosed import empty_survey


@pytest.fixture(scope="module")
def scene() -> Scene:
    machine = read_machine("vertical_three_axis")
    return set_up(fit_machine(machine, empty_survey(machine, 120, 3, channels=True, grid=False))).scene


@pytest.mark.parametrize(
    ("sensor", "own"),
    [("T_spindle", True), ("T_Headstock_2", True), ("T_quill", True), ("T_hall", False), ("T_bed", False)],
)
def test_a_sensor_by_its_name(scene: Scene, sensor: str, own: bool) -> None:
    """Growth by another sensor than the spindle's has odds against it, and more of them across the spindle."""
    along, across = (
        make(EffectSpec("spindle-growth", {"sensor": sensor, **more})).cost(scene) for more in ({}, {"motion": "dy"})
    )
    named = make(EffectSpec("spindle-growth", {"sensor": "T_spindle"})).cost(scene)
    assert (along == named) == own
    assert along >= named
    assert across > along


@pytest.mark.parametrize("sensor", ["T_3", "T_ch03", "T_b"])
def test_a_sensor_whose_name_is_a_number(scene: Scene, sensor: str) -> None:
    """It may be the spindle's, as one of all members: less likely than one that says so, likelier than the bed's."""
    spindle, unknown, bed = (
        make(EffectSpec("spindle-growth", {"sensor": name})).cost(scene) for name in ("T_spindle", sensor, "T_bed")
    )
    assert spindle < unknown < bed


@pytest.mark.parametrize("name", ["w_spindle", "w_spindle_speed", "w_rpm", "w_Spindle_Power_kW"])
def test_a_channel_that_heats_the_spindle(name: str) -> None:
    assert heats(name)


@pytest.mark.parametrize("name", ["T_spindle", "w_spindle_ea", "w_speed", "w_level_X", "w_current", "w_spindle_level"])
def test_a_channel_that_does_not(name: str) -> None:
    """A level on the spindle is a witness of its motion; a speed or a current may be of anything."""
    assert not heats(name)


@pytest.mark.parametrize(
    ("sensor", "own"),
    [
        ("T_spindle_nose", True),
        ("T_bearing", True),
        ("T_bearing_front", True),
        ("T_head_bearing", True),
        ("T_Lager_2", True),
        ("T_table_bearing", False),
        ("T_bearing_X", False),
        ("T_bed", False),
    ],
)
def test_a_sensor_at_a_bearing_of_no_other_member_is_the_spindles(sensor: str, own: bool) -> None:
    assert of_spindle(sensor) is own
