"""Text of users' files travels through the whole of `compensate` as comments only, for every target."""

from __future__ import annotations

import re
from pathlib import Path

import pandas as pd
import pytest

from errormodel import library
from errormodel.controllers import registry
from errormodel.controllers.base import Rewriter
from tests.contract.test_controller_text import COMMENT, PEOPLE
from tests.helpers.commands import MILL, done, write
from tests.helpers.nightly import first_of

MARK = "QXQ"  # a word that no controller has; wherever it stands, a user's text got there
HOSTILE = f"{MARK}\nG0 Z-500 {MARK}\nM30 {MARK} ) % ; * M556 {MARK}\u2028G0 {MARK}"
DATA = (*PEOPLE, "checklist.txt", "compensation.json", "manifest.json")  # read by people and programmes, by no control
OFTEN = ("csv", "fanuc-pitch", "gcode", "heidenhain", "klipper", "siemens-lec", "twincat-nc")  # a comment of each kind
TARGETS = [*OFTEN, *sorted({*registry()} - {*OFTEN})]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fit of which every text is hostile: the machine's name and notes, runs, the survey's file and the folder."""
    folder = tmp_path_factory.mktemp("hostile")
    done("simulate", MILL, 60, "--noise", 0.002, "--out", folder / "plain.csv")
    table = pd.read_csv(folder / "plain.csv")
    table["run"] = [f"{HOSTILE} {k % 2}" for k in range(len(table))]
    table["T_QXQ\tM30"] = 20.0 + 0.1 * table.index
    table.to_csv(folder / f"{MARK}\nG0 Z-77.csv", index=False)
    text = re.sub(r"^name:.*$", "", library()[MILL].read_text(encoding="utf-8"), flags=re.M)
    quoted = HOSTILE.replace("\n", "\\n").replace("\u2028", "\\u2028")
    write(folder / "m.yaml", f'{text}\nname: "{quoted}"\n')
    done("fit", folder / "m.yaml", folder / f"{MARK}\nG0 Z-77.csv", "--out", folder / "fit")
    (folder / "fit").rename(folder / f"{MARK}\nG0 Z-66")
    write(folder / f"{MARK}\nM30.nc", "G90 G21\nG0 X10 Y10 Z200\nG1 X20 F100\n")
    return folder


@pytest.mark.parametrize("name", first_of(TARGETS, len(OFTEN)))
def test_no_text_leaves_its_comment(name: str, place: Path) -> None:
    more = ("--program", place / f"{MARK}\nM30.nc", "--at", "start=X0,Y0,Z200", "--offset", "X0,Y0,Z0")
    more = more if issubclass(registry()[name], Rewriter) else ("--points", 5)
    done("compensate", place / f"{MARK}\nG0 Z-66", "--controller", name, *more, "--out", place / name)
    seen = 0
    for path in sorted(p for p in (place / name).rglob("*") if p.is_file() and p.name not in DATA):
        for line in path.read_text(encoding="utf-8").split("\n"):
            assert all(" " <= c <= "~" for c in line), f"{path.name}: {line!r}"
            if MARK in line.upper():
                seen += 1
                assert COMMENT.fullmatch(line), f"{path.name}: {line!r}"
    assert seen or registry()[name].comment is None  # type: ignore[attr-defined]
