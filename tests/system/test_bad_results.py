"""Files that errormodel itself wrote, tampered with, cut short, or of another version: refused in one line."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.helpers.commands import Fill, run, tree, write

Change = Callable[[dict[str, Any]], object]


@pytest.fixture(scope="module")
def made(with_mill: Fill, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return with_mill(tmp_path_factory.mktemp("made"))


@pytest.fixture
def sealed(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(made, tmp_path / "w")
    monkeypatch.chdir(tmp_path / "w")
    return tmp_path / "w"


@pytest.fixture
def place(sealed: Path) -> Path:
    """A fit without a manifest, so that each file is judged by what it holds."""
    (sealed / "fit/manifest.json").unlink()
    return sealed


PREDICT = ("predict", "fit", "s.csv", "--out", "p.csv")
COMPENSATE = ("compensate", "fit", "--controller", "csv", "--points", 3, "--out", "t")
MONITOR = ("monitor", "fit", "s.csv")


def refused(place: Path, command: tuple[object, ...], *words: str) -> None:
    before = tree(place)
    result = run(*command)
    assert result.code == 2, result.out
    assert result.err.count("\n") == 1, result.err
    rest = result.err
    for word in words:
        assert word in rest, result.err
        rest = rest.partition(word)[2]
    assert tree(place) == before


def test_every_command_says_that_a_folder_cannot_be_checked(place: Path) -> None:
    for command in (PREDICT, MONITOR, ("export", "fit", "--format", "dh", "--out", "dh.csv")):
        assert "note: fit holds no manifest.json" in run(*command).err, command


def at(*keys: Any, to: Any) -> Change:
    def change(data: Any) -> None:
        for key in keys[:-1]:
            data = data[key]
        data[keys[-1]] = to

    return change


def without(*keys: Any) -> Change:
    def change(data: Any) -> None:
        for key in keys[:-1]:
            data = data[key]
        del data[keys[-1]]

    return change


NAN, INF = float("nan"), float("inf")
FIRST = ("parameters", 0)
POSE = ("frame", 0, "alignment")
FIT_JSON: dict[str, tuple[Change, tuple[str, ...]]] = {
    **{f"a value of {v}": (at(*FIRST, "value", to=v), ("fit.json, key parameters[1].value", "not finite"))
       for v in (NAN, INF, -INF)},
    "a coefficient of NaN": (at(*FIRST, "members", "table.dx", to=NAN), ("key parameters[1].members.table.dx",)),
    "a figure that is infinite": (at("heldout", "rms_um", to=INF), ("key heldout.rms_um", "not finite")),
    **{f"a noise of {v!r}": (at("sigma_um", to=v), ("key sigma_um",)) for v in (-3.0, NAN, "2")},
    "a negative bound of the noise": (at("sigma_interval_um", 0, to=-1.0), ("key sigma_interval_um[1]",)),
    **{f"a value of {v!r}": (at(*FIRST, "value", to=v), ("key parameters[1].value", "Run the fit again"))
       for v in ("0.1", None, [1.0], True, {}, 1e300)},
    **{f"std of {v!r}": (at(*FIRST, "std", to=v), ("key parameters[1].std",)) for v in (-1e-3, None, "1")},
    "std of another fit": (at(*FIRST, "std", to=1.0), ("covariance.csv", "another fit")),
    "unit of no kind": (at(*FIRST, "unit", to="furlong"), ("parameter 'table.dx'", "'furlong'", "mm")),
    "another unit": (at(*FIRST, "unit", to="rad"), ("parameter 'table.dx'", "'rad'", "mm")),
    "unit of a number": (at(*FIRST, "unit", to=1), ("key parameters[1].unit",)),
    "no unit": (without(*FIRST, "unit"), ("key parameters[1].unit", "missing")),
    "an unknown member": (at(*FIRST, "members", to={"Q.dx": 1.0}), ("the member 'Q.dx'",)),
    "members of text": (at(*FIRST, "members", "table.dx", to="1"), ("key parameters[1].members",)),
    "no members": (at(*FIRST, "members", to={}), ("key parameters[1].members",)),
    "members as a list": (at(*FIRST, "members", to=[1]), ("key parameters[1].members",)),
    "an unknown parameter": (at(*FIRST, "id", to="Q.dx"), ("machine.yaml", "no parameter 'Q.dx'")),
    "a parameter twice": (at("parameters", 1, "id", to="table.dx"), ("another fit",)),
    "no parameters": (at("parameters", to=[]), ("covariance.csv", "another fit")),
    "parameters of text": (at("parameters", to="x"), ("key parameters",)),
    "a parameter of text": (at(*FIRST, to="x"), ("key parameters[1]",)),
    **{f"a translation of {v!r}": (at(*POSE, "translation", to=v), ("key frame[1].alignment.translation",))
       for v in ([1.0, 2.0], [1.0, 2.0, 3.0, 4.0], [1.0, 2.0, "3"], [1.0, None, 3.0], 7.0, None)},
    **{f"a rotation of {v!r}": (at(*POSE, "rotation", to=v), ("key frame[1].alignment.rotation",))
       for v in ([0.0, 0.0], [[0.0, 0.0, 0.0]], "none", [0.0, 3.2, 0.0])},
    "undetermined of two": (at(*POSE, "undetermined", to=[[1.0, 0.0]]), ("key frame[1].alignment.undetermined",)),
    "no alignment": (without(*POSE), ("key frame[1].alignment", "missing")),
    "no frames": (at("frame", to=[]), ("key frame", "no measuring frame")),
    "frame of text": (at("frame", to="x"), ("key frame",)),
    "an odd frame mode": (at("frame_mode", to="odd"), ("key frame_mode", "'odd'", "'shared'")),
    **{f"no {key}": (without(key), (f"key {key}", "missing"))
       for key in ("parameters", "frame_mode", "frame", "nominal", "fitted", "test", "noise")},
    "no schema": (without("schema"), ("key schema", "missing")),
    "nominal of text": (at("nominal", to="x"), ("key nominal",)),
    "nominal without rms": (without("nominal", "rms_um"), ("key nominal.rms_um", "missing")),
    "negative rms": (at("nominal", "rms_um", to=-1.0), ("key nominal.rms_um", "-1.0")),
    "fitted of half a row": (at("fitted", "n", to=1.5), ("key fitted.n",)),
    "noise of text": (at("noise", "position", "sigma", to="x"), ("key noise.position.sigma",)),
    "noise declared by a word": (at("noise", "position", "declared", to="no"), ("key noise.position.declared",)),
    "covered of one": (at("covered", "X", to=[1.0]), ("key covered.X",)),
    "covered of text": (at("covered", "X", to=["a", "b"]), ("key covered.X",)),
    "test of a word": (at("test", to="x"), ("key test",)),
    "robust of a word": (at("robust", to="yes"), ("key robust",)),
    "location errors of numbers": (at("location_errors", to=[1]), ("key location_errors[1]",)),
    "a newer version": (at("version", to="99.0"), ("errormodel 99.0 wrote it", "Use errormodel 99.0 or later")),
    "a newer schema": (lambda d: d.update(schema="errormodel.fit/2", version="7.1.0"), ("Use errormodel 7.1.0",)),
    "a schema of no version": (
        at("schema", to="errormodel.fit/99"), ("key schema", "'errormodel.fit/99'", "reads number 1", "that wrote it")
    ),
    "another schema": (at("schema", to="errormodel.compensation/1"), ("errormodel.compensation/1", "Give the folder")),
    "schema of a list": (at("schema", to=[1]), ("[1]",)),
}  # fmt: skip


@pytest.mark.parametrize("name", FIT_JSON)
def test_fit_json(name: str, place: Path) -> None:
    change, words = FIT_JSON[name]
    path = Path("fit/fit.json")
    data = json.loads(path.read_text())
    change(data)
    write(path, json.dumps(data))
    refused(place, PREDICT, "fit/", *words)


@pytest.mark.parametrize("command", [COMPENSATE, MONITOR])
@pytest.mark.parametrize("name", ["a value of nan", "a translation of [1.0, 2.0]", "no nominal", "unit of no kind"])
def test_every_reader_of_a_fit(name: str, command: tuple[object, ...], place: Path) -> None:
    change, words = FIT_JSON[name]
    data = json.loads(Path("fit/fit.json").read_text())
    change(data)
    write(Path("fit/fit.json"), json.dumps(data))
    refused(place, command, "fit/", *words)


def cell(row: int, column: int, value: str) -> Callable[[str], str]:
    def change(text: str) -> str:
        rows = [line.split(",") for line in text.splitlines()]
        rows[row][column] = value
        return "".join(",".join(r) + "\n" for r in rows)

    return change


COVARIANCE: dict[str, Callable[[str], str]] = {
    "not symmetric": cell(1, 2, "1e9"),
    "NaN": cell(1, 2, "nan"),
    "empty cell": cell(2, 1, ""),
    "text": cell(2, 1, "x"),
    "infinite": cell(3, 3, "inf"),
    "negative variance": lambda t: cell(1, 1, "-" + t.splitlines()[1].split(",")[0])(t),
    "correlation of 2": lambda t: cell(2, 1, "1.0")(cell(1, 2, "1.0")(t)),
    "a row less": lambda t: t.rpartition("\n")[0].rpartition("\n")[0] + "\n",
    "a row more": lambda t: t + t.splitlines()[-1] + "\n",
    "a column less": lambda t: re.sub(r",[^,\n]*$", "", t, flags=re.M),
    "other names": lambda t: t.replace("table.dx", "table.dy", 1),
    "header only": lambda t: t.partition("\n")[0] + "\n",
}


@pytest.mark.parametrize("name", COVARIANCE)
def test_covariance(name: str, place: Path) -> None:
    path = Path("fit/covariance.csv")
    write(path, COVARIANCE[name](path.read_text()))
    refused(place, PREDICT, "fit/covariance.csv")


READ = {"fit.json": PREDICT, "covariance.csv": PREDICT, "machine.yaml": PREDICT, "residuals.csv": COMPENSATE}


@pytest.mark.parametrize("share", [0.0, 0.1, 0.37, 0.62, 0.9])
@pytest.mark.parametrize("name", [n for n in READ if n != "residuals.csv"])
def test_cut_short(name: str, share: float, place: Path) -> None:
    path = Path("fit") / name
    data = path.read_bytes()
    write(path, data[: int(share * len(data))])
    refused(place, READ[name], f"fit/{name}" if name != "machine.yaml" else "fit/")


@pytest.mark.long
@pytest.mark.parametrize("content", [b"", b"\0" * 4096, b"\xff\xfe\0\1" * 64, b"[" * 50_000, b"{}", b"null", b"PK\3\4"])
@pytest.mark.parametrize("name", READ)
def test_overwritten(name: str, content: bytes, place: Path) -> None:
    write(Path("fit") / name, content)
    refused(place, READ[name], "fit/")


@pytest.mark.parametrize("name", READ)
def test_lost(name: str, place: Path) -> None:
    (Path("fit") / name).unlink()
    refused(place, READ[name], "fit/")


SEALED: dict[str, tuple[object, ...]] = {
    "predict": PREDICT,
    "compensate": COMPENSATE,
    "monitor": MONITOR,
    "export": ("export", "fit", "--format", "urdf", "--out", "arm.urdf"),
    "iso": ("iso", "230-1", "fit", "--out", "iso"),
    "verify": ("verify", "fit"),
    "rerun": ("rerun", "fit"),
}


@pytest.mark.parametrize("name", ["parameters.csv", "covariance.csv"])
@pytest.mark.parametrize("command", SEALED)
def test_a_file_that_the_manifest_lists_and_that_is_lost(command: str, name: str, sealed: Path) -> None:
    """Whoever removed one file may have exchanged others: no reader goes on without it."""
    (Path("fit") / name).unlink()
    refused(sealed, SEALED[command], "fit", f"{name}: ", "missing")


def test_a_page_that_is_lost_is_missed_by_verify_only(sealed: Path) -> None:
    Path("fit/report.html").unlink()
    refused(sealed, ("verify", "fit"), "report.html: missing")
    assert run(*PREDICT).code == 0


def test_residuals_of_more_cells_than_the_header(place: Path) -> None:
    path = Path("fit/residuals.csv")
    header, _, rows = path.read_text().partition("\n")
    write(path, f"{header}\n" + "".join(f"s.csv,{row}\n" for row in rows.splitlines()))
    refused(place, COMPENSATE, "fit/residuals.csv", "more cells than the header")


@pytest.mark.parametrize("value", ["x", "1e+300", "-82.53:4", "inf"])
@pytest.mark.parametrize("column", ["X", "tool_z", "residual_x_um", "heldout_y_um"])
def test_residuals(column: str, value: str, place: Path) -> None:
    path = Path("fit/residuals.csv")
    rows = [line.split(",") for line in path.read_text().splitlines()]
    rows[5][rows[0].index(column)] = value
    write(path, "".join(",".join(row) + "\n" for row in rows))
    refused(place, COMPENSATE, f"fit/residuals.csv, row 5, column {column}", value)


def test_a_fit_without_its_values_is_no_plain_machine(sealed: Path) -> None:
    Path("fit/fit.json").unlink()
    refused(sealed, ("export", "fit", "--format", "urdf", "--out", "arm.urdf"), "fit/fit.json")


MANIFEST: dict[str, Change] = {
    "a newer version": at("version", to="99.0"),
    "a newer schema": lambda d: d.update(schema="errormodel.manifest/2", version="3.0"),
    "no files": without("files"),
    "files as a list": at("files", to=[]),
    "inputs of numbers": at("inputs", to=[1]),
    "no command": without("command"),
    "another digest": at("files", "fit.json", to="0" * 64),
    "arguments of a word": at("arguments", to="x"),
    "options of a word": at("options", to="x"),
    "a file less": without("files", "fit.json"),
    "a file of another folder": lambda d: d["files"].update({"../fit.json": d["files"].pop("fit.json")}),
    "one file too many, of another folder": at("files", "../s.csv", to="0" * 64),
    "an absolute path": at("files", "/s.csv", to="0" * 64),
}


@pytest.mark.parametrize("name", MANIFEST)
@pytest.mark.parametrize("command", [PREDICT, ("verify", "fit"), ("rerun", "fit")])
def test_manifest(name: str, command: tuple[object, ...], sealed: Path) -> None:
    data = json.loads(Path("fit/manifest.json").read_text())
    MANIFEST[name](data)
    write(Path("fit/manifest.json"), json.dumps(data))
    refused(sealed, command, "fit")


NO_MANIFEST = {
    "empty": (b"", ("manifest.json, line 1, column 1", "no JSON from here on")),
    "cut short": (b'{"schema":\n "errorm', ("manifest.json, line 2, column 2", "no JSON")),
    "too deep": (b"[" * 50_000, ("manifest.json", "nested too deep")),
    "a list": (b"[]", ("manifest.json", "no mapping of keys to values")),
    "no schema": (b"{}", ("manifest.json, key schema", "missing")),
    "no files": (b'{"schema": "errormodel.manifest/1"}', ("manifest.json, key holds", "missing")),
    "another encoding": (b"\xff\xfe{}", ("manifest.json", "the byte 0xff at 0, which is not UTF-8")),
    "a number of many digits": (b'{"schema": ' + b"1" * 5000 + b"}", ("manifest.json", "too long")),
}


@pytest.mark.parametrize("name", NO_MANIFEST)
def test_what_is_wrong_with_a_manifest_is_said_in_words(name: str, sealed: Path) -> None:
    content, words = NO_MANIFEST[name]
    write(Path("fit/manifest.json"), content)
    refused(sealed, ("verify", "fit"), *words)
    assert not re.search(r"[A-Z]\w+Error", run("verify", "fit").err)


@pytest.mark.parametrize("name", ["diagnosis.json", "decisions.csv"])
def test_a_file_beside_a_fit_that_is_read_with_it(name: str, sealed: Path) -> None:
    write(Path("fit") / name, "{}")
    for command in (PREDICT, ("verify", "fit"), ("rerun", "fit")):
        refused(sealed, command, "fit", name)


def test_the_history_of_a_machine(place: Path) -> None:
    assert run(*MONITOR).code == 0
    whole = Path("fit/monitor.sqlite").read_bytes()
    for content in (b"", whole[:5000], b"x" * 4096, whole[:100] + b"\xff" * 3000 + whole[3100:]):
        write(Path("fit/monitor.sqlite"), content)
        result = run("monitor", "fit", "s.csv")
        assert (result.code, result.err.count("\n")) == (2, 1), result.err
