"""The base of an arm tilts by the moment of the weights that it swings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from errormodel.chain import Chain
from errormodel.effects.ground_compliance import GroundCompliance
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.machine_file import read_machine
from errormodel.simulation import random_points

ARM = read_machine("six_axis_arm")


def test_the_base_tilts_down_where_the_tool_is() -> None:
    """Moment of a weight at r: r x (0, 0, -w); a turn about x of the sign of -y, about y of that of x."""
    joint = ARM.joints[1].name
    effect = GroundCompliance(joint=joint)
    poses = random_points(ARM, 40, 3)
    chain = Chain(ARM)
    x, y, z = chain.kernel("nominal", outputs=(0, 1, 2))(chain.columns(poses))
    terms = effect.terms(lambda name: poses[name].to_numpy(), ARM)
    (tool,) = (t for t in terms if t.label == "tool")
    assert set(tool.motion) == {"ea", "eb"}
    np.testing.assert_allclose(np.ptp(tool.motion["ea"] + y), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.ptp(tool.motion["eb"] - x), 0.0, atol=1e-9)
    assert np.ptp(z) > 100.0  # which makes no moment
    assert effect.where == "frame"


def test_an_arm_has_it_by_the_joint_that_lifts_its_weight() -> None:
    """The first joint turns about the upright, and makes no difference to what the base carries."""
    poses = random_points(ARM, 60, 3)
    columns = {name: poses[name].to_numpy() for name in (*(j.name for j in ARM.joints), "tool_x", "tool_y", "tool_z")}
    found = {
        (e.joint, e.gravity) for e in GroundCompliance.proposals(Scene(ARM, columns)) if isinstance(e, GroundCompliance)
    }
    assert (ARM.joints[1].name, "-z") in found
    assert (ARM.joints[0].name, "-z") not in found
    still = replace(ARM, elements=ARM.elements[:1])
    assert not list(GroundCompliance.proposals(Scene(still, {ARM.joints[0].name: np.zeros(9)})))


def test_what_travels_up_and_down_tilts_no_ground() -> None:
    """The moment of a weight on the feet is that of its place across the upright, in most machines z."""
    mill = read_machine("vertical_three_axis")
    scene = Scene(mill, {j.name: np.linspace(*j.travel, 9) for j in mill.joints})
    level, upright = (GroundCompliance(joint=name) for name in ("X", "Z"))
    assert level.cost(scene) == GroundCompliance(joint="X", by="Y").cost(scene) == 0.0
    assert upright.cost(scene) == GroundCompliance(joint="X", by="Z").cost(scene) > 0.5
