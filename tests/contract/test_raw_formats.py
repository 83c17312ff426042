"""What every raw format keeps to, and each one on a file as its source describes it (made here, of no recording)."""

from __future__ import annotations

import inspect
import io
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from errormodel import read_machine
from errormodel.exceptions import InputError
from errormodel.raw_formats.base import Asked, Recording, format_of, open_raw, raw_formats
from tests.helpers.raw_files import read_back

MILL = read_machine("vertical_three_axis")
ARM = read_machine("six_axis_arm")

SPATIAL = """// SpatialAnalyzer SA 2024.1  ( x64 )
// Points Relative to Coordinate Frame 'A::WORLD'
// AXES = CARTESIAN: X,  Y,  Z (inch)
Cell,  Main,  P1,  1.0,  2.0,  -3.5,  02/12/25 16:38:29
Cell,  Main,  P2,  1.5,  2.5,  -3.25,  02/12/25 16:38:31
"""
LEICA = (
    "X  [mm],Y  [mm],Z  [mm],U(95)  [mm],U(95) X  [mm],U(95) Y  [mm],U(95) Z  [mm],Q0 ,Q1 ,Q2 ,Q3 ,Target,"
    "Temperature  [°C],Pressure  [mBar],Humidity  [%],Time Stamp\n"
    "1.5,2.5,3.5,0.01,0.004,0.006,0.008,1,0,0,0,TMC 30-B,22.8,1018,32,'11.10.2022 15:06:48.043\n"
    f"4.5,5.5,6.5,0.01,0.004,0.006,0.008,{math.sqrt(0.5)!r},0,0,{math.sqrt(0.5)!r},TMC 30-B,22.9,1018,32,"
    "'11.10.2022 15:06:50.043\n"
).encode("cp1252")
LASER = """HEADER::
File type: RTL
TARGET DATA::
Filetype: Linear
Target-count: 6
Targets :
 0.0000 100.0000 200.0000 300.0000 350.0000
 360.0000
Flags: 1 0 0
USER-TEXT::
Machine: Mill  Serial No: 7
Axis: X
RUNS::
Run-count: 2
DEVIATIONS::
Run Target Data:
1 1 0.5
1 2 1.5
1 3 2.5
1 4 3.5
1 5 4.5
1 6 5.5
2 6 5.0
2 5 4.0
2 4 3.0
2 3 2.0
2 2 1.0
2 1 -0.25
EQUIPMENT::
ENVIRONMENT::
Air temp: 20.5
EOF::
""".replace("\n", "\r\n")
TEST = "target_mm,cycle,direction,position_mm\n-20,1,+,-20.01\n20,1,+,20.04\n20,1,-,20.02\n-20,1,-,-20.03\n"
BALLBAR = (
    "Radius: 150 mm\nFeed rate: 1000\nPlane XY\nAngle [deg]\tDeviation [um]\n0\t1.5\n90\t-2.5\n180\t1.0\n270\t0.5\n"
)
OPTITRACK = """Format Version,1.23,Take Name,a,Rotation Type,Quaternion,Length Units,Meters

,,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body
,,Head,Head,Head,Head,Head,Head,Head
,,01,01,01,01,01,01,01
,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position
Frame,Time (Seconds),X,Y,Z,W,X,Y,Z
0,0.00,0,0,0,1,0.010,0.020,0.030
1,0.01,0.6,0,0,0.8,0.011,0.021,0.031
2,0.02,,,,,,,
"""
CMM = """
DateTime, "20240110152512946"
Part Name, plate

FEATURE, AXIS, NOMINAL, MEAS, +TOL, -TOL, DEV, OUTTOL
"CIRCLE1","X","10.0000","10.0020","0.1","-0.1","0.002","0"
"CIRCLE1","Y","20.0000","19.9990","0.1","-0.1","-0.001","0"
"CIRCLE1","Z","5.0000","5.0005","0.1","-0.1","0.0005","0"
"CIRCLE1","D","30.0000","30.0100","0.1","-0.1","0.01","0"
"CIRCLE2","X","110.0000","110.0030","0.1","-0.1","0.003","0"
"CIRCLE2","Y","20.0000","20.0000","0.1","-0.1","0","0"
"CIRCLE2","Z","5.0000","5.0000","0.1","-0.1","0","0"
"""
POSES = "Name,X,Y,Z,W,P,R,J1,J2,J3,J4,J5,J6\nA,1,2,3,0,0,90,0,1,2,3,4,5\nB,4,5,6,0,0,0,5,4,3,2,1,0\n"
LOGGER = "Logger 77\nDate;Time;Bed [°F];Spindle temp\n11.10.2022;15:06:48;68,0;33,1\n11.10.2022;15:07:48;69,8;33,2\n"
PROGRAMME = "%\nG21 G90 G94\nG0 X0 Y0 Z300\nG1 X-5 F1500\nX10\nG4 P2\nX20 Y1\nX15\nG4 P2\nM30\n%\n"


def spreadsheet() -> bytes:
    """A workbook with a title sheet and a table; written by a plain zip of its parts (ECMA-376)."""
    import zipfile

    cells = [["Name", "X [mm]", "Y [mm]", "Z [mm]"], ["P1", 1.25, 2.5, -3.0], ["P2", 4.5, 5.25, 6.0]]
    rows = ""
    for r, row in enumerate(cells, start=1):
        inner = ""
        for c, value in enumerate(row):
            at = f"{'ABCD'[c]}{r}"
            text = f'<c r="{at}" t="inlineStr"><is><t>{value}</t></is></c>'
            inner += text if isinstance(value, str) else f'<c r="{at}"><v>{value}</v></c>'
        rows += f'<row r="{r}">{inner}</row>'
    space = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
    links = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    package = "http://schemas.openxmlformats.org/package/2006"
    parts = {
        "[Content_Types].xml": f'<Types xmlns="{package}/content-types">'
        '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
        '<Default Extension="xml" '
        'ContentType="application/vnd.openxmlformats-officedocument.spreadsheetml.sheet.main+xml"/>'
        "</Types>",
        "_rels/.rels": f'<Relationships xmlns="{package}/relationships"><Relationship Id="r1" '
        f'Type="{links}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        "xl/workbook.xml": f'<workbook xmlns="{space}" xmlns:r="{links}"><sheets>'
        '<sheet name="Data" sheetId="1" r:id="r1"/></sheets></workbook>',
        "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{package}/relationships"><Relationship Id="r1" '
        f'Type="{links}/worksheet" Target="worksheets/sheet1.xml"/></Relationships>',
        "xl/worksheets/sheet1.xml": f'<worksheet xmlns="{space}"><sheetData>{rows}</sheetData></worksheet>',
    }
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, text in parts.items():
            archive.writestr(name, f'<?xml version="1.0" encoding="UTF-8"?>{text}')
    return out.getvalue()


def three_reflectors() -> str:
    """A rigid flange with three reflectors, moved."""
    rng = np.random.default_rng(1)
    body = np.array([[0.0, 0, 0], [120, 10, 0], [30, 90, 50]])
    lines = []
    for _ in range(5):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        points = body @ turn.T + rng.uniform(-500, 500, 3)
        joints = rng.uniform(-50, 50, 6)
        lines.append(" ".join(f"{v:.18e}" for v in [*points.ravel(), *np.zeros(3), *joints]))
    return "\n".join(lines) + "\n"


SAMPLES: dict[str, tuple[bytes | str, Asked]] = {
    "spatialanalyzer-points": (SPATIAL, Asked(MILL)),
    "leica-tracker": (LEICA, Asked(MILL)),
    "tracker-points": ("P1;-148.743;-3153.918;104.44;;;;\nP2;-140.5;-3150.25;100.75;;;;\n", Asked(MILL)),
    "renishaw-laser": (LASER, Asked(MILL)),
    "positioning-test": (TEST, Asked(MILL, joint="X")),
    "ballbar-trace": (BALLBAR, Asked(MILL)),
    "optitrack-take": (OPTITRACK, Asked(MILL)),
    "cmm-ascii": (CMM, Asked(MILL)),
    "robot-poses": (POSES, Asked(ARM)),
    "robot-targets": (three_reflectors(), Asked(ARM)),
    "temperature-log": (LOGGER, Asked(MILL)),
    "nc-programme": (PROGRAMME, Asked(MILL)),
    "delimited-table": ("east,north\n1.5,2.5\n3.5,4.5\n", Asked(MILL)),
    "spreadsheet": (spreadsheet(), Asked(MILL)),
}


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


def test_robots(tmp_path: Path) -> None:
    frame = recording("robot-poses", tmp_path).frame
    np.testing.assert_allclose(frame[["mrx", "mry", "mrz"]].iloc[0], [0, 0, math.pi / 2], atol=1e-12)
    assert list(frame["J6"]) == [5, 0]
    targets = recording("robot-targets", tmp_path).frame
    assert len(targets) == 15
    assert list(targets["target"][:4]) == ["1", "2", "3", "1"]
    assert set(targets) == {"J1", "J2", "J3", "J4", "J5", "J6", "mx", "my", "mz", "target"}


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
