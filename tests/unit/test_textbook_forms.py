"""Forms of effects against their textbook: integrated beams, an axis on a cone, an elastic ground."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from errormodel.arrays import Array
from errormodel.conventions import MOTIONS
from errormodel.effects.base import Effect
from errormodel.exceptions import EffectError
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine
from identification.diagnosis.pipeline import diagnose
from tests.helpers.diagnosed import empty_survey, showing
from tests.helpers.effect_battery import numeric
from tests.helpers.findings import made

MILL, TABLE = read_machine("vertical_three_axis"), read_machine("five_axis_table_quill")


def motions(effect: Effect, machine: Machine, values: list[float], **channels: Array) -> dict[str, Array]:
    """What an effect's parameters do to each motion of its place."""
    rows = np.zeros_like(next(iter(channels.values())))
    moved = numeric(effect, machine, {j.name: rows for j in machine.joints} | channels)
    whole = sum(value * motion for value, (_, motion) in zip(values, moved, strict=True))
    return dict(zip(MOTIONS, np.asarray(whole), strict=True))


@pytest.mark.parametrize("foot", ["low", "high"])
def test_a_column_is_the_integral_of_its_curvature(foot: str) -> None:
    """The load's moment bends the column from below its travel on: tilt and displacement of Euler and Bernoulli."""
    column, load = (next(j for j in MILL.joints if j.name == name) for name in ("Z", "X"))
    effect = made("column-bending", joint="Z", load_joint="X", motion="eb", foot=foot, overhang=True)
    length, below, rest, stiff = np.ptp(column.travel), 0.2, 1.4, 3e-5
    for v in (-1.0, -0.3, 0.8):
        h = np.linspace(0, 1, 2001)
        curvature = np.full_like(h, stiff * (v + rest))  # moment over stiffness, per length of the travel
        tilt = stiff * (v + rest) * below + cumulative_trapezoid(curvature, h, initial=0)
        bow = cumulative_trapezoid(tilt * length, h, initial=0)  # along X, from where the travel begins
        up = h if foot == "low" else 1 - h
        z = column.travel[0] + up * length
        x = np.full_like(h, np.mean(load.travel) + v * np.ptp(load.travel) / 2)
        # what is the same at every height of the column moves as a member would, and is left out
        steady = stiff * rest * below
        found = motions(effect, MILL, [stiff, stiff * rest, stiff * below], X=x, Z=z)
        np.testing.assert_allclose(found["eb"], tilt - steady, atol=1e-12)
        sense = 1 if foot == "low" else -1
        np.testing.assert_allclose(found["dx"], sense * (bow - steady * h * length), atol=1e-9)


def test_what_overhangs_bends_a_column_from_its_foot() -> None:
    with pytest.raises(EffectError, match="write foot: low or foot: high"):
        made("column-bending", joint="Z", load_joint="X", overhang=True)


@pytest.mark.parametrize(("whirl", "sense"), [("forward", 1.0), ("backward", -1.0)])
def test_an_axis_on_a_cone_keeps_its_tilt_and_runs_round(whirl: str, sense: float) -> None:
    b = np.linspace(0, 2 * np.pi, 25)
    found = motions(made("wobble", joint="B", harmonic=2, whirl=whirl), TABLE, [3e-5, 4e-5], B=b)
    (joint,) = (j for j in TABLE.joints if j.name == "B")
    tilt = np.array([found[name] for name in ("ea", "eb", "ec")]).T
    np.testing.assert_allclose(np.linalg.norm(tilt, axis=1), 5e-5)
    np.testing.assert_allclose(tilt @ joint.axis, 0, atol=1e-15)
    step = np.einsum("ni,i->n", np.cross(tilt[:-1], tilt[1:]), joint.axis) / 5e-5**2
    np.testing.assert_allclose(step, sense * np.sin(2 * np.diff(b)))


def test_an_axis_on_a_cone_has_no_motion_of_its_own() -> None:
    with pytest.raises(EffectError, match="a motion or a whirl"):
        made("wobble", joint="B", motion="ea", whirl="forward")


def findings_of(machine: Machine, spec: EffectSpec, values: list[float], **columns: Array) -> list[tuple[str, str]]:
    """What a survey of a machine with an effect is found to show."""
    survey = empty_survey(machine, 260, 5, channels=False, grid=False)
    survey = replace(survey, table=survey.table.assign(**columns))
    findings = diagnose(machine, showing(survey, machine, [(spec, values)], 0.003)).diagnosis.findings
    return [(f.effect, f.where) for f in findings]


@pytest.mark.long
def test_an_axis_on_a_cone_is_no_compliance_of_the_next_joint() -> None:
    spec = EffectSpec("wobble", {"joint": "B", "harmonic": 2, "whirl": "forward"})
    assert findings_of(TABLE, spec, [3e-5, 2e-5]) == [("wobble", "B")]


@pytest.mark.long
def test_a_spindle_that_grows_over_the_air() -> None:
    hours = np.linspace(0, 6, 260)
    air, own = 19 + 3 * np.sin(hours), 24 + 6 * np.sin(2.1 * hours + 1)
    spec = EffectSpec("spindle-growth", {"sensor": "T_spindle", "minus": "T_air"})
    assert [word for word, _ in findings_of(MILL, spec, [0.004], time=3600 * hours, T_spindle=own, T_air=air)] == [
        "spindle-growth"
    ]


@pytest.mark.long
def test_a_table_that_was_on_in_the_first_of_two_runs() -> None:
    spec = EffectSpec("compensation-active", {"joint": "X", "points": 7, "run": "1"})
    values = [0.0, 0.03, -0.02, 0.025, -0.03, 0.02, 0.0]
    runs = np.repeat(["1", "2"], 130)
    assert findings_of(MILL, spec, values, run=runs) == [("compensation-active", "X")]


def test_a_servo_that_lags_on_lines_of_other_joints() -> None:
    """One joint moves at a time; the feed is recorded, and the speed of a joint at rest is none."""
    steps = np.arange(260)
    moving, along = (steps // 20) % 3, np.abs((steps % 40) - 20) / 20
    time, feed = 0.5 * steps, np.where((steps // 60) % 2, 1500.0, 3000.0)
    places = {j.name: np.mean(j.travel) + np.ptp(j.travel) * 0.3 * (along - 0.5) * (moving == k)
              for k, j in enumerate(MILL.joints)}  # fmt: skip
    spec = EffectSpec("servo-lag", {"joint": "Y", "speed": "clock"})
    assert findings_of(MILL, spec, [2e-3], time=time, feed=feed, **places) == [("servo-lag", "Y")]
