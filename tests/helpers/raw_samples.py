"""A small file of each raw format, as its source describes it; made here, of no recording."""

from __future__ import annotations

import math

import numpy as np

from errormodel import read_machine
from errormodel.raw_formats.base import Asked
from tests.helpers.workbooks import workbook

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
SIDE_BY_SIDE = (
    "Abweichung in \u00b5m\nX soll [mm];1\u2191;1\u2193;2\u2191;2\u2193;Mittel\n"
    "-20;-10,5;-30;-11;-29;-20\n20;40;20;41;21;30,5\n"
)
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
POLAR = "Point;Hz [gon];V [gon];D [m]\nA;0;100;2\nB;100;100;3\nC;50;50;1\n"
LABELLED = "# log\nA X=1.5, Y=2.5, Z=-3 t=10:00:00\nB X=1.75, Y=2, Z=4 t=10:00:01\n"
POSES = "Name,X,Y,Z,W,P,R,J1,J2,J3,J4,J5,J6\nA,1,2,3,0,0,90,0,1,2,3,4,5\nB,4,5,6,0,0,0,5,4,3,2,1,0\n"
LOGGER = "Logger 77\nDate;Time;Bed [°F];Spindle temp\n11.10.2022;15:06:48;68,0;33,1\n11.10.2022;15:07:48;69,8;33,2\n"
PROGRAMME = "%\nG21 G90 G94\nG0 X0 Y0 Z300\nG1 X-5 F1500\nX10\nG4 P2\nX20 Y1\nX15\nG4 P2\nM30\n%\n"

SIEMENS = "N10 G54 G90\nN20 G0 X=0 Y=0 Z=300\nN30 G1 X=10 F1500\nN40 G4 F2\nN50 X=15 Y=1\nN60 G4 F2\nN70 M30\n"
HEIDENHAIN = (
    "0 BEGIN PGM A MM\n1 L X+0 Y+0 Z+300 FMAX\n2 L X+10 R0 F1500\n3 STOP\n4 L X+15 Y+1\n5 STOP\n6 END PGM A MM\n"
)


def spreadsheet() -> bytes:
    """A workbook with one table."""
    cells = [["Name", "X [mm]", "Y [mm]", "Z [mm]"], ["P1", 1.25, 2.5, -3.0], ["P2", 4.5, 5.25, 6.0]]
    return workbook({"Data": cells})


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
    "positioning-runs": (SIDE_BY_SIDE, Asked(MILL)),
    "ballbar-trace": (BALLBAR, Asked(MILL)),
    "optitrack-take": (OPTITRACK, Asked(MILL)),
    "cmm-ascii": (CMM, Asked(MILL)),
    "robot-poses": (POSES, Asked(ARM)),
    "robot-targets": (three_reflectors(), Asked(ARM)),
    "polar-points": (POLAR, Asked(MILL)),
    "labelled-values": (LABELLED, Asked(MILL)),
    "temperature-log": (LOGGER, Asked(MILL)),
    "nc-programme": (PROGRAMME, Asked(MILL)),
    "siemens-programme": (SIEMENS, Asked(MILL, offsets=("G54=X0,Y0,Z0",))),
    "heidenhain-programme": (HEIDENHAIN, Asked(MILL)),
    "delimited-table": ("east,north\n1.5,2.5\n3.5,4.5\n", Asked(MILL)),
    "spreadsheet": (spreadsheet(), Asked(MILL)),
}
