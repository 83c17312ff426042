"""Witness channels: one that stands on the member supports a finding there or brings it down; others say nothing."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine
from errormodel.simulation import random_points
from errormodel.survey import Survey
from identification.diagnosis.pipeline import diagnose
from identification.diagnosis.results.findings import Finding
from identification.diagnosis.results.witnesses import WitnessResult, with_witnesses, witnesses
from tests.helpers.chains import errors
from tests.helpers.surveys import measured, positions
from tests.helpers.surveys import survey as survey_of

ROWS, NOISE = 240, 0.002
BACKLASH = 0.02  # mm


def test_names_say_what_is_seen() -> None:
    machine = read_machine("trunnion_five_axis")
    names = ["w_encoder_X", "w_level_Y_urad", "w_A_dz_um", "w_scale_C_arcsec", "w_humidity", "w_current_X", "w_level"]
    seen = {w.name: w for w in witnesses(machine, names)}
    assert set(seen) == set(names[:4])
    assert (seen["w_encoder_X"].motions, seen["w_encoder_X"].scale) == (("dx",), 1.0)
    assert seen["w_level_Y_urad"].scale == pytest.approx(1e-6)
    assert (seen["w_A_dz_um"].element, seen["w_A_dz_um"].motions) == ("A", ("dz",))
    assert seen["w_A_dz_um"].scale == pytest.approx(1e-3)
    assert (seen["w_scale_C_arcsec"].motions, seen["w_scale_C_arcsec"].encoder) == (("ec",), True)


def test_who_goes_along_raises_the_odds() -> None:
    along = WitnessResult("w_a", "supports", 1.0, 0.1)
    assert with_witnesses(0.6, []) == pytest.approx(0.6)
    assert with_witnesses(0.6, [replace(along, word="contradicts")]) == pytest.approx(0.6)
    assert 0.9 < with_witnesses(0.6, [along]) < with_witnesses(0.6, [along, along]) < 1


@cache
def reversing() -> tuple[Machine, Survey, Array]:
    """A bridge whose X has backlash, and the side of arrival of X, (n,)."""
    machine = read_machine("bridge_cmm")
    rng = np.random.default_rng(4)
    side = rng.choice([-1.0, 1.0], ROWS)
    points = random_points(machine, ROWS, 3).assign(
        **{f"dir_{j.name}": rng.choice([-1.0, 1.0], ROWS) for j in machine.joints}
    )
    points["dir_X"] = side
    real = replace(machine, effects=(EffectSpec("backlash", {"joint": "X"}),))
    chain = Chain(real)
    p = errors(Chain(machine))
    values = dict(zip(Chain(machine).ids, p.tolist(), strict=True)) | {"X.dx.backlash": BACKLASH}
    table = positions(measured(real, chain.vector(values), noise=NOISE, points=points))
    return machine, survey_of(table), side


@cache
def unwitnessed() -> Finding:
    return diagnosed()


def diagnosed(**channels: Array) -> Finding:
    machine, survey, _ = reversing()
    (found,) = diagnose(machine, replace(survey, table=survey.table.assign(**channels))).diagnosis.findings
    return found


def noise(size: float, seed: int = 8) -> Array:
    return np.random.default_rng(seed).normal(0, size, ROWS)


def test_an_encoder_that_goes_along_supports() -> None:
    _, survey, side = reversing()
    reading = survey.table["X"].to_numpy() + BACKLASH / 2 * side + noise(0.001)
    found = diagnosed(w_encoder_X=reading)
    assert (found.effect, found.where) == ("backlash", "X")
    assert "w_encoder_X shows it too" in found.statement
    assert found.probability > unwitnessed().probability


def test_an_encoder_that_stays_brings_the_name_down() -> None:
    _, survey, _ = reversing()
    found = diagnosed(w_encoder_X_um=1e3 * (survey.table["X"].to_numpy() + noise(0.001)))
    assert (found.effect, found.where) != ("backlash", "X")
    assert "w_encoder_X_um does not show what backlash of X would do" in found.statement


@pytest.mark.long
@pytest.mark.parametrize("name", ["w_encoder_Y", "w_level_X", "w_humidity", "w_current_X"])
def test_who_does_not_stand_there_says_nothing(name: str) -> None:
    found = diagnosed(**{name: noise(1e-6)})
    assert (found.effect, found.where) == ("backlash", "X")
    assert "w_" not in found.statement


def test_a_coarse_witness_says_nothing() -> None:
    found = diagnosed(w_encoder_X=noise(0.2))
    assert (found.effect, found.where) == ("backlash", "X")
    assert "w_" not in found.statement
