"""Where effects are looked for: what a machine's file says of which member is a ram and which a beam."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from errormodel.chain import TOOL_CHANNELS
from errormodel.effects import make, registry
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.travel import member_of
from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec, Shape, joint_of
from errormodel.machine_file import read_machine


@pytest.mark.parametrize(
    ("name", "rams"),
    [
        ("five_axis_table_quill", ["W"]),
        ("gantry_crossbeam_ram", ["Z"]),
        ("bridge_cmm", ["Z"]),
        ("fork_head_five_axis", ["Z"]),  # a head turns at its end
        ("h_gantry_dual_drive", []),  # its sensor hangs beside the beam
        ("vertical_three_axis", []),  # its tool stands out across the column's travel
    ],
)
def test_a_ram_carries_out_the_tool_and_a_slide_travels_along_a_beam(name: str, rams: list[str]) -> None:
    machine = read_machine(name)
    here = Scene(machine, {j.name: np.linspace(*j.travel, 9) for j in machine.joints})
    names = [j.name for j in machine.joints if j.type == "prismatic"]
    assert [n for n in names if member_of(machine, joint_of(machine, n)) == "ram"] == rams
    for word, places in (("ram-sag", rams), ("beam-sag", [n for n in names if n not in rams])):
        assert list(dict.fromkeys(e.where for e in registry()[word].proposals(here))) == places


@pytest.mark.parametrize(
    ("name", "where"), [("bridge_cmm", ["Z"]), ("five_axis_table_quill", ["Z", "W"]), ("vertical_three_axis", [])]
)
def test_a_ram_telescopes_and_a_slide_only_along_another(name: str, where: list[str]) -> None:
    """A ram leaves its guide as it extends, as does what slides along a further joint; a lathe's slide does not."""
    machine = read_machine(name)
    here = Scene(machine, {j.name: np.linspace(*j.travel, 9) for j in machine.joints})
    assert list(dict.fromkeys(e.where for e in registry()["telescoping-compliance"].proposals(here))) == where


def test_without_lengths_a_member_may_be_a_ram_or_a_slide() -> None:
    machine = read_machine("five_axis_table_quill")
    bare = tuple(replace(e, offset=(0.0, 0.0, 0.0)) if isinstance(e, Shape) else e for e in machine.elements)
    machine = replace(machine, elements=bare, tool=(0.0, 0.0, 0.0))
    assert [member_of(machine, joint_of(machine, n)) for n in ("X", "W")] == ["slide", ""]


@pytest.mark.parametrize("name", ["six_axis_arm", "five_axis_table_quill", "vertical_three_axis"])
def test_a_target_is_exchanged_between_runs_and_within(name: str) -> None:
    """Also where no joint turns it, and a station that moves looks alike: both are named then."""
    machine = read_machine(name)
    rng = np.random.default_rng(0)
    columns = {j.name: rng.uniform(*j.travel, 40) for j in machine.joints}
    columns |= {"time": 60.0 * np.arange(40.0), "run(2)": np.repeat([0.0, 1.0], 20)}
    drivers = {e.drivers for e in registry()["target-offset"].proposals(Scene(machine, columns))}
    assert drivers == {(), ("run(2)",), ("time",)}


@pytest.mark.parametrize(("tools", "by_run"), [([0, 1, 0, 2], {"1", "3"}), ([0, 0, 1, 1], {"1", "2", "3", "4"})])
def test_where_runs_have_tools_of_their_own_the_tool_is_the_cause(tools: list[int], by_run: set[str]) -> None:
    """What differs in all rows of a tool and in no others is that tool's, though it was used in one run only."""
    machine = read_machine("five_axis_table_quill")
    rng = np.random.default_rng(0)
    columns = {j.name: rng.uniform(*j.travel, 40) for j in machine.joints}
    columns |= {f"run({k})": 1.0 * (np.repeat([1, 2, 3, 4], 10) == k) for k in (1, 2, 3, 4)}
    columns |= {"tool_x": np.zeros(40), "tool_y": np.zeros(40), "tool_z": -20.0 * np.repeat(tools, 10)}
    proposed = [e.model_dump() for e in registry()["target-offset"].proposals(Scene(machine, columns))]
    assert {e["run"] for e in proposed if isinstance(e["run"], str)} == by_run
    assert ("1", "3") not in {e["run"] for e in proposed} or tools == [0, 0, 1, 1]
    assert len([e for e in proposed if e["tool"]]) == len(set(tools))


def test_a_target_offset_is_of_a_tool_a_time_or_a_run() -> None:
    with pytest.raises(InputError, match="one of a tool"):
        make(EffectSpec("target-offset", {"at": 60.0, "run": "2"}))


def test_a_load_sags_an_arm_by_its_lever() -> None:
    """The lever of the load is that of the compliance: with the arm stretched out to the side, the reach."""
    machine = read_machine("six_axis_arm")
    channels = {j.name: np.zeros(1) for j in machine.joints} | {"load": np.array([5.0])}
    channels |= {name: np.array([v]) for name, v in zip(TOOL_CHANNELS, machine.tool, strict=True)}
    sag, gear = (
        make(EffectSpec(word, {"joint": "J2", "gravity": "-z", **more}))
        for word, more in (("payload-sag", {}), ("joint-compliance", {"payload": True}))
    )
    (term,) = sag.terms(channels.__getitem__, machine)
    of_load = next(t for t in gear.terms(channels.__getitem__, machine) if t.label == "payload")
    assert term.motion.keys() == of_load.motion.keys()
    for motion, value in term.motion.items():
        np.testing.assert_array_equal(value, of_load.motion[motion])
        assert 5 * 500 < abs(float(np.squeeze(value))) < 5 * 1500  # kg mm: the arm reaches about a metre
