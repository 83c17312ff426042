"""What every raw format keeps to, and each one on a file as its source describes it (made here, of no recording)."""

from __future__ import annotations

import inspect
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from errormodel.exceptions import InputError
from errormodel.raw_formats.base import Asked, Recording, format_of, open_raw, raw_formats
from tests.helpers.raw_files import read_back
from tests.helpers.raw_samples import ARM, LASER, MILL, SAMPLES


def recording(name: str, folder: Path) -> Recording:
    data, asked = SAMPLES[name]
    path = folder / "sample.dat"
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    raw = open_raw(path, path.name)
    assert format_of(raw).name == name
    return format_of(raw).read(raw, asked)


@pytest.mark.parametrize("name", raw_formats())
def test_says_what_it_is(name: str) -> None:
    kind = raw_formats()[name]
    assert kind.title
    assert kind.source
    assert (inspect.getdoc(kind) or "").strip()
    assert "-" in name or name == "spreadsheet"  # names with a hyphen are found by the test of names everywhere


@pytest.mark.parametrize("name", [n for n in raw_formats() if n in SAMPLES])
def test_its_sample_is_recognised_and_read(name: str, tmp_path: Path) -> None:
    if name == "spreadsheet":
        pytest.importorskip("python_calamine")
    read = recording(name, tmp_path)
    assert len(read.frame) > 1
    assert len(read.lines) in (0, len(read.frame))
    assert set(read.units) <= {str(n) for n in read.frame} | {"feed"}


@pytest.mark.parametrize("name", raw_formats())
@settings(max_examples=6, suppress_health_check=[HealthCheck.function_scoped_fixture])
@example(content=b"M\n(\xc0\xa3\xe8\x0cF\xc5", at=13)  # a radius of 100 mM
@given(content=st.binary(max_size=300), at=st.integers(0, 400))
def test_any_bytes_are_read_or_refused(name: str, content: bytes, at: int, tmp_path: Path) -> None:
    """Bytes of chance, and the format's own sample with such bytes in it."""
    data, asked = SAMPLES.get(name, (b"", Asked(MILL)))
    own = data.encode() if isinstance(data, str) else data
    cures = []
    for k, damaged in enumerate((content, own[:at] + content[:5] + own[at:], own[:at])):
        path = tmp_path / f"any{k}"
        path.write_bytes(damaged)
        try:
            raw = open_raw(path, path.name)
            raw_formats()[name].opened(raw, asked)
        except InputError as error:
            cures.append(error.cure)
    assert all(cures)


def test_spatialanalyzer(tmp_path: Path) -> None:
    read = recording("spatialanalyzer-points", tmp_path)
    assert list(read.frame["point"]) == ["P1", "P2"]
    np.testing.assert_array_equal(read.frame[["mx", "my", "mz"]], [[1, 2, -3.5], [1.5, 2.5, -3.25]])
    assert read.units == {"mx": "inch", "my": "inch", "mz": "inch"}
    assert float(np.diff(read.frame["time"])[0]) == 2.0


def test_leica(tmp_path: Path) -> None:
    """Half of U(95) is the standard uncertainty; a quarter turn about z is (0, 0, pi / 2)."""
    frame = recording("leica-tracker", tmp_path).frame
    np.testing.assert_array_equal(frame[["sigma_x", "sigma_y", "sigma_z"]], [[0.002, 0.003, 0.004]] * 2)
    np.testing.assert_allclose(frame[["mrx", "mry", "mrz"]], [[0, 0, 0], [0, 0, math.pi / 2]], atol=1e-12)
    assert list(frame["T_air"]) == [22.8, 22.9]
    assert list(frame["target"]) == ["TMC 30-B"] * 2
    assert float(np.diff(frame["time"])[0]) == pytest.approx(2.0, abs=1e-6)  # microseconds of 1.7e9 s


def test_renishaw(tmp_path: Path) -> None:
    """Odd runs forward, even ones back; micrometres become mm; there and back are one run of a survey."""
    frame = recording("renishaw-laser", tmp_path).frame
    assert list(frame["X"]) == [0, 100, 200, 300, 350, 360, 360, 350, 300, 200, 100, 0]
    np.testing.assert_allclose(frame["dx"], np.array([0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 5, 4, 3, 2, 1, -0.25]) * 1e-3)
    assert list(frame["dir_X"]) == [1.0] * 6 + [-1.0] * 6
    assert set(frame["run"]) == {"1"}
    assert set(frame["T_air"]) == {20.5}


def test_an_angle_or_a_straightness_of_renishaw_is_asked_for(tmp_path: Path) -> None:
    angular = LASER.replace("RTL", "RTA").replace("Linear", "Angular").encode()
    read = read_back(tmp_path, angular, MILL, "a.rta")
    assert "deviation" in read.frame
    assert "deviation" not in read.units
    assert any("--columns eb=deviation" in note for note in read.notes)
    straight = LASER.replace("RTL", "RTS").replace("Linear", "Straightness").encode()
    assert read_back(tmp_path, straight, MILL, "a.rts").units["deviation"] == "um"


def test_positioning_test(tmp_path: Path) -> None:
    frame = recording("positioning-test", tmp_path).frame
    np.testing.assert_allclose(frame["dx"], [-0.01, 0.04, 0.02, -0.03], atol=1e-12)
    assert list(frame["dir_X"]) == [1, 1, -1, -1]


def test_ballbar(tmp_path: Path) -> None:
    frame = recording("ballbar-trace", tmp_path).frame
    np.testing.assert_allclose(frame["length"], [150.0015, 149.9975, 150.001, 150.0005])
    assert set(frame["plane"]) == {"XY"}
    assert set(frame["side"]) == {1.0}


def test_optitrack(tmp_path: Path) -> None:
    read = recording("optitrack-take", tmp_path)
    np.testing.assert_allclose(read.frame[["mx", "my", "mz"]].iloc[1], [0.011, 0.021, 0.031])
    assert read.units["mx"] == "m"
    np.testing.assert_allclose(read.frame["mrx"].iloc[1], 2 * math.atan2(0.6, 0.8))
    assert read.frame["mx"].isna().iloc[2]


def test_cmm(tmp_path: Path) -> None:
    frame = recording("cmm-ascii", tmp_path).frame
    assert list(frame["point"]) == ["CIRCLE1", "CIRCLE2"]
    np.testing.assert_array_equal(frame[["mx", "my", "mz"]], [[10.002, 19.999, 5.0005], [110.003, 20, 5]])


def test_joints_as_rtde_names_them_are_in_rad(tmp_path: Path) -> None:
    names = [f"{kind}_q_{k}" for kind in ("target", "actual") for k in range(6)]
    rows = "".join(f"{0.1 * k:.1f} " + " ".join(["1.5"] * 12) + "\n" for k in range(4))
    (tmp_path / "ur.log").write_text(f"timestamp {' '.join(names)}\n{rows}")
    raw = open_raw(tmp_path / "ur.log", "ur.log")
    read = format_of(raw).read(raw, Asked(ARM))
    assert {read.units[n] for n in ("J1", "J6", "read_J1", "read_J6")} == {"rad"}
    assert any("read in rad" in note for note in read.notes)


def test_robots(tmp_path: Path) -> None:
    frame = recording("robot-poses", tmp_path).frame
    np.testing.assert_allclose(frame[["mrx", "mry", "mrz"]].iloc[0], [0, 0, math.pi / 2], atol=1e-12)
    assert list(frame["J6"]) == [5, 0]
    targets = recording("robot-targets", tmp_path).frame
    assert len(targets) == 15
    assert list(targets["target"][:4]) == ["1", "2", "3", "1"]
    assert set(targets) == {"J1", "J2", "J3", "J4", "J5", "J6", "mx", "my", "mz", "target"}


def test_polar_points(tmp_path: Path) -> None:
    """A horizontal direction counts clockwise from the second axis, an azimuth counterclockwise from the first."""
    frame = recording("polar-points", tmp_path).frame
    root = math.sqrt(0.5)
    expected = [[0, 2, 0], [3, 0, 0], [root * root, root * root, root]]
    np.testing.assert_allclose(frame[["mx", "my", "mz"]], expected, atol=1e-12)
    text = b"Az,El,Range\n90,30,2\n0,90,1\n"
    with pytest.raises(InputError, match="angles without a unit"):
        read_back(tmp_path, text)
    path = tmp_path / "polar.csv"
    path.write_bytes(text)
    raw = open_raw(path, path.name)
    own = format_of(raw).read(raw, Asked(units={"azimuth": "deg", "elevation": "deg", "range": "m"}))
    np.testing.assert_allclose(
        own.frame[["mx", "my", "mz"]], [[0, 2 * math.cos(math.pi / 6), 1], [0, 0, 1]], atol=1e-12
    )
    assert own.units["mx"] == "m"


def test_labelled_values(tmp_path: Path) -> None:
    read = recording("labelled-values", tmp_path)
    assert list(read.frame["point"]) == ["A", "B"]
    np.testing.assert_array_equal(read.frame[["X", "Y", "Z"]], [[1.5, 2.5, -3], [1.75, 2, 4]])
    np.testing.assert_array_equal(read.frame["time"], [36000, 36001])
    assert read.lines == (2, 3)
    assert "1 line without these labels passed over" in read.notes
    display = read_back(tmp_path, b"P1 X1.5 Y-2.50 Z+3.0\nP2 X4.0 Y5.0 Z6.0\n", name="display.txt").frame
    assert list(display["point"]) == ["P1", "P2"]
    np.testing.assert_array_equal(display[["X", "Y", "Z"]], [[1.5, -2.5, 3], [4, 5, 6]])
    data = b'{"name": "P 1", "x": 1.5e0, "y": -2}\n{"name": "P 2", "x": 3, "y": 4.25}\n'
    own = read_back(tmp_path, data, name="log.json").frame
    assert list(own["name"]) == ["P 1", "P 2"]
    np.testing.assert_array_equal(own[["x", "y"]], [[1.5, -2], [3, 4.25]])


def test_temperatures(tmp_path: Path) -> None:
    read = recording("temperature-log", tmp_path)
    assert set(read.frame) == {"T_Bed", "T_Spindle", "time"}
    assert read.units["T_Bed"] == "degF"
    assert list(read.frame["T_Bed"]) == [68.0, 69.8]


def test_programme(tmp_path: Path) -> None:
    """Poses where it waits, from the side of the last move before."""
    frame = recording("nc-programme", tmp_path).frame
    np.testing.assert_array_equal(frame[["X", "Y", "Z"]], [[10, 0, 300], [15, 1, 300]])
    assert list(frame["dir_X"]) == [1, -1]
    assert frame["dir_Y"].isna().tolist() == [True, False]
    assert list(frame["feed"]) == [1500, 1500]


def test_a_sheet_is_read_as_the_table_in_it(tmp_path: Path) -> None:
    pytest.importorskip("python_calamine")
    frame = recording("spreadsheet", tmp_path).frame
    pd.testing.assert_frame_equal(
        frame[["X", "Y", "Z"]], pd.DataFrame({"X": [1.25, 4.5], "Y": [2.5, 5.25], "Z": [-3.0, 6.0]})
    )
