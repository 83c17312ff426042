"""Corrected commands beyond what was measured: carried on where geometry is constant, named, and in no claim."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine
from errormodel.simulation import random_points
from identification.compensation.beyond import carried_on, passes, region_words
from identification.estimation.fit import fit_machine
from identification.results.store import save
from tests.helpers.chains import Array, errors
from tests.helpers.commands import MILL, done
from tests.helpers.compensation import field_of, volume_of
from tests.helpers.surveys import measured, positions, rms, survey

UM = 1e-3
pytestmark = pytest.mark.usefixtures("few_poses")


def arm() -> Machine:
    return read_machine("six_axis_arm")


def reached(machine: Machine, p: Array, commands: Array, wanted: Array) -> Array:
    """Errors (n, 3), mm, of the machine at commands (deg), after the rigid motion that fits best."""
    field = field_of(machine, p)
    actual, nominal = field.actual(np.radians(commands), np.ones_like(commands)), field.nominal(np.radians(wanted))
    a, b = actual - actual.mean(axis=0), nominal - nominal.mean(axis=0)
    u, _, v = np.linalg.svd(a.T @ b)
    return np.asarray(a @ u @ v - b)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Machine, Array, Path]:
    """An arm of constant errors of some 0.5 mm, measured over a third of the travels."""
    machine, folder = arm(), tmp_path_factory.mktemp("arm")
    p = errors(Chain(machine), 3, um=200.0, urad=500.0)
    points = random_points(machine, 150, 4)
    points[[j.name for j in machine.joints]] = np.random.default_rng(4).uniform(-2.0, 2.0, (150, 6))
    save(fit_machine(machine, survey(positions(measured(machine, p, points=points, noise=2 * UM)))), folder / "fit")
    return machine, p, folder / "fit"


def test_the_model_of_an_arm_is_carried_on_and_rows_beyond_are_named(
    fitted: tuple[Machine, Array, Path], tmp_path: Path
) -> None:
    machine, p, fit = fitted
    names = [j.name for j in machine.joints]
    q = np.random.default_rng(5).uniform(-110, 110, (60, 6)).round(3)
    q[::5, 2] = np.random.default_rng(6).uniform(150, 175, 12).round(3)
    pd.DataFrame(q, columns=names).to_csv(tmp_path / "p.csv", index=False)
    what = ("--controller", "gcode", "--program", tmp_path / "p.csv", "--allow-large", "--out", tmp_path / "o")
    done("compensate", fit, *what)
    made = pd.read_csv(tmp_path / "o/p.csv")[names].to_numpy()
    assert rms(reached(machine, p, q, q)) > 300
    assert rms(reached(machine, p, made, q)) < 10  # 2 um of noise on 150 rows; held at the edge 152
    found = json.loads((tmp_path / "o/compensation.json").read_text())
    (beyond,) = [x for x in found["first"] if "beyond what was measured" in x]
    assert "12 of the 60 rows of p.csv lie beyond what was measured of J3" in beyond
    assert f"(row {int(np.argmax(q[:, 2])) + 1})" in beyond
    assert "no figure here is of such places" in beyond
    assert not [x for x in found["first"] if "the correction steps" in x], "no joint of an arm begins a new turn"
    assert "12 rows leave the measured region (first row 1)" in " ".join(found["sets"][0]["notes"])
    told = " ".join((tmp_path / "o/checklist.txt").read_text().split())
    assert "carried on along J1, J2, J3, J4, J5, J6, on which no error depends" in told


def test_rows_within_what_was_measured_are_no_matter(fitted: tuple[Machine, Array, Path], tmp_path: Path) -> None:
    machine, _, fit = fitted
    q = np.random.default_rng(5).uniform(-110, 110, (9, 6)).round(3)
    pd.DataFrame(q, columns=[j.name for j in machine.joints]).to_csv(tmp_path / "p.csv", index=False)
    what = ("--controller", "gcode", "--program", tmp_path / "p.csv", "--allow-large", "--out", tmp_path / "o")
    done("compensate", fit, *what)
    found = json.loads((tmp_path / "o/compensation.json").read_text())
    assert not [x for x in found["first"] if "beyond" in x or "steps" in x]
    assert not found["sets"][0]["notes"]


def test_how_far_follows_from_what_errors_depend_on() -> None:
    machine = replace(arm(), effects=(EffectSpec("eccentricity", {"joint": "J2"}),))
    p = np.zeros(len(Chain(machine).ids))
    volume = carried_on(volume_of(machine, p, (0.25, 0.75)))
    low, high = np.degrees(volume.ends)
    np.testing.assert_allclose([low[1], high[1]], [-180 - 36, 180 + 36])
    assert np.isinf(np.delete(high, 1)).all()
    words = region_words(volume)
    assert "along J1, J3, J4, J5, J6, on which no error depends, and along J2 by 10% of its range; else" in words
    both = np.radians(np.array([[0.0] * 6, [0.0, 230, 0, 0, 0, 300], [0.0, -230, 0, 0, 0, -300]]))
    assert passes(volume, both).tolist() == [False, True, False, False, False, False]
    assert not passes(volume, both[:2]).any()


def test_error_motions_of_a_slide_are_held_at_the_edge() -> None:
    machine = read_machine(MILL)
    volume = volume_of(machine, errors(Chain(machine), 1), (0.25, 0.75))
    np.testing.assert_allclose(carried_on(volume).ends, volume.ends)
    assert region_words(carried_on(volume)) == "beyond it the correction of its edge is held"
