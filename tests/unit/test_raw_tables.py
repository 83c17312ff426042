"""The tolerant reader of tables: what comes out equals what went in, whatever the encoding, delimiter and header."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from errormodel.exceptions import InputError
from errormodel.raw_formats.base import Asked, decoded, format_of, open_raw
from tests.helpers.raw_files import ENCODINGS, STYLES, Style, read_back, written
from tests.helpers.raw_samples import spreadsheet

NAMES, UNITS = ("Achse X", "east", "Δ", "flow"), ("mm", "µm", "deg", "°C")
READ_UNITS = ("mm", "um", "deg", "degC")  # the same as the toolkit's words
# more than three decimals: of a file of whole numbers in groups of three nobody knows the decimal sign
VALUES = st.builds(
    lambda most, last: round(most / 1e3 + last / 1e5, 5), st.integers(-(10**7), 10**7), st.integers(1, 99)
)
TABLES = st.lists(st.lists(VALUES, min_size=4, max_size=4), min_size=2, max_size=12)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(style=STYLES, rows=TABLES)
def test_what_comes_out_is_what_went_in(style: Style, rows: list[list[float]], tmp_path: Path) -> None:
    assume(not (style.comma and style.delimiter == ","))
    assume(not (style.names == "comment" and style.units == "row"))
    names = [n.replace(" ", "_") for n in NAMES] if style.delimiter == " " else list(NAMES)
    if style.encoding == "cp1252":
        names = [n.replace("Δ", "d") for n in names]
    read = read_back(tmp_path, written(style, names, UNITS, rows))
    np.testing.assert_array_equal(read.frame.to_numpy(dtype=float), np.array(rows))
    if style.names == "none":
        assert [str(n) for n in read.frame] == ["1", "2", "3", "4"]
    else:
        assert [str(n) for n in read.frame] == names
    stated = style.units in ("brackets", "parentheses") and style.names != "none"
    stated = stated or (style.units == "row" and style.names == "plain")
    assert dict(read.units) == (dict(zip(names, READ_UNITS, strict=True)) if stated else {})
    assert len(read.lines) == len(rows)


def test_gaps_and_texts_stay(tmp_path: Path) -> None:
    rows = [["A 1", 1.25, None], ["B*", None, -2.5], ["C", 3.125, 4.75]]
    for delimiter in ",;\t|":
        read = read_back(tmp_path, written(Style(delimiter=delimiter), ("id", "x", "y"), ("", "", ""), rows))
        assert list(read.frame["id"]) == ["A 1", "B*", "C"]
        np.testing.assert_array_equal(read.frame["x"], [1.25, np.nan, 3.125])
        np.testing.assert_array_equal(read.frame["y"], [np.nan, -2.5, 4.75])


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_the_encoding_is_found_and_said(encoding: str, tmp_path: Path) -> None:
    text = "Grüße [°C];X\n20,5;1,25\n21,5;2,25\n"
    assert decoded(text.encode(encoding))[0] == text
    read = read_back(tmp_path, text.encode(encoding))
    assert list(read.frame) == ["Grüße", "X"]
    said = [n for n in read.notes if n.startswith("read as")]
    assert said == (
        [] if encoding.startswith("utf-8") else [f"read as {'UTF-16' if '16' in encoding else 'Windows-1252'}"]
    )


@pytest.mark.parametrize("unit", ["m", "[m]"])
def test_a_row_of_units_may_begin_with_an_empty_cell(unit: str, tmp_path: Path) -> None:
    """Behind a semicolon it is a row; a line of another number of cells that begins with one is a comment."""
    rows = "".join(f"P{k};{k},5;{k},25;A\n" for k in range(1, 6))
    read = read_back(tmp_path, f"; shop;7\nPoint;X;Y;Kind\n;{unit};{unit};\n{rows}".encode())
    assert list(read.frame) == ["Point", "X", "Y", "Kind"]
    assert read.units == {"X": "m", "Y": "m"}
    assert len(read.frame) == 5
    empty = read_back(tmp_path, b"; made by hand\nA;X\n;1,5\nP2;2,5\nP3;3,5\n")
    assert list(empty.frame["X"]) == [1.5, 2.5, 3.5]


@pytest.mark.parametrize(
    ("text", "where", "found"),
    [
        ("X,Y\n1,5,2,5\n3,5,4,5\n", "line 1", "2 names above rows of 4 cells"),
        ("X,Y\n1,5,2\n3,5,4\n", "line 1", "2 names above rows of 3 cells"),
        ("A,B,C\n1,2,3\n4,5\n7,8,9\n", "line 3", "2 cells where the table has 3"),
        ("A;B\n1.234;1,5\n2.345;2,5\n", "line 2, column A", "'1.234' in a file with another decimal sign"),
        ("time,X\n02/03/2020 10:00:00,1\n02/03/2020 10:00:01,2\n", "column time", "may be either"),
        ("time,X\n30/02/2020 10:00:00,1\n31/01/2020 10:00:01,2\n", "line 2", "no calendar has"),
        ("words\nand more words\n", "raw.txt", "without rows of numbers"),
    ],
)  # fmt: skip
def test_what_nobody_can_read_says_what_it_looks_like(text: str, where: str, found: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        read_back(tmp_path, text.encode())
    assert where in error.value.where
    assert found in error.value.found
    assert error.value.cure


ODD = {
    "a rule below the names": "X   Y\n--- ---\n1.5 -2.5\n3.5 4.5\n5.5 6.5\n",
    "bars around": "| X | Y |\n|---|---|\n| 1.5 | -2.5 |\n| 3.5 | 4.5 |\n| 5.5 | 6.5 |\n",
    "decimal commas between quotes": '"X","Y"\n"1,5","-2,5"\n"3,5","4,5"\n"5,5","6,5"\n',
    "a preamble as wide as the table": "Job,7\n24,20.5\nX,Y\n1.5,-2.5\n3.5,4.5\n5.5,6.5\n",
    "names again": "X;Y\n1.5;-2.5\nX;Y\n3.5;4.5\nX;Y\n5.5;6.5\n",
    "titles between": "X,Y,Z\n1.5,-2.5,0\nGroup 2\n3.5,4.5,0\nGroup 3\n5.5,6.5,0\n",
    "a unit in each cell": "X;Y\n1.5 mm;-2.5 mm\n3.5 mm;4.5 mm\n5.5 mm;6.5 mm\n",
    "units behind a comma": "X, mm;Y, mm\n1.5;-2.5\n3.5;4.5\n5.5;6.5\n",
    "the minus of typesetters": "X;Y\n1.5;\u22122.5\n3.5;4.5\n5.5;6.5\n",
    "a remark behind a row": "X,Y\n1.5,-2.5\n3.5,4.5   # again\n5.5,6.5\n",
    "blanks within names of points": "Name\tX\tY\nP 1\t1.5\t-2.5\nP 2\t3.5\t4.5\nP 3\t5.5\t6.5\n",
    "a block filled up": "X,Y\n1.5,-2.5\n3.5,4.5\n5.5,6.5\n\0\0\0\0",
}


@pytest.mark.parametrize("what", ODD)
def test_odd_tables(what: str, tmp_path: Path) -> None:
    read = read_back(tmp_path, ODD[what].encode())
    np.testing.assert_array_equal(read.frame[["X", "Y"]], [[1.5, -2.5], [3.5, 4.5], [5.5, 6.5]])
    stated = "unit" in what
    assert read.units == ({"X": "mm", "Y": "mm"} if stated else {})


def test_a_row_within_a_table_is_never_lost_in_silence(tmp_path: Path) -> None:
    def text(row: str) -> bytes:
        rows = [f"P{k};{k}.5;{k}.25" for k in range(1, 9)]
        return ("\n".join(["Name;X;Y", *rows[:2], row, *rows[3:]]) + "\n").encode()

    for row in ("P3;lost;beam", "P3;;", "P3;lost;invalid", "---;---;---", "Name;3.5;Y"):
        assert len(read_back(tmp_path, text(row)).frame) == 8
    failed = read_back(tmp_path, text("P3;Lost;invalid"))
    assert np.isnan(failed.frame[["X", "Y"]].to_numpy()[2]).all()
    assert "no value where it says Lost, invalid: row 3" in failed.notes
    assert "1 line of words between the rows passed over" in read_back(tmp_path, text("Group 2")).notes
    with pytest.raises(InputError, match="1 cells where the table has 3"):
        read_back(tmp_path, text("P3"))
    with pytest.raises(InputError, match="is not a number"):
        read_back(tmp_path, text("P3;12 mm;13 inch"))


@pytest.mark.parametrize("at", [0, 3, 7])
@pytest.mark.parametrize("row", ["#####,1.5,2.5", "***,1.5,?", "##,lost,1.5"])
def test_a_row_that_begins_with_the_sign_of_a_failed_reading_is_no_comment(row: str, at: int, tmp_path: Path) -> None:
    rows = [f"{k}.5,{k}.25,{k}.125" for k in range(8)]
    rows[at] = row
    read = read_back(tmp_path, "\n".join(["X,Y,Z", *rows]).encode())
    assert list(np.flatnonzero(read.frame["X"].isna())) == [at]
    drawn = read_back(tmp_path, "\n".join(["X,Y,Z", "#####", *rows[:at], "## 1 2", *rows[at + 1 :]]).encode())
    assert len(drawn.frame) == 7


@pytest.mark.parametrize(
    ("line", "unit"),
    [("Units: inches", "inch"), ("# unit = m", "m"), ("All dimensions in mm", "mm"), ("Einheit;mm", "mm"),
     ("Units: mm, deg", "mm"), ("Units of measure", ""), ("Unit 7", ""), ("Units: mm\nUnits: m", "")],
)  # fmt: skip
def test_a_unit_above_a_table_is_that_of_its_coordinates(line: str, unit: str, tmp_path: Path) -> None:
    read = read_back(tmp_path, f"{line}\nX;Y\n1.5;-2.5\n3.5;4.5\n".encode())
    assert read.length_unit == unit


@pytest.mark.parametrize("data", [b"", b"\x89PNG\r\n\x1a\n\0\0\1", b"PK\x03\x04 no sheet", bytes(range(256))])
def test_what_is_no_text_is_refused(data: bytes, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        read_back(tmp_path, data)


@pytest.mark.parametrize(
    ("cells", "order", "seconds", "read"),
    [
        (["2024-03-12T10:00:00", "2024-03-12T10:00:01.5"], "", [1710237600.0, 1710237601.5], ""),
        (["2024-03-12 12:00:00+02:00", "2024-03-12 10:00:01Z"], "", [1710237600.0, 1710237601.0], ""),
        (["'11.10.2022 15:06:48.043", "'11.10.2022 15:06:55.562"], "", [1665500808.043, 1665500815.562], "day-first"),
        (["02/28/25 16:38:29", "02/28/25 16:38:31"], "", [1740760709.0, 1740760711.0], "month-first"),
        (["28/02/2025 04:38:29 PM", "01/03/2025 04:38:31 PM"], "", [1740760709.0, 1740847111.0], "day-first"),
        (["02/03/2025 00:00:00", "02/03/2025 00:00:01"], "day-first", [1740873600.0, 1740873601.0], "day-first"),
        (["02/03/2025 00:00:00", "02/03/2025 00:00:01"], "month-first", [1738540800.0, 1738540801.0], "month-first"),
    ],
)
def test_dates(cells: list[str], order: str, seconds: list[float], read: str, tmp_path: Path) -> None:
    """Seconds since 1970 as any calendar program gives them; to a microsecond, the resolution of float64 there."""
    text = "time;X\n" + "".join(f"{cell};{k}.5\n" for k, cell in enumerate(cells))
    recording = read_back(tmp_path, text.encode(), dates=order)
    np.testing.assert_allclose(recording.frame["time"], seconds, rtol=0, atol=1e-6)
    assert recording.dated
    assert [n for n in recording.notes if n.startswith("dates")] == (
        [f"dates read {read.replace('-', ' ')}"] if read else []
    )


def test_a_date_and_a_time_beside_it_and_midnight(tmp_path: Path) -> None:
    read = read_back(tmp_path, b"Date;Time;x\n11.10.2022;23:59:59;1.5\n12.10.2022;00:00:01;2.5\n")
    assert float(np.diff(read.frame["time"])[0]) == 2.0
    clock = read_back(tmp_path, b"Time;x\n23:59:59;1.5\n00:00:01;2.5\n")
    assert float(np.diff(clock.frame["time"])[0]) == 2.0
    assert not clock.dated


WIDE = ",".join(map(str, range(12_000)))
LARGE = {
    "a million columns": (",".join(map(str, range(1_000_000))) + "\n", "line 1: more than 1000000 characters"),
    "12 000 columns": (f"{WIDE}\n{WIDE}\n", "more than 10000 columns"),
    "a quote without an end": ('"' * 200_001, "without rows of numbers"),
    "blanks in a name": ("a" + " " * 300_000 + "b,c\n1,2\n3,4\n", "line 1: more than 2000 blanks in a row"),
    "digits without an end": ("X" + "1" * 300_000 + "!", "without rows of numbers"),
    "a line without an end": ("x" * 3_000_000, "more than 1000000 characters"),
}


@pytest.mark.parametrize("name", LARGE)
def test_large_tables_are_refused(name: str, tmp_path: Path) -> None:
    text, words = LARGE[name]
    with pytest.raises(InputError, match=words):
        read_back(tmp_path, text.encode())


def test_a_spreadsheet_of_an_unknown_kind_of_archive(tmp_path: Path) -> None:
    data = bytearray(spreadsheet())
    data[data.index(b"PK\x01\x02") + 6] = 115  # version needed to extract: 11.5
    path = tmp_path / "s.xlsx"
    path.write_bytes(data)
    raw = open_raw(path, path.name)
    with pytest.raises(InputError, match=r"not a readable spreadsheet: zip file version 11\.5"):
        format_of(raw).read(raw, Asked())


def test_a_spreadsheet_that_unpacks_to_much_more(tmp_path: Path) -> None:
    path = tmp_path / "s.xlsx"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/workbook.xml", "<workbook/>")
        with archive.open("xl/worksheets/sheet1.xml", "w") as sheet:
            for _ in range(320):
                sheet.write(bytes(1_000_000))
    raw = open_raw(path, path.name)
    with pytest.raises(InputError, match="a spreadsheet of 320 MB unpacked"):
        format_of(raw).read(raw, Asked())


@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=400) | st.text(max_size=200).map(str.encode))
def test_any_bytes_are_read_or_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "any.dat"
    path.write_bytes(content)
    try:
        raw = open_raw(path, path.name)
        format_of(raw).read(raw, Asked())
    except InputError as error:
        cure = error.cure
    else:
        cure = "none needed"
    assert cure


def test_a_sentence_of_as_many_words_as_columns_is_no_row_of_names(tmp_path: Path) -> None:
    rows = "".join(f"{k} {k}.25 {-k}.5 {k + 1}.75\n" for k in range(1, 6))
    for title in ("Standpunkt 1; Prüfer Müller", "Prüfer: Müller am Tracker"):
        read = read_back(tmp_path, f"{title}\n{rows}".encode("cp1252"))
        assert {"mx", "my", "mz"} <= {*read.frame}
        assert "1 line above the table passed over" in read.notes
    named = read_back(tmp_path, f"No: X: Y: Z:\n{rows}".encode())
    assert [str(n) for n in named.frame] == ["No:", "X:", "Y:", "Z:"]


def test_one_column_of_decimal_commas(tmp_path: Path) -> None:
    values = ["0,00012", "-12,50000", "103,12345"]
    for head in ("Länge [mm]\n", "Messung 4\nLänge\n", ""):
        read = read_back(tmp_path, (head + "\n".join(values) + "\n").encode("cp1252"))
        np.testing.assert_array_equal(read.frame.iloc[:, 0], [0.00012, -12.5, 103.12345])
        assert read.frame.shape == (3, 1)
    two = read_back(tmp_path, b"east,north\n1,25\n3,45\n")
    np.testing.assert_array_equal(two.frame[["east", "north"]], [[1, 25], [3, 45]])
