"""Corrected programmes: positions that are sent, words that stay, cuts that are divided, axes that are left alone."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from errormodel.controllers.gcode import GCode
from errormodel.exceptions import InputError
from errormodel.gcode.reading import Reading
from tests.helpers.chains import Array
from tests.helpers.gcode_machine import execute
from tests.helpers.gcode_trial import MARKS, TARGET
from tests.helpers.setups import plain_setup

SETUP = plain_setup()
G = TARGET
HERE = "start=X0,Y100,Z-60"


def shift(q: Array, came: Array) -> Array:
    """A correction that differs along each axis: 10 um, 100 um/m and a bow of Z along X."""
    return q + np.column_stack([np.full(len(q), 0.01), 1e-4 * q[:, 0], 1e-6 * q[:, 0] ** 2])


def play(q: Array, came: Array) -> Array:
    """20 um of play in X."""
    return q + 0.01 * came * np.array([1.0, 0, 0])


def sent(text: str) -> Array:
    return G.positions("a.nc", text, SETUP)


def rewritten(text: str, *at: str, offset: tuple[str, ...] = (), dialect: str = "auto", name: str = "a.nc") -> str:
    return G.rewrite(name, text, SETUP, shift, Reading.of(dialect, offset, at)).text


def test_positions_are_corrected_and_other_words_stay() -> None:
    text = "%\nN10 G90 G21 G17\nN20 G0 X0 Y10 Z-60 (first)\nN30 G1 X100 F500 M8\nM5\nN40 Z-61\nM30\n%\n"
    out = rewritten(text)
    lines = out.splitlines()
    assert lines[0] == lines[-1] == "%"
    assert lines[1] == "N10 G90 G21 G17"
    assert "(first)" in out
    assert "M5" in lines
    assert next(line for line in lines if "N30" in line).startswith("N30 G1 F500 M8 X")
    asked = np.array([[0, 10, -60], [100, 10, -60], [100, 10, -61]], dtype=float)
    ends = sent(out)
    wanted = shift(asked, asked)
    for target in wanted:
        assert np.abs(ends - target).max(axis=1).min() <= G.quantum(SETUP) + 1e-12


def test_a_cut_along_one_axis_moves_the_others_too_and_is_divided_where_the_correction_bends() -> None:
    ends = sent(rewritten("G0 X-190 Y1 Z-60\nG1 X390\n"))[1:]
    assert len(ends) > 10
    x = ends[:, 0] - 0.01
    np.testing.assert_allclose(ends[:, 1], 1 + 1e-4 * x, atol=1e-4)
    middle = (x[1:] + x[:-1]) / 2
    chord = (ends[1:, 2] + ends[:-1, 2]) / 2
    assert np.abs(chord - (-60 + 1e-6 * middle**2)).max() < 4e-4
    assert len(sent(rewritten("G0 X-190 Y1 Z-60\nG0 X390\n"))) == 2  # rapids are not


def test_arcs_become_chords_on_the_circle() -> None:
    ends = sent(rewritten("G0 X50 Y100 Z-60\nG3 X0 Y150 I-50 J0 F100\nG2 X50 Y100 I0 J-50\n"))
    back = ends - (shift(ends, ends) - ends)
    assert len(ends) > 50
    np.testing.assert_allclose(np.hypot(back[:, 0], back[:, 1] - 100), 50, atol=1e-3)
    assert ends[len(ends) // 4, 1] > 110  # counter-clockwise
    assert "G3" not in rewritten("G0 X50 Y100 Z-60\nG3 X0 Y150 I-50 J0 F100\n")
    full = sent(rewritten("G0 X50 Y100 Z-60\nG2 X50 Y100 I-50 J0\n"))
    assert np.ptp(full[:, 0]) == pytest.approx(100, abs=0.1)


def test_an_offset_says_where_the_axes_stand() -> None:
    plain, offset = (
        sent(rewritten(f"{head}G0 X0 Y10 Z-60\n"))[-1] for head in ("", "(ERRORMODEL OFFSET X100 Y0 Z5)\n")
    )
    np.testing.assert_allclose(plain, [0.01, 10, -60], atol=1e-4)
    np.testing.assert_allclose(offset[:2], [100.01, 10.01], atol=1e-4)  # in axes: the reader adds the offset itself
    named = rewritten("G54\nG0 X0 Y10 Z-160\nG43 H2 Z-110\n", offset=("G54=X100,Y0,Z100", "H2=Z-55"))
    assert named.splitlines()[1:] == ["G0 X0.0100 Y10.0100 Z-159.9900", "G43 H2 Z-109.9900"]
    assert rewritten("G54\nG0 X0 Y10 Z-60\n", offset=("X100,Y0,Z0",)) == rewritten(
        "G54\nG0 X0 Y10 Z-60\n", offset=("G54=X100,Y0,Z0",)
    )


@pytest.mark.parametrize(
    ("block", "words"), [("G1 X10 F100\nG43 H2", "while G1 is in force"), ("G91 G43 H2", "with an incremental Z (G91)")]
)
def test_a_tool_length_that_cannot_change_there_says_why(block: str, words: str) -> None:
    with pytest.raises(InputError, match=re.escape(f"a tool length that changes {words}")):
        rewritten(f"G54\nG90 G0 X0 Y10 Z-160\n{block} Z-110\n", offset=("G54=X100,Y0,Z100", "H2=Z-55"))


def test_machine_coordinates_and_lines_without_a_path_stay_as_they_are() -> None:
    text = "G0 X0 Y10 Z-60\nG53 G0 Z-55\n  G4 P2  (wait)\nG91 G28 Z0\nM8 ; on\n\nT3\n"
    assert rewritten(text).splitlines()[1:] == text.splitlines()[1:]
    said = " ".join(G.rewrite("a.nc", text, SETUP, shift, Reading.of("auto", (), ())).notes)
    assert "positionings stay as they are (first in line 2: G53 counts in machine coordinates)" in said
    said = " ".join(G.rewrite("a.nc", "G0 X0 Y10\nG0 Z-60\n", SETUP, shift, Reading.of("auto", (), ())).notes)
    assert "(first in line 1: the position of Z is not known there, and errors depend on it)" in said


def test_an_axis_that_was_not_commanded_is_not_moved() -> None:
    with pytest.raises(InputError, match=r"line 1 .*where X, Y, Z stand is not known .*--at start=X"):
        rewritten("G1 X10 Y10 F1000\n")
    with pytest.raises(InputError, match=r"where Z stands is not known"):
        rewritten("G0 X20 Y20\nG1 X30 F100\n")
    out = rewritten("G1 X10 Y10 F1000\n", HERE)
    assert "Z" not in out
    notes = G.rewrite("a.nc", "G1 X10 Y10 F1000\n", SETUP, shift, Reading.of(after=(HERE,))).notes
    assert any("Z is never commanded" in n for n in notes)


def test_rapids_keep_their_axes_and_their_order() -> None:
    out = rewritten("G0 X20 Y20\nM3\nG0 Z-55\nG1 Z-58 F100\nG0 Z-51\nX100\n").splitlines()
    assert out[0] == "G0 X20 Y20"  # where Z stands is not known: as it was
    assert out[1:3] == ["M3", "G0 Z-54.9996"]
    assert out[3] == "G1 F100 X20.0100 Y20.0020"  # the correction of X and Y, at the feed of the cut
    assert out[4] == "Z-57.9996"
    assert out[5:] == ["G0 Z-50.9996", "X100.0100"]


def test_what_tool_changes_and_returns_leave_is_not_known() -> None:
    text = "G0 X0 Y10 Z-60\n{}\nG1 X20 F100\n"
    for line in ("T1 M6", "G91 G28 Z0"):
        with pytest.raises(InputError, match="not known here since"):
            rewritten(text.format(line))
    assert rewritten(text.format("T1 M6"), "M6=stay").splitlines()[1] == "T1 M6"
    assert rewritten(text.format("T1 M6"), "M6=X0,Y10,Z-60").splitlines()[2].startswith("G1 F100 X0.0100")
    out = rewritten("G0 X0 Y10 Z-60\nG91 G28 Z0\nG90 G1 X20 F100\n", "G28=Z-51").splitlines()
    assert out[2] == "G90 G1 F100 X20.0100 Y10.0020 Z-50.9996"
    assert rewritten(text.format("M60 P1").replace("M60 P1", "M11"), "M11=stay").splitlines()[1] == "M11"


def test_extrusion_is_shared_out_by_length() -> None:
    head = "M83\nG92 E0\nG0 X0 Y100\nG0 Z-60\nG1 F1200\nG1 X1 E0.1\n"
    for code, whole in (("M83", 44.5), ("M82", 44.6)):
        out = rewritten(head.replace("M83", code) + f"G1 X300 E{whole}\nG1 X301 E{whole + 0.1:g}\n")
        cuts = [e for e in execute(out, printer=True) if e.what == "cut" and e.extruded]
        lengths = np.array([e.length for e in cuts])
        rates = np.array([e.extruded for e in cuts]) / lengths
        assert len(cuts) > 8
        assert sum(e.extruded for e in cuts) == pytest.approx(44.7 if code == "M82" else 44.5 + 0.1 + 44.6, abs=1e-4)
        np.testing.assert_allclose(rates[1:-1], rates[1], rtol=1e-3)
    with pytest.raises(InputError, match="whether E counts absolutely is not certain"):
        rewritten("M104 S200\nG0 X0 Y100\nG0 Z-60\nG1 X300 E44.5\n")
    with pytest.raises(InputError, match="whether E counts absolutely is not certain"):  # firmwares differ
        rewritten(head + "M83\nG91\nG90\nG1 X300 E44.5\n")
    with pytest.raises(InputError, match="where the extruder stands"):
        rewritten("M82\nG0 X0 Y100\nG0 Z-60\nG1 X300 E44.5\n")


def test_the_time_of_inverse_time_is_shared_out() -> None:
    out = rewritten("G0 X0 Y100 Z-60\nG93 G1 X300 F2\nG94 G1 X0 F100\n")
    timed = [e for e in execute(out) if e.modes and e.modes[2] == 93]
    assert len(timed) > 5
    assert sum(e.minutes for e in timed) == pytest.approx(0.5, rel=1e-6)
    speeds = np.array([e.length / e.minutes for e in timed])
    np.testing.assert_allclose(speeds, 600, rtol=1e-3)
    assert out.count("F100") == 1


def test_play_is_taken_up_where_an_axis_turns_back() -> None:
    text = "G0 X0 Y100 Z-60\nG1 X50 F100\nX0\nX100\n"
    lines = G.rewrite("a.nc", text, replace(SETUP, reversing=frozenset("X")), play, Reading()).text.splitlines()
    assert lines[1:] == ["G1 F100 X50.0100", "G1 X49.9900", "X-0.0100", "G1 X0.0100", "X100.0100"] or lines[1:] == [
        "G1 F100 X50.0100", "X49.9900", "X-0.0100", "X0.0100", "X100.0100"
    ]  # fmt: skip
    circle = G.rewrite("a.nc", "G0 X50 Y100 Z-60\nG3 I-20\n", SETUP, play, Reading()).text
    steps = np.diff(sent(circle)[1:], axis=0)
    jumps = steps[(np.abs(steps[:, 1]) < 1e-9) & (np.abs(steps[:, 0]) > 0.015)]
    np.testing.assert_allclose(np.abs(jumps[:, 0]), 0.02, atol=2e-4)
    assert len(jumps) == 1  # at 180 deg; at the start it comes as it leaves


def test_an_optional_block_is_right_carried_out_or_not() -> None:
    head = "G0 X0 Y100 Z-60\n"
    out = rewritten(head + "/N5 G1 X300 F100\nG0 X30 Y3 Z-60\n/M1\n").splitlines()
    assert len(out) > 8
    assert all(line.startswith("/") for line in out[1:-2])
    assert out[1].startswith("/N5 G1 F100 X")
    assert out[-1] == "/M1"
    with pytest.raises(InputError, match=r"line 3 .*depends on whether the optional block in line 2"):
        rewritten(head + "/G1 X20 F100\nG1 X30 Y3 Z-60\n")


def test_a_stop_comes_behind_its_cut_and_a_spindle_before() -> None:
    out = rewritten("G0 X0 Y100 Z-60\nS500 M3 G1 X300 F100 M0\n").splitlines()
    assert len(out) > 5
    assert out[1].startswith("S500 M3 G1 F100 X")
    assert [line for line in out if "M0" in line] == [out[-1]]


def test_inches_and_increments() -> None:
    inch = rewritten("G0 X0 Y100 Z-60\nG20\nG1 X2 F10\n").splitlines()
    assert inch[-1].endswith("X2.00039 Y3.93721 Z-2.36210")
    steps = rewritten("G0 X0 Y100 Z-60\nG91 G1 X20 F10\nG1 X-20\n").splitlines()
    assert steps[1] == "G91 G1 F10 X20.0000 Y0.0020 Z0.0004"
    assert steps[2] == "G1 X-20.0000 Y-0.0020 Z-0.0004"


def test_pieces_that_are_less_than_a_figure_come_with_the_next() -> None:
    """Chords of 0.13 mm on a control of 0.1 or 0.01 mm: no line without a position, no time lost."""
    text = "G0 X50 Y100 Z-60\nG93 G3 X40 Y110 I-10 F5\n"
    for resolution in (0.1, 0.01):
        out = G.rewrite("a.nc", text, replace(SETUP, resolution=resolution), shift, Reading()).text
        assert all(re.search(r"[XYZ]", line) for line in out.splitlines())
        timed = [e for e in execute(out) if e.what == "cut"]
        assert len(timed) > 20
        assert sum(e.minutes for e in timed) == pytest.approx(0.2, rel=1e-6)


def test_feeds_that_a_correction_would_change_are_refused() -> None:
    """With F in degrees a minute, a word of X would make it mm: the axis would turn at its rapid."""
    table = replace(SETUP.axes[0], name="C", joint="C", rotary=True, travel=(0.0, 360.0), measured=(0.0, 360.0))
    setup = replace(SETUP, axes=(*SETUP.axes, table))

    def runout(q: Array, came: Array) -> Array:
        return q + np.column_stack([0.02 * np.sin(np.radians(q[:, 3])), np.zeros((len(q), 3))])

    def go(line: str) -> str:
        return G.rewrite("a.nc", f"G0 X0 Y100 Z-60 C0\n{line}\n", setup, runout, Reading()).text

    with pytest.raises(InputError, match=r"line 2 .*a feed of other axes .*G93"):
        go("G1 C90 F500")
    assert len(go("G93 G1 C90 F5").splitlines()) > 3
    assert len(go("G1 C90 X100 F500").splitlines()) > 3


def test_the_deviation_is_measured_and_said() -> None:
    out = G.rewrite("a.nc", "G0 X50 Y100 Z-60\nG3 X0 Y150 I-50 J0 F100\nG0 Z-51\n", SETUP, shift, Reading())
    match = re.search(r"2 rapids, 1 cuts in \d+ pieces; .* path ([\d.]+) um \(line 2\), of rapids' ends", out.notes[0])
    assert match is not None
    assert 0.3 < float(match[1]) < 1.0
    assert any("G90, G21, G17" in n for n in out.notes)


def test_a_correction_that_is_none_is_refused() -> None:
    for size, words in ((2.0, "a correction of X by 2.000 mm"), (np.nan, "a correction of X by nan mm")):
        for line in ("G1 X10 F100", "G0 X10"):
            with pytest.raises(InputError, match=words):
                G.rewrite("a.nc", f"G0 X0 Y100 Z-60\n{line}\n", SETUP, lambda q, c, s=size: q + s, Reading())
    with pytest.raises(InputError, match="bends more often"):
        G.rewrite(
            "a.nc", f"{'G1 X300 F9'}\n", SETUP, lambda q, c: q + 0.05 * np.sin(1e4 * q), Reading.of(after=(HERE,))
        )


def test_tables_of_commands() -> None:
    out = G.rewrite("a.csv", "X,Y,Z\n100,20,-60\n-50,20,-60\n", SETUP, shift).text
    np.testing.assert_allclose(
        G.positions("a.csv", out, SETUP), [[100.01, 20.01, -59.99], [-49.99, 19.995, -59.9975]], atol=1e-9
    )
    with pytest.raises(InputError, match="columns X, Q"):
        G.rewrite("a.csv", "X,Q\n1,2\n", SETUP, shift)
    with pytest.raises(InputError, match="line 3"):
        G.rewrite("a.csv", "X,Y,Z\n1,2,-60\n1,b,-60\n", SETUP, shift)
    with pytest.raises(InputError, match="takes no --dialect"):
        G.rewrite("a.csv", "X,Y,Z\n100,20,-60\n", SETUP, shift, Reading.of(after=(HERE,)))
    for wrong in ("5000,20,-60", "nan,20,-60"):
        with pytest.raises(InputError, match=r"line 2: X at (5000|nan), beyond its travel -200 to 400"):
            G.rewrite("a.csv", f"X,Y,Z\n{wrong}\n", SETUP, shift)


def test_other_columns_of_a_table_of_commands_stay() -> None:
    plain = 'time,Z,X,Y,what,mx\n0.5,-60,100,20,"a, b",99.97\n1.5,-60,-50,20,,\n'
    out = G.rewrite("a.csv", plain, SETUP, shift)
    assert [line.split(",")[0] for line in out.text.splitlines()] == ["time", "0.5", "1.5"]
    assert out.text.splitlines()[1].endswith(',"a, b",99.97')
    assert out.text.splitlines()[2].endswith(",,")
    np.testing.assert_allclose(
        G.positions("a.csv", out.text, SETUP), [[100.01, 20.01, -59.99], [-49.99, 19.995, -59.9975]], atol=1e-9
    )
    assert not out.notes
    (note,) = G.rewrite("a.csv", "X,Y,Z,target\n100,20,-60,B\n", SETUP, shift).notes
    assert "column target stays as it is, and is not followed: all rows are for the tip at" in note
    followed = replace(SETUP, conditions={"load": "load = 14 kg"})
    (note,) = G.rewrite("a.csv", "X,Y,Z,load\n100,20,-60,0\n", followed, shift).notes
    assert "column load stays as it is, and is not followed: all rows are for load = 14 kg" in note
    x, _, z = SETUP.tool
    G.rewrite("a.csv", f"X,Y,Z,tool_x,tool_z\n100,20,-60,{x},{z}\n", SETUP, shift)
    with pytest.raises(InputError, match=r"line 3: tool_z .*commands are for the tip at .*--tool"):
        G.rewrite("a.csv", f"X,Y,Z,tool_z\n100,20,-60,{z}\n100,20,-60,{z + 7}\n", SETUP, shift)
    with pytest.raises(InputError, match="directions of arrival are those of the rows"):
        G.rewrite("a.csv", "X,Y,Z,dir_X\n100,20,-60,1\n", SETUP, shift)
    with pytest.raises(InputError, match="line 2: 3 cells where 4 belong"):
        G.rewrite("a.csv", "X,Y,Z,time\n100,20,-60\n", SETUP, shift)


def test_directions_of_arrival_are_given_to_the_correction() -> None:
    seen: list[Array] = []

    def note(q: Array, came: Array) -> Array:
        seen.append(came)
        return q

    G.rewrite("a.nc", "G0 X0 Y10 Z-60\nG0 X50\nG0 Y5\nG0 X20\n", SETUP, note)
    assert seen[0][:, 0].tolist() == [1, 1, 1, -1]
    assert seen[0][:, 1].tolist() == [1, 1, -1, -1]


def test_programmes_as_cam_systems_and_slicers_write_them() -> None:
    mill = (
        "%\nO0001(FACE)\n(T1 D50)\nG90G94G17\nG21\nG28G91Z0.\nG90\nT1M6\nS2000M3\nG54\nG0X-40.Y10.\nG43Z15.H1\nM8\n"
        "G1Z-1.F200.\nX140.F800.\nG2X150.Y20.I0.J10.\nG0Z15.\nM9\nG28G91Z0.\nG28X0.Y0.\nM30\n%\n"
    ).splitlines()
    out = rewritten("\n".join(mill) + "\n", offset=("G54=X50,Y50,Z-150", "H1=Z50")).splitlines()
    assert out[:11] == mill[:11]
    assert re.fullmatch(r"G43 H1 Z1[45]\.\d+", out[11])
    assert out[-5:] == mill[-5:]
    printer = (
        'M201 X1000 Y1000 Z200 E5000 ; accelerations\nM862.3 P "MK3S"\nM115 U3.14.1 ; firmware\nG90\nM83\nG28 W\nG80\n'
        "G1 Z-60 F720\nG1 Y3 F1000\nG92 E0\nG1 X60 E9\nG1 E-.8 F2100\nG1 Z-58 F10800\nG1 X80 Y80\nM106 S127\nM84\n"
    )
    sure = rewritten(printer, "G80=X0,Y100,Z-60").splitlines()
    assert sure[:7] == printer.splitlines()[:7]
    with pytest.raises(InputError, match=r"where X stands is not known here since G80 in line 7"):
        rewritten(printer)


@pytest.mark.parametrize(
    ("head", "dialect", "mark", "place"),
    [
        ("", "iso", MARKS[0], 0),
        ("%\nO0012 (PART)\n(NAME)\n", "fanuc", MARKS[0], 3),
        (";FLAVOR:Marlin\n", "printer", MARKS[1], 1),
    ],
)
def test_a_corrected_programme_says_so_and_is_not_corrected_again(
    head: str, dialect: str, mark: str, place: int
) -> None:
    text = f"{head}G90\nG0 X0. Y100. Z-60.\nG1 X20. F100.\n{'%' if head[:1] == '%' else ''}\n"
    reading = Reading.of(dialect, (), (HERE,))
    once = GCode().rewrite("a.nc", text, SETUP, shift, reading).text
    assert [k for k, line in enumerate(once.splitlines()) if "errormodel" in line.lower()] == [place]
    assert once.splitlines()[place] == mark
    with pytest.raises(InputError, match=r"line \d.*corrected already"):
        GCode().rewrite("elsewhere.nc", once, SETUP, shift, reading)


def test_a_programme_without_positions_carries_no_mark() -> None:
    text = "G21 G90\nM8\nM30\n"
    assert GCode().rewrite("a.nc", text, SETUP, shift, Reading()).text == text


def test_blanks_behind_a_comment_are_none_of_it() -> None:
    assert "X1" in rewritten("G0 X0 Y10 Z-60\nG1 X1 F100 ;slowly  \n")
    assert rewritten("(before)\n%\nG0 X0 Y10 Z-60\n%\n(behind)\n").splitlines()[1:2] == ["%"]


def test_letters_of_other_alphabets_stay_in_comments() -> None:
    comment = b"(F\xe4se, \xc3\xbcber Alles)".decode("utf-8", "surrogateescape")
    out = rewritten(f"G0 X0 Y10 Z-60 {comment}\nG1 X20 F100 ; \u00e4\n").splitlines()
    assert out[0].endswith(comment)
    assert any(line.endswith("; \u00e4") for line in out)
    for line in ("G1 X20 \u00e4", "(a) \u00e4 (b)", "M117 \u00e4"):
        with pytest.raises(InputError, match="no printable ASCII"):
            rewritten(f"G0 X0 Y10 Z-60\n{line}\n", dialect="printer" if line[0] == "M" else "iso")
