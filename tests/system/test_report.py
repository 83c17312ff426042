"""The report and the figures of a fit: what they show is what the fit found, whoever named the machine."""

from __future__ import annotations

import base64
import re
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from errormodel.chain import Chain
from errormodel.files import write_csv, write_text_atomic
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine
from errormodel.simulation import measured_at, outward, random_points
from errormodel.survey import read_survey
from errormodel.truth import Truth
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit, Spread
from identification.plots.correlation import draw_correlation
from identification.plots.error_distribution import draw_error_distribution
from identification.plots.error_motions import draw_error_motions, moving_joints
from identification.plots.parameters import draw_parameters
from identification.plots.residuals import draw_residuals_by_order, draw_residuals_by_position
from identification.plots.singular_values import draw_singular_values
from identification.plots.style import plain, render
from identification.plots.volumetric_error import draw_volumetric_error
from identification.report import write, write_report
from identification.report.singular_values import HEIGHT, singular_values_part
from identification.report.tables import number
from identification.report.wording import short, strongest_correlation, three
from identification.results.analysis import Analysis
from identification.results.correlations import correlation
from identification.results.terminal import table_lines
from tests.helpers.pages import Page

pytestmark = pytest.mark.every_figure

HOSTILE = '</title><script>alert("x")</script> & $\\frac$ "M"'
SURVEY = """\
errormodel: 1
files:
  - {path: "fit $1$ <b>.csv", role: fit}
  - {path: "_test <img src=x>.csv", role: test}
frame: per-run
"""


def measured(machine: Machine, count: int, seed: int) -> pd.DataFrame:
    chain = Chain(machine)
    sizes = {"mm": 0.03, "rad": 5e-5, "1": 5e-5, "rad/mm": 5e-8}
    rng = np.random.default_rng(1)
    values = {p.id: sizes[p.unit] * rng.normal() for p in chain.parameters if p.id in chain.machine_ids}
    points = random_points(machine, count, seed)
    truth = Truth(values, (800.0, -1500.0, 300.0), (0.1, -0.2, 2.0))
    table = measured_at(machine, points, truth, 0.005, seed)[["mx", "my", "mz"]]
    table.loc[::17, "my"] = np.nan
    return outward(points, machine).drop(columns=["tool_x", "tool_y", "tool_z"]).join(table)


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    """A small machine with names from hell, two runs, an error motion measured by itself, and a test file."""
    folder = tmp_path_factory.mktemp("survey")
    machine = replace(read_machine("vertical_three_axis"), name=HOSTILE)
    rows = measured(machine, 120, 1).assign(run=["<i>1</i>"] * 60 + ["zwei $"] * 60)
    motion = pd.DataFrame({"joint": "X", "X": np.linspace(-300, 300, 20), "run": "laser"})
    motion["dx"] = 5e-5 * motion["X"] + 0.2 + 0.001 * np.random.default_rng(2).normal(size=20)
    write_csv(pd.concat([rows, motion]), folder / "fit $1$ <b>.csv")
    write_csv(measured(machine, 50, 2).assign(run="<u>3</u>"), folder / "_test <img src=x>.csv")
    write_text_atomic(SURVEY, folder / "survey.yaml")
    return fit_machine(machine, read_survey(folder / "survey.yaml", machine))


@pytest.fixture(scope="module")
def page(fit: Fit, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("report") / "new" / "report.html"
    write_report(Analysis(fit), path)
    return path.read_text(encoding="utf-8")


def test_report_shows_the_numbers_of_the_fit(fit: Fit, page: str) -> None:
    tables = Page(page).tables
    spreads = [fit.nominal, fit.fitted, fit.heldout, fit.tests[0].nominal, fit.tests[0].fitted]
    for cells, s in zip(tables["results"][1:], spreads, strict=True):
        assert cells[1:] == [f"{s.mean_um:.1f}", f"{s.rms_um:.1f}", f"{s.max_um:.1f}", str(s.n)]
    groups = [cells for cells in tables["groups"][1:] if len(cells) == 7]
    found = sorted(Analysis(fit).estimates, key=lambda e: ["member", "joint", "effect", "frame", "zero"].index(e.kind))
    assert len(groups) == len(found) == fit.solution.groups.rank
    for cells, e in zip(groups, found, strict=True):
        value, std = (float(v.replace("−", "-")) for v in cells[3].split(" ± "))
        assert cells[:3] + cells[4:5] == [str(e.number), e.formula, e.symbol + e.meaning, e.unit]
        assert std == pytest.approx(e.std, rel=0.06)
        assert value == pytest.approx(e.value, abs=0.06 * e.std)
    bars = re.findall(r'<path d="M([-\d.]+) 6H([-\d.]+)"/><circle cx="([-\d.]+)"', page)
    assert len(bars) == sum(e.kind in ("member", "joint", "effect") for e in found)
    assert all(0 < float(low) <= float(at) <= float(high) < 120 for low, high, at in bars)
    hidden = {i for cells in tables["no-effect"][1:] for i in cells[0].split(", ")}
    assert hidden == set(fit.solution.groups.no_effect)
    assert [cells[0] for cells in tables["poses"][1:]] == list(fit.problem.frames)
    assert f"{three(1e3 * fit.sigma_mm)} µm" in tables["noise"][1]


def test_headline_says_what_came_out(fit: Fit, page: str) -> None:
    nominal, fitted, heldout = (short(s.mean_um) for s in (fit.nominal, fit.fitted, fit.heldout))
    assert f"Geometry fitted: mean error {nominal} → {fitted} µm; held-out {heldout} µm." in page
    assert "predicted about as well" in page


def test_same_fit_same_bytes(fit: Fit, page: str, tmp_path: Path) -> None:
    write_report(Analysis(fit), tmp_path / "again.html")
    assert (tmp_path / "again.html").read_bytes() == page.encode()


def test_report_asks_for_nothing_outside_itself(page: str) -> None:
    elements = Page(page).elements
    places = [v for _, values in elements for name, v in values.items() if name in ("src", "href", "srcset", "data")]
    assert places
    assert all(place.startswith(("data:image/", "#")) for place in places)
    own = re.sub(r'src="data:[^"]*"', "", page)
    assert not re.search(r"http|url\(|@import|//", own)
    targets = {values["id"] for _, values in elements if "id" in values}
    assert {p[1:] for p in places if p.startswith("#")} <= targets


def test_names_stay_text(page: str) -> None:
    parsed = Page(page)
    assert not {tag for tag, _ in parsed.elements} & {"script", "i", "b", "u", "link", "iframe", "object"}
    assert parsed.headings["h1"] == HOSTILE
    assert parsed.headings["title"].startswith(HOSTILE)
    assert all(values["src"].startswith("data:") for tag, values in parsed.elements if tag == "img")
    assert not any(name.startswith("on") for _, values in parsed.elements for name in values)


def test_embedded_drawings_are_well_formed(page: str) -> None:
    drawings = [base64.b64decode(data) for data in re.findall(r'src="data:image/svg\+xml;base64,([^"]*)"', page)]
    assert len(drawings) > 5
    for drawing in drawings:
        assert ElementTree.fromstring(drawing).tag.endswith("svg")


def test_report_is_accessible(page: str) -> None:
    elements = Page(page).elements
    assert ("html", {"lang": "en"}) in elements
    assert all(values.get("alt") for tag, values in elements if tag == "img")
    assert all(values.get("scope") for tag, values in elements if tag == "th")
    tags = [tag for tag, _ in elements]
    assert tags.count("table") == tags.count("caption") == tags.count("thead")
    assert tags.count("h1") == 1
    drawn = [values for tag, values in elements if tag == "svg" and values.get("class") == "dots"]
    assert tags.count("figure") == tags.count("figcaption") == tags.count("img") + len(drawn)
    assert all(values.get("role") == "img" and values.get("aria-label") for values in drawn)


def test_doubts_are_said(fit: Fit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(write, "pictures", lambda _: defaultdict(list))
    worse = Spread(3 * fit.fitted.rms_um, 3 * fit.fitted.mean_um, 5 * fit.fitted.max_um, fit.fitted.n)
    doubtful = replace(fit, heldout=worse, tests=(replace(fit.tests[0], fitted=worse),), notes=("look <here>",))
    write_report(Analysis(doubtful), tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    for words in ("3.0 times worse", "_test &lt;img src=x&gt;.csv is predicted clearly worse", "look &lt;here&gt;"):
        assert words in text
    assert 'class="verdict check"' in text


def test_a_survey_of_error_motions_alone(fit: Fit, tmp_path: Path) -> None:
    x = np.linspace(-300, 300, 30)
    motion = pd.DataFrame({"joint": "X", "X": x, "dx": 1e-5 * x + 1e-3 * np.sin(x), "ea": 1e-8 * x + 1e-6 * np.cos(x)})
    write_csv(motion, tmp_path / "motion.csv")
    machine = fit.chain.machine
    alone = fit_machine(machine, read_survey(tmp_path / "motion.csv", machine))
    write_report(Analysis(alone), tmp_path / "report.html")
    parsed = Page((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "results" not in parsed.tables
    assert [cells[0] for cells in parsed.tables["noise"][1:]] == [
        "displacement, one coordinate",
        "angle, one coordinate",
    ]


def test_effects_have_their_place(tmp_path: Path) -> None:
    machine = replace(read_machine("vertical_three_axis"), effects=(EffectSpec("backlash", {"joint": "X"}),))
    points = random_points(machine, 80, 3)
    table = measured_at(machine, points, Truth({"X.dx.backlash": 0.02}), 0.003, 3)[["mx", "my", "mz"]]
    write_csv(outward(points, machine).join(table), tmp_path / "s.csv")
    found = fit_machine(machine, read_survey(tmp_path / "s.csv", machine))
    effect = [e for e in Analysis(found).estimates if e.kind == "effect"]
    assert [e.id for e in effect] == ["X.dx.backlash"]
    assert effect[0].value == pytest.approx(20, abs=4 * effect[0].std)
    assert labels(draw_parameters(Analysis(found))) >= {"value ± 2 standard uncertainties / µm"}
    draw_error_motions(found, machine.joints[0])


def labels(figure: Figure) -> set[str]:
    texts = [(axes.get_xlabel(), axes.get_ylabel(), *(t.get_text() for t in axes.texts)) for axes in figure.axes]
    return {label for some in texts for label in some if label}


FIGURES: dict[Callable[[Any], Figure], set[str]] = {
    draw_error_distribution: {"|e| / µm", "share of the rows / %", "rows with less / %"},
    draw_volumetric_error: {"x / mm", "y / mm", "|e| / µm"},
    draw_residuals_by_position: {"X / mm", "Y / mm", "Z / mm", "x / µm", "y / µm", "z / µm"},
    draw_residuals_by_order: {"row, in the order of the survey", "x / µm", "y / µm", "z / µm"},
    draw_parameters: {f"value ± 2 standard uncertainties / {u}" for u in ("µm", "µm/m", "µrad", "µrad/m")},
    draw_singular_values: {"number of the singular value", "singular value, logarithmic"},
    draw_correlation: {"number of the group", "correlation coefficient"},
}


@pytest.mark.parametrize("draw", FIGURES, ids=lambda draw: draw.__name__)
def test_figures_are_labelled(fit: Fit, draw: Callable[[Any], Figure]) -> None:
    figure = draw(Analysis(fit) if draw in (draw_parameters, draw_correlation) else fit)
    assert isinstance(figure, Figure)
    assert labels(figure) >= {label for label in FIGURES[draw] if not label.startswith("|e|")}
    assert any(label.startswith("|e| / µm") for label in labels(figure)) == ("|e| / µm" in FIGURES[draw])


def test_singular_values_are_those_of_the_fit(fit: Fit) -> None:
    groups, part = fit.solution.groups, singular_values_part(fit)
    assert part is not None
    heights = np.array([y for _, y, _ in part.dots])
    assert [identified for *_, identified in part.dots] == [k < groups.rank for k in range(len(heights))]
    assert (heights[: groups.rank] < part.threshold).all()  # down the page is less
    assert (heights[groups.rank :] > part.threshold).all()
    (top, high), (low, least) = part.decades[-1], part.decades[0]
    of = np.polyval(np.polyfit([top, low], [high, least], 1), heights[: groups.rank])
    np.testing.assert_allclose(10**of, groups.singular_values[: groups.rank], rtol=0.01)  # of a rounded place
    assert heights.min() >= 0
    assert heights.max() <= HEIGHT


def test_error_motions_are_those_of_the_fit(fit: Fit) -> None:
    assert [j.name for j in moving_joints(fit)] == ["X", "Y", "Z"]
    joint = fit.chain.machine.joints[0]
    left, right = draw_error_motions(fit, joint).axes
    assert (left.get_xlabel(), left.get_ylabel(), right.get_ylabel()) == (
        "X / mm",
        "translation / µm",
        "rotation / µrad",
    )
    lines = {line.get_label(): line for axes in (left, right) for line in axes.get_lines()}
    assert {"EXX", "EAX"} <= set(lines)
    named, q = fit.solution.named(), np.asarray(lines["EXX"].get_xdata(), dtype=float)
    u = q / max(abs(t) for t in joint.travel)
    exx = 1e3 * sum(named[f"X.dx.{k}"] * u**k for k in (1, 2))
    np.testing.assert_allclose(np.asarray(lines["EXX"].get_ydata(), dtype=float), exx, atol=1e-9)


def test_a_figure_takes_any_name() -> None:
    assert plain("a$b$\n" + "x" * 60, 20) == r"a\$b\$ xxxxxxxx…xxxxxx"
    figure = Figure()
    figure.text(0, 0, plain("$\\frac$ ＊機械"))
    assert render(figure, "svg") == render(figure, "svg")


def test_numbers_as_people_write_them() -> None:
    assert [number(v, 1) for v in (-1.25, -0.04, float("nan"))] == ["−1.2", "0.0", "–"]
    assert [short(v) for v in (421.4, 26.6, 4.23, 0.351)] == ["421", "27", "4.2", "0.35"]
    assert [three(v) for v in (9.0, 0.01234, 1083.2)] == ["9.00", "0.0123", "1083"]


def test_the_strongest_correlation_has_a_subject(fit: Fit) -> None:
    text = strongest_correlation(Analysis(fit))
    groups, matrix = correlation(Analysis(fit))
    value = float(re.search(r"correlation coefficient of ([+−]\d\.\d+)", text)[1].replace("−", "-"))  # type: ignore[index]
    assert abs(value) == pytest.approx(np.abs(matrix - np.eye(len(groups))).max(), abs=1e-3)
    assert text.startswith("Of all pairs of groups, the estimates of ")
    assert ("known better than either" in text) == (abs(value) > 0.9)


def test_a_kind_of_motion_that_was_not_identified_has_no_panel(fit: Fit, tmp_path: Path) -> None:
    machine, x = fit.chain.machine, np.linspace(-300, 300, 30)
    for names, panels in ((["dx"], 1), (["ea"], 1), (["dx", "ea"], 2)):
        motion = pd.DataFrame({"joint": "X", "X": x} | {n: 1e-7 * x + 1e-6 * np.cos(x) for n in names})
        write_csv(motion, tmp_path / "motion.csv")
        figure = draw_error_motions(
            fit_machine(machine, read_survey(tmp_path / "motion.csv", machine)), machine.joints[0]
        )
        assert len(figure.axes) == panels
        words = {axes.get_ylabel() for axes in figure.axes}
        assert words <= {"translation / µm", "rotation / µrad"}
        assert ("rotation / µrad" in words) == ("ea" in names)


def test_labels_of_parameters_are_whole(tmp_path: Path) -> None:
    """No label begins left of the figure, however long the names are."""
    machine = replace(read_machine("vertical_three_axis"), effects=(EffectSpec("backlash", {"joint": "X"}),))
    points = random_points(machine, 80, 3)
    table = measured_at(machine, points, Truth({"X.dx.backlash": 0.02}), 0.003, 3)[["mx", "my", "mz"]]
    write_csv(outward(points, machine).join(table), tmp_path / "s.csv")
    figure = draw_parameters(Analysis(fit_machine(machine, read_survey(tmp_path / "s.csv", machine))))
    canvas = FigureCanvasAgg(figure)
    figure.draw_without_rendering()
    for axes in figure.axes:
        for label in axes.get_yticklabels():
            box = label.get_window_extent(canvas.get_renderer())
            assert box.x0 >= 0, label.get_text()
            others = [a.get_window_extent() for a in figure.axes if a is not axes]
            assert not any(o.x0 < box.x0 < o.x1 and o.y0 < box.y0 < o.y1 for o in others), label.get_text()


def test_figures_fit_a_telephone(page: str) -> None:
    narrow = page[page.index("@media (max-width: 40rem)") :]
    assert "figure img, .chain img { min-width: 0; max-width: 100%; }" in narrow[: narrow.index("@page")]


def test_degrees_are_written_short() -> None:
    machine = read_machine("trunnion_five_axis")
    angles = [30.0, 29.1, -110.0, 0.1, 359.9, 12.345678901234567]
    table = outward(pd.DataFrame({"C": np.radians(angles), "A": 0.0}), machine)
    assert table["C"].tolist()[:5] == angles[:5]
    np.testing.assert_array_equal(np.radians(table["C"]), np.radians(angles))


@settings(deadline=None)
@given(st.lists(st.lists(st.floats(-1e9, 1e9).map(lambda v: f"{v:.2f}"), min_size=3, max_size=3), min_size=1))
def test_numbers_never_run_together(rows: list[list[str]]) -> None:
    lines = list(table_lines(rows, "<>>", least=4))
    assert [line.split() for line in lines] == rows
    assert len({len(line) for line in lines}) == 1
