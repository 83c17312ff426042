"""The CMM paper's numbers, against a simulator that shares no code with the tool; the notebook tells the story."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import sqrt

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.conventions import MOTIONS
from errormodel.machine_file import read_machine
from errormodel.simulation import measured_at
from errormodel.truth import Truth
from identification.uncertainty.budget import Input, combine
from tests.helpers import thermal_cmm as cmm

CMM = "bridge_cmm"
X23, Y34, Z12, Z45 = -60.0, 110.0, 560.0, 200.0  # mm, of the library's machine


def moved(monkeypatch: pytest.MonkeyPatch, joint: str, motion: str, command: np.ndarray) -> np.ndarray:
    """Lever (3,) of one error motion by finite kinematics of the simulator: tip's motion per unit."""
    size = 1e-7

    def only(name: str, position: np.ndarray, theta: Mapping[str, np.ndarray]) -> np.ndarray:
        out = np.zeros((len(position), 6))
        out[:, MOTIONS.index(motion)] = size * (name == joint)
        return out

    monkeypatch.setattr(cmm, "motions", only)
    monkeypatch.setattr(cmm, "SQUARENESS", {"Y": (0.0, 0.0, 0.0), "X": (0.0, 0.0, 0.0)})
    return np.asarray((cmm.tip(command, {}) - cmm.nominal(command))[0] / size)


@pytest.mark.parametrize(
    ("joint", "motion", "levers"),
    [  # as eqs. (16) to (18) should read; Z of the machine upwards, the paper's downwards
        ("Y", "ec", lambda x, z: (Y34, X23 + x, 0.0)),  # Yaw_Y: its first lever is missing in print
        ("Y", "eb", lambda x, z: (Z12 + z - Z45, 0.0, -(X23 + x))),  # Roll_Y
        ("Y", "ea", lambda x, z: (0.0, -(Z12 + z - Z45), -Y34)),  # Pitch_Y
        ("X", "ec", lambda x, z: (Y34, 0.0, 0.0)),  # Yaw_X
        ("X", "eb", lambda x, z: (z - Z45, 0.0, 0.0)),  # Pitch_X
        ("X", "ea", lambda x, z: (0.0, -(z - Z45), -Y34)),  # Roll_X: eq. (2) has Roll_Y in its place
        ("Z", "eb", lambda x, z: (-Z45, 0.0, 0.0)),  # Yaw_Z: in print its lever has Z as well
        ("Z", "ea", lambda x, z: (0.0, Z45, 0.0)),  # Pitch_Z
    ],
)
def test_levers_of_the_angles(monkeypatch: pytest.MonkeyPatch, joint: str, motion: str, levers: object) -> None:
    for x, y, z in ((30.0, 350.0, -280.0), (310.0, 20.0, -10.0)):
        found = moved(monkeypatch, joint, motion, np.array([[x, y, z]]))
        np.testing.assert_allclose(found, levers(x, z), atol=1e-3)  # type: ignore[operator]


def test_the_simulator_is_the_machine_of_the_library() -> None:
    """Same chain, same signs, finite angles: cubic error motions and squareness in both, to a picometre."""
    machine = replace(read_machine(CMM))
    chain = Chain(machine)
    rng = np.random.default_rng(4)
    command = np.column_stack([rng.uniform(*cmm.TRAVEL[j], 40) for j in "XYZ"])
    angles = {
        "bridge.ec": cmm.SQUARENESS["Y"][2],
        "carriage.ea": cmm.SQUARENESS["X"][0],
        "carriage.eb": cmm.SQUARENESS["X"][1],
    }
    sizes = {i: rng.normal(0, 5e-3 if ".d" in i else 3e-5) for i in chain.machine_ids if i[0] in "XYZ" and i[1] == "."}
    points = pd.DataFrame(command, columns=["X", "Y", "Z"])
    points[["tool_x", "tool_y", "tool_z"]] = machine.tool
    said = measured_at(machine, points, Truth(sizes | angles))[["mx", "my", "mz"]].to_numpy()

    def motions(joint: str, position: np.ndarray, theta: Mapping[str, np.ndarray]) -> np.ndarray:
        u = position / max(map(abs, cmm.TRAVEL[joint]))
        terms = [[sizes[f"{joint}.{m}.{k}"] for m in MOTIONS] for k in (1, 2, 3)]
        return sum(np.outer(u**k, row) for k, row in enumerate(terms, start=1))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cmm, "motions", motions)
        np.testing.assert_allclose(cmm.tip(command, {}), said, atol=1e-9)


def test_a_ring_without_errors_has_its_diameter(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cmm, "motions", lambda joint, position, theta: np.zeros((len(position), 6)))
    monkeypatch.setattr(cmm, "SQUARENESS", {"Y": (0.0, 0.0, 0.0), "X": (0.0, 0.0, 0.0)})
    for level in (0.0, 6.0):
        table = cmm.ring(1, level)
        for place in (1, 8):
            here = table["place"] == place
            found = cmm.diameter(table.loc[here, ["X", "Y", "Z"]].to_numpy())
            warm = table.loc[here, "ring"].mean() - 20
            assert found == pytest.approx(cmm.RING * (1 + 11.5e-6 * warm), abs=6e-4)  # noise of 0.3 um a point
            assert level - 2.5 < warm < level + 0.1


def test_table_4_is_not_the_budget_of_its_own_lines() -> None:
    """Degrees of freedom and k follow from the lines, u and U do not: they have the repeatability twice."""
    repeatability = Input("M", "A", "normal", 0.074, "um", 1.0, 4.0)
    lines = [repeatability, Input("R_laser", "B", "rectangular", 0.0058, "um", 1.0)]
    own, twice = combine("X", "um", lines), combine("X", "um", [*lines, repeatability])
    assert (round(own.dof, 2), round(own.k, 2)) == (4.05, 2.78)
    assert own.std == pytest.approx(0.0742, abs=5e-5)
    assert own.expanded == pytest.approx(0.206, abs=5e-4)
    assert twice.std == pytest.approx(0.104, abs=1e-3)
    assert twice.dof == pytest.approx(8.05, abs=0.01)
    assert own.k * 0.104 == pytest.approx(0.289, abs=5e-4)
    assert 0.02 / 2 / sqrt(3) == pytest.approx(0.0058, abs=5e-5)  # a laser's resolution of 0.02 um
