"""Sizes that are usual for the compliance of an arm's joint."""

from __future__ import annotations

import numpy as np
import pytest

from errormodel.effects.joint_compliance import USUAL, JointCompliance
from errormodel.machine_file import read_machine
from errormodel.simulation import random_points


@pytest.mark.parametrize("number", [1, 2, 4])
def test_a_joint_with_many_members_behind_it_yields_no_more(number: int) -> None:
    """The weights share a joint's usual twist: a shoulder that carries five members is built for them."""
    arm = read_machine("six_axis_arm")
    poses = random_points(arm, 5, 1)
    terms = JointCompliance(joint=arm.joints[number].name).terms(lambda name: poses[name].to_numpy(), arm)
    weights = [t.size for t in terms if t.label not in ("hardening", "payload")]
    assert np.sum(weights) == pytest.approx(USUAL)
