"""Surveys: what is read, what is refused and in which words."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from errormodel.exceptions import InputError
from errormodel.files import write_csv, write_text_atomic
from errormodel.instruments.laser_tracker import LaserTracker
from errormodel.survey import Survey, read_survey
from tests.helpers.survey_files import JOINTS, MACHINE, poses, write, yaml

HEADER = "B,X,Y,Z,mx,my,mz"
ROW = "10,20,30,240,1,2,3"


# ---- bad input: every one is an InputError that says where, what and what to do


BAD = {
    "empty file": ("", "", "empty file", "header"),
    "blank lines only": ("\n\n  \n", "", "empty file", "header"),
    "header only": (f"{HEADER}\n", "", "no rows", "row a pose"),
    "header without an end": (HEADER, "", "no rows", "row a pose"),
    "only empty rows": (f"{HEADER}\n,,,,,,\n", "", "no rows", "row a pose"),
    "no header": (f"{ROW}\n{ROW}\n", "header (line 1)", "numbers where the columns' names belong", "names above"),
    "separated by blanks": ("B X Y Z mx my mz\n1 2 3 4 5 6 7\n", "header (line 1)", "one column", "commas"),
    "missing joint": ("B,X,Z,mx,my,mz\n1,2,3,4,5,6\n", "header", "no column for the joint 'Y'", "columns: {Y:"),
    "joint in lower case": ("B,x,Y,Z,mx\n1,2,3,4,5\n", "header", "the nearest is 'x'", 'columns: {X: "x"}'),
    "nothing measured": ("B,X,Y,Z\n1,2,3,400\n", "header", "no measured column", "mx my mz"),
    "measured under another name": ("B,X,Y,Z,X_meas\n1,2,3,400,5\n", "header", "looks like 'mx'", "Found: B, X"),
    "motions without joint": ("B,X,Y,Z,dx\n1,2,3,400,5\n", "header", "need a column 'joint'", "mx my mz"),
    "nothing in any row": (f"{HEADER}\n1,2,3,400,,,\n", "", "nothing measured", "Fill in"),
    "name twice": ("B,X,Y,Z,mx,mx\n1,2,3,4,5,6\n", "header", "'mx' stands above columns 5 and 6", "of its own"),
    "text in a number": (f"{HEADER}\n{ROW}\n1,2,3,4,5,abc,7\n", "row 2 (line 3), column my", "'abc' is not", "number"),
    "text in a command": (f"{HEADER}\n\n1,2,3,x4,5,6,7\n", "row 1 (line 3), column Z", "'x4' is not", "a number"),
    "inf command": (f"{HEADER}\n{ROW}\n1,inf,3,4,5,6,7\n", "row 2 (line 3), column X", "inf", "finite"),
    "inf measured": (f"{HEADER}\n1,2,3,4,5,-inf,7\n", "row 1 (line 2), column my", "-inf", "finite"),
    "too large for a double": (f"{HEADER}\n1,2,3,4,5,1e999,7\n", "row 1 (line 2), column my", "inf", "finite"),
    "empty command": (f"{HEADER}\n{ROW}\n1,2,,4,5,6,7\n", "row 2 (line 3), column Y", "no commanded", "every row"),
    "NaN command": (f"{HEADER}\n1,2,NaN,4,5,6,7\n", "row 1 (line 2), column Y", "no commanded", "every row"),
    "placeholder": (f"{HEADER}\n1,2,3,4,5,6,1e30\n", "row 1 (line 2), column mz", "1e+30", "empty"),
    "short row": (f"{HEADER}\n{ROW}\n1,2,3\n", "row 2 (line 3)", "3 fields where the header has 7", "one field"),
    "long row": (f"{HEADER}\n{ROW},9\n", "row 1 (line 2)", "8 fields", "semicolons"),
    "quoted decimal comma": (f'{HEADER}\n1,2,3,4,"5,5",6,7\n', "column mx", "'5,5' is not a number", "a number"),
    "a cell of two lines": (f'{HEADER}\n1,2,3,4,"a\nb",6,7\n', "row 1 (line 2), column mx", "'a b' is not", "number"),
    "thousands": ("B;X;Y;Z;mx\n1;2;3,5;4;1.234\n", "column mx", "'1.234' in a file with another", "Write 1234"),
    "latin-1 in the header": (f"{HEADER},T_au\xdfen\n{ROW},20\n".encode("latin-1"), "header", "not UTF-8", "UTF-8"),
    "latin-1 in a cell": (f"{HEADER},run\n{ROW},a\n{ROW},\xe4\n".encode("latin-1"), "line 3", "0xe4", "UTF-8"),
    "UTF-16": (f"{HEADER}\n{ROW}\n".encode("utf-16"), "", "UTF-16", "UTF-8"),
    "binary": (b"PK\x03\x04\x00\x00\x00", "", "not a text file", "CSV"),
    "sigma 0": (f"{HEADER},sigma\n{ROW},0\n", "row 1 (line 2), column sigma", "0 as a standard", "above 0"),
    "sigma negative": (f"{HEADER},sigma_y\n{ROW},-1e-3\n", "column sigma_y", "-0.001", "above 0"),
    "direction 0": (f"{HEADER},dir_X\n{ROW},1\n{ROW},0\n", "row 2 (line 3), column dir_X", "0 as", "+1 or -1"),
    "time as text": (f"{HEADER},time\n{ROW},noon\n", "column time", "'noon'", "seconds, or dates such as"),
    "time with a gap": (f"{HEADER},time\n{ROW},1\n{ROW},\n", "row 2 (line 3), column time", "no time", "a time"),
    "time a wrong date": (f"{HEADER},time\n{ROW},2024-03-12\n{ROW},2024-13-12\n", "row 2", "'2024-13-12'", "dates"),
    "time infinite": (f"{HEADER},time\n{ROW},inf\n", "column time", "inf", "finite"),
    "run with a gap": (f"{HEADER},run\n{ROW},a\n{ROW},\n", "row 2 (line 3), column run", "no label", "a run"),
    "temperature as text": (f"{HEADER},T_bed\n{ROW},warm\n", "column T_bed", "'warm' is not a number", "empty"),
    "part of an orientation": (f"{HEADER},mrx,mry\n{ROW},0,0\n", "header", "without mrz", "all of them"),
    "gap in an orientation": (f"{HEADER},mrx,mry,mrz\n{ROW},0,,0\n", "column mry", "component missing", "none of them"),
    "orientation in degrees": (f"{HEADER},mrx,mry,mrz\n{ROW},90,0,0\n", "column mrx", "90", "rad"),
    "unknown joint": (f"{HEADER},joint,dx\n{ROW},,\n{ROW},x,0\n", "row 2 (line 3), column joint", "'x' is", "'X'?"),
    "joint without its position": ("joint,X,dx\nX,,0.001\n", "row 1 (line 2), column X", "no commanded", "of X"),
    "joint without its column": ("joint,X,dx\nX,1,0.001\nY,,0.001\n", "header", "joint 'Y'", "columns: {Y:"),
    "volumetric row without a joint": ("joint,X,dx,mx\nX,1,0.001,\n,2,,5\n", "header", "'B', 'Y' and 'Z'", "{B:"),
    "angle in urad": ("joint,X,ea\nX,1,12.5\n", "column ea", "12.5 rad", "1e-6"),
}  # fmt: skip


@pytest.mark.parametrize(("content", "where", "found", "cure"), BAD.values(), ids=BAD.keys())
def test_bad_table(tmp_path: Path, content: str, where: str, found: str, cure: str):
    path = write(tmp_path, content)
    with pytest.raises(InputError) as caught:
        read_survey(path, MACHINE)
    assert caught.value.where.startswith(str(path))
    assert where in caught.value.where
    assert found in caught.value.found
    assert cure in caught.value.cure
    assert "\n" not in str(caught.value)


BAD_YAML = {
    "unknown column": ('columns: {nx: "X meas"}', "line 3, key columns.nx", "not a column", "Did you mean 'mx'?"),
    "unknown joint": ("columns: {dir_Q: mx}", "line 3, key columns.dir_Q", "not a column", "dir_<joint>"),
    "no such column": (
        'columns: {mx: "Xmeas"}',
        "line 3, key columns.mx",
        "no file has a column 'Xmeas'",
        "Valid: B, X",
    ),
    "column used twice": ("columns: {mx: mx, my: mx}", "key columns", "mx", "a column each"),
    "unit": ("units: {length: furlongs_}", "key units.length", "furlongs_", "mm, um, m or inch"),
    "unit of another kind": ("units: {angle: percent}", "key units.angle", "percent", "deg, rad"),
    "unit of time": ("units: {time: mm}", "key units.time", "mm", "unit of time"),
    "frame": ("frame: per-day", "key frame", "per-day", "per-run"),
    "instrument": ("instrument: {type: laser}", "key instrument.type", "laser", "laser-tracker"),
    "no uncertainty": ("instrument: {type: cmm, sigma: [0, 0]}", "key instrument.sigma", "[0, 0]", "above 0"),
    "key": ("file: []", "line 3, key file", "unknown key", "files"),
}


@pytest.mark.parametrize(("extra", "where", "found", "cure"), BAD_YAML.values(), ids=BAD_YAML.keys())
def test_bad_survey_yaml(tmp_path: Path, extra: str, where: str, found: str, cure: str):
    write(tmp_path, f"{HEADER}\n{ROW}\n")
    with pytest.raises(InputError) as caught:
        read_survey(yaml(tmp_path, extra), MACHINE)
    assert where in caught.value.where
    assert found in caught.value.found
    assert cure in caught.value.cure


def test_bad_files(tmp_path: Path):
    good = write(tmp_path, f"{HEADER}\n{ROW}\n")
    with pytest.raises(InputError, match=r"t\.csv: no such file\. Did you mean 's\.csv'"):
        read_survey(tmp_path / "t.csv", MACHINE)
    with pytest.raises(InputError, match=r"a file of type '\.xlsx'.*\.csv"):
        read_survey(write(tmp_path, "", "s.xlsx"), MACHINE)
    with pytest.raises(InputError, match="not a readable Parquet file"):
        read_survey(write(tmp_path, "no parquet", "s.parquet"), MACHINE)
    with pytest.raises(InputError, match=r"both \.csv and \.parquet"):
        read_survey(tmp_path, MACHINE)
    with pytest.raises(InputError, match="only test files"):
        read_survey(yaml(tmp_path, files="[{path: s.csv, role: test}]"), MACHINE)
    with pytest.raises(InputError, match=r"key files: .*Name s\.csv once"):
        read_survey(yaml(tmp_path, files="[{path: s.csv}, {path: ./s.csv, role: test}]"), MACHINE)
    with pytest.raises(InputError, match=r"^gone\.csv: no such file"):
        read_survey(yaml(tmp_path, files="[{path: gone.csv}]"), MACHINE)
    (tmp_path / "none").mkdir()
    with pytest.raises(InputError, match=r"^gone\.csv: no such file$"):
        read_survey(yaml(tmp_path / "none", files="[{path: gone.csv}]"), MACHINE)
    (tmp_path / "none/survey.yaml").unlink()
    with pytest.raises(InputError, match="without a table"):
        read_survey(tmp_path / "none", MACHINE)
    parts = tmp_path / "parts"
    parts.mkdir()
    write(parts, good.read_text(), "1.csv")
    write(parts, f"{HEADER},time\n{ROW},1\n", "2.csv")
    with pytest.raises(InputError, match=r"parts/2\.csv, header: not the same columns as in .*: time"):
        read_survey(parts, MACHINE)
    write(parts, f"{HEADER}\n1,2,3,4,5,6,x\n", "2.csv")
    with pytest.raises(InputError, match=r"parts/2\.csv, row 1 \(line 2\), column mz: 'x'"):
        read_survey(parts, MACHINE)


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=80) | st.text(max_size=80).map(str.encode), st.booleans())
def test_never_a_traceback(tmp_path: Path, content: bytes, header: bool):
    write(tmp_path, HEADER.encode() + b"\n" + content if header else content)
    try:
        survey = read_survey(tmp_path / "s.csv", MACHINE)
    except InputError:
        return
    assert np.isfinite(survey.commands(JOINTS)).all()


# ---- good input in all its spellings


def values(survey: Survey) -> np.ndarray:
    return np.hstack([survey.commands(JOINTS), survey.measured, survey.tool])


@pytest.mark.parametrize(
    "content",
    [
        b"B,X,Y,Z,mx,my,mz\n10,20.5,30,240,1.5,,3\n20,21.5,31,250,-1.5,2,\n",
        b"\xef\xbb\xbfB,X,Y,Z,mx,my,mz\r\n10,20.5,30,240,1.5,,3\r\n20,21.5,31,250,-1.5,2,\r\n\r\n",
        b"B;X;Y;Z;mx;my;mz\n10;20,5;30;240;1,5;;3\n20;21,5;31;250;-1,5;2;",
        b"B;X;Y;Z;mx;my;mz\n10;20.5;30;240;1.5;;3\n20;21.5;31;250;-1.5;2;\n",
        b"B\tX\tY\tZ\tmx\tmy\tmz\n10\t20.5\t30\t240\t1.5\t\t3\n20\t21.5\t31\t250\t-1.5\t2\t\n",
        b" B , X,Y ,Z, mx,my,mz \n10, 20.5,30 ,240,1.5, ,3\n 20,21.5,31,+2.5e2,-1.5,2,NaN\n  \n",
        b'"B","X","Y","Z","mx","my","mz"\n"10","20.5","30","240","1.5","","3"\n"20","21.5","31","250","-1.5","2","nan"\n',
        b"\n\nmz,my,mx,Z,Y,X,B\n3,NA,1.5,240,30,20.5,10\n\n,2,-1.5,250,31,21.5,20\n,,,,,,\n",
        b'B,X,Y,Z,mx,my,mz,,comment\n10,20.5,30,240,1.5,,3,,"a, b"\n20,21.5,31,250,-1.5,2,,,\n',
        b"B,X,Y,Z,mx,my,mz\r10,20.5,30,240,1.5,,3\r20,21.5,31,250,-1.5,2,\r",
        b"B,X,Y,Z,mx,my,mz,tool_z\n10,20.5,30,240,1.5,,3,\n20,21.5,31,250,-1.5,2,,-150\n",
    ],
    ids=[
        "plain",
        "BOM",
        "decimal commas",
        "semicolons",
        "tabs",
        "blanks",
        "quotes",
        "order",
        "extra",
        "old Mac",
        "tool",
    ],
)
def test_spellings(tmp_path: Path, content: bytes):
    survey = read_survey(write(tmp_path, content), MACHINE)
    nan = np.nan
    expected = [[10, 20.5, 30, 240, 1.5, nan, 3, 1, 2, -150], [20, 21.5, 31, 250, -1.5, 2, nan, 1, 2, -150]]
    expected = np.array(expected)
    expected[:, 0] = np.deg2rad(expected[:, 0])
    np.testing.assert_array_equal(values(survey), expected)
    assert survey.frame == "shared"
    assert survey.refit == ("frame",)
    assert survey.instrument.covariance(survey.measured) is None
    assert list(survey.table["run"]) == ["1", "1"]
    assert list(survey.table["row"]) == [1, 2]
    notes = " ".join(survey.notes)
    assert ("decimal commas" in notes) == (b",5;" in content)
    assert ("separated by" in notes) == (
        b"mx,my" not in content and b'mx","my' not in content and b"my,mx" not in content
    )
    assert ("not used: comment" in notes) == (b"comment" in content)


def test_a_full_survey_yaml(tmp_path: Path):
    frame = poses(30).assign(run=[1.0] * 10 + [2.0] * 20, time=np.arange(30.0), T_bed=293.15, sigma=1e-3, w_level=0.5)
    frame["B"] = np.deg2rad(frame["B"])
    frame[["X", "Y", "Z", "mx", "my", "mz", "sigma"]] /= 25.4
    frame["time"] /= 60
    names = {"X": "x axis", "mx": "X meas", "T_bed": "bed"}
    write_csv(frame.rename(columns=names), tmp_path / "a.csv")
    write_csv(frame.rename(columns=names), tmp_path / "b.csv")
    path = yaml(
        tmp_path,
        'columns: {X: "x axis", mx: "X  meas ", T_bed: bed}\n'
        "units: {length: inch, angle: rad, time: min, temperature: K}\n"
        "frame: per-file\nrefit: [frame, tool]\n"
        "instrument: {type: laser-tracker, station: [2000, -1500, 600], range: [0.5e-3, 3.0e-6], angle: 1.2e-6}",
        "[{path: a.csv}, {path: b.csv, role: test}]",
    )
    survey = read_survey(path, MACHINE)
    assert not survey.notes
    assert (len(survey), len(survey.fit), [len(s) for s in survey.test]) == (60, 30, [30])
    assert set(survey.test[0].table["file"]) == {"b.csv"}
    assert list(survey.test[0].table.index) == list(range(30))
    assert (survey.frame, survey.refit, survey.source) == ("per-file", ("frame", "tool"), path)
    assert isinstance(survey.instrument, LaserTracker)
    expected = poses(30)
    np.testing.assert_allclose(np.rad2deg(survey.fit.commands(["B"])[:, 0]), expected["B"])
    np.testing.assert_allclose(survey.fit.commands(["X", "Z"]), expected[["X", "Z"]])
    np.testing.assert_allclose(survey.fit.measured, expected[["mx", "my", "mz"]])
    np.testing.assert_allclose(survey.table[["sigma_x", "sigma_y", "sigma_z"]], 1e-3)
    np.testing.assert_allclose(survey.table["T_bed"], 20.0)
    np.testing.assert_allclose(survey.fit.table["time"], np.arange(30.0))
    assert list(survey.table["run"].unique()) == ["1", "2"]


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_folder_of_parts(tmp_path: Path, suffix: str):
    frame = poses(30)
    folder = tmp_path / "parts"
    folder.mkdir()
    for k, name in enumerate(["part1", "part2", "part10"]):
        part, path = frame.iloc[10 * k : 10 * k + 10], folder / (name + suffix)
        part.to_parquet(path) if suffix == ".parquet" else write_csv(part, path)
    (folder / "_SUCCESS").touch()
    survey = read_survey(folder, MACHINE)
    np.testing.assert_array_equal(survey.measured, frame[["mx", "my", "mz"]])
    assert list(survey.table["row"]) == list(range(1, 31))
    assert set(survey.table["file"]) == {"parts"}
    assert not survey.notes


def test_parquet_types(tmp_path: Path):
    frame = poses(12)
    expected = frame["mx"].to_numpy()
    frame["mx"] = frame["mx"].map(repr)
    frame["X"] = frame["X"].round().astype(int)
    frame["run"] = [1.0] * 6 + [2.0] * 6
    frame["time"] = pd.date_range("2024-03-12", periods=12, freq="90s", tz="Europe/Berlin")
    frame.to_parquet(tmp_path / "s.parquet")
    survey = read_survey(tmp_path / "s.parquet", MACHINE)
    np.testing.assert_array_equal(survey.measured[:, 0], expected)
    np.testing.assert_allclose(survey.table["time"], np.arange(12) * 90.0)
    assert list(survey.table["run"].unique()) == ["1", "2"]
    frame["mx"] = ["a"] * 12
    frame.to_parquet(tmp_path / "s.parquet")
    with pytest.raises(InputError, match=r"s\.parquet, row 1, column mx: 'a' is not a number"):
        read_survey(tmp_path / "s.parquet", MACHINE)


def test_dates_share_one_zero(tmp_path: Path):
    for name, times in {
        "a": ("2024-03-12T10:00:10Z", "2024-03-12T11:00:20+01:00"),
        "b": ("2024-03-12 10:00", ""),
    }.items():
        rows = "".join(f"{ROW},{time}\n" for time in times if time)
        write(tmp_path, f"{HEADER},time\n{rows}", f"{name}.csv")
    survey = read_survey(yaml(tmp_path, files="[{path: a.csv}, {path: b.csv}]"), MACHINE)
    assert list(survey.table["time"]) == [10.0, 20.0, 0.0]
    assert sum("dates" in note for note in survey.notes) == 2


def test_near_names_are_noted(tmp_path: Path):
    path = write(tmp_path, f"{HEADER},Mx,temp_bed,dirX,Time,Sigma X,wind,dir_Q\n{ROW},1,2,3,4,5,6,1\n")
    notes = " | ".join(read_survey(path, MACHINE).notes)
    for theirs, ours in {"temp_bed": "T_bed", "dirX": "dir_X", "Time": "time", "Sigma X": "sigma_x"}.items():
        assert f"column '{theirs}' is not used; did you mean '{ours}'?" in notes
    assert "not used: Mx, wind" in notes  # mx is there already
    assert "column 'dir_Q' is not used; did you mean 'dir_<joint>' with one of B, X, Y, Z?" in notes


def test_commands_need_nothing_measured(tmp_path: Path):
    survey = read_survey(write(tmp_path, "X,Y,Z,B\n1,2,300,4\n"), MACHINE, measured=False)
    assert np.isnan(survey.measured).all()
    assert len(survey.fit) == 1


def test_error_motions_of_a_joint(tmp_path: Path):
    write(tmp_path, "joint,X,dx,ea,u_ea\nX,-100,2.5,,\nX,100,,0.01,1e-4\n")
    survey = read_survey(yaml(tmp_path, "units: {length: um}"), MACHINE)
    assert list(survey.table["joint"]) == ["X", "X"]
    np.testing.assert_allclose(survey.table[["X", "dx"]], [[-0.1, 0.0025], [0.1, np.nan]])
    np.testing.assert_array_equal(survey.table[["ea", "u_ea"]], [[np.nan, np.nan], [0.01, 1e-4]])
    assert np.isnan(survey.commands(["B", "Y", "Z"])).all()
    mixed = write(tmp_path, f"{HEADER},joint,dy\n{ROW},,\n,5,,,,,,X,0.001\n1,2,3,400,5,6,7,Z,0.002\n")
    survey = read_survey(mixed, MACHINE)
    assert list(survey.table["joint"]) == ["", "X", "Z"]
    assert np.isnan(survey.table["dz"]).all()
    plain = read_survey(write(tmp_path, f"{HEADER},joint,dy\n{ROW},,\n"), MACHINE)
    assert "joint" not in plain.table
    assert "dy" not in plain.table


def test_rows_without_measurement_are_noted(tmp_path: Path):
    survey = read_survey(write(tmp_path, f"{HEADER}\n{ROW}\n1,2,3,400,,,\n1,2,3,400,,,\n"), MACHINE)
    assert survey.notes == ("s.csv: nothing measured in row 2 and 1 more",)


# ---- direction


def survey_of(tmp_path: Path, frame: pd.DataFrame) -> Survey:
    frame = frame.assign(B=0.0, Y=0.0, Z=300.0)
    write_csv(frame, tmp_path / "s.csv")
    return read_survey(tmp_path / "s.csv", MACHINE, measured=False)


def expected_direction(positions: list[int]) -> list[float]:
    signs = [0.0, *np.sign(np.diff(positions))]
    last = next((s for s in signs if s), 1.0)
    result = []
    for sign in signs:
        last = sign or last
        result.append(last)
    return result


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.integers(-3, 3), min_size=1, max_size=12), st.randoms(use_true_random=False))
def test_direction(tmp_path: Path, positions: list[int], random):
    frame = pd.DataFrame({"X": positions})
    expected = np.array(expected_direction(positions))
    np.testing.assert_array_equal(survey_of(tmp_path, frame).direction("X"), expected)
    np.testing.assert_array_equal(survey_of(tmp_path, frame).direction("Y"), 1.0)
    # rows out of order, the times tell; times start again with the run, and what is said is believed
    order = random.sample(range(len(positions)), len(positions))
    shuffled = frame.assign(time=np.arange(len(positions)) * 1.5).iloc[order]
    np.testing.assert_array_equal(survey_of(tmp_path, shuffled).direction("X"), expected[order])
    runs = pd.concat([frame.assign(run="a"), frame.assign(run="b")])
    runs["time"] = np.tile(np.arange(len(positions)), 2)
    np.testing.assert_array_equal(survey_of(tmp_path, runs).direction("X"), expected_direction(positions * 2))
    said = frame.assign(dir_X=[-e if i % 2 else np.nan for i, e in enumerate(expected)])
    flipped = [-e if i % 2 else e for i, e in enumerate(expected)]
    np.testing.assert_array_equal(survey_of(tmp_path, said).direction("X"), flipped)


def test_direction_starts_anew_in_each_file(tmp_path: Path):
    for name, positions in {"a": (1, 2), "b": (1, 0)}.items():
        write_csv(pd.DataFrame({"X": positions, "B": 0, "Y": 0, "Z": 300}), tmp_path / f"{name}.csv")
    survey = read_survey(yaml(tmp_path, files="[{path: a.csv}, {path: b.csv}]"), MACHINE, measured=False)
    assert list(survey.direction("X")) == [1, 1, -1, -1]


# ---- files


@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.floats(allow_nan=False, allow_infinity=False, min_value=-1e7, max_value=1e7), min_size=1))
def test_floats_round_trip(tmp_path: Path, floats: list[float]):
    assume(not any({*repr(abs(v)).rstrip("0")} <= {*"9."} for v in floats))  # which stand for missing values
    frame = pd.DataFrame({"mx": floats, "B": 0.0, "X": 0.0, "Y": 0.0, "Z": 300.0})
    write_csv(frame, tmp_path / "s.csv")
    assert list(read_survey(tmp_path / "s.csv", MACHINE).measured[:, 0]) == floats


def test_writing_is_all_or_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "new" / "a.txt"
    write_text_atomic("one\n", path)
    monkeypatch.setattr("os.replace", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(InputError, match="cannot be written: No space left"):
        write_text_atomic("two\n", path)
    assert path.read_text() == "one\n"
    assert list(path.parent.iterdir()) == [path]
