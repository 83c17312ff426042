"""What a refusal of an import says to write can be written, and then the import goes on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import InputError, read_machine, read_survey, simulate
from identification import check, import_survey
from tests.helpers.commands import XYZ
from tests.helpers.importing import MILL, poses

ARM = "six_axis_arm"
AXES = ["J1", "J2", "J3", "J4", "J5", "J6"]


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    return simulate(ARM, 80, noise=0.01, seed=2)[[*AXES, *XYZ]]


def refused(table: pd.DataFrame, folder: Path) -> str:
    """The cure in the refusal of a table."""
    table.to_csv(folder / "arm.csv", index=False)
    with pytest.raises(InputError) as error:
        import_survey(folder / "arm.csv", ARM)
    return error.value.cure


def test_a_sign_in_some_rows_is_left_out_by_their_numbers(table: pd.DataFrame, tmp_path: Path) -> None:
    wrong = table.copy()
    wrong.loc[50:79, "J3"] *= -1
    assert "leave them out: `errormodel import` --leave-out 51-80" in refused(wrong, tmp_path)
    assert len(import_survey(tmp_path / "arm.csv", ARM, leave_out=["51-80"]).survey) == 50


def test_one_joint_in_radians_is_named(table: pd.DataFrame, tmp_path: Path) -> None:
    cure = refused(table.assign(J4=np.radians(table["J4"])), tmp_path)
    assert "--units J4=rad" in cure
    assert "angle=rad" not in cure
    import_survey(tmp_path / "arm.csv", ARM, units={"J4": "rad"})
    assert "--units angle=rad" in refused(table.assign(**{n: np.radians(table[n]) for n in AXES}), tmp_path)


def test_copies_are_named_as_they_are_left_out(table: pd.DataFrame, tmp_path: Path) -> None:
    assert "`errormodel import` --leave-out 81" in refused(pd.concat([table, table.iloc[[10]]]), tmp_path)
    import_survey(tmp_path / "arm.csv", ARM, leave_out=["81"])


@pytest.mark.parametrize("above", ["# probing; cell 3; 20,1 degC\n", "# a\n#b;c\n\n", ""])
def test_comments_above_a_header_are_passed_over(above: str, tmp_path: Path) -> None:
    commands = simulate(MILL, poses(1, 20), noise=0.002, seed=1)[["X", "Y", "Z", *XYZ]]
    path = tmp_path / "t.csv"
    path.write_text(above + commands.to_csv(index=False, sep=";", decimal=","))
    pd.testing.assert_frame_equal(
        read_survey(path, read_machine(MILL)).table[["X", *XYZ]], commands[["X", *XYZ]], atol=1e-9
    )


def test_a_header_may_begin_as_a_comment_does(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("#;X;Y;Z;mx;my;mz\n" + "\n".join(f"{k};{k};{2 * k};{k**2};1;2;{k}" for k in range(9)))
    assert len(read_survey(path, read_machine(MILL))) == 9


def test_probed_positions_alone_are_told_what_they_lack(tmp_path: Path) -> None:
    path = tmp_path / "ball.csv"
    found = poses(1, 20).assign(T_bed=20.0, time=np.arange(20.0))
    found.to_csv(path, index=False)
    with pytest.raises(InputError, match="channels of a log") as error:
        import_survey(path, MILL)
    assert "columns mx my mz with its place" in error.value.cure
    here = np.array([10.0, 20.0, 30.0]) + np.random.default_rng(1).normal(0, 0.005, (20, 3))
    found.assign(**dict(zip("XYZ", here.T, strict=True)), mx=0.0, my=0.0, mz=0.0).to_csv(path, index=False)
    check(MILL, path)
