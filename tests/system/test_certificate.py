"""The block ``test:`` and the certificate: verdict first, head, digests, the same bytes, and what is missing."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pandas as pd
import pytest

from errormodel.files import sha256
from tests.helpers.commands import MILL, done, run, tree, write
from tests.helpers.pages import Page

FILES = "errormodel: 1\nfiles: [{path: laser.csv}]\n"
INSTRUMENT = "instrument: {type: interferometer, sigma: [0.1e-3, 0.5e-6]}\n"
TEST = """test:
  number: C-17
  operator: A. Tester
  laboratory: Laboratory <one>
  date: 2026-11-20
  place: Hall 3
  machine: {maker: Maker, model: VMC 500, serial: "4711", controller: "1.2"}
  instrument: {maker: Optics, model: Laser, serial: "X1", certificate: K-1, due: 2027-06-30}
  ambient: {temperature: 20.3, humidity: 41}
  standard: ISO 230-2:2014
  tolerance: {A: 30 um, X.B: 3 um, G(b): 10 um}
"""


def laser(folder: Path, more: str = INSTRUMENT + TEST) -> Path:
    """Five runs of X to and fro with a scale of 20 um/m and a play of 8 um, as an interferometer sees them."""
    rows = []
    for cycle in range(5):
        for side in (1, -1):
            for x in [-300.0, -170.0, -40.0, 90.0, 220.0, 300.0][::side]:
                noise = 0.0002 * ((7 * len(rows)) % 11 - 5) / 5
                row = {"joint": "X", "X": x, "dx": 20e-6 * x + 0.004 * side + noise, "u_dx": 2e-4, "run": cycle}
                rows.append(row)
    pd.DataFrame(rows).to_csv(folder / "laser.csv", index=False)
    return write(folder / "survey.yaml", FILES + more)


def evaluated(folder: Path, *words: object, more: str = INSTRUMENT + TEST) -> Page:
    """The certificate in ``out``."""
    done("iso", "230-2", MILL, laser(folder, more), "--out", folder / "out", *words)
    return Page((folder / "out/certificate.html").read_text(encoding="utf-8"))


def said(folder: Path) -> str:
    (text,) = re.findall(
        r'<p class="headline">(.*?)</p>', (folder / "out/certificate.html").read_text(encoding="utf-8")
    )
    return str(text)


def test_the_first_page_has_verdict_head_decisions_and_signatures(tmp_path: Path) -> None:
    page = evaluated(tmp_path)
    assert said(tmp_path).startswith("Fails: X.B 8")
    text = (tmp_path / "out/certificate.html").read_text(encoding="utf-8")
    first = text[text.index('id="first"') : text.index('id="part-230-2"')]
    assert first.index("Fails: X.B") < first.index("Maker, VMC 500") < first.index("Approved by")
    assert "Laboratory &lt;one&gt;" in first
    assert dict(page.tables["test"])["Its calibration"] == "K-1, valid until 2027-06-30"
    head, *rows = page.tables["first-figures"]
    assert head[-2:] == ["Limit", "Decision"]
    assert [(row[0], row[-1]) for row in rows] == [("X.B", "✗ fails"), ("X.A", "✓ passes")]
    assert "G(b)" in first
    assert "counter(page)" in text


def test_the_digests_are_those_of_the_raw_files(tmp_path: Path) -> None:
    page = evaluated(tmp_path)
    files = dict(page.tables["files"][1:])
    assert files["laser.csv"] == sha256(tmp_path / "laser.csv")
    assert files["survey.yaml"] == sha256(tmp_path / "survey.yaml")
    beside = json.loads((tmp_path / "out/evaluation.json").read_text())
    assert {f["name"]: f["sha256"] for f in beside["inputs"]} == files


def test_the_file_beside_it_has_all_figures_decisions_and_the_test(tmp_path: Path) -> None:
    evaluated(tmp_path)
    beside = json.loads((tmp_path / "out/evaluation.json").read_text())
    assert beside["schema"] == "errormodel.iso/1"
    assert beside["verdict"] == "fails"
    assert beside["test"]["machine"]["serial"] == "4711"
    assert beside["missing"] == []
    (standard,) = beside["standards"]
    figures = {q["symbol"]: q for q in standard["quantities"]}
    assert figures["B"]["value"] == pytest.approx(0.008, abs=4e-4)
    assert figures["E"]["value"] == pytest.approx(20e-6 * 600 + 0.008, abs=4e-4)
    decided = {d["name"]: d for d in beside["conformity"]["decisions"]}
    assert decided["X.B"]["guard_band"] == pytest.approx(1.65 * figures["B"]["expanded_uncertainty"] / 2)
    table = pd.read_csv(tmp_path / "out/figures.csv").set_index("name")
    assert table.loc["X.B", "value"] == pytest.approx(1e3 * figures["B"]["value"])


@pytest.mark.every_figure
def test_the_same_input_gives_the_same_bytes(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    for name in "ab":
        evaluated(tmp_path / name)
    assert tree(tmp_path / "a/out") == tree(tmp_path / "b/out")


def test_without_the_block_it_says_what_is_missing(tmp_path: Path) -> None:
    evaluated(tmp_path, more="")
    text = (tmp_path / "out/certificate.html").read_text(encoding="utf-8")
    assert said(tmp_path) == "No tolerance is stated: figures without a decision."
    for key in ("operator", "date", "machine.serial", "instrument.due", "tolerance"):
        assert key in text
    assert json.loads((tmp_path / "out/evaluation.json").read_text())["test"] is None


def test_what_was_assumed_of_the_rows_is_on_the_certificate(tmp_path: Path) -> None:
    """No column says from which side X arrived; a limit in another unit is shown as it was stated."""
    evaluated(tmp_path, more=INSTRUMENT + TEST.replace("A: 30 um", "A: 0.03 mm"))
    page = (tmp_path / "out/certificate.html").read_text(encoding="utf-8")
    assert "the side of arrival is taken from the order of the rows" in page
    assert "30 µm (0.03 mm)" in page
    found = json.loads((tmp_path / "out/evaluation.json").read_text())
    assert found["coverage"] == {"k": 2.0, "probability": 0.95}
    assert found["units"]["figures"]["mm"] == r"\milli\metre"


def test_limits_of_the_command_line_and_another_rule(tmp_path: Path) -> None:
    evaluated(tmp_path, "--tolerance", "X.B=10 um", "--decision", "simple")
    assert said(tmp_path) == "Passes: all 2 tolerances are met."
    beside = json.loads((tmp_path / "out/evaluation.json").read_text())
    assert beside["conformity"]["rule"] == "simple"
    assert {d["guard_band"] for d in beside["conformity"]["decisions"]} == {0.0}


def test_a_value_within_the_guard_band_cannot_be_decided(tmp_path: Path) -> None:
    evaluated(tmp_path, "--tolerance", "X.B=8.1 um")
    assert said(tmp_path).startswith("Cannot be decided: X.B")


def test_an_expired_calibration_is_said(tmp_path: Path) -> None:
    evaluated(tmp_path, more=INSTRUMENT + TEST.replace("due: 2027-06-30", "due: 2026-06-30"))
    text = (tmp_path / "out/certificate.html").read_text(encoding="utf-8")
    assert "valid until 2026-06-30, before the test on 2026-11-20" in text


@pytest.mark.parametrize(
    ("wrong", "key", "cure"),
    [
        ("test: {date: 20.11.2026}", "test.date", "2026-11-20"),
        ("test: {operater: me}", "test.operater", "operator"),
        ("test: {tolerance: {A: 8}}", "test.tolerance", "limits with units"),
        ("test: {tolerance: {A: 8 kg}}", "test.tolerance", "8 um"),
        ("test: {decision: coin}", "test.decision", "guard-band"),
        ("test: {machine: {serial: 4711}}", "test.machine.serial", "in quotes"),
        ("test: {uncertainty: {environment: -1}}", "test.uncertainty.environment", "drift"),
    ],
)
def test_a_wrong_block_is_one_message(wrong: str, key: str, cure: str, tmp_path: Path) -> None:
    ended = run("iso", "230-2", MILL, laser(tmp_path, wrong + "\n"), "--out", tmp_path / "out")
    assert (ended.code, (tmp_path / "out").exists()) == (2, False)
    assert "survey.yaml" in ended.err
    assert key in ended.err, ended.err
    assert cure in ended.err, ended.err


def test_a_fit_carries_the_test_to_its_report_and_to_its_certificate(tmp_path: Path) -> None:
    done("simulate", MILL, 60, "--noise", 0.001, "--out", tmp_path / "laser.csv")
    tolerance = TEST.replace("{A: 30 um, X.B: 3 um, G(b): 10 um}", "{volume: 12 um}")
    survey = write(tmp_path / "survey.yaml", FILES + tolerance)
    done("fit", MILL, survey, "--out", tmp_path / "fit")
    report = Page((tmp_path / "fit/report.html").read_text(encoding="utf-8"))
    assert dict(report.tables["test"])["Serial number of the machine"] == "4711"
    done("iso", "volume", tmp_path / "fit", "--out", tmp_path / "out")
    assert said(tmp_path) == "Passes: the one tolerance is met."
    files = dict(Page((tmp_path / "out/certificate.html").read_text(encoding="utf-8")).tables["files"][1:])
    assert files["laser.csv"] == sha256(tmp_path / "laser.csv")  # of which the fit was made
    assert files["fit.json"] == sha256(tmp_path / "fit/fit.json")
    done("verify", tmp_path / "out")


def test_a_report_without_the_block_says_so(tmp_path: Path) -> None:
    done("simulate", MILL, 60, "--noise", 0.001, "--out", tmp_path / "s.csv")
    done("fit", MILL, tmp_path / "s.csv", "--out", tmp_path / "fit")
    assert "survey.yaml has no block test:" in (tmp_path / "fit/report.html").read_text(encoding="utf-8")
