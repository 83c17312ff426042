"""FIGAROH's kinematic regressor over given configurations, by its own function, from a URDF of the chain.

``calculate_identifiable_kinematics_model`` is the part of its ``calculate_base_kinematics_regressor`` that evaluates
the given poses; the whole does that twice (once for random poses) and a QR, and would look worse. Thirty columns like
Pinocchio's, position rows only, in the tool's axes and in metres as FIGAROH wants; timed on few poses.
"""

from __future__ import annotations

import logging
import tempfile
from pathlib import Path

import numpy as np
from figaroh.calibration.calibration_tools import calculate_identifiable_kinematics_model
from figaroh.calibration.config import unified_to_legacy_config
from figaroh.tools.robot import Robot

from tests.benchmarks.five_axis import JOINTS, MOTIONS, TOOL, Array

IDS = tuple(f"{element}.{motion}" for element in ("frame", "T1", "T2", "T3", "T4") for motion in MOTIONS)
MAX_POSES = 300
_UNIT = np.array([0.001 if kind == "prismatic" else 1.0 for _, kind, _, _ in JOINTS])
_URDF = {"rotary": "revolute", "prismatic": "prismatic"}


def urdf() -> str:
    """The chain as URDF text, in m and rad."""
    parts = ['<link name="base"/>']
    parent = "base"
    for (name, kind, axis, travel), unit in zip(JOINTS, _UNIT, strict=True):
        direction = " ".join(str(a) for a in axis)
        low, high = (t * unit for t in travel)
        parts.append(
            f'<link name="after_{name}"/><joint name="{name}" type="{_URDF[kind]}"><parent link="{parent}"/>'
            f'<child link="after_{name}"/><axis xyz="{direction}"/>'
            f'<limit lower="{low}" upper="{high}" effort="1" velocity="1"/></joint>'
        )
        parent = f"after_{name}"
    tip = " ".join(str(t / 1000) for t in TOOL)
    parts.append(
        f'<link name="tool"/><joint name="tip" type="fixed"><parent link="{parent}"/><child link="tool"/>'
        f'<origin xyz="{tip}"/></joint>'
    )
    return f'<robot name="five_axis">{"".join(parts)}</robot>'


def robot() -> Robot:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "five_axis.urdf")
        file.write_text(urdf(), encoding="utf-8")
        return Robot(str(file), package_dirs=folder)


logging.getLogger("figaroh").setLevel(logging.ERROR)
ROBOT = robot()
CONFIG = unified_to_legacy_config(
    ROBOT,
    {
        "kinematics": {"base_frame": "universe", "tool_frame": "tool"},
        "measurements": {"markers": [{"measurable_dof": [True] * 3 + [False] * 3}]},
        "parameters": {"calibration_level": "full_params"},
    },
)


def build(q: Array) -> Array:
    config = dict(CONFIG, NbSample=len(q))
    return calculate_identifiable_kinematics_model(q * _UNIT, ROBOT.model, ROBOT.data, config)


def as_design(result: Array, q: Array) -> Array:
    """(n, 3, 30) in mm and in the reference's axes, to be compared: rows come component by component."""
    M = result.reshape(3, len(q), len(IDS)).transpose(1, 0, 2).copy()
    s, c = np.sin(q[:, 0]), np.cos(q[:, 0])
    turn = np.zeros((len(q), 3, 3))
    turn[:, 0, 0] = turn[:, 2, 2] = c
    turn[:, 0, 2], turn[:, 2, 0], turn[:, 1, 1] = s, -s, 1.0
    M = turn @ M
    M[:, :, [k for k, identity in enumerate(IDS) if ".e" in identity]] *= 1000
    return M
