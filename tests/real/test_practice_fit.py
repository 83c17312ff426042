"""The practice recordings: a plain fit is as good as the model of the machine allows, no better and no worse.

Each comes with the noise that was put in, the error of a reference fit of the same model at poses it has not seen, and
exact positions there. What the model lacks in most of them is for `diagnose`; here it only has to stay where it is.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from errormodel.machine_file import read_machine
from errormodel.survey import read_survey
from identification.estimation.fit import fit_machine
from identification.results import store
from identification.uncertainty.prediction import predict
from tests.helpers.nightly import first_of

CASES = [f"case_{k:02}" for k in range(1, 25)]
OUTLIERS, BLUNDER = "case_22", "case_23"
NULL = ("case_05", "case_12", "case_19")


@dataclass(frozen=True)
class Outcome:
    truth: dict[str, Any]
    sigma_mm: float
    errors: np.ndarray  # (n, 3) predicted minus true, mm
    u: np.ndarray  # (n, 3) standard uncertainty, mm
    notes: tuple[str, ...]

    @property
    def rms_um(self) -> float:
        return 1e3 * float(np.sqrt((self.errors**2).sum(axis=1).mean()))

    @property
    def inside(self) -> float:
        return float((np.abs(self.errors) < 2 * self.u).mean())


@cache
def outcome(case: Path, scratch: Path) -> Outcome:
    """What a fit that went through its files predicts at the held-out commands."""
    machine = read_machine(case)
    survey = read_survey(case / "survey.csv", machine)
    fit = fit_machine(machine, survey)
    store.save(fit, scratch / case.name)
    stored = store.load(scratch / case.name)
    commands = read_survey(case / "heldout.csv", stored.chain.machine, measured=False)
    table = predict(stored, commands)
    truth = pd.read_csv(case / "heldout_truth.csv")
    errors = (table[["mx", "my", "mz"]] - truth[["mx", "my", "mz"]]).to_numpy()
    facts = json.loads((case / "truth.json").read_text())
    return Outcome(facts, fit.sigma_mm, errors, table[["ux", "uy", "uz"]].to_numpy(), survey.notes)


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fits")


@pytest.mark.parametrize("name", first_of([c for c in CASES if c not in (OUTLIERS, BLUNDER)], 2))
def test_held_out_poses_are_predicted_as_well_as_the_model_can(name: str, practice_data: Path, scratch: Path) -> None:
    """Where the truth is in the model, the error is noise's and may be less than the reference's few tenths of a um."""
    found = outcome(practice_data / name, scratch)
    ratio = found.rms_um / found.truth["base_heldout_um"]
    assert ratio < 1.02
    assert ratio > (0.9 if found.truth["null"] else 0.98)


def test_outliers_spoil_a_plain_fit(practice_data: Path, scratch: Path) -> None:
    """The reference figure is that of a fit without the ten wild rows; least squares takes them at their word."""
    found = outcome(practice_data / OUTLIERS, scratch)
    assert found.truth["base_heldout_um"] < found.rms_um < 2.5
    assert found.sigma_mm > 3 * found.truth["sigma_mm"]


def test_a_wrong_sign_of_a_column_is_noted_before_anything_is_fitted(practice_data: Path, scratch: Path) -> None:
    """The reference figure is that of the corrected column; as it stands no fit can make sense of it, and says so."""
    found = outcome(practice_data / BLUNDER, scratch)
    assert any("outside the travel of B" in note for note in found.notes)
    assert found.rms_um > 1e5
    assert found.sigma_mm > 1


def test_recordings_that_hold_nothing_show_their_noise_and_keep_their_promises(
    practice_data: Path, scratch: Path
) -> None:
    found = [outcome(practice_data / name, scratch) for name in NULL]
    assert all(o.truth["null"] for o in found)
    for one in found:
        assert abs(one.sigma_mm / one.truth["sigma_mm"] - 1) < 0.08
        assert one.inside > 0.9  # the errors of one fit at many poses are not independent
    assert 0.93 < np.mean([o.inside for o in found]) < 0.985
