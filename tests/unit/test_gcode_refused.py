"""Programmes that are refused as a whole, with line and word: what is not understood, not known or out of reach."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from errormodel.exceptions import InputError
from errormodel.gcode.programme import Source
from errormodel.gcode.reading import Reading
from tests.helpers.gcode_trial import READING, SETUP, TARGET, smooth, written

G = TARGET
HEAD = "G0 X0 Y100 Z-60\n"


def refusal(text: str, dialect: str = "auto", offsets: tuple[str, ...] = (), after: tuple[str, ...] = ()) -> str:
    with pytest.raises(InputError) as error:
        G.rewrite("a.nc", text, SETUP, smooth, Reading.of(dialect, offsets, after))
    return str(error.value)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("G1 X#1", "a variable"),
        ("#1=5", "a variable"),
        ("G1 X[10+5]", "an expression"),
        ("G1 X-[5]", "sign without a number"),
        ("G1 X10,5", "a decimal comma"),
        ("G1 X10 ,R5", "a corner or chamfer (,R)"),
        ("G1 X10,C5", "a corner or chamfer (,C)"),
        ("G1 X1.2.3", "two decimal points"),
        ("G1 X", "X without a number"),
        ("G1 X-", "sign without a number"),
        ("G1 X10 Y", "Y without a number"),
        ("G1 X10 X20", "X twice"),
        ("G1 X10 F100 F200", "F twice"),
        ("G0 G1 X10", "G0 and G1 in one block"),
        ("G90 G91 G1 X10", "G90 and G91 in one block"),
        ("M3 M5", "M3 and M5 in one block"),
        ("G1 X1 0", "the character '0'"),
        ("G1 X10 Q5", "Q5 is not understood"),
        ("G1 X10 P5", "P5 is not understood"),
        ("G1 A10", "the machine has no axis A"),
        ("G1 X10 R5", "R without an arc"),
        ("G1 X10 I5", "I without an arc"),
        ("G1 X10 $", "the character '$'"),
        ("G1 X1e3", "E directly behind a number"),
        ("G1 X10\u00a0Y5", "no printable ASCII"),
        ("G1 X10 (a\x0bG0 Z-51)", "no printable ASCII"),
        ("G1 \u0425 10", "no printable ASCII"),
        ("G1 X\u0661", "no printable ASCII"),
        ("\u017f500", "no printable ASCII"),
        ("G1 X10\rG0 Z-51", "no printable ASCII"),
        ("G1 X10 (never ends", "without its end"),
        ("G1 X10 (a (b) c)", "a comment within another"),
        ("G1 X10 )", "a bracket that nothing opens"),
        ("G1 X10 /M8", "a '/' within the block"),
        ("/2 G1 X10", "a numbered block delete"),
        ("G1 N5 X10", "N5 is not understood"),
        ("N5.1 G1 X10", "N5.1 is not understood"),
        ("%\nG1 X10", "a '%' within the programme"),
        ("O100 sub", "a subprogramme"),
        ("o<part> call", "a call of the subprogramme O<part>, which is not above it"),
        ("o<part> sub", "a subprogramme without its end"),
        ("O100 sub\nO100 sub", "a subprogramme within another"),
        ("O100 sub\nO100 endsub\nO100 sub\nO100 endsub", "a second time"),
        ("O100 sub\nO100 return\nO100 endsub\nO100 call", "O-word (return)"),
        ("O100 sub\nO100 call\nO100 endsub\nO100 call", "calls itself"),
        ("O100 sub\nO100 endsub\nO100 call [5]", "a call with arguments"),
        ("O100 sub\nO100 endsub\n/O100 call", "or an optional one"),
        ("O100 while", "O-word (while)"),
        ("O100 sub\nG1 X#1\nO100 endsub\nO100 call", "a variable"),
        ("O2000", "a subprogramme"),
        ("M98 P100", "a subprogramme call (M98)"),
        ("M99", "a return from a subprogramme"),
        ("G65 P9000", "a macro call"),
        ("G68 X0 Y0 R30", "rotation"),
        ("G51 X0 Y0 P2", "scaling"),
        ("G52 X100", "a local coordinate shift"),
        ("G92 X0", "a shift of the coordinates"),
        ("G10 L2 P1 X5", "data setting"),
        ("G54.1 P3", "an additional work offset"),
        ("G16", "polar coordinates"),
        ("G33 Z-90 F1", "threading"),
        ("G5 X10", "a spline"),
        ("G5.1 Q1", "a spline or look-ahead"),
        ("G38.2 Z-90", "probing"),
        ("G31 Z-90", "skipping or probing"),
        ("G41 D1", "cutter radius compensation"),
        ("G42 D1 X5", "cutter radius compensation"),
        ("G98 G81 Z-70 R-55", "the tool below its level R"),
        ("G98 G83 Z-70 R-65", "G83 without Q"),
        ("G98 G83 Z-70 R-65 Q0", "G83 with Q0"),
        ("G98 G83 Z-70 R-65 Q-2", "G83 with Q-2"),
        ("G98 G83 Z-70 R-65 Q0.001", "a depth of each peck"),
        ("G98 G82 Z-70 R-65", "G82 without P"),
        ("G98 G81 X5 Y110", "G81 without Z, R"),
        ("G98 G81 X5 R-65", "G81 without Z"),
        ("G98 G81 Z-60 R-65", "with Z above R"),
        ("G98 G81 Z-70 R-65 Q2", "Q2 in G81"),
        ("G98 G81 X5 Z-70 R-65\nZ-71", "without X and Y"),
        ("G98 G81 X5 Z-70 R-65 L3", "repeated at one place"),
        ("G91 G98 G81 X5 Z-7 R-2 L0", "such a number of repeats"),
        ("G91 G98 G81 X5 Z-7 R-2 L2.5", "such a number of repeats"),
        ("G98 G81 X5 Z-70 R-65 K3", "K3 in the block"),
        ("G98 G81 X5 Z-70 R-65 M0", "M0 in the block"),
        ("G98 G81 X5 Z-70 R-65 M5", "M5 in the block"),
        ("G98 G81 X5 Z-70 R-65 G20", "G20 in the block"),
        ("G17 G98 G81 X5 Z-70 R-65", "G17 in the block"),
        ("G18\nG98 G81 X5 Z-70 R-65", "another plane than G17"),
        ("G93\nG98 G81 X5 Z-70 R-65 F1", "inverse time"),
        ("G98 G81 X5 Z-70 R-65\nG53 G0 Z-60", None),
        ("G98 G81 X5 Z-70 R-65\nG28 Z-60", "G28 in the block of a canned cycle"),
        ("G98 G81 X5 Z-70 R-65\nG91 X5", "G90 and G91 within a series"),
        ("G91 G99 G81 X5 Z-7 R-2\nX5", "whose levels controls count differently"),
        ("G91 G99 G81 X5 Z-7 R-2\nG98\nX5", "whose levels controls count differently"),
        ("G81 X5 Z-70 R-65", "without G98 or G99"),
        ("G99 G81 X5 Z-70 R-65\nG98 X9", "in one rapid"),
        ("G98 G81 X5000 Z-70 R-65", "beyond its travel"),
        ("G98 G81 X5 Z-70 R-65\nG80\nX10", "positions without G0"),
        ("G84 Z-70 R-65", "a canned cycle (G84)"),
        ("G76 Z-70 R-65", "a canned cycle (G76)"),
        ("G43.4 H1", "tool centre point control"),
        ("G43 Z-55", "a tool length without H"),
        ("G43 H1 Z-55", "the tool length H1 is not known"),
        ("G44 H1", "a negative tool length"),
        ("G1 X10 H1", "H1 is not understood"),
        ("G1 X10 F0", "F0"),
        ("G93 G1 X10 F2\nG94 G1 X20", "since the inverse time (G93) ended"),
        ("G54\nG1 X10", "the work offset G54 is not known"),
        ("G123", "G123 is not understood"),
        ("G1.5 X10", "G1.5 is not understood"),
        ("M123", "M123 is not understood"),
        ("M6 X10", "M6 in a block that moves"),
        ("G28 G1 X10", "G28 and G1 in one block"),
        ("G28 X50\nG91 G28 Y5", "runs through another point"),
        ("G4 X2", "G4 with X"),
        ("G80\nX10", "positions without G0"),
        ("G53 G1 X10", "G53 that is no absolute rapid"),
        ("G53 X10", "G53 that is no absolute rapid"),
        ("G91 G0 G53 X10", "G53 that is no absolute rapid"),
        ("G1 X5000", "X at 5000.0000 (position of the axis), beyond its travel -200 to 400"),
        ("G0 X5000", "beyond its travel"),
        ("G91 G1 X399", None),
        ("G91 G1 X401", "beyond its travel"),
        ("G20 G1 X20", "X at 508.0000"),
        ("G1 X" + "9" * 400, "too large a number"),
        ("G3 X0 Y101 R-150", "beyond its travel"),  # between its ends
        ("G53 G0 Z0", "Z at 0.0000"),
        ("G1 Z-50", "Z at -49.9"),  # with its correction
        ("G2 X10 Y100", "an arc without a centre"),
        ("G2 X10 Y100 I5 R5", "a radius and a centre"),
        ("G2 X10 Y100 I5 J1 K2", "K in the plane G17"),
        ("G2 X10 Y100 I5.1", "end is not on its circle (radius 5.1000 mm at the start, 4.9000 at the end)"),
        ("G2 X10 Y110 R5", "ends are 14.1421 mm apart"),
        ("G2 X0 Y100 R5", "whose end is its start"),
        ("G2 X10 Y100 I0 J0", "an arc of radius 0.0000"),
        ("G90.1 G2 X10 Y100 I5", "an arc without a centre"),
        ("G93 G1 X10", "a cut without F"),
        ("G93 G1 X10 F0", "F0"),
        ("G1 X10 F-5", "a negative feed"),
        ("G61\nG1 X300", "exact stop"),
        ("G1 X300 M5", "M5 in a cut that has to be divided"),
        ("M30\nG1 X10", "behind the programme's end"),
        ("X10", None),
        ("G1 x10 f100 (lower case)", None),
    ],
)
def test_a_line_that_is_not_understood_refuses_the_programme(line: str, words: str | None) -> None:
    if words is None:
        G.rewrite("a.nc", HEAD + line + "\n", SETUP, smooth, Reading())
        return
    message = refusal(HEAD + line + "\n")
    assert words in message, message
    assert any(f"a.nc, line {k}" in message for k in (2, 3, 4))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0 BEGIN PGM TEST MM\n1 L X+10 R0 FMAX\n", "Heidenhain programmes are not read here"),
        ("1 L X+10 R0 F1000\n", "Heidenhain programmes are not read here"),
        ("L X+10 Y-5 FMAX\n", "Heidenhain programmes are not read here"),
        ("TRAORI\n", "tool centre point control (TRAORI)"),
        (HEAD + "CIP X10 I1=5\n", "Siemens programmes are not read here"),
        (HEAD + "G1 X=IC(5)\n", "Siemens programmes are not read here"),
        (HEAD + "G2 X10 CR=5\n", "Siemens programmes are not read here"),
        (HEAD + "R1=5\n", "Siemens programmes are not read here"),
        (HEAD + "SUPA G0 Z0\n", "Siemens programmes are not read here"),
        ("M104 S200\nG54\nG1 X5 E1\n", "words of 3-D printers (Marlin, Klipper, RepRapFirmware), and in line 2"),
        ("O1000\nG64 P0.1\n", "words of RS274/NGC"),
        ("G0 X10. Y100. Z-60.\nG1 X20 F100\n", "counts in least increments"),
        ("O1000\nG0 X10 Y100. Z-60.\n", "X10 without a decimal point"),
        ("O1000\nG0 X10. Y100. Z-60. ; X20.\n", "text behind ';'"),
        ("", "the programme is empty"),
    ],
)
def test_a_dialect_that_is_not_read_or_not_certain_is_refused(text: str, words: str) -> None:
    assert words in refusal(text)


def test_dialects_that_are_asked_for() -> None:
    whole = "G0 X10. Y100. Z-60.\nG1 X20 F100\n"
    assert "X20.0" in G.rewrite("a.nc", whole, SETUP, smooth, Reading.of("iso")).text
    assert "without a decimal point" in refusal(whole, "fanuc")
    assert "Siemens programmes are not read here" in refusal(whole, "siemens")
    assert "Did you mean 'fanuc'" in refusal(whole, "fanux")
    tape = "%\nO0012 (PART)\nG21 G90\nG0 X10. Y100. Z-60.;\nG04 X2.\nG1 X20. F100;\nM30\n%\n"
    out = G.rewrite("a.nc", tape, SETUP, smooth, Reading()).text.splitlines()
    assert out[:3] == ["%", "O0012 (PART)", "G21 G90"]
    assert out[4] == "G04 X2."


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("X10 Y20", "X10 where a command belongs"),
        ("G1 X10 G4 P5", "two commands in one line"),
        ("N5 G1 X10", "a line number"),
        ("G1 X10*57", "a checksum"),
        ("G92 X0", "G92 with other words"),
        ("G10 P1", "P1 is not understood"),
        ("/G1 X10", "which printers do not know"),
        ("G1 X10 (text)", "the character '('"),
        ("START_PRINT BED=60", "START_PRINT is not understood"),
        ("PRINT_START", "PRINT_START is not understood"),
        ("M600", "M600 is not understood"),
        ("G5 X1 Y1", "a spline"),
        ("G1 X10E5", "E directly behind a number"),
        ("T1\nG1 X5 E1", "not known here since T in line 6"),
        ("G29\nG1 X5 E1", "not known here since G29 in line 6"),
    ],
)
def test_what_printers_do_not_read_is_refused(line: str, words: str) -> None:
    head = "M83\nM104 S200\nG0 X0 Y100\nG0 Z-60\nG1 X1 E0.1\n"
    assert words in refusal(head + line + "\n")
    allowed = G.rewrite("a.nc", head + "M600 B3\nSTART_PRINT A=1\nG1 X5 E1\n", SETUP, smooth,
                        Reading.of(after=("M600=stay", "START_PRINT=X1,Y100,Z-60"))).text  # fmt: skip
    assert "M600 B3\nSTART_PRINT A=1\n" in allowed


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"offsets": ("G54",)}, "no letter with a number"),
        ({"offsets": ("G53=X0",)}, "no letter with a number"),
        ({"offsets": ("G54=X1,X2",)}, "there twice"),
        ({"offsets": ("G54=X1", "G54=X2")}, "given twice"),
        ({"offsets": ("X1e3",)}, "no letter with a number"),
        ({"offsets": ("Q5",)}, "no such axis"),
        ({"offsets": ("Z10",)}, "no X, Y, which counts"),
        ({"offsets": ("X1,Y2,Z3", "H1=X80")}, "no Z, which counts"),
        ({"after": ("G1=stay",)}, "it names no start"),
        ({"after": ("M98",)}, "it names no start"),
        ({"after": ("start=stay,",)}, "no letter with a number"),
        ({"after": ("start=X0", "start=X1")}, "given twice"),
        ({"offsets": ("G55=X0,Y0,Z0",)}, "the work offset that is active here is not known"),
    ],
)
def test_options_that_cannot_be_read_are_refused(options: dict[str, tuple[str, ...]], words: str) -> None:
    assert words in refusal(HEAD, **options)


def test_two_statements_of_an_offset_are_refused() -> None:
    stated = "(ERRORMODEL OFFSET X100)\n"
    assert "stated twice" in refusal(stated + HEAD, offsets=("X5",))
    assert "stated twice" in refusal(stated + stated + HEAD)
    assert "no letter with a number" in refusal("(ERRORMODEL OFFSET X1,5)\n" + HEAD)
    assert "M98" in refusal(HEAD + "M98 P1\n", after=("M98=stay",))  # a call is never harmless


JUNK = "!\"#$&'*+,-./:<=>?@[\\]^_`{|}~\u00e9\u2028\x00\x0b\x85QDLUVWE"


@given(seed=st.integers(0, 400), where=st.floats(0, 1), junk=st.sampled_from(JUNK), twice=st.booleans())
@settings(max_examples=150, deadline=None)
def test_a_character_that_does_not_belong_refuses_the_programme(
    seed: int, where: float, junk: str, twice: bool
) -> None:
    """Between two words of a block that moves; a sign or point beside digits could make another number, and a letter
    another word: what is inserted here can be neither."""
    text, _ = written(4 * (seed // 4))
    lines = text.splitlines()
    moving = [k for k, line in enumerate(lines) if line.startswith(("G0 ", "G1 "))]
    assume(moving)
    k = moving[int(where * (len(moving) - 1))]
    code, rest = lines[k].split(" ", 1)
    lines[k] = f"{code} {junk * (2 if twice else 1)} {rest}"
    with pytest.raises(InputError):
        G.rewrite("a.nc", "\n".join(lines) + "\n", SETUP, smooth, READING)


@given(st.binary(min_size=1, max_size=200))
@settings(max_examples=200, deadline=None)
def test_bytes_are_refused_or_move_nothing(data: bytes) -> None:
    text = data.decode("latin-1")
    try:
        out = G.rewrite("a.nc", text, SETUP, smooth, Reading()).text
    except InputError:
        return
    assert out.rstrip("\n") == text.replace("\r\n", "\n").rstrip("\n")


@given(
    st.lists(st.sampled_from([*"GMXYZIJKFRSTNHE%/();#[]=,.+- ", *"0123456789", "\n", "G1 ", "X1", "G0 "]), max_size=60)
)
@settings(max_examples=300, deadline=None)
def test_text_of_the_same_letters_is_refused_or_checked(parts: list[str]) -> None:
    """What is written has passed the check; what is not ends in one message, never in a traceback."""
    message = ""
    try:
        done = G.rewrite("a.nc", HEAD + "".join(parts) + "\n", SETUP, smooth, Reading())
    except InputError as error:
        message = str(error)
    assert "Report this programme" not in message
    if message:
        return
    assert "executed and compared" in done.notes[0]
    assert np.isfinite(G.positions("a.nc", done.text, SETUP, Reading())[0]).all()


def test_a_programmes_number_and_whole_numbers_are_read_as_the_user_says() -> None:
    """O and a number at the head of any mill's programme; whole numbers in mm, or in increments of G21 and G20."""
    tape = "%\nO1000\nN10 G21 G90\nG0 X10 Y100. Z-60000\nG4 P2000\nG1 X20500 F100\nG20\nG1 X10000\nM30\n%\n"
    assert "--dialect fanuc-calculator" in refusal(tape)
    steps = Source.of("a.nc", tape, Reading.of("fanuc-increments", (), ("start=X0,Y0,Z0",))).steps(SETUP)
    ends = [s.path.end for s in steps if s.path is not None]
    assert ends[0][:3].tolist() == [0.01, 100.0, -60.0]
    assert ends[1][0] == 20.5
    assert ends[2][0] == pytest.approx(25.4)
    calculator = tape.replace("60000", "60").replace("20500", "20").replace("10000", "1")
    for dialect in ("fanuc-calculator", "iso"):
        own = Source.of("a.nc", calculator, Reading.of(dialect, (), ("start=X0,Y0,Z0",))).steps(SETUP)
        assert next(s.path.end for s in own if s.path is not None)[:3].tolist() == [10.0, 100.0, -60.0]


def test_all_offsets_that_are_missing_are_said_at_once() -> None:
    told = refusal("G90 G0 G54 X10 Y10\nG43 H1 Z-55\nG1 X20\nG0 G55 X0 Y0\nG43 H7 Z-50\nM30\n")
    assert "the work offset G54 is not known" in told
    for name in ("G54=X..,Y..,Z..", "G55=X..,Y..,Z..", "H1=Z..", "H7=Z.."):
        assert told.count(f"--offset {name}") == 1
