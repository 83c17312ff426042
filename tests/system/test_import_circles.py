"""Raw traces of a ballbar into a survey: commanded positions, direction of travel, names, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from errormodel import InputError, read_machine, read_survey
from identification import import_survey
from tests.helpers.circles import RADIUS, circles, trace
from tests.helpers.commands import run

MILL = "vertical_three_axis"
MACHINE = read_machine(MILL)
CENTRE = {"X": 0.0, "Y": 0.0, "Z": 375.0}  # the middle of the travels


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    table = circles(MACHINE, {}, np.random.default_rng(1), noise=3e-4)
    for plane, part in table.groupby("plane"):
        (tmp_path / f"{plane}.csv").write_text(trace(part, str(plane)))
    return tmp_path


def test_commands_sides_and_readings_are_those_of_the_test(folder: Path) -> None:
    """Positions, directions (at reversals that of arrival) and deviations as the simulation had them, to its digits."""
    table = circles(MACHINE, {}, np.random.default_rng(1), noise=3e-4)
    result = import_survey([folder / f"{p}.csv" for p in ("XY", "YZ", "ZX")], MILL, centre=CENTRE)
    own = result.survey.table
    assert len(own) == len(table)
    # angles have four decimals of a degree
    np.testing.assert_allclose(own[["X", "Y", "Z"]], table[["X", "Y", "Z"]], atol=RADIUS * np.radians(1e-4))
    np.testing.assert_allclose(own["length"], table["length"], atol=1e-7)
    assert own["observation"].tolist() == table["plane"].tolist()
    # the file goes on to where the other sense begins: only the simulation knows that this was another start
    begins = table.index.to_numpy() % 360 == 180
    for joint in "XYZ":
        known = table[f"dir_{joint}"].notna().to_numpy() & ~begins
        np.testing.assert_array_equal(own[f"dir_{joint}"][known], table[f"dir_{joint}"][known])
    assert {k: o.calibrated for k, o in result.survey.observations.items()} == dict.fromkeys(("XY", "YZ", "ZX"), RADIUS)  # type: ignore[attr-defined]
    assert set(own["feed"]) == {1000.0}


def test_a_correction_is_a_line_of_the_map(folder: Path) -> None:
    """Another zero of the angle, and angles that count the other way, are keys of the circle."""
    import_survey(folder / "XY.csv", MILL, centre=CENTRE).save(folder / "s")
    text = (folder / "s/survey.yaml").read_text()
    plain = read_survey(folder / "s", MACHINE).table
    (folder / "s/survey.yaml").write_text(text.replace("    circle:\n", "    circle:\n      start: 90\n"))
    turned = read_survey(folder / "s", MACHINE).table
    np.testing.assert_allclose(turned["Y"], plain["X"], atol=1e-9)
    np.testing.assert_allclose(turned["X"], -plain["Y"], atol=1e-9)
    np.testing.assert_array_equal(turned["dir_Y"], plain["dir_X"])
    (folder / "s/survey.yaml").write_text(text.replace("    circle:\n", "    circle:\n      plane: YX\n"))
    swapped = read_survey(folder / "s", MACHINE).table
    np.testing.assert_allclose(swapped[["Y", "X"]], plain[["X", "Y"]], atol=1e-9)


def test_traces_of_one_plane_have_a_ball_each(folder: Path) -> None:
    (folder / "second.csv").write_text((folder / "XY.csv").read_text())
    result = import_survey([folder / "XY.csv", folder / "second.csv", folder / "ZX.csv"], MILL, centre=CENTRE)
    assert [*result.survey.observations] == ["XY", "second", "ZX"]


def test_turning_back_at_an_angle_is_part_of_the_way_back(tmp_path: Path) -> None:
    """Where the bar stands while the sense changes, no side of arrival is undefined."""
    angles = [0, 60, 120, 180, 240, 300, 360, 360, 300, 240, 180, 120, 60, 0]
    rows = "\n".join(f"{a},{0.1 * k}" for k, a in enumerate(angles))
    (tmp_path / "t.csv").write_text(f"Radius: 150 mm\nPlane XY\nAngle [deg],Deviation [um]\n{rows}\n")
    own = import_survey(tmp_path / "t.csv", MILL, centre=CENTRE).survey.table
    assert own["dir_Y"].tolist() == [1, 1, -1, -1, -1, 1, 1, -1, -1, 1, 1, 1, -1, -1]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ([], "--centre X=..,Y=..,Z=.."),
        (["--centre", "X=0,Y=0"], "no position of Z"),
        (["--centre", "X=0,Y=0,Z=300,W=1"], "no joint 'W'"),
        (["--centre", "X=0,Y=0,Z=high"], "Write numbers"),
        (["--centre", "X=0,Y=0,Z=300", "--plane", "XA"], "no linear joint 'A'"),
        (["--centre", "X=0,Y=0,Z=300", "--plane", "xy"], "Write --plane XY"),
        (["--radius", "150"], "no centre of the circle"),
    ],
)
def test_what_is_not_said_of_a_circle_is_asked_for(folder: Path, options: list[str], says: str) -> None:
    result = run("import", folder / "XY.csv", "--machine", MILL, *options, "--out", folder / "s")
    assert result.code == 2
    assert says in result.err
    assert "Traceback" not in result.err
    assert not (folder / "s").exists()


def test_deviations_of_no_circle_and_traces_without_a_plane_are_refused(folder: Path) -> None:
    text = (folder / "XY.csv").read_text()
    (folder / "mm.csv").write_text(text.replace("[um]", "[mm]"))
    with pytest.raises(InputError, match="none of a circle of 150 mm"):
        import_survey(folder / "mm.csv", MILL, centre=CENTRE)
    (folder / "no.csv").write_text(text.replace("Plane XY\n", ""))
    with pytest.raises(InputError, match="no plane of the circle"):
        import_survey(folder / "no.csv", MILL, centre=CENTRE)


def test_a_column_of_directions_is_that_of_the_joint_that_moves(tmp_path: Path) -> None:
    rows = [(x, s) for s, row in (("+", range(-300, 301, 60)), ("-", range(300, -301, -60))) for x in row]
    text = "X;Y;Z;direction;mx\n"
    text += "".join(f"{x};0;300;{s};{x + 0.001 * k}\n" for k, (x, s) in enumerate(rows))
    (tmp_path / "line.csv").write_text(text)
    result = import_survey(tmp_path / "line.csv", MILL)
    assert result.survey.table["dir_X"].tolist() == [1.0] * 11 + [-1.0] * 11
    (tmp_path / "line.csv").write_text(text.replace(";-;", ";left;", 1))
    with pytest.raises(InputError, match="'left' as a direction"):
        import_survey(tmp_path / "line.csv", MILL)
    (tmp_path / "two.csv").write_text(text.replace(";0;300;", ";10;300;", 1).replace(";300;", ";301;", 1))
    several = import_survey(tmp_path / "two.csv", MILL)  # of two joints no one knows which it is of
    assert not [c for c in several.survey.table if str(c).startswith("dir_")]
    assert any("direction" in note for note in several.notes)


def directed(text: str, words: list[str]) -> str:
    """The trace with a column of directions."""
    head, _, rows = text.partition("Deviation [um]\n")
    lines = "".join(f"{row},{word}\n" for row, word in zip(rows.splitlines(), words, strict=True))
    return f"{head}Deviation [um],Richtung\n{lines}"


def test_a_sense_that_the_file_itself_states_otherwise_is_refused(folder: Path) -> None:
    text, words = (folder / "XY.csv").read_text(), ["CCW"] * 180 + ["CW"] * 180
    (folder / "t.csv").write_text(directed(text, words))
    right = import_survey(folder / "t.csv", MILL, centre=CENTRE).survey.table
    (folder / "t.csv").write_text(directed(text, words[::-1]))
    with pytest.raises(InputError, match="CW where the angle grows from X to Y"):
        import_survey(folder / "t.csv", MILL, centre=CENTRE)
    # what the message says: angles that count clockwise from X, exported as they are
    mirrored = [f"{(360 - float(a)) % 360:.4f},{d}" for a, d in (r.split(",") for r in text.splitlines()[4:])]
    (folder / "t.csv").write_text(directed("\n".join([*text.splitlines()[:4], *mirrored]), words))
    own = import_survey(folder / "t.csv", MILL, centre=CENTRE, plane="YX", start=90).survey.table
    np.testing.assert_allclose(own[["X", "Y"]], right[["X", "Y"]], atol=1e-3)
    (folder / "t.csv").write_text(directed(text, words[40:] + words[:40]))
    with pytest.raises(InputError, match=r"line 145, column Richtung: CW where the angle grows, unlike"):
        import_survey(folder / "t.csv", MILL, centre=CENTRE)


def test_readings_in_other_rows_and_two_balls_are_refused(folder: Path) -> None:
    lines = (folder / "XY.csv").read_text().splitlines()
    rows = [r.split(",") for r in lines[4:]]

    def refused(deviations: list[str], says: str) -> None:
        own = [f"{a},{d}" for (a, _), d in zip(rows, deviations, strict=True)]
        (folder / "t.csv").write_text("\n".join([*lines[:4], *own]) + "\n")
        with pytest.raises(InputError, match=says):
            import_survey(folder / "t.csv", MILL, centre=CENTRE)

    plain = [d for _, d in rows]
    low, high = (plain.index(pick(plain, key=float)) for pick in (min, max))
    other = plain.copy()
    other[low], other[high] = plain[high], plain[low]
    first, second = sorted((low + 5, high + 5))
    refused(other, f"readings of lines {first} and {second} are exchanged")
    refused(plain[25:] + plain[:25], "stand 25 rows early beside their angles")
    moved = [float(d) + 40 * np.cos(np.radians(float(a))) * (k >= 180) for k, (a, d) in enumerate(rows)]
    refused([f"{d:.4f}" for d in moved], "the ball lies 39.6 um apart in the two senses: it was set anew")


def test_arcs_gaps_and_one_ball_are_said(folder: Path) -> None:
    lines = (folder / "XY.csv").read_text().splitlines()
    (folder / "arc.csv").write_text("\n".join([*lines[:50], *lines[52:134]]) + "\n")
    (told,) = trace_lines_of(folder / "arc.csv")
    assert "counter-clockwise 258 of 360 degrees only: an arc" in told
    assert "a gap of 6 degrees at 90" in told


def trace_lines_of(path: Path) -> list[str]:
    return [t.line for t in import_survey(path, MILL, centre=CENTRE).imported.traces]


def test_an_angle_that_counts_otherwise_shows_by_the_ball_of_three_circles(tmp_path: Path) -> None:
    table = circles(MACHINE, {}, np.random.default_rng(1), noise=3e-4, ball=np.array([0.03, -0.02, 0.01]))
    for plane, part in table.groupby("plane"):
        (tmp_path / f"{plane}.csv").write_text(trace(part, str(plane)))
    files = [tmp_path / f"{p}.csv" for p in ("XY", "YZ", "ZX")]
    assert "the circles show one ball, within 0." in import_survey(files, MILL, centre=CENTRE).summary()
    part = table[table["plane"] == "XY"]
    files[0].write_text(trace(part.assign(angle=(part["angle"] + 90) % 360), "XY"))
    result = import_survey(files, MILL, centre=CENTRE)
    (warning,) = [n for n in result.notes if "balls" in n]
    assert "that of XY as with --start 270" in warning


def test_angles_of_both_directions_in_growing_order_take_theirs_from_the_column(folder: Path) -> None:
    """Many programs list each direction from 0 to 360 degrees: the words say which way it was run."""
    text, words = (folder / "XY.csv").read_text(), ["G3"] * 180 + ["G2"] * 180
    lines = text.splitlines()
    right = import_survey(folder / "XY.csv", MILL, centre=CENTRE).survey.table
    sorted_rows = [*lines[4:184], *lines[184:][::-1]]
    (folder / "t.csv").write_text(directed("\n".join([*lines[:4], *sorted_rows]) + "\n", words))
    result = import_survey(folder / "t.csv", MILL, centre=CENTRE)
    assert "the direction of travel is that of the column Richtung" in result.summary()
    own = result.survey.table
    np.testing.assert_allclose(own["length"].to_numpy()[180:], right["length"].to_numpy()[180:][::-1])
    inner = slice(185, 355)  # where the direction turns, rows may count to either
    np.testing.assert_array_equal(own["dir_X"].to_numpy()[inner], right["dir_X"].to_numpy()[::-1][5:175])
    # readings of one direction at the mirrored angles: the ball is elsewhere
    mirrored = [f"{a.split(',')[0]},{b.split(',')[1]}" for a, b in zip(lines[4:184], lines[184:], strict=True)]
    (folder / "t.csv").write_text(directed("\n".join([*lines[:184], *mirrored]) + "\n", words))
    with pytest.raises(InputError, match=r"the ball lies .* um apart in the two senses"):
        import_survey(folder / "t.csv", MILL, centre=CENTRE)


def test_a_positioning_test_beside_circles_needs_no_angles(folder: Path) -> None:
    rows = [f"{x},{side},{0.001 * (x > 0):.4f}" for side in (1, -1) for x in range(-200, 201, 50)[::side]]
    (folder / "laser.csv").write_text("Axis: X\ntarget [mm],direction,deviation [mm]\n" + "\n".join(rows) + "\n")
    own = import_survey([folder / "XY.csv", folder / "laser.csv"], MILL, centre=CENTRE).survey.table
    assert own["length"].notna().sum() == 360
    assert own["dx"].notna().sum() == len(rows)
    with pytest.raises(InputError, match="a circle is stated, and no angles"):
        import_survey(folder / "laser.csv", MILL, centre=CENTRE)
