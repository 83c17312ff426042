"""The README keeps its word: its two commands and its table of commands."""

from __future__ import annotations

import json
import re
import shlex
import shutil
from pathlib import Path

from tests.helpers.commands import done

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
SHELL = [block.splitlines() for block in re.findall(r"^```sh\n(.*?)^```", README, re.MULTILINE | re.DOTALL)]


def test_two_commands_of_one_line_come_first() -> None:
    """One sets up and runs the main job, one runs the tests."""
    assert [len(block) for block in SHELL[:2]] == [1, 1]
    assert SHELL[1][0].endswith("-m pytest")


def test_the_first_command_finds_what_the_demonstration_hides(demonstration: tuple[Path, str], tmp_path: Path) -> None:
    diagnose, compensate = (shlex.split(part) for part in SHELL[0][0].split("&&")[-2:])
    assert diagnose[0] == compensate[0] == ".venv/bin/errormodel"
    words, example = diagnose, "machines/examples/gantry"
    assert words[1:] == ["diagnose", example, f"{example}/survey.csv", "--out", "demo"]
    made, printed = demonstration
    shutil.copytree(made, tmp_path / "demo")
    (finding,) = json.loads((tmp_path / "demo/diagnosis.json").read_text())["findings"]
    assert finding["statement"] in printed
    (truth,) = json.loads((ROOT / words[2] / "truth.json").read_text())["effects"]
    assert finding["effect"] in truth["accept"]
    assert finding["where"] in truth["where"]
    held = finding["heldout_rms_um"]
    assert held["after"] < 0.7 * held["before"]
    for name in ("fit.json", "parameters.csv", "residuals.csv", "machine.yaml", "report.html"):
        assert (tmp_path / "demo" / name).stat().st_size > 0, name
    assert compensate[2] == words[-1]
    assert compensate[-2] == "--out"
    done("compensate", tmp_path / "demo", *compensate[3:-1], tmp_path / "demo/tables")
    figures = json.loads((tmp_path / "demo/tables/compensation.json").read_text())["sets"][0]["figures"]
    assert all(f["removed"] > 0.9 for f in figures[:2])


def test_every_command_is_in_the_readme() -> None:
    from identification.command_line.main import app

    assert {name for name in app.commands if f"| `errormodel {name}" not in README} == set()
