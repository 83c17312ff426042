"""Orientations on a machine of linear axes: what they show beside the points tells their unit, sense and rows."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from errormodel import read_machine
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from identification import check, diagnose, fit, import_survey
from tests.helpers.surveys import measured

MACHINE = "vertical_three_axis"
TURNED = ["mrx", "mry", "mrz"]
NOISE = 5e-6  # rad
ROWS = 120
ERRORS = {"X.ea.1": 20e-6, "X.eb.1": 20e-6, "Y.ea.1": 30e-6, "Y.ec.1": 15e-6, "X.dx.1": 0.02}  # rad, mm
Change = Callable[[np.ndarray], np.ndarray]


def recorded(change: Change = lambda v: v, seed: int = 3, frame: float = 0.0, size: float = 1.0) -> pd.DataFrame:
    """Poses of a machine with angular errors, in a frame turned about z; orientations as `change` has them."""
    machine = read_machine(MACHINE)
    chain = Chain(machine)
    p = np.zeros(len(chain.ids))
    p[[chain.index[i] for i in ERRORS]] = size * np.array(list(ERRORS.values()))
    table = measured(machine, p, ROWS, seed, noise=0.002, frame=((500.0, 300.0, -200.0), (0.0, 0.0, frame)))
    scatter = Rotation.from_rotvec(np.random.default_rng(seed).normal(0, NOISE, (ROWS, 3)))
    table[TURNED] = change((scatter * Rotation.from_rotvec(np.array(table[TURNED]))).as_rotvec())
    return table[[*(j.name for j in machine.joints), "mx", "my", "mz", *TURNED]]


def named(notes: tuple[str, ...]) -> list[str]:
    return [n for n in notes if "orientation" in n]


@pytest.mark.parametrize("size", [0.0, 1.0])
@pytest.mark.parametrize("seed", [3, 4, 5])
def test_right_orientations_pass_without_a_note(seed: int, size: float) -> None:
    result = fit(MACHINE, recorded(seed=seed, frame=0.7, size=size))
    assert named(result.notes) == []
    line = next(one for one in result.summary().splitlines() if "component of orientation" in one)
    assert float(line.split()[6]) == pytest.approx(1e6 * NOISE, rel=0.15)


WRONG: dict[str, tuple[Change, float, str]] = {
    "degrees": (np.degrees, 0.0, "units: {mrx: deg, mry: deg, mrz: deg} in a survey.yaml"),
    "degrees in a turned frame": (np.degrees, 0.05, "--units mrx=deg,mry=deg,mrz=deg"),
    "mrad": (lambda v: 1e3 * v, 0.0, "--units mrx=mrad,mry=mrad,mrz=mrad"),
    "of the inverse sense": (np.negative, 0.7, "read as mrx=-mrx,mry=-mry,mrz=-mrz"),
    "two exchanged": (lambda v: v[:, [1, 0, 2]], 0.0, "read as mrx=mry,mry=mrx,mrz=mrz"),
    "one row late": (lambda v: np.roll(v, 1, axis=0), 0.7, "taken from the row after"),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_wrong_orientations_are_refused_with_what_fits(what: str) -> None:
    change, frame, found = WRONG[what]
    with pytest.raises(InputError) as error:
        fit(MACHINE, recorded(change, frame=frame))
    assert found in str(error.value)


def test_a_diagnosis_an_import_and_a_check_refuse_them_and_what_is_said_helps(tmp_path: Path) -> None:
    table = recorded(np.degrees)
    table.to_csv(tmp_path / "table.csv", index=False)
    with pytest.raises(InputError, match="read in deg"):
        diagnose(MACHINE, table)
    with pytest.raises(InputError, match="read in deg"):
        check(MACHINE, tmp_path / "table.csv")
    with pytest.raises(InputError, match="read in deg"):
        import_survey(tmp_path / "table.csv", MACHINE)
    right = import_survey(tmp_path / "table.csv", MACHINE, units=dict.fromkeys(TURNED, "deg"))
    np.testing.assert_allclose(right.survey.table[TURNED], recorded()[TURNED], atol=1e-12)


def test_of_smaller_errors_a_note_says_it() -> None:
    (note,) = named(fit(MACHINE, recorded(np.negative, frame=0.7, size=0.12)).notes)
    assert "may be read in a wrong way; read as mrx=-mrx,mry=-mry,mrz=-mrz" in note


def wild(v: np.ndarray) -> np.ndarray:
    v = v.copy()
    v[40, 0] += 3e-3
    return v


def test_a_wild_row_is_said_by_a_fit_and_left_out_by_a_diagnosis() -> None:
    table = recorded(wild)
    (note,) = named(fit(MACHINE, table).notes)
    assert "the orientation of row 41 lies up to" in note
    robust = fit(MACHINE, table, robust=True)
    assert named(robust.notes) == []
    found = diagnose(MACHINE, table)
    (outliers,) = found.diagnosed.diagnosis.findings
    assert (outliers.effect, outliers.rows) == ("outliers", [41])
    assert "urad from what the model with all findings predicts there" in outliers.statement
    (line,) = [one for one in found.summary().splitlines() if one.startswith("noise of one component")]
    assert float(line.split()[6]) == pytest.approx(1e6 * NOISE, rel=0.15)
    assert found.diagnosed.diagnosis.as_json()["orientation_noise_urad"] == pytest.approx(1e6 * NOISE, rel=0.15)


def unseen(v: np.ndarray) -> np.ndarray:
    v = v.copy()
    v[[40, 41]] = 0.0
    return v


def test_zeros_far_from_all_others_are_not_measured() -> None:
    notes = str(fit(MACHINE, recorded(unseen, frame=0.7)).notes)
    assert "0 in mrx mry mrz of 2 rows (41, 42) read as not measured" in notes
    assert "read as not measured" not in str(fit(MACHINE, recorded(unseen)).notes)  # among the others: a measurement


def test_a_rotation_vector_longer_than_a_turn_is_told_the_units(tmp_path: Path) -> None:
    recorded(lambda v: 1e6 * v, frame=0.7).to_csv(tmp_path / "table.csv", index=False)
    with pytest.raises(InputError, match="longer than a turn") as error:
        check(MACHINE, tmp_path / "table.csv")
    assert "--units mrx=deg,mry=deg,mrz=deg with errormodel import" in str(error.value)
    assert "--commands" not in str(error.value)
