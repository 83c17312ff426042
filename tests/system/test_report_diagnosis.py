"""The page of a diagnosis and its figures: each finding is shown, for whatever effect it is, and nothing else is."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from errormodel.chain import Chain
from errormodel.effects import make, registry
from errormodel.effects.hysteresis import Hysteresis
from errormodel.files import write_csv
from errormodel.instruments.plain import Plain
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine
from errormodel.simulation import measured_at, outward, random_points
from errormodel.survey import Survey, read_survey
from errormodel.truth import Truth
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.pipeline import diagnose
from identification.diagnosis.results.diagnosed import Diagnosed
from identification.diagnosis.results.findings import Alternative, Finding, HeldOut, Untestable
from identification.diagnosis.search.candidates import Candidates
from identification.diagnosis.search.model import EffectModel
from identification.diagnosis.search.scoring import Step
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit
from identification.plots.effect_curve import Channels, curves, draw_effect_curve
from identification.plots.residuals_along_driver import binned, draw_residuals_along_driver
from identification.plots.style import render
from identification.plots.where_map import where_map
from identification.report import write_report
from identification.report.diagnosis import numbered, odds
from identification.results.analysis import Analysis
from identification.results.residual_projection import evidence_of
from tests.helpers import effect_battery as battery
from tests.helpers.nightly import first_of
from tests.helpers.pages import Page

pytestmark = pytest.mark.every_figure

MOVING = [w for w in battery.WORDS if registry()[w].family != "blunder"]
BACKLASH = 0.03  # mm
NOISE = 0.003


@cache
def grown(word: str) -> tuple[EffectModel, Fit, dict[str, float]]:
    """An effect of the battery as the one finding of its recording, the fit with it, and the truth."""
    machine, effect = battery.example(word)
    ids, frame = battery.own_ids(machine), battery.table(machine.name)
    sizes = [term.size for term, _ in battery.numeric(effect, machine, battery.arrays(machine.name))]
    truth = battery.base_errors(machine.name) | dict(zip(ids, sizes, strict=True))
    measured = measured_at(machine, frame, Truth(truth), battery.NOISE, seed=6)[["mx", "my", "mz"]]
    table = pd.concat([frame, measured], axis=1)
    survey = Survey(table, "shared", ("frame",), Plain(), Path("battery.csv"))
    linear = set_up(fit_machine(replace(machine, effects=()), survey))
    step = Step(effect, 100.0, 100.0, 0.5)
    return EffectModel(linear, linear.with_effect(effect), (step,)), fit_machine(machine, survey), truth


@pytest.mark.parametrize("word", first_of(MOVING, 4))
def test_every_effect_can_be_drawn(word: str) -> None:
    model, fit, _ = grown(word)
    evidence = evidence_of(model, model.findings[0])
    assert np.square(evidence.after).sum() < np.square(evidence.before).sum()
    assert evidence.abscissa.label
    figures = (draw_residuals_along_driver(evidence, fit.sigma_mm), draw_effect_curve(evidence, model, fit))
    for figure in figures:
        assert all(axes.get_xlabel() for axes in figure.axes)
        assert figure.axes[0].get_ylabel().endswith(("/ µm", "/ µrad"))
        assert len(render(figure, "png", 50)) > 1000
    families = curves(evidence, model, fit)
    assert 0 < len(families) <= 6
    for family in families.values():
        assert len(family) == (len(evidence.split.levels) if evidence.split else 1)
        for curve in family:
            assert np.isfinite([curve.x, curve.value, curve.band]).all()
    assert any(curve.value.any() and curve.band.any() for family in families.values() for curve in family)


def test_the_curve_is_the_effect_within_its_band() -> None:
    model, fit, truth = grown("lost-motion")
    evidence = evidence_of(model, model.findings[0])
    ((key, (up, down)),) = curves(evidence, model, fit).items()
    assert key == ("X", "dx")
    assert (up.label, down.label) == ("X arrived from below", "X arrived from above")
    true = 1e3 * (truth["X.dx.lost-motion-growth"] * up.x / 2000 + truth["X.dx.lost-motion-size"]) / 2
    for curve, side in ((up, 1), (down, -1)):
        assert (np.abs(curve.value - side * true) < 2 * curve.band).all()
        assert (curve.band < 0.2 * np.abs(true).max()).all()


def test_residuals_are_those_of_the_fit() -> None:
    model, fit, _ = grown("backlash")
    evidence = evidence_of(model, model.findings[0])
    assert (evidence.element, evidence.motion) == ("X", "dx")
    np.testing.assert_allclose(evidence.after, 1e3 * fit.residuals[:, 0], atol=0.05)
    up = evidence.channel("dir_X") > 0
    assert evidence.split is not None
    assert ((evidence.split.member == 0) == up).all()
    assert evidence.before[up].mean() - evidence.before[~up].mean() > 5  # of 20 um; geometry takes the rest
    assert abs(evidence.after[up].mean() - evidence.after[~up].mean()) < 0.1


def test_a_wave_with_many_periods_is_folded() -> None:
    model, fit, _ = grown("pitch-cyclic")
    evidence = evidence_of(model, model.findings[0])
    assert evidence.abscissa.period == pytest.approx(10.0)
    shown = evidence.abscissa.shown(evidence.channel("X"))
    assert 0 <= shown.min() < shown.max() <= 10
    ((curve,),) = curves(evidence, model, fit).values()
    assert np.ptp(curve.x) == pytest.approx(30)


def test_few_values_are_drawn_as_they_are() -> None:
    """A target offset belongs to one of two tools, and there is nothing between them."""
    model, fit, _ = grown("target-offset")
    evidence = evidence_of(model, model.findings[0])
    assert evidence.abscissa.name == "tool_z"
    for (curve,) in curves(evidence, model, fit).values():
        np.testing.assert_array_equal(curve.x, np.unique(evidence.channel("tool_z")))
        assert np.count_nonzero(curve.value) == 1


def test_hysteresis_is_drawn_there_and_back() -> None:
    model, fit, truth = grown("hysteresis")
    effect = model.steps[0].effect
    assert isinstance(effect, Hysteresis)
    evidence = evidence_of(model, model.findings[0])
    ((up, down),) = curves(evidence, model, fit).values()
    size = 1e3 * truth["X.dx.hysteresis"]
    assert (up.value[0], up.value[-1]) == pytest.approx((-size / 2, size / 2), abs=2 * up.band.max())
    assert (down.value[0], down.value[-1]) == pytest.approx((-size / 2, size / 2), abs=2 * up.band.max())
    wound = up.x > up.x[0] + effect.width
    assert np.ptp(up.value[wound]) < 1e-9 < np.ptp(up.value[~wound])
    middle = Channels(evidence, {"dir_X": np.ones(1)})
    assert middle("X") - middle(f"play(X,{effect.width})") == pytest.approx(effect.width / 2)


def test_what_began_with_another_state_is_drawn_over_time() -> None:
    """A spindle 0.9 K colder than its sensor in the first row: what fades of that is no second sensor."""
    options: dict[str, object] = {"sensor": "T_spindle", "tau": 600.0, "initial": -0.9}
    plain = read_machine("vertical_three_axis")
    options["element"] = plain.elements[-1].name
    machine = replace(plain, effects=(EffectSpec("spindle-growth", options),))
    frame = random_points(plain, 150, 3).assign(time=np.arange(150) * 60.0)
    frame = frame.assign(T_spindle=20.0 + 14.0 * (1 - np.exp(-frame["time"] / 1500.0)), run="1", role="fit")
    frame = frame.assign(file="warm.csv", row=np.arange(1, 151))
    truth = {next(i for i in Chain(machine).ids if "spindle-growth" in i): 2e-3}
    seen = measured_at(machine, frame, Truth(truth), 1e-3, seed=6)[["mx", "my", "mz"]]
    survey = Survey(pd.concat([frame, seen], axis=1), "shared", ("frame",), Plain(), Path("warm.csv"))
    linear = set_up(fit_machine(plain, survey))
    step = Step(make(machine.effects[0]), 100.0, 100.0, 0.5)
    model = EffectModel(linear, linear.with_effect(step.effect), (step,))
    evidence = evidence_of(model, model.findings[0])
    assert evidence.abscissa.name == "time"
    ((curve,),) = curves(evidence, model, fit_machine(machine, survey)).values()
    assert curve.value[0] == 0
    assert abs(curve.value[-1]) == pytest.approx(2e-3 * 14 * 1e3, rel=0.2)
    assert Channels(evidence, {"T_spindle": np.full(1, 30.0)})("initial(T_spindle,600)") == 0


def test_bins_hold_all_rows_and_their_scatter() -> None:
    rng = np.random.default_rng(4)
    x = rng.integers(0, 3, 900).astype(float)
    middle, mean, error = binned(x, 5 * x + rng.normal(size=900), 20)
    np.testing.assert_array_equal(middle, [0, 1, 2])
    np.testing.assert_allclose(mean, [0, 5, 10], atol=0.25)
    np.testing.assert_allclose(error, 1 / np.sqrt(300), rtol=0.2)
    assert all(len(part) == 0 for part in binned(np.zeros(0), np.zeros(0), 5))


def test_the_map_shows_where() -> None:
    model, _, _ = grown("backlash")
    ranking = Candidates.of(model.start).scores(model.start).ranking()
    found = where_map(model, ranking, [(3, model.findings[0])])
    row, column = found.rows.index(("X", "dx")), found.columns.index("dir_X")
    assert found.marks == {(row, column): [3]}
    assert found.share[row, column] > 0.9
    assert found.share[row, column] == np.nanmax(found.share)
    assert np.nanmax(found.share) <= 1
    assert np.isnan(found.share).any()


def recorded(folder: Path, effects: tuple[EffectSpec, ...]) -> tuple[Machine, Survey]:
    machine = read_machine("vertical_three_axis")
    points = random_points(machine, 150, 3)
    truth = Truth({"X.dx.backlash": BACKLASH} if effects else {})
    table = measured_at(replace(machine, effects=effects), points, truth, NOISE, 3)[["mx", "my", "mz"]]
    write_csv(outward(points, machine).join(table), folder / "s.csv")
    return machine, read_survey(folder / "s.csv", machine)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Diagnosed:
    """A backlash, and before it a blunder that an ill-meaning user has named."""
    diagnosed = diagnose(*recorded(tmp_path_factory.mktemp("found"), (EffectSpec("backlash", {"joint": "X"}),)))
    (own,) = diagnosed.diagnosis.findings
    assert own.effect == "backlash"
    blunder = Finding("axis-blunder", "<b>Q</b>", "Column -1 +- 2 um", 0.999, 0.0, HeldOut(90.0, 5.0), "mend <it>")
    unseen = (Untestable("refraction", "one <station>", "another"),)
    diagnosis = replace(diagnosed.diagnosis, findings=(blunder, own), untestable=unseen, unexplained="some <u>")
    return replace(diagnosed, diagnosis=diagnosis)


@pytest.fixture(scope="module")
def page(found: Diagnosed, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_report(Analysis(found.final), path, found)
    return path.read_text(encoding="utf-8")


def pictures_of(page: str) -> list[str]:
    return [values["alt"] for tag, values in Page(page).elements if tag == "img"]


@pytest.mark.long
def test_each_finding_is_shown(found: Diagnosed, page: str) -> None:
    assert list(numbered(found)) == [2]
    own = [alt for alt in pictures_of(page) if "finding 2, backlash at X" in alt]
    assert len(own) == 2
    assert sum("the findings are framed" in alt for alt in pictures_of(page)) == 1
    tables = Page(page).tables
    assert [cells[0] for cells in tables["found"][1:]] == ["1. Axis-blunder at <b>Q</b>", "2. Backlash at X"]
    assert tables["found"][2][1] == "side from which X arrives"
    ((name, value, unit),) = tables["size-2"][1:]
    size, std = (float(v) for v in value.split(" ± "))
    assert (name, unit) == ("X.dx.backlash", "µm")
    assert abs(size - 1e3 * BACKLASH) < 4 * std < 8
    assert ["Next measurement", "mend <it>"] in tables["facts-1"]
    assert tables["unseen"][1:] == [["refraction", "one <station>", "another"]]
    assert "Column −1 ± 2 µm" in page
    assert re.search(r"Axis-blunder at &lt;b&gt;Q&lt;/b&gt; and backlash of X by \d+ µm \(EXX\); [a-z]+", page)
    assert "left over: some &lt;u&gt;" in page


def test_same_diagnosis_same_bytes(found: Diagnosed, page: str, tmp_path: Path) -> None:
    write_report(Analysis(found.final), tmp_path / "again.html", found)
    assert (tmp_path / "again.html").read_bytes() == page.encode()


def test_the_page_is_whole_and_accessible(page: str) -> None:
    elements = Page(page).elements
    ids = [values["id"] for _, values in elements if "id" in values]
    assert len(set(ids)) == len(ids)
    places = [v for _, values in elements for name, v in values.items() if name in ("src", "href")]
    assert all(place.startswith(("data:image/", "#")) for place in places)
    assert {p[1:] for p in places if p.startswith("#")} <= set(ids)
    labels = {values["aria-labelledby"] for _, values in elements if "aria-labelledby" in values}
    assert labels <= set(ids)
    assert all(pictures_of(page))
    tags = [tag for tag, _ in elements]
    assert tags.count("table") == tags.count("caption") == tags.count("thead")
    drawn = sum(tag == "svg" and values.get("class") == "dots" for tag, values in elements)  # by the browser
    assert tags.count("figure") == tags.count("figcaption") == tags.count("img") + drawn
    assert not {"b", "u", "it", "station"} & set(tags)
    assert not re.search(r"http|url\(|@import|//", re.sub(r'src="data:[^"]*"', "", page))


def test_nothing_found_is_said_plainly(tmp_path: Path) -> None:
    diagnosed = diagnose(*recorded(tmp_path, ()))
    assert diagnosed.diagnosis.findings == ()
    write_report(Analysis(diagnosed.final), tmp_path / "report.html", diagnosed)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Nothing was found: the model and the noise explain what was measured." in page
    assert not [alt for alt in pictures_of(page) if "finding" in alt]
    parsed = Page(page)
    assert "found" not in parsed.tables
    assert [cells[0] for cells in parsed.tables["unseen"][1:]] == [u.effect for u in diagnosed.diagnosis.untestable]
    assert "scale-expansion" in page  # a survey without temperatures cannot show it, and that is said


@pytest.mark.parametrize(
    ("power", "words"),
    [(-0.6, "4 times less likely"), (-0.1, "fits about as well"), (0.3, "2 times likelier"), (-120.0, "by far less")],
)
def test_odds_in_words(power: float, words: str) -> None:
    separable = abs(power) > 2
    share, text, said = odds(Alternative("backlash", "X", power, separable, probability=0.25))
    assert share == "0.25"
    assert text.startswith(words)
    assert said == ("distinguishable" if separable else "not distinguishable by this data")


def test_a_long_recording_stays_small() -> None:
    """Figures hold at most some thousand dots, whatever the survey."""
    model, fit, _ = grown("backlash")
    evidence = evidence_of(model, model.findings[0])
    many = replace(
        evidence,
        first=np.tile(evidence.first, 40),
        before=np.tile(evidence.before, 40),
        after=np.tile(evidence.after, 40),
        split=replace(evidence.split, member=np.tile(evidence.split.member, 40)) if evidence.split else None,
    )
    figure = draw_residuals_along_driver(many, fit.sigma_mm)
    assert isinstance(figure, Figure)
    dots = sum(len(line.get_xdata()) for line in figure.axes[0].get_lines() if line.get_marker() == ".")
    assert dots <= 1500
    assert many.split is not None
    one_sided = replace(many, split=replace(many.split, member=np.zeros(len(many.before), dtype=np.intp)))
    _, texts = draw_residuals_along_driver(one_sided, fit.sigma_mm).axes[0].get_legend_handles_labels()
    assert texts == ["X arrived from below"]
