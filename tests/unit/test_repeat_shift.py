"""A small displacement in the middle of a survey shows in the repeats of its commands, and in nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from errormodel import simulate
from errormodel.observations.station import located
from identification import fit
from identification.importing.repeat_shift import repeat_shift
from tests.helpers.importing import MILL, poses

SHIFT = np.array([0.02, -0.02, 0.01])  # 30 um, ten times the noise


def measured(labels: np.ndarray, first: int, shift: np.ndarray, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    places = rng.uniform(-500, 500, (labels.max() + 1, 3))
    return places[labels] + rng.normal(0, 0.003, (len(labels), 3)) + np.outer(np.arange(len(labels)) >= first, shift)


@pytest.mark.parametrize("seed", range(5))
def test_ten_times_the_noise_between_reference_poses_at_both_ends(seed: int) -> None:
    """Twelve poses at the beginning and again at the end; between them nobody knows when."""
    labels = np.concatenate([np.arange(60), np.arange(12)])
    found = repeat_shift(labels, measured(labels, 30, SHIFT, seed), np.arange(1, 73), "a.csv")
    assert found is not None
    assert (found.after, found.before, found.count) == (12, 61, 12)
    assert found.size_um == pytest.approx(30, abs=4 * found.u_um)
    assert found.u_um == pytest.approx(3 * np.sqrt(2 / 12), rel=0.4)
    assert "repeats of 12 commands lie" in found.text
    assert "between rows 12 and 61" in found.text


def test_poses_that_come_again_and_again_say_where() -> None:
    labels = np.tile(np.arange(6), 10)
    found = repeat_shift(labels, measured(labels, 33, SHIFT, 1), np.arange(1, 61), "a.csv")
    assert found is not None
    assert (found.after, found.before) == (33, 34)
    assert "at row 34" in found.text


@pytest.mark.parametrize("seed", range(20))
def test_noise_is_no_displacement(seed: int) -> None:
    for labels in (np.concatenate([np.arange(60), np.arange(8)]), np.tile(np.arange(6), 10), np.arange(50)):
        assert repeat_shift(labels, measured(labels, 30, 0 * SHIFT, seed), np.arange(len(labels)), "a.csv") is None


def test_noise_that_drifts_slowly_is_none() -> None:
    """Correlated by 0.9 from row to row: means of a dozen repeats differ by far more than noise that averages out."""
    labels = np.concatenate([np.arange(60), np.arange(12)])
    found = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        noise = rng.normal(0, 0.003, (len(labels), 3))
        for k in range(1, len(noise)):
            noise[k] = 0.9 * noise[k - 1] + np.sqrt(1 - 0.9**2) * noise[k]
        found += repeat_shift(labels, noise, np.arange(1, 73), "a.csv") is not None
    assert found <= 1


@pytest.mark.parametrize("moved", [0.0, 0.03])
def test_a_fit_says_it_too(moved: float) -> None:
    # all but the first pose are reached from the same sides again
    survey = simulate(MILL, poses(2, 40).iloc[[*range(40), *range(14)]], noise=0.002, seed=2)
    survey.loc[survey.index[40:], "mx"] += moved
    notes = [note for note in fit(MILL, survey.reset_index(drop=True)).notes if "displaced" in note]
    assert [("from row 41 on the points lie" in note) for note in notes] == [True] * bool(moved)


def test_places_of_a_station_have_digits_that_are_known() -> None:
    """Lengths of the other sign fit places at astronomic distances; those of points in a plane both sides of it."""
    rng = np.random.default_rng(1)
    points = rng.uniform(0, 500, (40, 3))
    lengths = np.linalg.norm(points - [1234.567, -700.4, -200.2], axis=1) - 400 + rng.normal(0, 1e-3, 40)
    with pytest.raises(ValueError, match=r"fit no station within \d\d m. Look for a wrong sign"):
        located(points, -lengths, {})
    points[:, 2] = 0
    lengths = np.linalg.norm(points - [1234.567, -700.4, -200.2], axis=1) + rng.normal(0, 1e-3, 40)
    with pytest.raises(ValueError, match=r"at \[1235, -700, -?200\] and at \[1235, -700, -?200\] mm alike"):
        located(points, lengths, {"dead_path": 0.0})
