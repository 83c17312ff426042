"""``errormodel explain``: why a diagnosis found what it found, and where another effect dropped out."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import pandas as pd
import pytest

from errormodel import simulate
from errormodel.effects.station_shift import StationShift
from errormodel.effects.unnamed import Unnamed
from errormodel.machine_library import library
from identification import diagnose, explain
from identification.diagnosis.decisions.fates import FOUND, NAMELESS, History
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.search.candidates import TIE
from tests.helpers.commands import MILL, Done, Fill, done, run
from tests.helpers.interferometer import MILL as SMALL_MILL
from tests.helpers.interferometer import positioning, written

ROOT = Path(__file__).resolve().parents[2]
GANTRY = ROOT / "machines/examples/gantry"


@pytest.fixture
def gantry(demonstration: tuple[Path, str]) -> Path:
    return demonstration[0]


@pytest.fixture(scope="module")
def mill(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mill whose X has a play of 6 um either side, which its file does not know of."""
    folder = tmp_path_factory.mktemp("mill")
    worn = folder / "worn.yaml"
    worn.write_text(library()[MILL].read_text(encoding="utf-8") + "\neffects:\n  - {effect: backlash, joint: X}\n")
    simulate(worn, 150, {"X.dx.backlash": 0.006}, noise=0.002, seed=1).to_csv(folder / "s.csv", index=False)
    done("diagnose", MILL, folder / "s.csv", "--out", folder / "d")
    return folder / "d"


def said(folder: Path, *asked: str) -> str:
    return done("explain", folder, *asked).out


@pytest.mark.long
def test_a_finding_has_its_evidence_tests_and_alternatives(gantry: Path) -> None:
    text = said(gantry, "beam-sag@X")
    (finding,) = json.loads((gantry / "diagnosis.json").read_text())["findings"]
    assert text.startswith("beam-sag@X was found")
    assert finding["statement"] in text
    parts = ("number 1 of", "gain in log likelihood", "detection: ", "threshold 4.61, margin", "cross-validation: ")
    for part in parts:
        assert part in text
    assert "instead contact-knee@X" in text


def test_a_finding_of_a_mill_and_what_it_may_be_instead(mill: Path) -> None:
    assert said(mill, "backlash@X").startswith("backlash@X was found")
    text = said(mill, "lost-motion@X")
    assert "was not chosen: it is another explanation of backlash@X" in text
    assert "(log Bayes factor) behind backlash@X" in text


def test_an_effect_whose_channel_is_missing_was_not_considered(mill: Path) -> None:
    text = said(mill, "servo-lag")
    assert [line for line in text.splitlines() if line.endswith("could not be considered")] == [
        f"servo-lag@{joint} could not be considered" for joint in "XYZ"
    ]
    assert "no feed was recorded that changes" in text


def test_an_effect_that_a_finding_explains(gantry: Path) -> None:
    text = said(gantry, "backlash@X")
    assert "has none to speak of beside the findings: beam-sag@X explains" in text
    assert "first score" in text
    assert "last score" in text


def test_an_effect_with_too_little_evidence_and_one_that_was_no_candidate(gantry: Path) -> None:
    assert "too little evidence" in said(gantry, "ram-sag@Z")
    assert "was no candidate" in said(gantry, "eccentricity")  # it has no rotary joint


@pytest.mark.parametrize(("asked", "rule"), [("outliers", "gross-outlier: "), ("axis-blunder@X", "nominal-misfit: ")])
def test_what_the_data_are_checked_for_is_said_with_the_checks(gantry: Path, asked: str, rule: str) -> None:
    text = said(gantry, asked)
    assert "was not found: it is no candidate, the data are checked for it" in text
    assert rule in text


def test_no_finding_is_an_alternative_to_itself(gantry: Path) -> None:
    table, finding = said(gantry).split("probability of a name: ")[1].split("\n\n")[0], "beam-sag@X"
    assert finding in table
    assert f"instead {finding}" not in table


def test_the_margin_of_a_chance_is_a_factor(gantry: Path) -> None:
    (line,) = (x for x in said(gantry).splitlines() if "dependence-of-residuals: " in x)
    assert "(p-value), threshold 0.001, margin a factor of " in line


def test_all_stages_stand_in_their_order(gantry: Path) -> None:
    text = said(gantry)
    stages = ("data checks", "outliers", "instrument noise", "candidates", "forward selection", "untestable effects")
    places = [text.index(f"\n{stage}: ") for stage in stages]
    assert places == sorted(places)
    assert "beam-sag@X cross-validation" in text


@pytest.mark.long
def test_mistakes_of_the_recording_are_found_by_checks(tmp_path: Path) -> None:
    table = simulate(MILL, 80, noise=0.002, seed=2)
    table["X"] /= 25.4
    table.to_csv(tmp_path / "s.csv", index=False)
    done("diagnose", MILL, tmp_path / "s.csv", "--out", tmp_path / "d")
    assert "wrong-column: " in said(tmp_path / "d")
    assert "was found by a check of the data" in said(tmp_path / "d", "axis-blunder")


def test_joints_that_were_diagnosed_by_themselves_are_told_apart(tmp_path: Path) -> None:
    (tmp_path / "mill.yaml").write_text(SMALL_MILL)
    table = positioning(6, runs=3)
    table.loc[30:43, "dx"] += 12.0
    done("diagnose", tmp_path / "mill.yaml", written(tmp_path, table), "--out", tmp_path / "d")
    text = said(tmp_path / "d")
    assert "run-lost-zero: " in text
    assert "==== displacements of X" in text
    assert "backlash@X was found" in said(tmp_path / "d", "backlash@X")
    assert "was found by a check of the data" in said(tmp_path / "d", "station-shift@frame")


# ---- the files


def test_the_log_is_in_the_manifest(gantry: Path) -> None:
    assert "decisions.csv" in json.loads((gantry / "manifest.json").read_text())["files"]
    done("verify", gantry)


@pytest.mark.long
def test_the_log_is_the_same_from_run_to_run(gantry: Path, tmp_path: Path) -> None:
    done("diagnose", GANTRY, GANTRY / "survey.csv", "--out", tmp_path / "again")
    for name in ("decisions.csv", "diagnosis.json"):
        assert (tmp_path / "again" / name).read_bytes() == (gantry / name).read_bytes()


def test_the_short_form_agrees_with_the_whole_log(gantry: Path) -> None:
    decisions = json.loads((gantry / "diagnosis.json").read_text())["decisions"]
    with (gantry / "decisions.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    counts = pd.DataFrame(rows).groupby(["stage", "outcome"]).size()
    assert {(s, o): n for s, own in decisions["stages"].items() for o, n in own.items()} == counts.to_dict()
    assert [(f["effect"], f["where"]) for f in decisions["findings"]] == [("beam-sag", "X")]
    near = {(n["effect"], n["where"]): n for n in decisions["near"]}
    assert near["higher-order-geometry", "X"]["fate"] == "alternative"
    assert near["higher-order-geometry", "X"]["explained_by"] == ["beam-sag@X"]


@pytest.mark.long
def test_every_candidate_is_scored_in_the_first_round(gantry: Path) -> None:
    """The first scores are those of the ranking from which the map of where is drawn."""
    result = diagnose(GANTRY / "machine.yaml", GANTRY / "survey.csv")
    table = result.decisions
    first = table[(table["rule"] == "candidate-score") & (table["round"] == 0)]
    strong = [(r.effect.effect, r.effect.where, " ".join(r.effect.drivers)) for r in result.diagnosed.ranking]
    assert set(strong) <= set(zip(first["effect"], first["where"], first["driver"], strict=True))
    assert first["value"].diff().max() <= TIE  # what is alike has a fixed order
    assert result.explain("beam-sag@X").summary() + "\n" == said(gantry, "beam-sag@X")


# ---- in Python, and the figure


def test_the_function_answers_as_the_command_does(gantry: Path) -> None:
    answer = explain(gantry, "contact-knee")
    assert answer.summary() + "\n" == said(gantry, "contact-knee")
    assert answer.fates[0].place == "contact-knee@X"
    assert set(answer.decisions["effect"]) == {"contact-knee"}
    assert len(explain(gantry).decisions) > 1000


@pytest.mark.parametrize("suffix", ["svg", "png"])
def test_the_figure_is_the_same_each_time(gantry: Path, tmp_path: Path, suffix: str) -> None:
    for name in ("one", "two"):
        assert "Figure: " in done("explain", gantry, "--out", tmp_path / f"{name}.{suffix}").out
    assert (tmp_path / f"one.{suffix}").read_bytes() == (tmp_path / f"two.{suffix}").read_bytes()


def test_the_figure_shows_what_was_asked_for(gantry: Path, tmp_path: Path) -> None:
    for name, asked in (("all", ()), ("one", ("ram-sag@Z",))):
        done("explain", gantry, *asked, "--out", tmp_path / f"{name}.svg")
    everything, one = ((tmp_path / f"{name}.svg").read_text() for name in ("all", "one"))
    for part in ("beam-sag@X", "another explanation of a finding", "gain in log likelihood"):
        assert part in everything
    assert "ram-sag@Z" not in everything
    assert "ram-sag@Z" in one


# ---- what cannot be answered


def refused(result: Done, *parts: str) -> None:
    assert result.code == 2
    assert result.out == ""
    assert len(result.err.strip().splitlines()) == 1
    for part in parts:
        assert part in result.err


def test_what_is_not_known_is_refused(gantry: Path, tmp_path: Path) -> None:
    refused(run("explain", gantry, "beam-sagg"), "no effect 'beam-sagg'", "Did you mean 'beam-sag'")
    refused(run("explain", gantry, "beam-sag@Q"), "no place 'Q'", "Valid:")
    refused(run("explain", gantry, "beam-sag@"), "no place ''")
    refused(run("explain", tmp_path / "nowhere"), "nowhere")
    refused(run("explain", gantry, "--out", tmp_path / "x.txt"), "a drawing of type '.txt'")
    assert not (tmp_path / "x.txt").exists()


def test_a_folder_without_a_decision_log_is_refused(with_mill: Fill, gantry: Path, tmp_path: Path) -> None:
    with_mill(tmp_path)
    refused(run("explain", tmp_path / "fit"), "the results of `errormodel fit`, and no diagnosis")
    old = tmp_path / "old"
    shutil.copytree(gantry, old)
    (old / "decisions.csv").unlink()
    made = json.loads((old / "manifest.json").read_text())
    del made["files"]["decisions.csv"]  # as an earlier version wrote it
    (old / "manifest.json").write_text(json.dumps(made))
    refused(run("explain", old), "no decisions.csv", "Run `errormodel diagnose` again")


def test_a_log_that_was_changed_is_refused(gantry: Path, tmp_path: Path) -> None:
    shutil.copytree(gantry, tmp_path / "d")
    path = tmp_path / "d/decisions.csv"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace(",accepted,", ",refused,"), encoding="utf-8")
    refused(run("explain", tmp_path / "d"), "decisions.csv", "changed since")
    path.write_text(text + "x\n", encoding="utf-8")
    refused(run("explain", tmp_path / "d"), f"decisions.csv, row {len(text.splitlines())}: it cannot be read")


def test_a_diagnosis_without_a_manifest_is_judged_by_what_it_holds(gantry: Path, tmp_path: Path) -> None:
    shutil.copytree(gantry, tmp_path / "d")
    (tmp_path / "d/manifest.json").unlink()
    log, diagnosis = tmp_path / "d/decisions.csv", tmp_path / "d/diagnosis.json"
    text, held = log.read_text(encoding="utf-8"), diagnosis.read_text(encoding="utf-8")
    for wrong in (text.splitlines()[0] + "\n", ""):
        log.write_text(wrong, encoding="utf-8")
        refused(run("explain", tmp_path / "d"), "decisions.csv", "no decision in it")
    log.write_text(text.replace(",1,", ",nan,", 1), encoding="utf-8")
    refused(run("explain", tmp_path / "d"), "decisions.csv, row 1: it cannot be read")
    log.write_text(text, encoding="utf-8")
    diagnosis.write_text(held.replace("errormodel.diagnosis/1", "errormodel.diagnosis/9"), encoding="utf-8")
    refused(run("explain", tmp_path / "d"), "errormodel.diagnosis/9")
    diagnosis.write_text(held.replace('"noise_um":', '"noise_um": NaN, "was":'), encoding="utf-8")
    refused(run("explain", tmp_path / "d"), "diagnosis.json, key noise_um", "not finite")


def test_a_name_that_was_refused_is_told_from_what_was_found() -> None:
    """A motion that jumps at one time was found in the form of a station that moved, which it is not."""
    log, shift, none = DecisionLog(), StationShift(at=100.0), Unnamed(element="frame", motion="dz", driver="time")
    log.add("candidate-score", "examined", shift, 500.0)
    log.add("candidate-score", "scored", none, 0.7)
    log.add("cross-validation", "added", shift, 0.5, 1.0)
    log.begin(1)
    log.add("name-probability", "kept", shift, 0.95)
    log.add("nameless-alternative", "refused", shift, -4.0, 0.0, beside="dz of X by time")
    history = History(log, [("unnamed", "frame")])
    name, found = history.fate("station-shift", "frame"), history.fate("unnamed", "frame")
    assert (name.word, name.explained_by) == (NAMELESS, ("unnamed@frame",))
    assert (found.word, found.explained_by) == (FOUND, ("station-shift@frame",))
    assert found.first is not None
    assert found.first.value == 500.0
