"""Measured orientations that do not turn as the commands say are refused, by `fit`, `diagnose` and `import`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from errormodel import read_machine
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.simulation import outward
from identification import diagnose, fit, import_survey
from tests.helpers.surveys import measured

MACHINE = "trunnion_five_axis"
TURNED = ["mrx", "mry", "mrz"]
LEFT_OUT = dict.fromkeys(TURNED, "-")


def recorded(seed: int = 4) -> pd.DataFrame:
    """40 poses of a machine that nobody calibrated (members off by 3 mrad), seen with a target mounted at any angle."""
    machine = read_machine(MACHINE)
    chain = Chain(machine)
    p = np.zeros(len(chain.ids))
    p[[chain.index[f"{shape.name}.ec"] for shape in machine.shapes[:3]]] = 3e-3
    table = outward(measured(machine, p, 40, seed, noise=0.02), machine)
    mount = Rotation.from_rotvec([1.2, -0.9, 2.0])
    scatter = Rotation.from_rotvec(np.random.default_rng(seed).normal(0, 1e-4, (40, 3)))
    turned = scatter * Rotation.from_rotvec(np.array(table[TURNED])) * mount
    table[TURNED] = turned.as_rotvec()
    return table[[*(j.name for j in machine.joints), "mx", "my", "mz", *TURNED]]


def inverse(v: np.ndarray) -> np.ndarray:
    return -v


WRONG = {
    "of the frame in the target": (inverse, "mrx=-mrx,mry=-mry,mrz=-mrz"),
    "two components exchanged": (lambda v: v[:, [1, 0, 2]], "mrx=mry,mry=mrx,mrz=mrz"),
    "one row late": (lambda v: np.roll(v, 1, axis=0), "taken from the row after they lie"),
    "of other rows": (lambda v: np.roll(v, 7, axis=0), "in the frame of the points and with any mount"),
}


def test_right_orientations_pass() -> None:
    assert fit(MACHINE, recorded()).sigma_um > 0


@pytest.mark.long
@pytest.mark.parametrize("what", WRONG)
def test_wrong_orientations_are_refused_with_what_fits(what: str) -> None:
    change, found = WRONG[what]
    table = recorded()
    table[TURNED] = change(table[TURNED].to_numpy())
    with pytest.raises(InputError) as error:
        (diagnose if what == "of other rows" else fit)(MACHINE, table)
    assert found in str(error.value)


def test_an_import_refuses_them_or_leaves_them_out(tmp_path: Path) -> None:
    table = recorded()
    table[TURNED] = np.roll(table[TURNED], 7, axis=0)
    table.to_csv(tmp_path / "table.csv", index=False)
    with pytest.raises(InputError, match="in the frame of the points and with any mount"):
        import_survey(tmp_path / "table.csv", MACHINE)
    result = import_survey(tmp_path / "table.csv", MACHINE, columns=LEFT_OUT)
    assert "mrx" not in result.survey.table
    assert any("columns not used: mrx, mry, mrz" in note for note in result.notes)


def test_what_is_said_instead_is_taken(tmp_path: Path) -> None:
    table = recorded()
    table[TURNED] = -table[TURNED]
    table.to_csv(tmp_path / "table.csv", index=False)
    result = import_survey(tmp_path / "table.csv", MACHINE, columns={k: f"-{k}" for k in TURNED})
    np.testing.assert_allclose(result.survey.table[TURNED], recorded()[TURNED], atol=1e-12)


def test_a_column_that_is_not_there_cannot_be_left_out(tmp_path: Path) -> None:
    recorded().drop(columns=TURNED).to_csv(tmp_path / "table.csv", index=False)
    with pytest.raises(InputError, match="mrx: no such column to leave out"):
        import_survey(tmp_path / "table.csv", MACHINE, columns=LEFT_OUT)
