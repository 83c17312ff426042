"""Wrong input of every kind, through the commands: one line that says where, what and the cure; nothing written."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from tests.helpers.commands import MILL, Fill, run, tree, write

Content = str | bytes | Callable[[str], str]
FIT = ("fit", MILL, "s.csv", "--out", "out")
FORM = ("fit", MILL, "s.yaml", "--out", "out")
PREDICT = ("predict", "fit", "s.csv", "--out", "p.csv")
SIMULATE = ("simulate", MILL, "s.csv", "--out", "p.csv")
DESCRIBE = ("describe", "m.yaml", "--json", "d.json")


def cell(column: str, value: str, row: int = 3) -> Callable[[str], str]:
    """The survey with another value in one cell (rows from 1)."""

    def change(text: str) -> str:
        lines = text.splitlines()
        fields = lines[row].split(",")
        fields[lines[0].split(",").index(column)] = value
        return "\n".join([*lines[:row], ",".join(fields), *lines[row + 1 :]]) + "\n"

    return change


def header(old: str, new: str) -> Callable[[str], str]:
    return lambda text: re.sub(rf"\b{old}\b", new, text.splitlines()[0]) + "\n" + text.partition("\n")[2]


def added(column: str, values: Callable[[int], str]) -> Callable[[str], str]:
    """The survey with one more column; `values` of the row from 1."""
    return lambda text: "".join(
        f"{line},{column if k == 0 else values(k)}\n" for k, line in enumerate(text.splitlines())
    )


def scaled(columns: str, factor: float) -> Callable[[str], str]:
    def change(text: str) -> str:
        rows = [line.split(",") for line in text.splitlines()]
        places = [rows[0].index(c) for c in columns.split()]
        for row in rows[1:]:
            for k in places:
                row[k] = repr(float(row[k]) * factor)
        return "".join(",".join(row) + "\n" for row in rows)

    return change


def first(rows: int) -> Callable[[str], str]:
    return lambda text: "\n".join(text.splitlines()[: rows + 1]) + "\n"


TABLES: dict[str, tuple[Content, tuple[str, ...]]] = {
    "missing joint": (header("Y", "Q"), ("s.csv, header", "no column for the joint 'Y'", "Name the column 'Y'")),
    "joint in lower case": (header("Y", "y"), ("the nearest is 'y'", 'columns: {Y: "y"}')),
    "joint twice": (header("Y", "X"), ("s.csv, header", "'X' stands above columns 1 and 2", "of its own")),
    "text in a number": (cell("mx", "abc"), ("s.csv, row 3 (line 4), column mx", "'abc' is not a number", "leave")),
    "formula in a number": (cell("Y", "=1+1"), ("row 3 (line 4), column Y", "'=1+1'", "write a number")),
    "NaN as a command": (cell("X", "NaN"), ("row 3", "column X", "no commanded position", "Write the position")),
    "empty command": (cell("X", ""), ("row 3", "column X", "no commanded position")),
    "infinite": (cell("mz", "-inf"), ("row 3", "column mz", "-inf", "finite")),
    "overflow": (cell("mz", "1e999"), ("row 3", "column mz", "inf", "finite")),
    "huge": (cell("mz", "-1e300", row=7), ("row 7", "column mz", "-1e+300", "beyond any machine", "unit")),
    "placeholder": (cell("my", "-99999999"), ("row 3", "column my", "-99999999", "Leave the cell empty")),
    "ragged row": (lambda t: t + "1,2,3\n", ("s.csv, row 61 (line 62)", "3 fields where the header has", "one field")),
    "decimal commas": (lambda t: re.sub(r"\.(\d)", r",\1", t), ("row 1", "fields where", "semicolons")),
    "blanks between columns": (lambda t: t.replace(",", " "), ("one column", "Separate the columns with commas")),
    "no header": (lambda t: t.partition("\n")[2], ("header (line 1)", "numbers where", "names above the data")),
    "empty file": ("", ("s.csv", "an empty file", "header")),
    "header only": (first(0), ("s.csv", "no rows below the header", "row a pose")),
    "binary": (b"\x00\x01\x7fELF" * 40, ("s.csv", "not a text file", "CSV in UTF-8")),
    "UTF-16": ("X,Y\n1,2\n".encode("utf-16"), ("s.csv", "UTF-16", "UTF-8")),
    "not UTF-8": (b"X,Y,Z,mx,T_\xe9\n1,2,3,4,5\n", ("s.csv", "not UTF-8", "Save the file as UTF-8")),
    "metres": (scaled("X Y Z tool_z mx my mz", 1e-3), ("s.csv, columns X Y Z", "in m", "units: {length: m}")),
    "measured in inches": (scaled("mx my mz", 1 / 25.4), ("s.csv, columns mx my mz", "in inch", "units")),
    "nothing measured": (header("mx,my,mz", "a,b,c"), ("s.csv, header", "no measured column", "mx my mz", "Found")),
    "zero sigma": (added("sigma", lambda k: "0"), ("row 1", "column sigma", "0 as a standard", "above 0")),
    "negative sigma": (added("sigma_x", lambda k: "-1" if k == 5 else "1"), ("row 5", "sigma_x", "above 0")),
    "sigma partly": (added("sigma", lambda k: "" if k == 4 else "1"), ("row 4, column sigma", "without", "every")),
    "sigma of one component": (added("sigma_x", lambda k: "1"), ("row 1, column sigma", "sigma_x sigma_y sigma_z")),
    "runs without a label": (added("run", lambda k: "" if k == 9 else "a"), ("row 9", "column run", "no label")),
    "direction of 2": (added("dir_X", lambda k: "2"), ("row 1", "column dir_X", "2 as a direction", "+1 or -1")),
    "times partly": (added("time", lambda k: "" if k == 2 else "1"), ("row 2", "column time", "no time")),
    "five rows": (first(5), ("s.csv", "5 rows with 15 measured", "30 groups", "15 fall: X.eb.1", "at least 11 rows")),
    "one row": (first(1), ("s.csv", "1 row with 3 measured values", "30 groups", "27 fall: table.ea", "at least 11")),
    "just as many rows": (first(10), ("10 rows with 30", "30 groups", "at least 11")),
}  # fmt: skip

YAML = "errormodel: 1\nfiles:\n  - {path: a.csv, role: fit}\n"
FORMS: dict[str, tuple[Content, tuple[str, ...]]] = {
    "unknown key": (YAML + "frames: shared\n", ("s.yaml, line 4, key frames", "unknown key 'frames'", "'frame'")),
    "misspelt role": (YAML.replace("fit}", "fitt}"), ("s.yaml, line 3", "role", "'fitt'", "Did you mean 'fit'")),
    "unknown frame": (YAML + "frame: perrun\n", ("line 4, key frame", "'perrun'", "'per-run'")),
    "missing file": (YAML.replace("a.csv", "aa.csv"), ("aa.csv", "no such file", "Did you mean 'a.csv'")),
    "only tests": (YAML.replace("fit", "test"), ("s.yaml, line 2, key files", "only test files", "role fit")),
    "a file twice": (YAML + "  - {path: ./a.csv, role: test}\n", ("s.yaml, line 2, key files", "Name a.csv once")),
    "no files": ("errormodel: 1\nfiles: []\n", ("s.yaml, line 2, key files", "[]", "path: data.csv")),
    "no version": (YAML.partition("\n")[2], ("s.yaml", "'errormodel' is missing", "1")),
    "another version": (YAML.replace("1", "2"), ("s.yaml, line 1, key errormodel", "2", "1")),
    "unknown instrument": (YAML + "instrument: {type: laser}\n", ("line 4", "'laser'", "'laser-tracker'")),
    "a key of another instrument": (
        YAML + "instrument: {type: plain, sigma: 0.001}\n", ("line 4", "unknown key 'sigma'. Valid: type")),
    "half an instrument": (
        YAML + "instrument: {type: laser-tracker, angle: 1.0e-6}\n",
        ("line 4", "Write range and angle"),
    ),
    "zero uncertainty": (YAML + "instrument: {type: cmm, sigma: [0, 0]}\n", ("line 4", "sigma", "above 0")),
    "negative angle": (
        YAML + "instrument: {type: laser-tracker, range: [1e-3, 0], angle: -1e-6}\n", ("line 4", "angle", "-1e-06")),
    "unknown unit": (YAML + "units: {length: furlongs_}\n", ("line 4", "length", "'furlongs_'", "mm")),
    "unit as code": (YAML + "units: {length: 10**10**10}\n", ("line 4", "length", "10**10**10", "mm")),
    "unknown column": (YAML + 'columns: {nx: "X"}\n', ("line 4, key columns.nx", "'nx' is not a column", "'mx'")),
    "no such column": (YAML + 'columns: {mx: "X meas"}\n', ("key columns.mx", "no file has a column 'X meas'")),
    "code": (YAML + "frame: !!python/object/apply:os.mkdir [pwned]\n", ("line 4, key frame", "the tag", "Remove")),
    "a key twice": (YAML + "frame: shared\nframe: fixed\n", ("line 5, key frame", "already given in line 4")),
    "tabs": ("errormodel: 1\nfiles:\n\t- {path: a.csv}\n", ("s.yaml, line 3", "tab")),
    "open bracket": (YAML + "units: {length: mm\n", ("s.yaml, line 4", "bracket")),
    "a list": ("- a\n- b\n", ("s.yaml, line 1", "a list where keys are expected")),
    "nothing": ("", ("s.yaml", "an empty file", "errormodel: 1")),
    "not text": (b"\xff\xfe\x00\x01", ("s.yaml, line 1", "0xff", "UTF-8")),
    "two anchors": ("errormodel: 1\nfiles: &a []\nunits: &a {}\n", ("s.yaml, line 3", "a second anchor 'a'")),
    "alias bomb": ("a: &a [1,1,1,1,1,1,1,1,1,1]\n" + "".join(
        f"{n}: &{n} [{','.join('*' + p for _ in range(10))}]\n" for p, n in zip("abcdef", "bcdefg", strict=True)),
        ("s.yaml", "more than 100000 values")),
}  # fmt: skip

CHAIN = """errormodel: 1
chain:
  - {joint: X, type: prismatic, axis: x, travel: [0, 500]}
  - {shape: T1, offset: [0, 0, 100]}
  - {joint: B, type: rotary, axis: y, travel: [0, 360]}
"""
MACHINES: dict[str, tuple[Content, tuple[str, ...]]] = {
    "duplicate element": (CHAIN + "  - {shape: X}\n", ("m.yaml, line 6", "'X' is already taken in line 3", "another")),
    "unknown shape": (CHAIN + "errors: {shapes: {T2: all}}\n", ("m.yaml, line 6", "T2", "T1")),
    "unknown joint": (CHAIN + "errors: {joints: {x: first-order}}\n", ("m.yaml, line 6", "'x'", "'X'")),
    "unknown motion": (CHAIN + "errors: {shapes: {T1: [dx, eq]}}\n", ("m.yaml, line 6", "eq", "ea")),
    "unknown model": (CHAIN + "errors: {joints: {X: firstorder}}\n", ("m.yaml, line 6", "'first-order'")),
    "degree of text": (CHAIN + "errors: {joints: {X: {polynomial: many}}}\n", ("m.yaml, line 6", "many")),
    "unknown effect": (CHAIN + "effects: [{effect: back-lash}]\n", ("m.yaml, line 6", "'back-lash'", "'backlash'")),
    "effect nowhere": (CHAIN + "effects: [{effect: backlash, joint: Q}]\n", ("m.yaml, line 6", "'Q'", "X")),
    "unknown type": (CHAIN.replace("prismatic", "linear"), ("m.yaml, line 3", "type", "'linear'", "prismatic")),
    "travel backwards": (CHAIN.replace("0, 500", "500, 0"), ("m.yaml, line 3", "travel", "[0, 500]")),
    "axis of length 2": (CHAIN.replace("axis: x", "axis: [0, 2, 0]"), ("m.yaml, line 3", "length 2", "[0, 1, 0]")),
    "hostile name": (CHAIN.replace("T1", '"T\\u001b[31m\\n1"'), ("m.yaml, line 4", "letters, digits and _")),
    "infinite offset": (CHAIN.replace("100", ".inf"), ("m.yaml, line 4", "offset")),
    "code": (CHAIN + "tool: !!python/object/apply:os.mkdir [pwned]\n", ("m.yaml, line 6, key tool", "the tag")),
    "no chain": ("errormodel: 1\nname: empty\n", ("m.yaml", "'chain' is missing")),
}  # fmt: skip

Case = tuple[tuple[str, ...], Mapping[str, Content], tuple[str, ...]]
FIT_JSON = '{"schema": "errormodel.fit/1", "parameters": [%s]}'
COMMANDS: dict[str, Case] = {
    "unknown command": (("fits",), {}, ("errormodel", "no command 'fits'", "Did you mean 'fit'")),
    "unknown option": ((*FIT, "--otu", "x"), {}, ("errormodel fit", "--otu", "errormodel fit --help")),
    "missing argument": (("fit", MILL), {}, ("errormodel fit", "'SURVEY'", "--help")),
    "missing output": (("fit", MILL, "s.csv"), {}, ("errormodel fit", "'--out'", "--help")),
    "bad seed": ((*SIMULATE, "--seed", "-1"), {}, ("errormodel simulate", "--seed", "--help")),
    "unknown machine": (("describe", "vertical_three_axes"), {}, ("vertical_three_axes", f"Did you mean '{MILL}'")),
    "machine is a table": (("describe", "s.csv"), {}, ("s.csv, line 1", "where keys are expected")),
    "machine is an empty folder": (("fit", ".", "s.csv", "--out", "out"), {}, (".: a folder without machine.yaml",)),
    "survey missing": (("fit", MILL, "t.csv", "--out", "out"), {}, ("t.csv", "no such file", "Did you mean 's.csv'")),
    "survey is another type": (("fit", MILL, "s.xlsx", "--out", "out"), {"s.xlsx": "PK"}, ("s.xlsx", "type", ".csv")),
    "survey is an empty folder": (("fit", MILL, "x", "--out", "out"), {"x/.keep": ""}, ("x", "without a table")),
    "a name too long": (("fit", MILL, "n" * 300, "--out", "out"), {}, ("too long",)),
    "--out is a file": (("fit", MILL, "s.csv", "--out", "s.csv"), {}, ("--out", "s.csv", "is a file")),
    "--out below a file": (("fit", MILL, "s.csv", "--out", "s.csv/x"), {}, ("s.csv/x", "cannot be written")),
    "--out is a folder": (("predict", "fit", "s.csv", "--out", "fit"), {}, ("--out", "fit", "is a directory")),
    "drawing of another type": (("describe", MILL, "--drawing", "a.doc"), {}, ("a.doc", ".svg")),
    "no poses": (("simulate", MILL, "0", "--out", "p.csv"), {}, ("POINTS", "0 random poses", "from 1 to")),
    "too many poses": (("simulate", MILL, "9" * 30, "--out", "p.csv"), {}, ("POINTS", "from 1 to 10000000")),
    "noise of text": ((*SIMULATE, "--noise", "much"), {}, ("--noise", "'much'", "0.005")),
    "noise of nothing": ((*SIMULATE, "--noise", "nan"), {}, ("--noise", "'nan'", "0.005")),
    "noise of no instrument": ((*SIMULATE, "--noise", "instrument"), {}, ("--noise", "no instrument", "instrument:")),
    "effect without its joint": (
        ("fit", "fit", "s.csv", "--out", "out"), {"fit/machine.yaml": lambda t: t + "effects: [{effect: backlash}]\n"},
        ("fit/machine.yaml", "backlash", "joint", "Example")),
    "effect without its column": (
        ("fit", "fit", "s.csv", "--out", "out"),
        {"fit/machine.yaml": lambda t: t + "effects: [{effect: payload-sag, joint: Z}]\n"},
        ("s.csv, header", "no column 'load'", "Add it (kg). Found: ")),
    "unknown parameter": (
        (*SIMULATE, "--parameters", "t.yaml"), {"t.yaml": "parameters:\n  tabel.dx: 1\n"},
        ("t.yaml, line 2, key parameters.tabel.dx", "Did you mean 'table.dx'")),
    "parameter of another unit": (
        (*SIMULATE, "--parameters", "t.yaml"), {"t.yaml": "parameters:\n  X.dx.1: 1e3\n"},
        ("t.yaml, line 2, key parameters.X.dx.1", "1000 mm", "Write it in mm, at most 100")),
    "parameter of text": (
        (*SIMULATE, "--parameters", "t.yaml"), {"t.yaml": "parameters: {table.dx: 1 mm}\n"}, ("line 1", "table.dx")),
    "no fit": (("predict", ".", "s.csv", "--out", "p.csv"), {}, ("fit.json", "No such file", "errormodel fit")),
    "fit is a file": (("predict", "s.csv", "s.csv", "--out", "p.csv"), {}, ("s.csv", "is a file")),
    "fit of no JSON": (PREDICT, {"fit/fit.json": "{"}, ("fit/fit.json", "no JSON from here on", "errormodel fit")),
    "fit of binary": (PREDICT, {"fit/fit.json": b"\xff\xfe"}, ("fit/fit.json", "not UTF-8")),
    "fit too deep": (PREDICT, {"fit/fit.json": "[" * 100000}, ("fit/fit.json", "nested too deep")),
    "fit of a list": (PREDICT, {"fit/fit.json": "[1]"}, ("fit/fit.json", "no mapping of keys")),
    "fit of another schema": (PREDICT, {"fit/fit.json": '{"schema": "x"}'}, ("fit/fit.json", "'errormodel.fit/1'")),
    "fit cut short": (PREDICT, {"fit/fit.json": FIT_JSON % "{}"}, ("key parameters[1].id", "missing", "again")),
    "fit with a hole": (
        PREDICT, {"fit/fit.json": lambda t: re.sub(r'"value": [-+.\de]+', '"value": null', t, count=1)},
        ("fit/fit.json, key parameters[1].value", "nothing", "again")),
    "covariance of another fit": (
        PREDICT, {"fit/covariance.csv": lambda t: re.sub(r"(?<=\n)[\d.e-]+", "1.0", t, count=1)},
        ("fit/covariance.csv", "of another fit", "Run the fit again")),
    "covariance of other columns": (
        PREDICT, {"fit/covariance.csv": lambda t: t.replace("Z.dz.1", "Z.dz.2")}, ("fit/covariance.csv", "another")),
    "covariance empty": (PREDICT, {"fit/covariance.csv": ""}, ("fit/covariance.csv", "cannot be read", "again")),
    "machine of another fit": (
        PREDICT, {"fit/machine.yaml": lambda t: t.replace("polynomial: 2", "polynomial: 1")},
        ("fit/machine.yaml", "no parameter 'X.d", "Run the fit again")),
    "points without a joint": (PREDICT, {"s.csv": header("Z", "z")}, ("s.csv, header", "the joint 'Z'", "'z'")),
}  # fmt: skip

CASES: dict[str, Case] = (
    {f"table: {k}": (FIT, {"s.csv": content}, words) for k, (content, words) in TABLES.items()}
    | {f"form: {k}": (FORM, {"a.csv": str, "s.yaml": content}, words) for k, (content, words) in FORMS.items()}
    | {f"machine: {k}": (DESCRIBE, {"m.yaml": content}, words) for k, (content, words) in MACHINES.items()}
    | COMMANDS
)


@pytest.fixture(scope="module")
def mill(with_mill: Fill, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return with_mill(tmp_path_factory.mktemp("mill"))


@pytest.mark.parametrize("name", CASES)
def test_wrong_input(name: str, mill: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments, files, words = CASES[name]
    shutil.copytree(mill, tmp_path, dirs_exist_ok=True)
    good = (mill / "s.csv").read_text()
    for path, content in files.items():
        old = (mill / path).read_text() if (mill / path).exists() else good
        write(tmp_path / path, content(old) if callable(content) else content)
    monkeypatch.chdir(tmp_path)
    before = tree(tmp_path)
    result = run(*arguments)
    assert result.code == 2, result.out
    assert result.err.count("\n") == 1, result.err
    assert result.err.startswith("error: ")
    assert result.err.strip().isprintable()
    assert "Traceback" not in result.err
    rest = result.err
    for word in words:  # in this order: where, what, the cure
        assert word in rest, result.err
        rest = rest.partition(word)[2]
    assert tree(tmp_path) == before
    assert not (tmp_path / "pwned").exists()
