"""The speed of a joint on the path: its share of the feed, in the direction in which the path runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.channels import channel, root
from errormodel.effects import make
from errormodel.exceptions import EffectError, InputError
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from errormodel.path_speed import clock_speed, in_motion, path_speed, rate_name, speed_name

XY = np.array([True, True])


def speeds(places, feed=6000.0, side=None, time=None, linear=XY, series=None):
    position = np.array(places, dtype=float)
    n = len(position)
    if side is None:
        side = np.sign(np.diff(position, axis=0, prepend=position[:1])) + 0.0
        side[side == 0] = 1.0
    return path_speed(
        position,
        linear,
        np.full(n, feed),
        np.array(side, dtype=float),
        np.full(n, np.nan) if time is None else np.array(time, dtype=float),
        np.zeros(n, dtype=int) if series is None else np.array(series),
    )


def test_a_joint_that_moves_alone_has_the_feed() -> None:
    out = speeds([[0, 0], [50, 0], [120, 0], [120, -30]])
    np.testing.assert_allclose(out[1:], [[100, 0], [100, 0], [0, -100]], atol=1e-12)


def test_joints_that_move_together_share_the_feed() -> None:
    out = speeds([[0, 0], [30, 40], [60, 80], [0, 0]])
    np.testing.assert_allclose(out[1:3], [[60, 80]] * 2, atol=1e-9)
    np.testing.assert_allclose(out[3], [-60, -80], atol=1e-9)
    assert np.allclose(np.linalg.norm(out, axis=1), 100)


def test_a_curve_has_the_direction_of_its_tangent() -> None:
    angle = np.linspace(0, np.pi, 13)
    circle = 100 * np.column_stack([np.cos(angle), np.sin(angle)])
    tangent = 100 * np.column_stack([-np.sin(angle), np.cos(angle)])
    out = speeds(circle, side=np.sign(tangent) + (tangent == 0))
    assert np.abs(out[1:-1] - tangent[1:-1]).max() < 1.0
    assert np.abs(np.diff(circle, axis=0)[0] / 26.1 * 100 - tangent[1]).max() > 10  # as the step before has it


def test_the_first_row_of_a_line_goes_with_the_line() -> None:
    """A jump leads to it, which the feed is not for; the stated sides say which of two steps it is."""
    places = [[0, 0], [10, 0], [20, 0], [80, 50], [80, 60], [80, 70]]
    out = speeds(places, side=[[1, 1]] * 6)
    np.testing.assert_allclose(out[3], [0, 100], atol=1e-9)
    np.testing.assert_allclose(speeds(places, side=[[1, 1]] * 6, series=[0, 0, 0, 1, 1, 1])[3], [0, 100], atol=1e-9)


def test_sides_that_no_step_has_turn_the_share() -> None:
    """Approached anew from a side of its own: by the way that it came, in the stated direction."""
    out = speeds([[0, 0], [30, 40], [0, 80]], side=[[1, 1], [1, -1], [1, -1]])
    np.testing.assert_allclose(out[1], [60, -80], atol=1e-9)


def test_rows_that_were_read_in_motion_are_as_fast_as_their_times_say() -> None:
    """Along a line with an acceleration of 500 mm/s^2, then at rest for a minute."""
    time = np.concatenate([np.linspace(0.02, 3.0, 60), [63.0, 123.0]])
    way = np.where(time < 0.2, 250 * time**2, 100 * time - 10)
    way[-2:] = way[-3] + np.array([5.0, 10.0])
    fast = np.minimum(500 * time, 100)
    out = speeds(np.column_stack([way, 0 * way]), time=time)[:, 0]
    assert np.abs(out[2:60] - fast[2:60]).max() < 8
    assert np.abs(out[-1]) < 1  # the feed is 100
    np.testing.assert_allclose(speeds(np.column_stack([way, 0 * way]))[:, 0], 100)  # without times


def test_rotary_joints_take_the_feed_in_degrees_where_they_move_alone() -> None:
    turning = np.array([True, False])
    out = speeds(np.radians([[0, 0], [0, 30], [0, 90]]), feed=600.0, linear=turning)
    np.testing.assert_allclose(np.degrees(out[1:, 1]), 10, rtol=1e-12)
    mixed = speeds([[0, 0], [50, 0.1], [100, 0.2]], feed=6000.0, linear=turning)
    np.testing.assert_allclose(mixed[1:], [[100, 0.2]] * 2, rtol=1e-12)  # along 50 mm in half a second


def test_the_channel_takes_each_run_by_its_own() -> None:
    machine = read_machine("vertical_three_axis")
    name = speed_name(machine, "X")
    table = pd.DataFrame({j.name: [0.0, 30, 60, 500, 530, 560] for j in machine.joints})
    table = table.assign(feed=6000.0, run=["a"] * 3 + ["b"] * 3, file="s.csv")
    table.loc[1:2, "Y"] = table.loc[4:5, "Y"] = [0.0, 0.0]
    table.loc[3:5, "Y"] = 0.0
    out = channel(table, name)
    assert root(name) == "feed"
    np.testing.assert_allclose(out, 100 / np.sqrt(2), rtol=1e-12)


@pytest.mark.parametrize("speed", ["path", "clock"])
def test_a_delay_on_a_path_is_the_displacement_on_it(speed: str) -> None:
    """Of a machine with rotary axes too: to first order the tool is where it will be a delay later."""
    machine = read_machine("trunnion_five_axis")
    rng = np.random.default_rng(4)
    low, high = np.array([j.travel for j in machine.joints]).T
    places = low + (high - low) * rng.uniform(0.2, 0.8, (30, len(low)))
    table = pd.DataFrame(places, columns=[j.name for j in machine.joints])
    table = table.assign(feed=rng.choice([600.0, 3000.0], 30), tool_x=30.0, tool_y=-20.0, tool_z=-150.0, file="s.csv")
    table = table.assign(time=np.cumsum(rng.uniform(5, 20, 30)))
    chain = Chain(replace(machine, effects=(EffectSpec("clock-offset", {"speed": speed}),)))
    p, delay = np.zeros(len(chain.ids)), 1e-3
    p[chain.index["frame.dx.clock-offset"]] = delay
    rows = chain.columns(table)
    moved = chain.kernel("actual", outputs=(0, 1, 2))(rows, p) - chain.kernel("nominal", outputs=(0, 1, 2))(rows)
    ahead = table.copy()
    for j in machine.joints:
        name = speed_name(machine, j.name) if speed == "path" else rate_name(j.name)
        ahead[j.name] = table[j.name] + delay * channel(table, name)
    there = chain.kernel("nominal", outputs=(0, 1, 2))(chain.columns(ahead))
    expected = there - chain.kernel("nominal", outputs=(0, 1, 2))(rows)
    assert np.abs(moved - expected).max() < 1e-2 * np.abs(expected).max()


def test_the_clock_says_how_fast_a_joint_is_in_a_row() -> None:
    """Exactly where it accelerates evenly; each series by itself, and rows at one time are at rest."""
    time = np.array([0.0, 1.0, 3.0, 4.0, 0.0, 2.0, 2.0, 5.0])
    series = np.array([0, 0, 0, 0, 1, 1, 1, 2])
    out = clock_speed(np.where(series == 0, time**2, 3 * time), time, series)
    np.testing.assert_allclose(out, [0, 2, 6, 8, 3, 3, 0, 0])


def test_a_path_that_runs_on_is_read_in_motion() -> None:
    t = np.linspace(0, 40, 200)
    smooth = np.column_stack([np.sin(t), np.cos(0.7 * t)])
    assert in_motion([*smooth.T])
    assert not in_motion([*np.random.default_rng(1).permutation(smooth).T])
    assert not in_motion([t, np.zeros(200)])  # a line of one axis, which may be read at rest
    assert not in_motion([*smooth[:2].T])
    assert not in_motion([])


def test_a_delay_is_of_joints_that_there_are() -> None:
    unknown = EffectSpec("clock-offset", {"speed": "clock", "joints": ["U"]})
    machine = replace(read_machine("vertical_three_axis"), effects=(unknown,))
    with pytest.raises(InputError, match="U"):
        Chain(machine)


def test_a_path_takes_all_joints() -> None:
    with pytest.raises(EffectError, match="on a path all joints move"):
        make(EffectSpec("clock-offset", {"speed": "path", "joints": ["X"]}))
