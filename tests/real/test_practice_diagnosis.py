"""Recordings with a concealed effect: is it found, named and placed, and do predictions gain what they can?"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.effects import make
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from errormodel.survey import read_survey
from identification.diagnosis.pipeline import diagnose
from identification.diagnosis.results.diagnosed import Diagnosed
from identification.results import store
from identification.uncertainty.prediction import predict

CASES = [pytest.param(f"case_{number:02d}", marks=[] if number == 9 else [pytest.mark.long]) for number in range(1, 25)]
SHARE = 0.10  # of what a fit that knows the effect's true form gains, what may be missing from ours


def heldout_rms(result: Diagnosed, case: Path, folder: Path) -> float:
    """3-D root mean square (um) of predictions, by the saved and read back model, at the later poses."""
    store.save(result.final, folder)
    stored = store.load(folder)
    points = read_survey(case / "heldout.csv", stored.chain.machine, measured=False)
    wanted = pd.read_csv(case / "heldout_truth.csv").to_numpy()
    found = predict(stored, points)[["mx", "my", "mz"]].to_numpy()
    return float(1e3 * np.sqrt(np.mean(np.sum((found - wanted) ** 2, axis=1))))


@pytest.mark.parametrize("name", CASES)
def test_practice_recording(practice_data: Path, tmp_path: Path, name: str) -> None:
    case = practice_data / name
    truth = json.loads((case / "truth.json").read_text())
    machine = read_machine(case / "machine.yaml")
    result = diagnose(machine, read_survey(case / "survey.csv", machine))
    found = [(f.effect, f.where) for f in result.diagnosis.findings]
    explained = set()
    for effect in truth["effects"]:
        hits = [f for f in found if f[0] in effect["accept"]]
        assert hits, f"{effect['effect']} was not named: {found}"
        assert any(where in effect["where"] for _, where in hits), f"{effect['effect']} was not placed: {found}"
        explained |= set(hits)
    assert set(found) <= explained, "a finding that the recording does not hold"
    assert result.diagnosis.verdict == ("explained" if truth["effects"] else "adequate")
    rms = heldout_rms(result, case, tmp_path)
    base, oracle = truth["base_heldout_um"], truth["oracle_heldout_um"]
    assert rms < 1.02 * base, "worse than the fit without effects"
    if base > 1.01 * oracle:
        assert rms - oracle < SHARE * (base - oracle)


@pytest.mark.long
def test_extended_machine_gives_the_effect_back(practice_data: Path, tmp_path: Path) -> None:
    """What is written to machine.yaml is the effect that was found, and fitting it again finds the same size."""
    case = practice_data / "case_08"
    machine = read_machine(case / "machine.yaml")
    survey = read_survey(case / "survey.csv", machine)
    result = diagnose(machine, survey)
    store.save(result.final, tmp_path)
    again = read_machine(tmp_path / "machine.yaml")
    assert [make(spec).effect for spec in again.effects] == ["backlash"]
    by_hand = replace(machine, effects=(EffectSpec("backlash", {"joint": "Z"}),))
    assert again.effects == by_hand.effects
    (amount,) = result.diagnosis.findings[0].parameters
    assert amount.name == "Z.dz.backlash"
    assert abs(amount.value - 0.0201) < 2 * amount.std
