"""The functions that notebooks use: they do what the commands do, on files, dicts and tables alike."""

from __future__ import annotations

import doctest
import inspect
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import errormodel
import identification
from errormodel import InputError, read_machine, read_survey, simulate
from identification import compensate, describe, diagnose, fit, load, plan, predict, save
from tests.commands import FIVE, MILL, done

ROOT = Path(__file__).resolve().parent.parent
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
    folder = ROOT / "machines/examples/gantry"
    result = diagnose(folder, folder / "survey.csv")
    assert result.verdict == "explained"
    assert list(result.findings["effect"]) == ["beam-sag"]
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
    "module", ["errormodel.machine_file", "errormodel.simulation", "identification.api"], ids=lambda m: m
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
