"""The uncertainty budget: the GUM's own example, and what a fit's inputs really do to a prediction."""

from __future__ import annotations

import json
from dataclasses import replace
from math import floor, inf, isfinite, sqrt
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from errormodel.instruments import instruments
from errormodel.instruments.base import Instrument
from errormodel.instruments.laser_tracker import LaserTracker
from errormodel.machine import Machine
from errormodel.machine_file import read_machine
from errormodel.survey import Survey, read_survey
from errormodel.surveys.file import BudgetEntry
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit
from identification.results.analysis import Analysis
from identification.uncertainty.budget import Budget, Input, combine
from identification.uncertainty.prediction import predict
from tests.helpers.commands import MILL, done, run, write
from tests.helpers.instrument_settings import settings_of
from tests.helpers.surveys import measured, positions, survey

MACHINE = read_machine(MILL)
TRACKER = LaserTracker(type="laser-tracker", station=[2500, -1500, 600], range=[1e-3, 1e-6], angle=5e-6)
POINTS = np.array([[300.0, -200.0, 50.0], [2500.0, -1500.0, 601.0], [-40.0, 900.0, np.nan]])
GAUGE = 50_000_623.0  # nm
END_GAUGE = [  # JCGM 100:2008, H.1: lengths in nm
    Input("standard", "B", "normal", 25.0, "nm", 1.0, 18),
    Input("repeated observations", "A", "normal", 5.8, "nm", 1.0, 24),
    Input("comparator, random", "A", "normal", 3.9, "nm", 1.0, 5),
    Input("comparator, systematic", "B", "normal", 6.7, "nm", 1.0, 8),
    Input("difference of expansion", "B", "rectangular", 1e-6 / sqrt(3), "1/K", GAUGE * 0.1, 50),
    Input("difference of temperature", "B", "rectangular", 0.05 / sqrt(3), "K", -GAUGE * 11.5e-6, 2),
]


def fitted(machine: Machine = MACHINE, rows: int = 80, seed: int = 0, **how: object) -> Fit:
    p = np.zeros(len(_chain(machine)))
    return fit_machine(machine, _survey(positions(measured(machine, p, rows, seed, noise=2e-3)), **how))


def _chain(machine: Machine) -> tuple[str, ...]:
    from errormodel.chain import Chain

    return Chain(machine).ids


def _survey(table: object, budget: tuple[BudgetEntry, ...] = (), **how: object) -> Survey:
    return replace(survey(table, **how), budget=budget)  # type: ignore[arg-type]


def test_the_end_gauge_of_the_guide():
    budget = combine("length of the end gauge", "nm", END_GAUGE, 0.99)
    assert [round(i.contribution, 1) for i in budget.inputs[-2:]] == [2.9, 16.6]
    assert round(budget.std) == 32
    assert floor(budget.dof) == 16
    assert round(budget.k, 2) == 2.92
    assert round(budget.k * round(budget.std)) == 93  # as the guide rounds
    assert budget.expanded == pytest.approx(93, abs=1)


def test_infinite_degrees_of_freedom():
    budget = combine("x", "mm", [Input("a", "B", "normal", 3.0, "mm", 1.0), Input("b", "B", "normal", 4.0, "mm", -1.0)])
    assert (budget.std, budget.dof) == (pytest.approx(5.0), inf)
    assert budget.k == pytest.approx(1.96, abs=1e-3)
    assert combine("x", "mm", []).std == 0


@given(
    st.lists(
        st.tuples(
            st.floats(1e-3, 1e3),
            st.one_of(st.just(0.0), st.floats(1e-3, 1e3), st.floats(-1e3, -1e-3)),
            st.one_of(st.just(inf), st.integers(1, 200)),
        ),
        max_size=8,
    ),
    st.sampled_from([0.68, 0.95, 0.99]),
)
def test_any_budget_is_that_of_gtc(lines, level):
    import GTC

    budget = combine(
        "y", "mm", [Input(f"x{k}", "A", "normal", u, "mm", c, dof) for k, (u, c, dof) in enumerate(lines)], level
    )
    terms = [c * GTC.ureal(0.0, u, dof) for u, c, dof in lines if c]
    if not terms:
        assert (budget.std, budget.dof, budget.k) == (0, inf, 0)
        return
    whole = sum(terms[1:], terms[0])
    assert budget.std == pytest.approx(GTC.uncertainty(whole), rel=1e-12)
    if isfinite(GTC.dof(whole)):  # it calls 10^5 degrees of freedom infinite
        assert budget.dof == pytest.approx(GTC.dof(whole), rel=1e-9)
    k = GTC.reporting.k_factor(max(1.0, floor(GTC.dof(whole) + 1e-9)) if isfinite(GTC.dof(whole)) else inf, 100 * level)
    # at 10^5 Student's k of 99 % is above the normal one by a share of (k^2 + 1) / 4 / 10^5
    assert budget.k == pytest.approx(k, rel=2e-5)


def test_noise_of_the_residuals_is_what_predict_says():
    fit = fitted()
    worst = Analysis(fit).budgets.prediction
    assert worst is not None
    (line,) = worst.inputs
    assert (line.type, line.dof) == ("A", fit.solution.dof)
    groups = [b.std for b in Analysis(fit).budgets.groups]
    np.testing.assert_allclose(groups, np.sqrt(np.diag(fit.solution.covariance)), rtol=1e-9)
    table = positions(measured(MACHINE, np.zeros(len(fit.chain.ids)), 50, 7))
    known = predict(Analysis(fit).stored, survey(table))[["ux", "uy", "uz"]].to_numpy()
    assert worst.std >= 0.97 * known.max()  # the worst of the volume


def test_parts_of_a_tracker_add_up():
    table = positions(measured(MACHINE, np.zeros(len(_chain(MACHINE))), 80, 3))
    rng = np.random.default_rng(0)
    table[["mx", "my", "mz"]] += TRACKER.draw_noise(table[["mx", "my", "mz"]].to_numpy(), rng)
    fit = fit_machine(MACHINE, _survey(table, instrument=TRACKER))
    budgets = Analysis(fit).budgets
    assert budgets.prediction is not None
    names = [i.name for i in budgets.prediction.inputs]
    assert names[:3] == [
        "laser-tracker, range", "laser-tracker, range, in proportion to length", "laser-tracker, angle",
    ]  # fmt: skip
    assert all(i.type == "B" for i in budgets.prediction.inputs[:3])
    std = np.sqrt(np.diag(fit.solution.covariance)) * fit.inflation
    np.testing.assert_allclose([b.std for b in budgets.groups], std, rtol=1e-6)
    table.loc[[3, 30, 44, 61, 70, 71], "my"] += 5.0
    robust = fit_machine(MACHINE, _survey(table, instrument=TRACKER), robust=True)
    std = np.sqrt(np.diag(robust.solution.covariance)) * robust.inflation
    np.testing.assert_allclose(
        [b.std for b in Analysis(robust).budgets.groups], std, rtol=1e-6
    )  # wrong rows are no source


def test_the_target_of_a_tracker_is_a_line_of_its_own_and_counted_once():
    table = positions(measured(MACHINE, np.zeros(len(_chain(MACHINE))), 80, 3, noise=2e-3))
    tracker = TRACKER.model_copy(update={"target": 2e-3})
    fit = fit_machine(MACHINE, _survey(table, instrument=tracker))
    assert Analysis(fit).budgets.prediction is not None
    for budget in (Analysis(fit).budgets.prediction, *Analysis(fit).budgets.groups):
        own = [i for i in budget.inputs if i.name == "laser-tracker, target"]
        assert [(i.type, i.std, i.unit) for i in own] == [("B", 2e-3, "mm")]
        assert sum(i.contribution**2 for i in budget.inputs if i is not own[0]) < budget.std**2
    std = np.sqrt(np.diag(fit.solution.covariance)) * fit.inflation
    np.testing.assert_allclose([b.std for b in Analysis(fit).budgets.groups], std, rtol=1e-6)
    seat = tracker.covariance(POINTS) - TRACKER.covariance(POINTS)  # type: ignore[operator]
    np.testing.assert_allclose(seat, np.broadcast_to(4e-6 * np.eye(3), seat.shape), atol=1e-15)


@pytest.mark.parametrize("kind", instruments().values(), ids=lambda kind: kind.__name__)
@settings(max_examples=20, deadline=None)
@given(st.data())
def test_the_sources_of_an_instrument_are_all_of_its_noise(kind: type[Instrument], data: st.DataObject):
    instrument = data.draw(settings_of(kind))
    sources, whole = instrument.sources(POINTS), instrument.covariance(POINTS)
    assert len({s.name for s in sources}) == len(sources)
    assert (whole is None) == (not sources)
    if whole is None:
        return
    np.testing.assert_allclose(sum(s.covariance for s in sources), whole, rtol=1e-12, atol=1e-12 * np.abs(whole).max())
    for source in sources:
        assert source.unit in ("mm", "rad", "1")
        assert source.std > 0
        np.testing.assert_allclose(source.covariance, source.covariance.transpose(0, 2, 1))
        assert np.linalg.eigvalsh(source.covariance).min() >= -1e-12 * np.abs(source.covariance).max()


@pytest.mark.parametrize("kind", instruments().values(), ids=lambda kind: kind.__name__)
@settings(max_examples=3, deadline=None)
@given(st.data())
def test_the_parts_of_every_budget_add_up_to_the_whole(kind: type[Instrument], data: st.DataObject):
    instrument = data.draw(settings_of(kind))
    table = positions(measured(MACHINE, np.zeros(len(_chain(MACHINE))), 60, 3, noise=2e-3))
    fit = fit_machine(MACHINE, _survey(table, instrument=instrument))
    std = np.sqrt(np.diag(fit.solution.covariance)) * fit.inflation
    parts = [sqrt(sum(i.contribution**2 for i in b.inputs)) for b in Analysis(fit).budgets.groups]
    np.testing.assert_allclose(parts, std, rtol=1e-6)
    assert {i.name for b in Analysis(fit).budgets.groups for i in b.inputs} >= {
        f"{instrument.type}, {s.name}" for s in instrument.sources(POINTS)
    }


@pytest.mark.parametrize(
    ("acts", "step", "move"), [("scale", 1e-5, None), ("X", 1e-3, "X"), ("tool_z", 1e-3, "tool_z")]
)
def test_a_systematic_input_moves_the_groups_as_a_new_fit_says(acts: str, step: float, move: str | None):
    entry = BudgetEntry(name="it", half_width=step, acts=acts)
    table = positions(measured(MACHINE, np.zeros(len(_chain(MACHINE))), 60, 3, frame=((0, 0, 0), (0, 0, 0))))
    fit = fit_machine(MACHINE, _survey(table, (entry,), frame="fixed"))
    other = table.copy()
    if move is None:
        other[["mx", "my", "mz"]] *= 1 + step
    else:
        other[move] += step
    again = fit_machine(MACHINE, _survey(other, frame="fixed"))
    base = fit.solution.groups.base
    assert again.solution.groups.base.tolist() == base.tolist()
    moved = (again.solution.values - fit.solution.values)[base] / step
    lines = [next(i for i in b.inputs if i.name == "it") for b in Analysis(fit).budgets.groups]
    scale = np.abs(moved).max()
    np.testing.assert_allclose([i.sensitivity for i in lines], moved, atol=2e-4 * scale, rtol=2e-3)
    assert lines[0].std == pytest.approx(step / sqrt(3))


def test_direct_inputs_and_the_form_of_the_model():
    entry = BudgetEntry(name="repeatability", std=0.01, dof=5, type="A")
    plain, more = (Analysis(fitted(budget=b)).budgets.prediction for b in ((), (entry,)))
    assert isinstance(plain, Budget)
    assert isinstance(more, Budget)
    assert more.std == pytest.approx(np.hypot(plain.std, 0.01))
    assert 5 < more.dof < 6
    assert more.k > 2.4


def test_a_survey_brings_its_budget_and_the_report_shows_it(tmp_path: Path):
    done("simulate", MILL, 60, "--noise", 0.002, "--out", tmp_path / "s.csv")
    text = (
        "errormodel: 1\nfiles: [{path: s.csv}]\nbudget:\n"
        "  - {name: tracker's scale, half_width: 1.0e-6, acts: scale}\n  - {name: probe, std: 0.001, dof: 9}\n"
    )
    data = read_survey(write(tmp_path / "survey.yaml", text), MACHINE)
    assert [(e.shape, round(e.standard, 9)) for e in data.budget] == [("rectangular", 5.77e-07), ("normal", 0.001)]
    done("fit", MILL, tmp_path / "survey.yaml", "--out", tmp_path / "fit")
    written = json.loads((tmp_path / "fit" / "fit.json").read_text(encoding="utf-8"))["budget"]
    assert [i["name"] for i in written["prediction"]["inputs"]][-2:] == ["tracker's scale", "probe"]
    assert written["prediction"]["expanded_uncertainty"] > 1.9 * 0.001
    assert len(written["groups"]) > 20
    report = (tmp_path / "fit" / "report.html").read_text(encoding="utf-8")
    assert 'id="budget-prediction"' in report
    assert "tracker&#39;s scale" in report


@pytest.mark.parametrize(
    ("line", "found", "cure"),
    [
        ("{name: a, std: 0}", "0", "above 0"),
        ("{name: a, std: -1}", "-1", "above 0"),
        ("{name: a}", "name", "either std or half_width"),
        ("{name: a, std: 1, half_width: 1}", "name", "either std or half_width"),
        ("{name: a, half_width: 1, distribution: normal}", "name", "Write std"),
        ("{name: a, std: 1, distribution: arcsine}", "name", "Write half_width"),
        ("{name: a, std: 1, distribution: round}", "round", "Valid: arcsine"),
        ("{name: a, std: 1, acts: T_bad}", "T_bad", "Valid:"),
        ("{name: a, std: 1, dof: 0}", "0", "degrees of freedom"),
    ],
)
def test_wrong_lines_of_a_budget_are_told(tmp_path: Path, line: str, found: str, cure: str):
    done("simulate", MILL, 40, "--noise", 0.002, "--out", tmp_path / "s.csv")
    path = write(tmp_path / "survey.yaml", f"errormodel: 1\nfiles: [{{path: s.csv}}]\nbudget:\n  - {line}\n")
    ended = run("fit", MILL, path, "--out", tmp_path / "fit")
    assert ended.code == 2
    assert found in ended.err
    assert cure in ended.err
    assert "line 4" in ended.err


def test_the_form_of_the_model_is_the_same_by_rows_of_one_component():
    """The same readings with each component in a row of its own: an interferometer reads one direction at a time."""
    table = positions(measured(MACHINE, np.zeros(len(_chain(MACHINE))), 80, 0, noise=2e-3))
    table["my"] += np.where(table["X"] > table["X"].quantile(0.8), 0.05, 0.0)  # more than the model can follow
    table = table.sort_values("X")
    apart = table.loc[table.index.repeat(3)].reset_index(drop=True)
    for k, name in enumerate(["mx", "my", "mz"]):
        apart.loc[apart.index % 3 != k, name] = np.nan
    whole, single = (_form_of(fit_machine(MACHINE, survey(t))) for t in (table, apart))
    assert whole > 0.005
    assert single == pytest.approx(whole, rel=1e-6)


def _form_of(fit: Fit) -> float:
    budget = Analysis(fit).budgets.prediction
    assert isinstance(budget, Budget)
    return next(i.std for i in budget.inputs if i.name.startswith("form of the model"))
