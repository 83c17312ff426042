"""Where the rows of a survey begin a line after another one."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from errormodel.approach import starts_of_lines
from errormodel.line_starts import line_starts
from errormodel.read_again import read_again


def starts(*lines: list[tuple[float, float]], series: list[int] | None = None) -> dict[int, list[float]]:
    """Numbers of the rows that begin a line, with the signs of the moves along it."""
    path = np.array([p for line in lines for p in line], dtype=float)
    ways = line_starts(path, np.zeros(len(path), int) if series is None else np.array(series))
    return {int(k): ways[k].tolist() for k in np.flatnonzero(ways.any(axis=1))}


def line(first: tuple[float, float], last: tuple[float, float], targets: int = 4) -> list[tuple[float, float]]:
    return [tuple(p) for p in np.linspace(first, last, targets)]


def test_a_target_read_again_begins_the_way_back() -> None:
    there, back = line((0, 0), (30, 20)), line((30, 20), (0, 0))
    assert starts(there, back) == {4: [-1, -1]}


def test_a_reversal_that_is_read_once_ends_its_line() -> None:
    assert starts(line((0, 0), (30, 20)), line((20, 40 / 3), (0, 0), 3)) == {}


def test_a_jump_to_another_line_begins_it() -> None:
    assert starts(line((0, 0), (30, 0)), line((0, 10), (30, 0))) == {4: [1, -1]}


def test_rows_of_a_grid_begin_lines() -> None:
    assert starts(line((0, 0), (30, 0)), line((30, 5), (0, 5)), line((0, 10), (30, 10))) == {4: [-1, 0], 8: [1, 0]}


def test_repeated_readings_are_no_reversal() -> None:
    there = [p for p in line((0, 0), (30, 20)) for _ in range(2)]
    assert starts(there, line((20, 40 / 3), (0, 0), 3)) == {}
    both = [p for p in line((0, 0), (30, 20)) for _ in range(2)]
    assert list(starts(both, both[::-1])) == [8, 9]


def test_another_series_begins_without_a_way() -> None:
    there, back = line((0, 0), (30, 20)), line((30, 20), (0, 0))
    assert starts(there, back, series=[0] * 4 + [1] * 4) == {}


@given(st.integers(0, 2**32 - 1))
def test_a_curve_has_no_corners(seed: int) -> None:
    angle = np.linspace(0, 2 * np.pi, 40) + np.random.default_rng(seed).uniform(-0.05, 0.05, 40)
    assert not line_starts(np.column_stack([np.cos(angle), np.sin(angle)]), np.zeros(40, int)).any()


@pytest.mark.parametrize("stated", [False, True])
def test_only_sides_that_nothing_states(stated: bool) -> None:
    path = np.array([*line((0, 0), (30, 20)), *line((30, 20), (0, 0))])
    table = pd.DataFrame({"file": "s.csv", "run": "1", "X": path[:, 0], "Y": path[:, 1]})
    if stated:
        table["dir_X"] = [1.0] * 4 + [-1.0] * 4
    assert np.flatnonzero(starts_of_lines(table, "X", ["X", "Y"])).tolist() == ([] if stated else [4])


@pytest.mark.parametrize(
    ("order", "next_"),
    [("AB", "AB"), ("AB", "BA"), ("AABB", "AABB"), ("AABB", "BBAA"), ("ABBA", "ABBA"), ("AAB", "AAB")],
)
def test_readings_from_the_other_side_are_among_the_usual_orders(order: str, next_: str) -> None:
    sides = np.array([side == "B" for side in (order + next_) * 2])
    along = np.repeat(np.arange(4.0), len(order))
    path, run, tool = np.column_stack([along, 0 * along]), np.zeros(len(along), int), np.zeros((len(along), 3))
    found = read_again(path, tool, 0, run)
    assert any((again == sides).all() for again, _ in found)
    assert all(seen.all() for _, seen in found)
    assert len({again.tobytes() for again, _ in found}) == len(found)
    assert not read_again(path, tool, 1, run)  # it stands
    assert not read_again(path, np.arange(len(along))[:, None], 0, run)  # another tool makes another target


@given(moves=st.lists(st.tuples(*[st.integers(-1, 1)] * 2, *[st.integers(0, 1)] * 2), min_size=1, max_size=20))
@example(moves=[(-1, 0, 1, 0), (1, 0, 0, 0), (1, -1, 1, 0), (0, 0, 1, 0), (-1, 1, 0, 0), (0, 1, 0, 0)])
def test_any_path_has_readings_again_or_none(moves: list[tuple[int, int, int, int]]) -> None:
    """Whatever the path, the tools and the series: rows that are read again are among those of their targets.

    In the example a line begins with the second reading of its first target.
    """
    table = np.array(moves, dtype=float)
    path, tools, series = np.cumsum(table[:, :2], axis=0), table[:, 2:3], np.sort(table[:, 3].astype(int))
    for joint in (0, 1):
        for again, seen in read_again(path, tools, joint, series):
            assert again.any()
            assert not (again & ~seen).any()
