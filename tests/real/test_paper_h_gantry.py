"""The H-gantry thesis: its raw tables make its error motions and Table 11, and its recordings survive every command.

J. G. Anaya Aranda, "Design of a model for multi axis measuring machines to analyze error positioning in Gantry
systems", Tecnologico de Monterrey, 2019. Here Eqs. 9 to 16 stand as printed, in 4 x 4 matrices; the notebook has them
otherwise.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.machine_file import read_machine
from errormodel.simulation import measured_at
from errormodel.truth import Truth
from tests.helpers.commands import run

FOLDER = Path(__file__).resolve().parents[2] / "machines" / "examples" / "h_gantry"
MACHINE = "h_gantry_dual_drive"
PRINTED = pd.read_csv(FOLDER / "tables_4_to_12.csv", index_col="point")
ARM = pd.read_csv(FOLDER / "table_8_and_appendix.csv", index_col="point")
TILT = 0.0013302318  # rad, the plate's, as printed
USED = 0.00070622809  # as Table 11 has it
REACH = 150.0  # mm, from the plate to the laser's spot (Table 3)
LEVER = (-38.64, -19.798, -83.283)  # mm (Eq. 16)
TABLE_11 = PRINTED[["x_um", "y_um", "z_um"]].to_numpy()


def signed_ey() -> np.ndarray:
    """Eq. 14 with its sign, over the distance along x of the two touched points, rad."""
    rows = ARM.loc[1:]
    return ((rows["right_z"] - rows["left_z"]) / (rows["right_x"] - rows["left_x"])).to_numpy()


def frame(turn: tuple[float, float, float], move: tuple[float, float, float]) -> np.ndarray:
    """Eq. 6: a frame with small angles."""
    ex, ey, ez = turn
    return np.array([[1, -ez, ey, move[0]], [ez, 1, -ex, move[1]], [-ey, ex, 1, move[2]], [0, 0, 0, 1]])


def table_11(tilt: float = USED, first: float = 0.01, point_15: float = 58.0, sign: float = -1.0) -> np.ndarray:
    """T1 T2 P minus P_ideal with the stated choices, (18, 3) um."""
    step = (PRINTED["motor_a_um"] - PRINTED["motor_b_um"]).to_numpy(dtype=float)
    step[14] = point_15
    ideal = np.array([*LEVER[:2], LEVER[2] - REACH])
    out = []
    for k, ey in enumerate(signed_ey()):
        turn = (np.radians(PRINTED["orientation_deg"].iloc[k] - first), ey, step[k] / 830e3)
        t1 = frame(turn, (1e-3, step[k] / 2e3, PRINTED["dz_mm"].iloc[k]))
        t2 = frame((tilt, 0.0, 0.0), LEVER)
        out.append(sign * 1e3 * ((t1 @ t2 @ [0, 0, -REACH, 1])[:3] - ideal))
    return np.array(out)


def test_table_6_follows_from_the_encoders() -> None:
    step = PRINTED["motor_a_um"] - PRINTED["motor_b_um"]
    assert (PRINTED["dy_um"] == step / 2).all()
    assert [f"{v:.6g}" for v in step / 830e3] == [f"{v:.6g}" for v in PRINTED["ez_rad"]]


def test_table_8_drops_the_sign_and_takes_the_touched_distance() -> None:
    rows = ARM.loc[1:]
    assert [f"{v:.5g}" for v in np.abs(signed_ey())] == [f"{v:.5g}" for v in rows["ey_rad"]]
    with_830 = (rows["right_z"] - rows["left_z"]).abs() / 830
    assert sum(f"{a:.5g}" == f"{b:.5g}" for a, b in zip(with_830, rows["ey_rad"], strict=True)) == 0


def test_table_9_is_the_step_from_the_point_before() -> None:
    assert np.allclose(PRINTED["tip_z_mm"].diff().iloc[1:], PRINTED["dz_mm"].iloc[1:], atol=1e-9)
    assert PRINTED["tip_z_mm"].iloc[-1] - PRINTED["tip_z_mm"].iloc[0] == pytest.approx(-0.216)


def test_table_11_comes_out_to_its_printed_digits() -> None:
    """It prints ten characters a number, sign and point among them: so many decimals, each within half of the last."""
    for ours, printed in zip(table_11().ravel(), TABLE_11.ravel(), strict=True):
        decimals = 10 - len(f"{printed:.0f}.") if abs(printed) >= 1 else 8
        assert abs(ours - printed) <= 0.5001 * 10.0**-decimals, printed


@pytest.mark.parametrize(
    ("choice", "columns", "least_um"),
    [
        ({"tilt": TILT}, "y", 90.0),
        ({"first": 0.0}, "yz", 3.0),
        ({"point_15": 56.0}, "xy", 0.04),
        ({"sign": 1.0}, "xyz", 40.0),
    ],
)
def test_each_choice_is_needed(choice: dict[str, float], columns: str, least_um: float) -> None:
    """Undone alone, it spoils the columns named, by at least so much somewhere."""
    away = np.abs(table_11(**choice) - TABLE_11).max(axis=0)
    assert all(away["xyz".index(c)] > least_um for c in columns)


def test_all_columns_agree_on_one_tilt_that_is_not_the_printed_one() -> None:
    """The constant in Y, and the levers of ez in X and of ex in Z, each by least squares with the others left open."""
    base, slope = table_11(tilt=0.0), (table_11(tilt=1e-3) - table_11(tilt=0.0)) / 1e-3
    gap = TABLE_11 - base
    by_column = (gap * slope).sum(axis=0) / (slope**2).sum(axis=0)
    assert by_column[1] == pytest.approx(USED, abs=1e-10)
    assert by_column[[0, 2]] == pytest.approx(USED, abs=2e-7)
    assert np.abs(by_column - TILT).min() > 6e-4


def test_the_chain_of_the_library_has_the_two_frames() -> None:
    """Errors of T1 on the crossbeam at X = 0, the tilt on the plate: exact kinematics differ by second order only."""
    machine = read_machine(MACHINE)
    pose = pd.DataFrame({"Y": [0.0], "X": [0.0], "tool_x": [0.0], "tool_y": [0.0], "tool_z": [-REACH]})
    values = {"crossbeam.dx": 1e-3, "crossbeam.dy": 0.0255, "crossbeam.dz": 0.04, "plate.ea": USED}
    values |= {"crossbeam.ea": np.radians(0.03), "crossbeam.eb": signed_ey()[4], "crossbeam.ec": 51 / 830e3}
    assert set(values) <= set(Chain(machine).ids)
    tips = [measured_at(machine, pose, Truth(v))[["mx", "my", "mz"]].to_numpy()[0] for v in (values, {})]
    assert 1e3 * (tips[1] - tips[0]) == pytest.approx(TABLE_11[4], abs=0.1)


def test_the_angles_bring_more_into_z_than_the_sensors_resolution() -> None:
    """Section 6.1 says less than 0.25 um."""
    by_ex = 1e3 * np.radians(PRINTED["orientation_deg"]) * (LEVER[1] + TILT * REACH)
    by_ey = -1e3 * signed_ey() * LEVER[0]
    assert np.abs(by_ex).max() == pytest.approx(13.68, abs=0.01)
    assert np.abs(by_ey).max() == pytest.approx(13.88, abs=0.01)


def test_the_probe_went_elsewhere_between_points_7_and_8() -> None:
    """Touched place along y less the encoder's position, mm: two places, 11 and 5 mm apart, and nothing between."""
    for side, motor, apart in (("left", "motor_a_um", 10.8), ("right", "motor_b_um", 5.3)):
        place = ARM.loc[1:, f"{side}_y"] + PRINTED[motor] / 1e3
        assert place.loc[8:].mean() - place.loc[:7].mean() == pytest.approx(apart, abs=0.1)
        assert max(place.loc[:7].std(), place.loc[8:].std()) < 0.5


@pytest.mark.long
@pytest.mark.parametrize("command", ["fit", "diagnose"])
def test_the_recordings_survive_and_nothing_is_invented(command: str, tmp_path: Path) -> None:
    result = run(command, MACHINE, FOLDER / "survey.yaml", "--out", tmp_path / "out", "--quiet")
    assert result.code == 0, result.err
    fit = json.loads((tmp_path / "out" / "fit.json").read_text())
    assert fit["nominal"]["rms_um"] == pytest.approx(97, abs=1)
    level = next(p for p in fit["parameters"] if p["id"] == "bed.eb")
    assert level["value"] == pytest.approx(304e-6, abs=3e-6)  # the crossbeam in the arm's frame
    if command == "diagnose":
        found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
        assert (found["verdict"], found["findings"]) == ("adequate", [])


def test_error_motions_alone_can_be_fitted_and_hold_nothing_more(tmp_path: Path) -> None:
    assert run("fit", MACHINE, FOLDER / "motions.csv", "--out", tmp_path / "fit", "--quiet").code == 0
    assert run("diagnose", MACHINE, FOLDER / "motions.csv", "--out", tmp_path / "d", "--quiet").code == 0
    found = json.loads((tmp_path / "d" / "diagnosis.json").read_text())
    assert (found["verdict"], found["findings"]) == ("adequate", [])
