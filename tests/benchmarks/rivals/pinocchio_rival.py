"""Pinocchio's own kinematic regressor, called pose by pose from Python (it has no call for many poses).

It offers six columns a joint, for the variation of that joint's placement: on this chain those of the measuring frame
and of the members T1 to T4, 30 columns. The members' T5, the joints' error motions and the basis functions of position
would be the user's own work and are left out, so that its figure is for less than the 52 columns.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from tests.benchmarks.five_axis import JOINTS, MOTIONS, TOOL, Array

IDS = tuple(f"{element}.{motion}" for element in ("frame", "T1", "T2", "T3", "T4") for motion in MOTIONS)


def model() -> tuple[pin.Model, int]:
    """The chain in Pinocchio (mm instead of m: it does not mind), and the id of the functional point's frame."""
    model = pin.Model()
    last = 0
    for name, kind, axis, _ in JOINTS:
        make = pin.JointModelRevoluteUnaligned if kind == "rotary" else pin.JointModelPrismaticUnaligned
        last = model.addJoint(last, make(np.array(axis)), pin.SE3.Identity(), name)
    tool = pin.SE3(np.eye(3), np.array(TOOL))
    return model, model.addFrame(pin.Frame("tool", last, 0, tool, pin.FrameType.OP_FRAME))


MODEL, FRAME = model()
DATA = MODEL.createData()


def build(q: Array) -> Array:
    M = np.empty((len(q), 3, len(IDS)))
    for row, command in enumerate(q):
        pin.forwardKinematics(MODEL, DATA, command)
        regressor = pin.computeFrameKinematicRegressor(MODEL, DATA, FRAME, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        M[row] = regressor[:3]
    return M.reshape(3 * len(q), -1)
