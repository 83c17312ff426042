"""Positioning and diagonals from lengths along a line, as an interferometer reads them, by the formulas."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import read_machine
from errormodel.exceptions import InputError
from errormodel.observations.base import Observation
from identification import fit, iso
from identification.iso_standards.base import Quantity
from tests.helpers.lengths import entry, survey

MILL = "vertical_three_axis"
MACHINE = read_machine(MILL)
RUNS = 5
CORNERS = {"+X+Y+Z": (1, 1, 1), "-X+Y+Z": (-1, 1, 1), "+X+Y": (1, 1, 0), "X": (1, 0, 0)}
MIDDLE, HALF = np.array([0.0, 0.0, 300.0]), np.array([300.0, 150.0, 200.0])


def figures(up: np.ndarray, down: np.ndarray) -> dict[str, float]:
    """E, M, R, B, A of deviations (targets, runs) by the formulas of ISO 230-2:2014, clause 3."""
    mean = [up.mean(axis=1), down.mean(axis=1)]
    s = [np.sqrt(np.sum((v - v.mean(axis=1)[:, None]) ** 2, axis=1) / (RUNS - 1)) for v in (up, down)]
    reversal = mean[0] - mean[1]
    high, low = [m + 2 * t for m, t in zip(mean, s, strict=True)], [m - 2 * t for m, t in zip(mean, s, strict=True)]
    return {
        "E": np.max(mean) - np.min(mean), "B": np.abs(reversal).max(), "A": np.max(high) - np.min(low),
        "R": float(np.max([2 * s[0] + 2 * s[1] + np.abs(reversal), 4 * s[0], 4 * s[1]])),
    }  # fmt: skip


def recorded(backwards: bool = False) -> tuple[pd.DataFrame, dict[str, dict[str, float]]]:
    """Displacements along each line, from its first target on, and what the standard says of them.

    backwards : whether the beam comes from the far end, so that lengths shrink.
    """
    rng = np.random.default_rng(2)
    share = np.array([0.02, 0.21, 0.38, 0.63, 0.8, 0.97])
    rows, found = [], {}
    for n, (name, sign) in enumerate(CORNERS.items()):
        start, along = MIDDLE - HALF * sign, 2 * HALF * np.array(sign)
        length = float(np.linalg.norm(along))
        q = start + share[:, None] * along
        ways = {1: [], -1: []}
        for _ in range(RUNS):
            for side in (1, -1):
                error = 1e-5 * length * share + 0.002 * np.sin(5 * share) - 0.0015 * side + 4e-4 * rng.normal(size=6)
                ways[side].append(error)
                for k in range(6)[::side]:
                    moved = length * (share[k] - share[0]) + error[k]
                    reading = 2 * length - moved if backwards else 7.0 + moved
                    place = {a: q[k][i] for i, a in enumerate("XYZ")} | {
                        f"from_{a}": q[0][i] for i, a in enumerate("XYZ")
                    }
                    rows.append({**place, "run": f"{n}", "observation": "beam", "length": reading})
        found[name] = figures(np.array(ways[1]).T, np.array(ways[-1]).T)
    return pd.DataFrame(rows), found


def evaluated(standard: str, table: pd.DataFrame, of: Observation) -> dict[str, Quantity]:
    result = iso(standard, MILL, replace(survey(MACHINE, table, {"beam": of}), source=Path("s")))
    assert any("beam is held to lie along it" in note for note in result.notes)
    return {q.name: q for q in result.evaluations[0].quantities}


@pytest.mark.parametrize("backwards", [False, True])
def test_a_beam_along_diagonals_gives_the_figures_of_the_standard(backwards: bool) -> None:
    table, expected = recorded(backwards)
    of = entry(type="station-distance", station="per-run", dead_path="per-run", sigma=4e-4)
    found = evaluated("230-6", table.drop(columns=["from_X", "from_Y", "from_Z"]), of)
    for name in ("+X+Y+Z", "-X+Y+Z", "+X+Y"):
        for symbol, value in expected[name].items():
            assert found[f"{name}.{symbol}"].value == pytest.approx(value, abs=1e-9), f"{name}.{symbol}"
        # standard deviations are in A as they are in R: (4 + 2 / n) times the square of U of a reading
        known = [found[f"{name}.{symbol}"].expanded for symbol in "AR"]
        assert known == pytest.approx([np.sqrt(4 + 2 / RUNS) * 2 * 4e-4] * 2)
    assert found["E body"].value == pytest.approx(max(expected[n]["E"] for n in ("+X+Y+Z", "-X+Y+Z")), abs=1e-9)


def test_distances_from_the_first_target_do_too() -> None:
    table, expected = recorded()
    found = evaluated("230-6", table, entry(type="pose-distance", offset="unknown", sigma=4e-4))
    assert found["+X+Y+Z.R"].value == pytest.approx(expected["+X+Y+Z"]["R"], abs=1e-9)
    found = evaluated("230-2", table, entry(type="pose-distance", offset="unknown", sigma=4e-4))
    for symbol, value in expected["X"].items():
        assert found[f"X.{symbol}"].value == pytest.approx(value, abs=1e-9), symbol


def test_a_beam_that_lies_across_is_no_displacement() -> None:
    """A station beside the line: its lengths differ by the cosine of the angle."""
    table, _ = recorded()
    point = table[["X", "Y", "Z"]].to_numpy()
    table["length"] = np.linalg.norm(point - [-900.0, 400.0, 200.0], axis=1)
    of = entry(type="station-distance", station="per-run", dead_path="per-run", sigma=4e-4)
    with pytest.raises(InputError, match="no rows lie on a diagonal"):
        evaluated("230-6", table.drop(columns=["from_X", "from_Y", "from_Z"]), of)


def test_the_first_reading_of_a_row_of_displacements_is_no_length_without_derivative() -> None:
    """From a pose to itself: the fit found nothing that could be identified, since its rows were not numbers."""
    table, _ = recorded()
    table["length"] -= 7.0
    result = fit(MILL, survey(MACHINE, table, {"beam": entry(type="pose-distance", sigma=4e-4)}))
    assert result.parameters.loc["X.dx.1", "std"] > 0
