"""Readings of a bar along a circle that lie off their neighbours: peaks of reversals are usual, others are not."""

from __future__ import annotations

import numpy as np

from identification.importing.trace_proof import Circle, refuse_exchanged

ANGLE = np.radians(np.concatenate([np.arange(0, 360, 2.0), np.arange(358, -2, -2.0)]))
SENSE = np.repeat([1.0, -1.0], 180)


def circle(*wrong: tuple[int, float]) -> Circle:
    """A right circle with 8 um of play in both axes and a peak of 6 um behind each reversal; rows of it changed, mm."""
    play = 4e-3 * SENSE * (np.sign(np.sin(ANGLE + SENSE * 1e-6)) + np.sign(np.cos(ANGLE + SENSE * 1e-6)))
    peak = 6e-3 * np.exp(-np.degrees(np.mod(SENSE * ANGLE, np.pi / 2)) / 1.5)
    length = 100 + 0.03 * np.cos(ANGLE) + play + peak + np.random.default_rng(3).normal(0, 2e-4, len(ANGLE))
    for row, size in wrong:
        length[row] += size
    return Circle(ANGLE, SENSE, length, ())


def test_peaks_beside_reversals_are_usual() -> None:
    assert refuse_exchanged(circle(), "a.csv") == 0


def test_others_are_counted() -> None:
    assert refuse_exchanged(circle((20, 0.005), (200, 0.008)), "a.csv") == 2
    assert refuse_exchanged(circle((46, 0.2)), "a.csv") == 1  # 92 degrees: far more than beside the other reversals
