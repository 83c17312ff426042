"""Finding commands and dwells without names: rigid alignments without pairs, stretches at rest, offsets of clocks."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from errormodel.exceptions import InputError
from identification.importing.dwells import find_dwells
from identification.importing.matching import by_order, by_time, speed_offset
from identification.importing.nearest import find_pairing

SEEDS = st.integers(0, 10_000)


@settings(max_examples=15)
@given(seed=SEEDS)
def test_every_point_finds_its_command(seed: int) -> None:
    """Of up to 120 poses some were not measured; errors of 20 um, a tenth of the readings elsewhere, in any order."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(16, 120))
    nominal = rng.uniform(-500, 500, (n, 3)) * [1, rng.uniform(0.3, 1), rng.uniform(0.1, 0.6)]
    keep = rng.permutation(n)[: max(12, int(n * rng.uniform(0.6, 1)))]
    turn = Rotation.random(rng=seed).as_matrix()
    measured = (nominal + 0.02 * nominal[:, [1, 2, 0]] / 500)[keep] @ turn.T + rng.uniform(-3000, 3000, 3)
    measured += rng.normal(0, 0.005, measured.shape)
    wild = len(keep) // 10
    measured[:wild] += rng.uniform(20, 200, (wild, 3))
    found = find_pairing(nominal, measured)
    assert found is not None
    np.testing.assert_array_equal(found.command[wild:], keep[wild:])


def test_points_that_do_not_belong_find_nothing() -> None:
    rng = np.random.default_rng(1)
    assert find_pairing(rng.uniform(-400, 400, (50, 3)), rng.uniform(-400, 400, (50, 3))) is None


@settings(max_examples=15)
@given(seed=SEEDS)
def test_dwells_are_found_in_any_log(seed: int) -> None:
    """Noise of 0.3 to 30 um, 3 to 1000 readings a second, 3 to 300 mm/s; the means are right to five times it."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-400, 400, (int(rng.integers(4, 25)), 3))
    noise, rate, speed = 10 ** rng.uniform(-3.5, -1.5), 10 ** rng.uniform(0.5, 3), 10 ** rng.uniform(0.5, 2.5)
    stay = max(int(rng.uniform(2, 5) * rate), 5)
    log: list[np.ndarray] = []
    for k, place in enumerate(places):
        if k:
            between = min(int(np.linalg.norm(place - places[k - 1]) / speed * rate), 1500)
            log += [places[k - 1] + a * (place - places[k - 1]) for a in np.linspace(0, 1, between + 2)[1:-1]]
        log += [place] * stay
    points = np.array(log) + rng.normal(0, noise, (len(log), 3))
    found = find_dwells(points)
    if stay < 10 and found is None:  # so few readings of each place may be repeats of single points
        return
    assert found is not None
    assert len(found) == len(places)
    means = [points[a : b + 1].mean(axis=0) for a, b in zip(found.first, found.last, strict=True)]
    # the last reading on the way may lie within the noise of the place
    assert np.abs(np.array(means) - places).max() < 5 * noise


def test_single_points_have_no_dwells() -> None:
    rng = np.random.default_rng(2)
    assert find_dwells(rng.uniform(-400, 400, (60, 3))) is None
    assert find_dwells(np.repeat(rng.uniform(-400, 400, (20, 3)), 3, axis=0) + rng.normal(0, 1e-3, (60, 3))) is None


@pytest.mark.parametrize("offset", [-7.3, 0.0, 41.07])
def test_the_offset_of_two_clocks(offset: float) -> None:
    """A path recorded at 50 Hz, and in another frame at 13 Hz by a clock that is ahead; to a millisecond."""
    rng = np.random.default_rng(3)
    time = np.arange(0, 60, 0.02)
    path = np.column_stack([np.interp(time, np.linspace(0, 60, 25), rng.uniform(-300, 300, 25)) for _ in range(3)])
    when = np.arange(4, 55, 1 / 13)
    turn = Rotation.from_euler("xyz", [20, 30, 140], degrees=True).as_matrix()
    seen = np.column_stack([np.interp(when, time, path[:, k]) for k in range(3)]) @ turn.T + [1000, 2000, 3000]
    found = speed_offset(path, time, seen + rng.normal(0, 0.005, seen.shape), when + offset)
    assert found == pytest.approx(offset, abs=1e-3)


def test_a_list_of_times_is_joined_with_its_offset() -> None:
    told = np.cumsum(np.random.default_rng(4).uniform(20, 60, 12))
    rows = np.delete(np.arange(12), [2, 7])
    points = np.zeros((10, 3))
    found = by_time(np.zeros((12, 3)), told, points, told[rows], told[rows] + 100.0, same_clock=False, name="plan")
    np.testing.assert_array_equal(found.command, rows)
    assert found.offset == pytest.approx(100.0, abs=1.0)


def test_passes_and_repeats_are_told_apart() -> None:
    nominal = np.random.default_rng(5).uniform(-300, 300, (8, 3))
    passes = by_order(24, 8, nominal, np.tile(nominal, (3, 1)) + 5)
    repeats = by_order(24, 8, nominal, np.repeat(nominal, 3, axis=0) + 5)
    assert passes is not None
    assert repeats is not None
    np.testing.assert_array_equal(passes.command, np.tile(np.arange(8), 3))
    np.testing.assert_array_equal(repeats.command, np.repeat(np.arange(8), 3))
    assert by_order(23, 8, nominal, np.zeros((23, 3))) is None


def two_logs(q: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Path of the commands with their times, and what was seen on it with its true times."""
    rows = [q[:1].repeat(80, axis=0)]
    for a, b in pairwise(q):
        part = (1 - np.cos(np.linspace(0, np.pi, int(np.abs(b - a).max() / 2) + 2))) / 2
        rows += [a + np.outer(part, b - a), b[None].repeat(80, axis=0)]
    path = np.vstack(rows)
    told = 0.02 * np.arange(len(path))
    when = np.arange(2, told[-1] - 2, 0.05)
    seen = np.column_stack([np.interp(when, told, path[:, k]) for k in range(3)]) + rng.normal(0, 3e-3, (len(when), 3))
    return path, told, seen, when


def test_cycles_that_repeat_are_no_clock_that_was_set() -> None:
    """Each end of the recording fits other cycles as well; one offset fits all of it."""
    rng = np.random.default_rng(8)
    path, told, seen, when = two_logs(np.vstack([rng.uniform(-300, 300, (5, 3))] * 3), rng)
    by_time(path, told, seen, when + 12.3, when[100:200] + 12.3, same_clock=False, name="c.csv")


@pytest.mark.parametrize(("jump", "share"), [(30.0, 0.6), (1.2, 0.4)])
def test_a_clock_that_was_set_between_two_logs_is_named(jump: float, share: float) -> None:
    rng = np.random.default_rng(0)
    path, told, seen, when = two_logs(rng.uniform(-300, 300, (12, 3)), rng)
    first = int(share * len(when))
    clock = when + 12.3 + jump * (np.arange(len(when)) >= first)
    with pytest.raises(InputError, match=r"m\.csv: two logs.* clock is .* s further ahead of that of c\.csv") as error:
        by_time(path, told, seen, clock, clock[100:200], same_clock=False, name="c.csv", measured="m.csv")
    assert abs(int(str(error.value).split("from row ")[1].split(maxsplit=1)[0]) - first - 1) < 40  # of a rest
