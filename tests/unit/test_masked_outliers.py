"""Gross rows that pull a least-squares fit of few rows so far that none of them stands out."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import Machine, Survey, read_machine, read_survey
from identification.diagnosis.data_checks.outliers import gross_rows, masked_rows
from identification.diagnosis.pipeline import diagnose
from identification.estimation.fit import Fit, fit_machine
from tests.helpers.commands import XYZ, write

NOISE = 0.003  # mm
MACHINE = """\
errormodel: 1
chain:
  - {joint: X, type: prismatic, axis: x, travel: [-300, 300]}
  - {shape: a}
  - {joint: Y, type: prismatic, axis: y, travel: [-200, 200]}
  - {shape: b}
  - {joint: Z, type: prismatic, axis: z, travel: [-200, 200]}
tool: [0, 0, -150]
errors: {shapes: all, joints: {X: {polynomial: 3}, Y: {polynomial: 3}, Z: {polynomial: 3}}}
"""


def recorded(place: Path, seed: int, broken: list[int]) -> tuple[Machine, Survey]:
    rng = np.random.default_rng(seed)
    commands = (rng.random((60, 3)) - 0.5) * [600, 400, 400]
    noise = NOISE * rng.standard_normal(commands.shape)
    noise[broken] += 100 * NOISE * rng.standard_normal((len(broken), 3))
    table = np.hstack([commands, commands + np.array([0, 0, -150]) + noise])
    pd.DataFrame(table, columns=["X", "Y", "Z", *XYZ]).to_csv(place / "s.csv", index=False)
    machine = read_machine(write(place / "m.yaml", MACHINE))
    return machine, read_survey(place / "s.csv", machine)


@pytest.mark.parametrize("seed", [2, 3])
def test_rows_that_hide_one_another_are_found(seed: int, tmp_path: Path) -> None:
    broken = [4, 17, 30]
    machine, survey = recorded(tmp_path, seed, broken)
    fit = fit_machine(machine, survey)
    assert not gross_rows(fit).any()
    found = masked_rows(fit, partial(fit_machine, machine, survey, robust=True))
    assert np.flatnonzero(found).tolist() == broken


@pytest.mark.parametrize("seed", [2, 3])
def test_sound_rows_are_left_alone(seed: int, tmp_path: Path) -> None:
    machine, survey = recorded(tmp_path, seed, [])
    asked: list[Fit] = []

    def robust() -> Fit:
        asked.append(fit_machine(machine, survey, robust=True))
        return asked[-1]

    assert not masked_rows(fit_machine(machine, survey), robust).any()


@pytest.mark.long
def test_rows_that_are_only_eight_times_the_noise_are_found_at_last(tmp_path: Path) -> None:
    """They are no gross rows at first, when they may be physics; once nothing explains them they are left out."""
    rng = np.random.default_rng(11)
    commands = (rng.random((300, 3)) - 0.5) * [600, 400, 400]
    noise = NOISE * rng.standard_normal(commands.shape)
    broken = [20, 77, 140, 201, 260]
    noise[broken] += NOISE * np.array([[7, 3, -3], [-6, 5, 2], [2, -8, 1], [4, 4, 6], [-2, 7, 4]])
    table = np.hstack([commands, commands + np.array([0, 0, -150]) + noise])
    pd.DataFrame(table, columns=["X", "Y", "Z", *XYZ]).to_csv(tmp_path / "s.csv", index=False)
    machine = read_machine(write(tmp_path / "m.yaml", MACHINE))
    survey = read_survey(tmp_path / "s.csv", machine)
    assert not gross_rows(fit_machine(machine, survey)).any()
    (finding,) = diagnose(machine, survey).diagnosis.findings
    assert (finding.effect, finding.rows) == ("outliers", [row + 1 for row in broken])


def test_rows_of_another_uncertainty_are_no_tail(tmp_path: Path) -> None:
    """Half of the rows are six times less certain, as stated: a wrong one among the others is found all the same."""
    rng = np.random.default_rng(5)
    commands = (rng.random((300, 3)) - 0.5) * [600, 400, 400]
    sigma = np.where(np.arange(300) % 2 == 0, NOISE, 6 * NOISE)
    noise = sigma[:, None] * rng.standard_normal(commands.shape)
    broken = [20, 140, 260]  # as far as the less certain ones often are
    noise[broken] += NOISE * np.array([[9, 7, -8], [-8, 9, 7], [7, -8, 9]])
    table = np.hstack([commands, commands + np.array([0, 0, -150]) + noise, sigma[:, None]])
    pd.DataFrame(table, columns=["X", "Y", "Z", *XYZ, "sigma"]).to_csv(tmp_path / "s.csv", index=False)
    machine = read_machine(write(tmp_path / "m.yaml", MACHINE))
    fit = fit_machine(machine, read_survey(tmp_path / "s.csv", machine))
    assert np.flatnonzero(gross_rows(fit)).tolist() == broken
