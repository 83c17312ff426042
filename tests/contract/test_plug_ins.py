"""What a user's own package brings by an entry point works like the project's own: one file each, and no other.

The files are those that the documentation shows as examples.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from tests.helpers.interpreter import Interpreter, interpreter

ROOT = Path(__file__).resolve().parents[2]

HEADINGS = {
    "effects": "An effect",
    "joint_models": "A joint error model",
    "controllers": "A controller",
    "instruments": "An instrument",
    "observations": "An observation",
    "formats": "A format",
    "raw_formats": "A raw format",
    "machine_formats": "A format of robot descriptions",
}


def example(heading: str) -> str:
    """The file that the documentation shows under a heading, whole."""
    page = (ROOT / "docs/extending.md").read_text(encoding="utf-8")
    (section,) = re.findall(rf"^## {heading}\n(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL)
    (code,) = re.findall(r"^```python\n(.*?)^```", section, re.MULTILINE | re.DOTALL)
    return str(code)


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an installed package of the user's."""
    folder = tmp_path_factory.mktemp("site")
    info = folder / "shop_floor-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: shop-floor\nVersion: 1.0\n")
    lines = []
    for group, heading in HEADINGS.items():
        (folder / f"shop_{group}.py").write_text(example(heading))
        lines.append(f"[errormodel.{group}]\nmine = shop_{group}\n")
    (info / "entry_points.txt").write_text("\n".join(lines))
    return folder


Run = Callable[..., str]


@pytest.fixture(scope="module")
def process(elsewhere: Path) -> Iterator[Interpreter]:
    """A process with that package installed."""
    with interpreter(paths=(elsewhere, ROOT / "docs")) as started:
        yield started


@pytest.fixture(scope="module")
def run(elsewhere: Path, process: Interpreter) -> Run:
    """Run ``errormodel <arguments>`` in that folder."""
    return partial(process.command, folder=elsewhere)


@pytest.fixture(scope="module")
def reference(process: Interpreter) -> Run:
    """A page of reference as the documentation writes it."""

    def page(name: str, *of: str) -> str:
        return process.python(f"import generate; print(*generate.{name}(*{of}), sep='\\n')", ROOT)

    return page


def test_a_package_of_the_users_brings_an_effect(elsewhere: Path, run: Run, reference: Run) -> None:
    """Simulated, found by the diagnosis under its name, fitted, predicted, in the report and in the documentation."""
    (elsewhere / "slip.yaml").write_text(
        (ROOT / "machines/vertical_three_axis.yaml").read_text()
        + "\neffects: [{effect: coupling-slip, joint: X, at: 76}]\n"
    )
    travel = "vertical_three_axis"
    (elsewhere / "truth.yaml").write_text("parameters: {X.dx.coupling-slip: 0.02}\n")
    words = ["--parameters", "truth.yaml", "--noise", 0.001, "--out", "s.csv"]
    run("simulate", "slip.yaml", 200, *words)
    said = run("diagnose", travel, "s.csv", "--out", "found")
    (finding,) = json.loads((elsewhere / "found/diagnosis.json").read_text())["findings"]
    assert (finding["effect"], finding["where"]) == ("coupling-slip", "X"), said
    assert "coupling" in (elsewhere / "found/report.html").read_text()
    run("fit", "slip.yaml", "s.csv", "--out", "fitted")
    values = {p["id"]: p for p in json.loads((elsewhere / "fitted/fit.json").read_text())["parameters"]}
    slip = values["X.dx.coupling-slip"]
    assert abs(slip["value"] - 0.02) < 4 * slip["std"]
    run("predict", "found", "s.csv", "--out", "p.csv")
    assert "### coupling-slip" in reference("effects")


def test_a_package_of_the_users_brings_an_instrument_and_a_format(elsewhere: Path, run: Run, reference: Run) -> None:
    run("simulate", "vertical_three_axis", 60, "--noise", 0.001, "--out", "plain.csv")
    (elsewhere / "data.bar").write_text((elsewhere / "plain.csv").read_text().replace(",", "|"))
    instrument = "{type: flat-probe, across: 0.001, along: 0.0005}"
    (elsewhere / "survey.yaml").write_text(f"errormodel: 1\nfiles: [{{path: data.bar}}]\ninstrument: {instrument}\n")
    run("fit", "vertical_three_axis", "survey.yaml", "--out", "probed")
    assert json.loads((elsewhere / "probed/fit.json").read_text())["sigma_from"] == "declared"
    assert "## flat-probe" in reference("instruments")
    assert ".bar" in reference("formats")


def test_a_package_of_the_users_brings_a_raw_format(elsewhere: Path, process: Interpreter, reference: Run) -> None:
    """Recognised by its content, and in the documentation."""
    (elsewhere / "level.lvl").write_text("SHOP LEVEL 3\nA1 1,5 2,5\nA2 -0,5 3,25\n")
    program = (
        "from pathlib import Path; from errormodel.raw_formats.base import *; "
        "raw = open_raw(Path('level.lvl'), 'level.lvl'); kind = format_of(raw); "
        "print(kind.name, *kind.read(raw, Asked()).frame['w_tilt_x_arcsec'])"
    )
    assert process.python(program, elsewhere).split() == ["level-list", "1.5", "-0.5"]
    assert "## level-list" in reference("formats")


def test_a_package_of_the_users_brings_a_format_of_robots(elsewhere: Path, run: Run, reference: Run) -> None:
    """Recognised by its content, written from a machine and read back, and in the documentation."""
    (elsewhere / "arm.lst").write_text("SHOP ARM\nA 0 0 1 0 0 400\nB 0 1 0 300 0 50\n")
    said = run("machine", "arm.lst", "--out", "arm.yaml")
    assert "A (rotary), B (rotary)" in said
    run("export", "arm.yaml", "--format", "arm-list", "--out", "again.lst")
    assert (elsewhere / "again.lst").read_text() == (elsewhere / "arm.lst").read_text()
    assert "arm-list" in run("export", "list")
    assert "## arm-list" in reference("machine_formats")


def test_a_package_of_the_users_brings_an_observation(elsewhere: Path, run: Run, reference: Run) -> None:
    """Simulated, fitted with its zero, predicted, in the report and in the documentation."""
    rows = [f"{x},{y},{z},G\n" for x in (-300, 0, 300) for y in (-150, 0, 150) for z in (150, 300, 450, 600)]
    (elsewhere / "heights.csv").write_text("X,Y,Z,observation\n" + "".join(rows))
    text = "errormodel: 1\nfiles: [{path: FILE}]\nobservations: {G: {type: height-gauge}}\n"
    (elsewhere / "heights.yaml").write_text(text.replace("FILE", "heights.csv"))
    (elsewhere / "heights_truth.yaml").write_text("parameters: {X.dz.2: 0.02}\nobservations: {G: {zero: 12.5}}\n")
    words = ["--parameters", "heights_truth.yaml", "--noise", 0.001, "--out", "read.csv"]
    run("simulate", "vertical_three_axis", "heights.yaml", *words)
    (elsewhere / "read.yaml").write_text(text.replace("FILE", "read.csv"))
    run("fit", "vertical_three_axis", "read.yaml", "--out", "heights")
    fit = json.loads((elsewhere / "heights/fit.json").read_text())
    (zero,) = fit["observations"]
    assert abs(zero["value"] - 12.5) < 0.02  # the bow of X is a height too, where X stands still
    bow = next(p for p in fit["parameters"] if p["id"] == "X.dz.2")
    assert abs(bow["value"] - 0.02) < 4 * bow["std"]
    assert "height-gauge" in (elsewhere / "heights/report.html").read_text()
    run("predict", "heights", "read.yaml", "--out", "heights_predicted.csv")
    assert "length" in (elsewhere / "heights_predicted.csv").read_text().splitlines()[0]
    assert "## height-gauge" in reference("observations")


@pytest.mark.long
def test_a_package_of_the_users_brings_a_joint_error_model(elsewhere: Path, run: Run, reference: Run) -> None:
    """Described, drawn, simulated, fitted to the truth, reported, predicted, stored and in the documentation."""
    text = (ROOT / "machines/vertical_three_axis.yaml").read_text()
    block = "errors:\n  shapes: none\n  joints: {X: {exx: {thread: 2}}, Y: {thread: 1}, Z: first-order}\n"
    text, count = re.subn(r"^errors:\n(?:^[ #].*\n)*", block, text, flags=re.MULTILINE)
    assert count == 1
    (elsewhere / "threads.yaml").write_text(text)
    assert "X.dx.sin2" in run("describe", "threads.yaml")
    truth = {"X.dx.sin2": 0.012, "Y.dz.cos1": -0.008}
    (elsewhere / "threads_truth.yaml").write_text(f"parameters: {json.dumps(truth)}\n")
    words = ["--parameters", "threads_truth.yaml", "--noise", 0.001, "--out", "threads.csv"]
    run("simulate", "threads.yaml", 200, *words)
    run("fit", "threads.yaml", "threads.csv", "--out", "threads")
    found = {p["id"]: p for p in json.loads((elsewhere / "threads/fit.json").read_text())["parameters"]}
    for name, value in truth.items():
        assert abs(found[name]["value"] - value) < 4 * found[name]["std"], name
    assert "thread: 2" in (elsewhere / "threads/machine.yaml").read_text()
    assert "thread" in (elsewhere / "threads/report.html").read_text()
    run("predict", "threads", "threads.csv", "--out", "threads_predicted.csv")
    run("diagnose", "threads.yaml", "threads.csv", "--out", "threads_diagnosed")
    assert json.loads((elsewhere / "threads_diagnosed/diagnosis.json").read_text())["findings"] == []
    page = reference("joint_models")
    assert "## thread" in page
    assert "ISO 3408-3" in page


def test_a_model_from_elsewhere_is_named_where_a_key_is_wrong(elsewhere: Path, run: Run) -> None:
    text = (ROOT / "machines/vertical_three_axis.yaml").read_text()
    text = re.sub(r"^errors:\n(?:^[ #].*\n)*", "errors: {joints: {X: {tread: 2}}}\n", text, flags=re.MULTILINE)
    (elsewhere / "wrong.yaml").write_text(text)
    with pytest.raises(AssertionError, match="Did you mean 'thread'"):
        run("describe", "wrong.yaml")


@pytest.mark.long
def test_a_package_of_the_users_brings_a_controller(elsewhere: Path, run: Run, reference: Run) -> None:
    run("simulate", "vertical_three_axis", 150, "--noise", 0.001, "--seed", 3, "--out", "drives.csv")
    run("fit", "vertical_three_axis", "drives.csv", "--out", "drives")
    assert "shop-table" in run("compensate", "--controller", "list")
    said = run("compensate", "drives", "--controller", "shop-table", "--out", "tables")
    assert "table of the shop's own drives" in said
    assert (elsewhere / "tables/shop.tab").read_text().startswith("; machine:")
    assert "load shop.tab" in (elsewhere / "tables/checklist.txt").read_text()
    assert "(controllers/shop-table.md)" in reference("controllers")
    assert "# shop-table" in reference("controller", "shop-table").splitlines()


@pytest.mark.long
def test_the_contract_tests_run_over_what_a_package_brings(elsewhere: Path, pytestconfig: pytest.Config) -> None:
    """A user's own file is held to what the project's own files are held to."""
    words = ("coupling-slip", "thread", "shop-table", "flat-probe", "height-gauge", ".bar")
    files = [*(ROOT / "tests/contract").glob("test_*.py"), *(ROOT / "tests").rglob("test_effects.py")]
    files += (ROOT / "tests").rglob("test_controllers.py")
    chosen = " or ".join(words)
    warnings = [f"-W{w}" for w in pytestconfig.getoption("pythonwarnings") or ()]  # as this run was told
    own = ("-n", "0", "-p", "no:cacheprovider", *warnings, "-k", chosen)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *own, *map(str, files)],
        cwd=ROOT, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(elsewhere), str(ROOT)])},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-3000:]
