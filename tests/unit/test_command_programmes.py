"""Programmes of Siemens and Heidenhain controls as commands: the same poses in three languages, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import read_machine
from errormodel.exceptions import InputError
from errormodel.raw_formats.base import Asked, Recording, format_of, open_raw
from tests.helpers.importing import poses
from tests.helpers.raw_samples import MILL

TRUNNION = read_machine("trunnion_five_axis")


def commands(text: str, folder: Path, name: str = "", machine: object = MILL, **stated: tuple[str, ...]) -> Recording:
    """What is read; `name` : the format that must recognise it."""
    path = folder / "survey.txt"
    path.write_bytes(text.encode("latin-1"))
    raw = open_raw(path, "survey.txt")
    form = format_of(raw)
    assert name in ("", form.name)
    return form.read(raw, Asked(machine, **stated))  # type: ignore[arg-type]


def refusal(text: str, folder: Path, name: str, **stated: tuple[str, ...]) -> str:
    with pytest.raises(InputError) as error:
        commands(text, folder, name, **stated)
    return str(error.value)


def three_ways(table: pd.DataFrame) -> dict[str, str]:
    """Each pose overrun and waited at, in G-code, as Siemens and as Heidenhain write it, with their comments."""
    code, siemens = (
        ["(Prüfung)", "%", "G21 G90 G94 F2000", "G0 Z620"],
        ["; Prüfung", 'MSG("los; ab")', "G0 Z=620 F=2000"],
    )
    talk = ["0  BEGIN PGM MESS MM", "1  ; Prüfung", "2  * - Punkte", "3  L  Z+620 R0 FMAX", "4  L  F2000"]
    for x, y, z in table.to_numpy():
        code += [f"G1 X{x - 5:.3f} Y{y - 3:.3f} Z{z + 2:.3f}", f"X{x:.3f} Y{y:.3f} Z{z:.3f}", "G4 P3"]
        siemens += [
            f"N10 G1 X={x - 5:.3f} Y={y - 3:.3f} Z={z + 2:.3f}",
            f"X=IC(5) Y=IC(3) Z=IC({-2})",
            "G4 F3 ; warten",
        ]
        talk += [
            f"L  X{x - 5:+.3f}  Y{y - 3:+.3f}  Z{z + 2:+.3f} R0",
            f"L  X{x:+.3f} Y{y:+.3f} Z{z:+.3f}".replace(".", ","),
        ]
        talk += ["CYCL DEF 9.0 VERWEILZEIT", "CYCL DEF 9.1 V.ZEIT 3"]
    return {
        "nc-programme": "\n".join([*code, "M30", "%"]), "siemens-programme": "\n".join([*siemens, "M30"]),
        "heidenhain-programme": "\n".join([*talk, "L M30", "END PGM MESS MM"]),
    }  # fmt: skip


def test_three_languages_say_the_same(tmp_path: Path) -> None:
    table = poses(rows=12)
    frames = {name: commands(text, tmp_path, name).frame for name, text in three_ways(table).items()}
    for frame in frames.values():
        np.testing.assert_allclose(frame[["X", "Y", "Z"]], table, atol=1e-9)
        pd.testing.assert_frame_equal(frame, frames["nc-programme"], check_exact=False, atol=1e-9)
        assert {*frame["feed"]} == {2000.0}
        assert frame["dir_Z"].to_list() == [-1.0] * 12


SIEMENS = """%_N_SURVEY_MPF
;$PATH=/_N_WKS_DIR/_N_TEST_WPD
N5 G17 G54 G64 G90 SOFT FFWON
N10 T="REFLECTOR" M6
N15 D1
N20 CYCLE832(0.01,0,1)
N25 TRANS
N26 CYCLE800()
N27 GROUP_BEGIN(0,"Punkte (1)",0,0)
N30 START: G0 X100 Y=-50.5 Z300 A=0 C=DC(10)
N35 G4 F2
N40 G1 X=AC(110) C=DC(350) F1500
N45 G4 F2
N50 G91 X-20 C=IC(5)
N55 G4 F2 G90
N60 C=ACP(5)
N65 M0
N70 SUPA G0 Z0 D0
N75 M30
"""


def test_siemens(tmp_path: Path) -> None:
    """Offsets with the tool's length in them; a rotary axis by the shorter way; the dwell's F is no feed."""
    read = commands(SIEMENS, tmp_path, "siemens-programme", TRUNNION, offsets=("G54=X1,Y2,Z30",))
    names = ["X", "Y", "Z", "C"]
    expected = [[101, -48.5, 330, 10], [111, -48.5, 330, 350], [91, -48.5, 330, 355], [91, -48.5, 330, 5]]
    np.testing.assert_allclose(read.frame[names], expected)
    assert read.frame["dir_C"].to_list()[1:] == [-1, 1, 1]
    assert read.frame["dir_X"].to_list()[1:] == [1, -1, -1]
    assert read.lines == (11, 13, 15, 17)


HEIDENHAIN = """0  BEGIN PGM KONTROLLE MM
1  BLK FORM 0.1 Z X+0 Y+0 Z-20
2  BLK FORM 0.2  X+100  Y+100  Z+0
3  CYCL DEF 247 BEZUGSPUNKT SETZEN ~
    Q339=+1    ;BEZUGSPUNKT-NUMMER
4  CYCL DEF 7.0 NULLPUNKT
5  CYCL DEF 7.1  X+0
6  CYCL DEF 7.2  Y+0
7  PLANE RESET STAY
   L M140 MB MAX
8  TOOL CALL 12 Z S500
9  L  Z+0 R0 FMAX M91
10 L  X+100  Y-50.5  Z+300 R0 FMAX M3
11 STOP
12 L  IX+10 IY-5 F1000
13 CYCL DEF 9.0 DWELL TIME
14 CYCL DEF 9.1 DWELL 2.5
15 CC  X+110 Y-45.5
16 C  X+120 Y-45.5 DR+
17 FUNCTION DWELL TIME2
18 L M30
19 LBL 1
20 L X+1000
21 LBL 0
22 END PGM KONTROLLE MM
"""


def test_rotary_axes_take_the_shorter_way_behind_m126(tmp_path: Path) -> None:
    text = "L X+0 Y+0 Z+300 A+0 C+10 FMAX\nL C+350\nL C+340 M126\nL C+10\nL C+350 M127\nL M30\n"
    read = commands(text, tmp_path, "heidenhain-programme", TRUNNION)
    assert read.frame["dir_C"].to_list()[1:] == [1, -1, 1, 1]


def test_heidenhain(tmp_path: Path) -> None:
    read = commands(HEIDENHAIN, tmp_path, "heidenhain-programme", offsets=("X1,Y2,Z30",))
    np.testing.assert_allclose(read.frame[["X", "Y", "Z"]], [[101, -48.5, 330], [111, -53.5, 330], [121, -43.5, 330]])
    assert read.frame["dir_Y"].to_list()[1:] == [-1, 1]
    assert read.lines == (14, 17, 20)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("X=R1", "a variable or an expression (X=R1)"),
        ("R1=100", "a variable or an expression (R1=100)"),
        ("X=100+5", "a variable or an expression"),
        ("FOR I=1 TO 5", "a loop or jump (FOR)"),
        ("GOTOB START", "a loop or jump (GOTOB)"),
        ("REPEAT START P=5", "a loop or jump (REPEAT)"),
        ("CYCLE81(10,0,2,-5)", "a cycle or call (CYCLE)"),
        ("L100", "a call of a subprogramme (L100)"),
        ("M17", "the end of a subprogramme"),
        ("TRAORI", "tool centre point control"),
        ("TRANS X100", "a frame (TRANS)"),
        ("G505", "the settable offset G505"),
        ("G41 X10", "cutter radius compensation"),
        ("X=AC(10) Y=IC(5)", "positions and increments in one block"),
        ("G4 F2 X10", "a dwell with positions"),
        ("G1 X10 RND=5", "a corner or a chamfer (RND)"),
        ("B=5", "'B"),
        ("X5 X=6", "X twice"),
        ("G2 X10 Y0 I=AC(5) J=AC(0)", "I=AC(..)"),
        ("X=1000", "beyond its travel"),
        ("G54 T1 D1\nX=10", "the length of the tool 1. Write --offset G54=X..,Y..,Z.."),
        ("G55\nX=10", "the work offset G55 is not known"),
    ],
)
def test_what_a_siemens_programme_is_refused_for(line: str, words: str, tmp_path: Path) -> None:
    text = "\n".join(["G0 X=0 Y=0 Z=300", *[f"G1 X={k} F500" for k in range(12)], line, "M30"])
    message = refusal(text, tmp_path, "siemens-programme")
    assert words in message
    assert "survey.txt, line 1" in message


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("L X+Q1", "a Q parameter"),
        ("Q1 = 100", "a Q parameter"),
        ("FN 0: Q1 = +100", "a Q parameter"),
        ("CALL LBL 1 REP 5", "a call"),
        ("CALL PGM TEST", "a call"),
        ("CYCL CALL", "a cycle"),
        ("CYCL DEF 200 BOHREN", "a cycle"),
        ("CYCL DEF 7.1 X+50", "a datum shift (cycle 7)"),
        ("CYCL DEF 8.1 X", "mirroring (cycle 8)"),
        ("CYCL DEF 10.1 ROT+30", "rotation (cycle 10)"),
        ("PLANE SPATIAL SPA+0 SPB+30 SPC+0 MOVE", "a tilted plane"),
        ("M128", "tool centre point control"),
        ("L X+10 RL", "radius compensation"),
        ("LP PR+50 PA+30", "polar coordinates"),
        ("L X+10 IY+5", "positions and increments in one block"),
        ("C X+10 Y+0 DR+", "an arc whose plane, centre or sense"),
        ("L B+10", "the machine has no axis B"),
        ("L X+10 M140 MB MAX", "'MB'"),
        ("PLANE RESET TURN MB MAX FMAX\nL X+10", "where Y, Z stand is not known"),
        ("L X+1000", "beyond its travel"),
        ("TOOL CALL 5 Z\nL X+1 Y+1 Z+300", "the length of the tool 5"),
        ("CYCL DEF 247 Q339=+1\nL X+1", "the preset that cycle 247 takes"),
    ],
)
def test_what_a_heidenhain_programme_is_refused_for(line: str, words: str, tmp_path: Path) -> None:
    text = "\n".join(
        ["BEGIN PGM A MM", "L X+0 Y+0 Z+300 FMAX", *[f"L X+{k} F500" for k in range(12)], line, "END PGM A MM"]
    )
    message = refusal(text, tmp_path, "heidenhain-programme")
    assert words in message
    assert "survey.txt, line 1" in message


def test_inches_and_two_tools(tmp_path: Path) -> None:
    text = "BEGIN PGM A INCH\nL X+1 Y+0 Z+10 F100\nL X+2\nEND PGM A INCH\n"
    read = commands(text, tmp_path, "heidenhain-programme")
    np.testing.assert_allclose(read.frame["X"], [25.4, 50.8])
    assert "feed" not in read.frame
    siemens = "G70 G0 X=1 Y=0 Z=10\nG710 X=2 F100\n"
    np.testing.assert_allclose(commands(siemens, tmp_path, "siemens-programme").frame["X"], [25.4, 2])
    two = "TOOL CALL 1 Z\nL X+1 Y+0 Z+300\nTOOL CALL 2 Z\nL X+2 Y+0 Z+300\n"
    assert "positions with the tools 1 and 2" in refusal(two, tmp_path, "heidenhain-programme", offsets=("X0,Y0,Z0",))
