"""The scale of a rotary axis: off centre, and oval."""

from __future__ import annotations

import numpy as np

from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.diagnosis.pipeline import diagnose
from tests.helpers.diagnosed import empty_survey, showing
from tests.helpers.findings import made

MACHINE = read_machine(
    {
        "errormodel": 1,
        "name": "table that turns",
        "units": {"length": "mm", "angle": "deg"},
        "chain": [
            {"joint": "C", "type": "rotary", "axis": "z", "travel": [0, 360]},
            {"shape": "table"},
            {"joint": "X", "type": "prismatic", "axis": "x", "travel": [-200, 200]},
            {"shape": "saddle"},
            {"joint": "Z", "type": "prismatic", "axis": "z", "travel": [0, 300]},
        ],
        "tool": [0, 0, -100],
        "errors": {"shapes": "all", "joints": {"X": "first-order", "Z": "first-order"}},
    }
)
C = MACHINE.joints[0]


def test_an_oval_scale_has_twice_the_harmonic_as_well() -> None:
    q = np.linspace(0, 2 * np.pi, 9)
    round_one, oval = (
        [
            np.asarray(next(iter(t.motion.values())))
            for t in made("eccentricity", joint=C.name, oval=o).terms({C.name: q}.__getitem__, MACHINE)
        ]
        for o in (False, True)
    )
    sign = np.sign(round_one[1][0])
    np.testing.assert_allclose(oval[:2], round_one)
    np.testing.assert_allclose(oval[2:], sign * np.array([np.sin(2 * q), np.cos(2 * q)]), atol=1e-12)


def test_a_scale_off_centre_and_oval_is_one_cause() -> None:
    survey = empty_survey(MACHINE, 250, 3, channels=False, grid=False)
    spec = EffectSpec("eccentricity", {"joint": C.name, "oval": True})
    found = diagnose(MACHINE, showing(survey, MACHINE, [(spec, [1e-4, 5e-5, -7e-5, 4e-5])], 0.002)).diagnosis
    assert [(f.effect, f.where) for f in found.findings] == [("eccentricity", C.name)]
