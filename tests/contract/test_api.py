"""The functions that notebooks use: they do what the commands do, on files, dicts and tables alike."""

from __future__ import annotations

import doctest
import inspect
import json
import pkgutil
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import errormodel
import identification
from errormodel import InputError, read_machine, read_survey, simulate
from identification import compensate, controllers, describe, diagnose, fit, load, monitor, plan, predict, save
from tests.helpers.commands import FIVE, MILL, done

ROOT = Path(__file__).resolve().parents[2]
PUBLIC = [getattr(package, name) for package in (errormodel, identification) for name in package.__all__]
TRUTH = {"X.dx.1": 0.02, "Y.dy.1": -0.01}  # mm at the end of the travel


@pytest.fixture(scope="module")
def survey() -> pd.DataFrame:
    return simulate(MILL, 90, TRUTH, translation=(900, -400, 300), rotation=(0, 0, 40), noise=0.002, seed=3)


def test_it_is_the_same_as_on_the_command_line(survey: pd.DataFrame, tmp_path: Path) -> None:
    survey.to_csv(tmp_path / "s.csv", index=False)
    done("fit", MILL, tmp_path / "s.csv", "--out", tmp_path / "said")
    result = fit(MILL, str(tmp_path / "s.csv"))
    save(result, tmp_path / "saved")
    said = json.loads((tmp_path / "said/fit.json").read_text())
    assert said == json.loads((tmp_path / "saved/fit.json").read_text())
    assert result.parameters["value"].to_dict() == {p["id"]: p["value"] for p in said["parameters"]}
    assert result.statistics.loc["fitted", "rms_um"] == said["fitted"]["rms_um"]
    np.testing.assert_allclose(np.sqrt(np.diag(result.covariance)), result.parameters["std"])


def test_machines_and_surveys_come_in_many_ways(survey: pd.DataFrame, tmp_path: Path) -> None:
    import ruamel.yaml

    file = ROOT / "machines" / f"{MILL}.yaml"
    as_dict = ruamel.yaml.YAML(typ="safe").load(file)
    survey.to_csv(tmp_path / "s.csv", index=False)
    machine = read_machine(file)
    ways = [(MILL, survey), (file, tmp_path / "s.csv"), (as_dict, survey), (machine, read_survey(survey, machine))]
    results = [fit(*way).parameters["value"] for way in ways]
    for other in results[1:]:
        np.testing.assert_allclose(other, results[0], rtol=1e-9, atol=1e-15)


def test_tables_carry_their_units(survey: pd.DataFrame) -> None:
    result = fit(MILL, survey)
    assert result.parameters.attrs["units"]["X.dx.1"] == "mm"
    assert result.statistics.attrs["units"]["rms_um"] == "um"
    assert len(result.residuals) == len(survey)
    assert re.search("<table", result._repr_html_())
    for name in ("residuals", "residuals_by_order", "errors", "distribution", "parameters", "correlation"):
        assert type(getattr(result.plot, name)()).__name__ == "Figure"
    assert type(result.plot.motions("X")).__name__ == "Figure"
    with pytest.raises(InputError, match="no identified error motion"):
        result.plot.motions("Q")


def test_what_was_saved_predicts_the_same(survey: pd.DataFrame, tmp_path: Path) -> None:
    result = fit(MILL, survey)
    save(result, tmp_path / "fit")
    again = load(tmp_path / "fit")
    commands = survey.head(5)[["X", "Y", "Z"]]
    expected = result.predict(commands)
    assert list(expected.columns[-9:]) == ["mx", "my", "mz", "ex", "ey", "ez", "ux", "uy", "uz"]
    for other in (again.predict(commands), predict(tmp_path / "fit", commands)):
        np.testing.assert_allclose(other.to_numpy(dtype=float), expected.to_numpy(dtype=float), rtol=1e-9, atol=1e-9)
    assert again.parameters["value"].to_dict() == pytest.approx(result.parameters["value"].to_dict())


def test_a_diagnosis_and_its_tables(tmp_path: Path) -> None:
    worn = tmp_path / "worn.yaml"
    worn.write_text((ROOT / f"machines/{MILL}.yaml").read_text() + "\neffects:\n  - {effect: backlash, joint: X}\n")
    result = diagnose(MILL, simulate(worn, 120, {"X.dx.backlash": 0.006}, noise=0.002, seed=1))
    assert result.verdict == "explained"
    assert list(result.findings["effect"]) == ["backlash"]
    assert result.statistics.loc["held out", "rms_um"] < result.baseline.statistics.loc["held out", "rms_um"]
    assert type(result.plot.where()).__name__ == "Figure"
    save(result, tmp_path / "found")
    assert json.loads((tmp_path / "found/diagnosis.json").read_text())["verdict"] == "explained"


def test_tables_for_a_controller(survey: pd.DataFrame, tmp_path: Path) -> None:
    result = compensate(fit(MILL, survey), "linuxcnc-type1")
    left = result.figures.set_index(["poses", "stage"])["rms_um"]
    for poses in {p for p, _ in left.index}:
        assert left[poses, "after"] < left[poses, "before"]
    result.write(tmp_path / "tables")
    assert {p.name for p in (tmp_path / "tables").iterdir()} >= {Path(name).name for name in result.files}


@pytest.mark.long
def test_a_plan_and_a_description() -> None:
    assert describe(FIVE).groups.rank == 32
    result = plan(MILL, 30)
    assert len(result.poses) == 30
    assert result.uncertainty.loc["planned", "worst_um"] < result.uncertainty.loc["random", "worst_um"]
    assert {"effect", "verdict"} <= set(result.effects)


def test_wrong_input_has_one_error(survey: pd.DataFrame) -> None:
    with pytest.raises(InputError, match="no such file"):
        fit("no_such_machine", survey)
    with pytest.raises(InputError, match="no column for the joint 'X'"):
        fit(MILL, survey.drop(columns="X"))
    with pytest.raises(InputError, match=r"no parameter 'X\.dx\.9'"):
        simulate(MILL, 10, {"X.dx.9": 1e-6})


@pytest.mark.parametrize("function", [f for f in PUBLIC if inspect.isfunction(f)], ids=lambda f: f.__name__)
def test_every_public_function_says_what_it_takes_and_gives(function: object) -> None:
    text = inspect.getdoc(function) or ""
    parameters = inspect.signature(function).parameters  # type: ignore[arg-type]
    for name in parameters:
        assert re.search(rf"^[\w, ]*\b{name}\b[\w, ]*( : |$)", text.partition("Parameters")[2], re.MULTILINE), name
    assert "Returns\n" in text or "Write" in text.splitlines()[0]


@pytest.mark.parametrize(
    "module", ["errormodel.machine_file", "errormodel.simulation", "identification.api.models"], ids=lambda m: m
)
def test_the_examples_of_docstrings_hold(module: str) -> None:
    import importlib

    failed, tried = doctest.testmod(importlib.import_module(module))
    assert tried
    assert not failed


def test_importing_costs_nothing() -> None:
    code = "import sys, errormodel, identification; print(*{n.partition('.')[0] for n in sys.modules})"
    seen = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert not {"numpy", "casadi", "pandas", "scipy", "matplotlib"} & set(seen.split())


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:Estimated shape parameter of Pareto")  # 30 parameters of 90 rows: some decide much
def test_a_posterior_that_arviz_takes(survey: pd.DataFrame, tmp_path: Path) -> None:
    import arviz_stats
    import xarray

    result = fit(MILL, survey, bayes=True, priors={"X.dx.1": {"mean": 0.02, "std": 0.01}})
    tree = result.posterior
    assert {"posterior", "prior", "log_likelihood"} <= {*tree.children}
    assert list(tree["posterior"]["group"].values) == list(result.parameters.index)
    prior = tree["prior"]["parameter"].sel(group="X.dx.1")
    assert (prior.mean().item(), prior.std().item()) == pytest.approx((0.02, 0.01), rel=0.1)
    found = arviz_stats.loo(tree, var_name="position")
    right = arviz_stats.loo(
        fit(MILL, survey.assign(mx=survey["mx"] + 0.02 * np.sin(survey["X"])), bayes=True).posterior
    )
    assert found.n_data_points == len(survey)
    assert found.elpd > right.elpd + 50  # a wave that no parameter describes
    save(result, tmp_path / "saved")
    with xarray.open_datatree(tmp_path / "saved/posterior.nc", engine="h5netcdf") as again:
        xarray.testing.assert_identical(again.load(), tree)
    with pytest.raises(InputError, match="bayes=True"):
        _ = fit(MILL, survey).posterior


def test_what_is_known_beforehand(survey: pd.DataFrame) -> None:
    held = fit(MILL, survey, priors={"X.dx.1": {"high": 0.01}})
    assert held.parameters.loc["X.dx.1", "value"] == pytest.approx(0.01)
    with pytest.raises(InputError, match=r"priors\.X\.dx\.1.*least squares do not use"):
        fit(MILL, survey, priors={"X.dx.1": {"std": 0.01}})
    with pytest.raises(InputError, match="lower"):
        fit(MILL, survey, priors={"X.dx.1": {"lower": 0.01}})


def test_what_follows_from_a_fit_is_computed_once(
    survey: pd.DataFrame, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For tables, figures, files and the report together."""
    from identification.results import analysis as module

    calls: list[str] = []
    for name in ("groups_of", "gain_of", "estimates", "stored", "budgets_of"):
        function = getattr(module, name)

        def counted(*given: object, name: str = name, function: Any = function) -> object:
            calls.append(name)
            return function(*given)

        monkeypatch.setattr(module, name, counted)
    result = fit(MILL, survey)
    assert calls == []
    for text in (result.summary(), result.parameters, result.budget, result.predict(survey.head(2))):
        assert len(text)
    result.plot.parameters()
    save(result, tmp_path / "fit")
    assert sorted(calls) == ["budgets_of", "estimates", "gain_of", "groups_of", "stored"]


def test_a_budget_is_a_table(survey: pd.DataFrame) -> None:
    table = fit(MILL, survey).budget
    assert np.sqrt((table["contribution"] ** 2).sum()) == pytest.approx(table.attrs["standard_uncertainty"])
    assert table.attrs["expanded_uncertainty"] == pytest.approx(table.attrs["k"] * table.attrs["standard_uncertainty"])


def test_cycles_of_a_machine(survey: pd.DataFrame, tmp_path: Path) -> None:
    save(fit(MILL, survey), tmp_path / "fit")
    first = monitor(tmp_path / "fit", survey)
    assert (first.status, len(first.history)) == ("learning", 1)
    assert first.page == tmp_path / "fit/monitor.html"
    assert first.page.is_file()
    again = simulate(MILL, 90, TRUTH, translation=(900, -400, 300), rotation=(0, 0, 40), noise=0.002, seed=4)
    second = monitor(load(tmp_path / "fit"), again, report=False)
    assert len(second.history) == 2
    assert json.loads((tmp_path / "fit/monitor.json").read_text())["cycle"] == 1  # of the first
    assert "X.dx.1" in second.quantities.index
    assert type(second.plot.history()).__name__ == "Figure"
    with pytest.raises(InputError, match=r"between 0 and 0\.5"):
        monitor(tmp_path / "fit", survey, rate=0.7)


def test_predictions_say_what_was_assumed(survey: pd.DataFrame, tmp_path: Path) -> None:
    result = fit(MILL, survey)
    inside = result.predict(survey.head(2)[["X", "Y", "Z"]], axes="machine")
    far = survey[["X", "Y", "Z"]].sort_values("X").tail(3)
    half = fit(MILL, survey[survey["X"] < 100])
    assert inside.attrs["units"]["ux"] == "mm"
    assert inside.attrs["notes"] == ()
    save(half, tmp_path / "half")
    for known in (half, load(tmp_path / "half")):
        assert any("3 points lie beyond what was measured of X" in note for note in known.predict(far).attrs["notes"])


@pytest.mark.long
def test_what_is_printed_is_what_the_command_line_prints(survey: pd.DataFrame, tmp_path: Path) -> None:
    survey.to_csv(tmp_path / "s.csv", index=False)
    model = read_machine(MILL)
    for result, command in (
        (describe(model), ("describe", MILL)),
        (fit(model, tmp_path / "s.csv"), ("fit", MILL, tmp_path / "s.csv", "--out", tmp_path / "fit")),
        (plan(model, 30), ("plan", MILL, "--points", 30)),
    ):
        assert result.summary() in done(*command).out
    tables = compensate(tmp_path / "fit", "linuxcnc-type1")
    said = done("compensate", tmp_path / "fit", "--controller", "linuxcnc-type1", "--out", tmp_path / "tables").out
    assert tables.summary(tmp_path / "tables") in said
    assert [line.split()[0] for line in done("compensate", "--controller", "list").out.splitlines()] == [*controllers()]


def test_no_package_has_the_name_of_a_function() -> None:
    """The import of a package would put it in the function's place."""
    for package in (errormodel, identification):
        inside = {module.name for module in pkgutil.iter_modules(package.__path__)}
        assert not inside & set(package.__all__)
