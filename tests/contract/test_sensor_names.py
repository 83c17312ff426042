"""Sensors have the names that people give them: brackets, commas, blanks, any alphabet."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from errormodel import channels as features
from errormodel.chain import Chain
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import machine_text, read_machine, resolve
from errormodel.simulation import measured_at, random_points
from errormodel.survey import read_survey
from errormodel.truth import Truth
from errormodel.yamlfile import parse
from identification.results.description import describe
from tests.helpers.commands import MILL, XYZ, done

ODD = ("T_bed(1)", "T_bed, left", "T_Öl (vorne), 2 – lag(T_x,5)", "T_a − b")
SENSORS = (
    st.text(
        st.characters(codec="utf-8", exclude_categories=["C", "Z"]) | st.sampled_from(" (),;'\"−$#:{}[]"), min_size=1
    )
    .map(lambda text: "T_" + " ".join(text.split()))
    .filter(lambda name: len(name) > 2)
)


def drifting(name: str) -> Machine:
    machine = read_machine(MILL)
    options = {"element": machine.shapes[0].name, "motion": "dx", "sensor": name, "tau": 900.0}
    return replace(machine, effects=(EffectSpec("structure-drift", options),))


@given(name=SENSORS, tau=st.floats(1, 1e6))
def test_a_lagged_sensor_is_that_sensor(name: str, tau: float) -> None:
    table = pd.DataFrame({name: [20.0, 21.0, 23.0], "time": [0.0, 60.0, 120.0]})
    call = f"lag({name},{tau:.6g})"
    assert features.root(call) == name
    np.testing.assert_array_equal(features.channel(table, call), features.lag(table, name, float(f"{tau:.6g}")))


@pytest.mark.long
@given(name=SENSORS)
def test_any_name_survives_the_machines_file_and_a_description(name: str) -> None:
    machine = drifting(name)
    again = resolve(parse(machine_text(machine), "machine.yaml"))
    assert again.effects == machine.effects
    assert f"lag({name},900)" in Chain(again).channels


@pytest.mark.parametrize("name", ODD)
def test_described_by_random_poses(name: str) -> None:
    assert any("structure-drift" in i for i in describe(drifting(name)).chain.ids)


@settings(max_examples=50)
@given(name=SENSORS)
def test_any_name_is_read_from_a_table(name: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("names") / "s.csv"
    machine = read_machine(MILL)
    random_points(machine, 4).assign(time=[0.0, 1, 2, 3], **{name: 20.5}).to_csv(path, index=False)
    assert read_survey(path, machine, measured=False).table[name].eq(20.5).all()


@pytest.mark.long
@pytest.mark.parametrize("name", [ODD[1], ODD[3]])
def test_a_lagged_drift_is_found_and_used(name: str, tmp_path: Path) -> None:
    """A member that follows a sensor late: found, written into machine.yaml, fitted again, predicted, compensated."""
    machine, rows = drifting(name), 200
    chain, time = Chain(machine), 60.0 * np.arange(rows)
    warm = 20 + 3 * np.sin(time / 2400) + 2 * (time > 4000)
    points = random_points(machine, rows, 1).assign(time=time, run="1", **{name: warm.round(3)})
    drift = next(i for i in chain.ids if "structure-drift" in i)
    points[XYZ] = measured_at(machine, points, Truth({drift: 0.02}), 0.002)[XYZ]
    points.to_csv(tmp_path / "s.csv", index=False)
    result = done("diagnose", MILL, tmp_path / "s.csv", "--out", tmp_path / "out")
    assert f"driven by {name} behind a lag" in result.out
    done("fit", tmp_path / "out", tmp_path / "s.csv", "--out", tmp_path / "fit")
    done("predict", tmp_path / "fit", tmp_path / "s.csv", "--out", tmp_path / "p.csv")
    gap = (pd.read_csv(tmp_path / "p.csv")[XYZ] - points[XYZ]).to_numpy()
    assert np.sqrt((gap**2).mean()) < 0.0025  # mm; of the noise 0.002
