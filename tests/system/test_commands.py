"""The commands as a user types them: what they print and write, and that it holds together from one to the next."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from errormodel.chain import Chain
from errormodel.machine_file import read_machine, write_machine
from tests.helpers.commands import FIVE, MILL, XYZ, Fill, done, run, tree, write

ROOT = Path(__file__).resolve().parents[2]
TRUTH = """
parameters: {T1.dx: 0.03, T1.dz: -0.2, T3.ea: 4.0e-5, X.dx.1: -1.1e-4, W.ea.1: -3.0e-7, B.dx.1: 0.012, B.ec.1: 2.0e-5}
frame: {translation: [2500, -300, 120], rotation: [0, 30, -5]}
"""


@pytest.fixture(scope="module")
def trip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Simulated without noise, fitted, predicted elsewhere: ``survey.csv fit/ new.csv predicted.csv``."""
    folder = tmp_path_factory.mktemp("trip")
    truth = write(folder / "truth.yaml", TRUTH)
    done("simulate", FIVE, 120, "--parameters", truth, "--out", folder / "survey.csv", "--seed", 3)
    done("simulate", FIVE, 40, "--parameters", truth, "--out", folder / "new.csv", "--seed", 4)
    done("fit", FIVE, folder / "survey.csv", "--out", folder / "fit")
    done("predict", folder / "fit", folder / "new.csv", "--out", folder / "predicted.csv")
    return folder


@pytest.fixture(scope="module")
def mill(with_mill: Fill, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return with_mill(tmp_path_factory.mktemp("mill"))


def read_json(path: Path) -> dict[str, Any]:
    data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return data


# ---- describe


def test_describe_counts_what_the_paper_counts(tmp_path: Path) -> None:
    printed = done("describe", FIVE, "--json", tmp_path / "d.json").out
    data = read_json(tmp_path / "d.json")
    assert (data["n_parameters"], data["n_no_effect"], data["rank"]) == (52, 3, 32)
    assert set(data["no_effect"]) == {"T4.ec", "T5.ec", "W.ec.1"}
    assert 1 < data["condition"] < 1e4
    groups = {g["name"]: g["members"] for g in data["groups"]}
    assert len(groups) == 32
    name = "T1.dx + T2.dx + T3.dx + T4.dx + T5.dx - 312.035 T5.eb"
    assert groups[name] == {"T1.dx": 1, "T2.dx": 1, "T3.dx": 1, "T4.dx": 1, "T5.dx": 1, "T5.eb": -312.035}
    assert groups["T2.ec + T3.ec"] == {"T2.ec": 1, "T3.ec": 1}
    assert "52 parameters, 3 without effect, rank 32" in printed
    for name in groups:
        assert name in printed


def test_describe_takes_a_plan_of_poses(tmp_path: Path, trip: Path) -> None:
    """Commands alone: what they would tell, were all three coordinates measured there."""
    measured = pd.read_csv(trip / "survey.csv")
    measured.drop(columns=XYZ).to_csv(tmp_path / "plan.csv", index=False)
    done("describe", FIVE, tmp_path / "plan.csv", "--json", tmp_path / "plan.json")
    done("describe", FIVE, trip / "survey.csv", "--json", tmp_path / "survey.json")
    plan, survey = read_json(tmp_path / "plan.json"), read_json(tmp_path / "survey.json")
    assert plan["rank"] == survey["rank"] == 32
    assert plan["with_frame"]["rank"] == survey["with_frame"]["rank"] == 36
    names = [[g["name"] for g in d["with_frame"]["groups"]] for d in (plan, survey)]
    assert names[0] == names[1]
    measured.assign(Y=500.0).to_csv(tmp_path / "still.csv", index=False)
    done("describe", FIVE, tmp_path / "still.csv", "--json", tmp_path / "still.json")
    assert read_json(tmp_path / "still.json")["rank"] < 32


def test_describe_counts_the_rows_to_fit(tmp_path: Path, trip: Path) -> None:
    """A held-out file adds nothing to what a fit can tell, nor a frame of its own."""
    for name in ("survey.csv", "new.csv"):
        (tmp_path / name).write_bytes((trip / name).read_bytes())
    text = "errormodel: 1\nframe: per-file\nfiles: [{path: survey.csv}, {path: new.csv, role: test}]\n"
    done("describe", FIVE, write(tmp_path / "s.yaml", text), "--json", tmp_path / "d.json")
    assert read_json(tmp_path / "d.json")["with_frame"]["rank"] == 36


def test_describe_draws_the_chain(tmp_path: Path) -> None:
    done("describe", MILL, "--drawing", tmp_path / "chain.svg")
    assert "saddle" in (tmp_path / "chain.svg").read_text()
    wrong = run("describe", MILL, "--drawing", tmp_path / "chain.doc", "--json", tmp_path / "d.json")
    assert wrong.code == 2
    assert ".svg" in wrong.err
    assert not (tmp_path / "d.json").exists()


# ---- fit


def test_a_fit_writes_what_the_contract_says(trip: Path) -> None:
    names = set(tree(trip / "fit"))
    assert names >= {"fit.json", "parameters.csv", "residuals.csv", "report.html", "machine.yaml"}
    fit = read_json(trip / "fit/fit.json")
    assert fit["sigma_um"] < 1e-3  # no noise
    assert (fit["dof"], fit["rank"], fit["n_parameters"]) == (3 * 120 - 36, 36, 52)
    for spread in (fit["nominal"], fit["fitted"]):
        assert spread["n"] == 120
        assert spread["mean_um"] <= spread["rms_um"] <= spread["max_um"]
    assert fit["test"] == []
    assert len(fit["parameters"]) == 36
    for entry in fit["parameters"]:
        assert {"id", "group", "value", "std", "unit"} <= set(entry)
        assert entry["id"] in entry["group"]
        assert entry["unit"] in ("mm", "rad", "1", "rad/mm")
    table = pd.read_csv(trip / "fit/parameters.csv")
    assert list(table["id"]) == [p["id"] for p in fit["parameters"]]
    assert list(table["value"]) == [p["value"] for p in fit["parameters"]]
    residuals = pd.read_csv(trip / "fit/residuals.csv")
    assert len(residuals) == 120
    assert {"file", "role", "row", "run", "B", "tool_z", "residual_x_um", "nominal_x_um"} <= set(residuals)
    rms = (residuals[[f"nominal_{a}_um" for a in "xyz"]] ** 2).sum(axis=1).mean() ** 0.5
    assert rms == pytest.approx(fit["nominal"]["rms_um"])
    report = (trip / "fit/report.html").read_text(encoding="utf-8")
    assert "rotary table and quill" in report
    assert "T3.eb + T4.eb" in report


def test_the_example_shows_a_test_file(tmp_path: Path) -> None:
    """The README's own command: a folder with a survey.yaml stands for it, so that the check file stays unseen."""
    result = done("fit", FIVE, ROOT / "machines/examples" / FIVE, "--out", tmp_path / "fit")
    fit = read_json(tmp_path / "fit/fit.json")
    (test,) = fit["test"]
    assert test["path"] == "check.csv"
    for kind in ("nominal", "fitted"):
        assert {"rms_um", "mean_um", "max_um", "n"} <= set(test[kind])
    assert test["fitted"]["rms_um"] < 0.1 * test["nominal"]["rms_um"]
    assert 0.8 < fit["reduced_chi2"] < 1.2
    assert fit["nominal"]["n"] + test["nominal"]["n"] == len(pd.read_csv(tmp_path / "fit/residuals.csv"))
    assert "check.csv" in result.out
    assert str(tmp_path / "fit/report.html") in result.out
    assert result.err == ""


# ---- predict


def test_the_round_trip_recovers_the_truth_at_unseen_poses(trip: Path) -> None:
    """Exact kinematics in, exact kinematics out: nothing but rounding is left, in a frame turned by 30 degrees."""
    new, predicted = pd.read_csv(trip / "new.csv"), pd.read_csv(trip / "predicted.csv")
    assert list(predicted.columns[-9:]) == [*XYZ, "ex", "ey", "ez", "ux", "uy", "uz"]
    commands = ["B", "X", "Z", "Y", "W", "tool_x", "tool_y", "tool_z"]
    np.testing.assert_allclose(predicted[commands], new[commands], rtol=1e-13)  # degrees in, degrees out
    assert new["B"].max() > 100
    np.testing.assert_allclose(predicted[XYZ], new[XYZ], atol=2e-6)  # mm
    assert predicted[["ux", "uy", "uz"]].to_numpy().max() < 1e-5


def test_the_predicted_error_is_actual_minus_nominal_in_the_measuring_frame(trip: Path) -> None:
    predicted = pd.read_csv(trip / "predicted.csv")
    frame = read_json(trip / "fit/fit.json")["frame"][0]["alignment"]
    chain = Chain(read_machine(FIVE))
    rows = [np.radians(predicted[c]) if c == "B" else predicted[c] for c in chain.channels]
    nominal = chain.kernel("nominal", outputs=(0, 1, 2))([r.to_numpy(dtype=float) for r in rows]).T
    nominal = Rotation.from_rotvec(frame["rotation"]).apply(nominal) + frame["translation"]
    np.testing.assert_allclose(predicted[["ex", "ey", "ez"]], predicted[XYZ] - nominal, atol=1e-9)
    assert 0.01 < np.abs(predicted[["ex", "ey", "ez"]].to_numpy()).max() < 2


def test_another_tool_is_less_certain_where_the_survey_could_not_tell(mill: Path, tmp_path: Path) -> None:
    """With the tool on the spindle's axis its roll is not seen; a tool beside the axis makes it matter."""
    points = pd.read_csv(mill / "s.csv").drop(columns=XYZ)
    u = {}
    for name, tool in (("same", 0.0), ("beside", 200.0)):
        points.assign(tool_x=tool).to_csv(tmp_path / "p.csv", index=False)
        done("predict", mill / "fit", tmp_path / "p.csv", "--out", tmp_path / f"{name}.csv")
        u[name] = pd.read_csv(tmp_path / f"{name}.csv")[["ux", "uy", "uz"]].mean()
    assert (u["same"] < 0.005).all()
    assert u["beside"]["uy"] > 2 * u["same"]["uy"]  # along which a roll of 200 mm points
    assert u["beside"]["ux"] < u["beside"]["uy"]


def test_runs_with_frames_of_their_own(tmp_path: Path) -> None:
    """Each run is predicted where its station stood; one that was not fitted, in the first one's frame, with a note."""
    parts = []
    for k, turn in enumerate((0, 90)):
        frame = f"frame: {{translation: [{100 * k}, 0, 0], rotation: [0, 0, {turn}]}}"
        truth = write(tmp_path / "t.yaml", f"parameters: {{saddle.ec: 1.0e-4}}\n{frame}\n")
        done("simulate", MILL, 40, "--parameters", truth, "--seed", k, "--out", tmp_path / "part.csv")
        parts.append(pd.read_csv(tmp_path / "part.csv").assign(run=f'st. {k}, "<b>"'))
    survey = pd.concat(parts)
    survey.to_csv(tmp_path / "s.csv", index=False)
    form = write(tmp_path / "s.yaml", "errormodel: 1\nfiles: [{path: s.csv}]\nframe: per-run\n")
    done("fit", MILL, form, "--out", tmp_path / "fit")
    fit = read_json(tmp_path / "fit/fit.json")
    assert [f["label"] for f in fit["frame"]] == ['st. 0, "<b>"', 'st. 1, "<b>"']
    assert "<b>" not in (tmp_path / "fit/report.html").read_text()
    known = done("predict", tmp_path / "fit", tmp_path / "s.csv", "--axes", "machine", "--out", tmp_path / "p.csv")
    assert known.err == "note: predicted from the commands alone: what was measured there is not used\n"
    np.testing.assert_allclose(pd.read_csv(tmp_path / "p.csv")[XYZ], survey[XYZ], atol=1e-5)
    survey.assign(run="new").to_csv(tmp_path / "n.csv", index=False)
    unknown = done("predict", tmp_path / "fit", tmp_path / "n.csv", "--out", tmp_path / "n_out.csv")
    assert "run new was not fitted" in unknown.err
    first = pd.read_csv(tmp_path / "n_out.csv")[XYZ]
    np.testing.assert_allclose(first[:40], survey[XYZ][:40], atol=1e-5)
    assert np.abs(first[40:].to_numpy() - survey[XYZ][40:].to_numpy()).max() > 50


# ---- simulate


def test_simulate_knows_an_instrument_and_a_seed(tmp_path: Path, mill: Path) -> None:
    (tmp_path / "s.csv").write_bytes((mill / "s.csv").read_bytes())
    text = "errormodel: 1\nfiles: [{path: s.csv}]\ninstrument: {type: cmm, sigma: [0.05, 0]}\n"
    form = write(tmp_path / "s.yaml", text)
    exact, one, two, again = (tmp_path / f"{n}.csv" for n in ("exact", "one", "two", "again"))
    done("simulate", MILL, form, "--out", exact)
    for out, seed in ((one, 1), (two, 2), (again, 1)):
        done("simulate", MILL, form, "--noise", "instrument", "--seed", seed, "--out", out)
    noise = pd.read_csv(one)[XYZ] - pd.read_csv(exact)[XYZ]
    assert 0.04 < noise.to_numpy().std() < 0.06
    assert one.read_bytes() == again.read_bytes() != two.read_bytes()


def test_a_machine_with_an_effect_goes_all_the_way(tmp_path: Path) -> None:
    """Backlash needs a direction, which no column gives: all commands derive it from the rows."""
    model = read_machine(MILL)
    lines = "\neffects: [{effect: backlash, joint: X}]\n"
    machine = tmp_path / "m.yaml"
    write_machine(model, machine)
    machine.write_text(machine.read_text() + lines)
    assert "53 parameters" in done("describe", machine).out
    truth = write(tmp_path / "t.yaml", "parameters: {X.dx.backlash: 0.03}\n")
    done("simulate", machine, 60, "--parameters", truth, "--out", tmp_path / "s.csv")
    assert "53 parameters" in done("describe", machine, tmp_path / "s.csv").out
    done("fit", machine, tmp_path / "s.csv", "--out", tmp_path / "fit")
    fit = read_json(tmp_path / "fit/fit.json")
    assert {p["id"]: p["value"] for p in fit["parameters"]}["X.dx.backlash"] == pytest.approx(0.03, abs=1e-7)
    done("predict", tmp_path / "fit", tmp_path / "s.csv", "--out", tmp_path / "p.csv")
    predicted, measured = (pd.read_csv(tmp_path / name)[XYZ] for name in ("p.csv", "s.csv"))
    np.testing.assert_allclose(predicted[1:], measured[1:], atol=1e-6)
    # from which side the first row came, nothing tells
    assert abs(predicted["mx"][0] - measured["mx"][0]) == pytest.approx(0.015, abs=1e-6)


def test_one_component_is_enough_for_what_it_sees(mill: Path, tmp_path: Path) -> None:
    """An interferometer along x: no rotation of the frame is known, and nothing that moves along y or z matters."""
    pd.read_csv(mill / "s.csv").drop(columns=["my", "mz"]).assign(sigma_x=0.002).to_csv(tmp_path / "x.csv", index=False)
    done("fit", MILL, tmp_path / "x.csv", "--out", tmp_path / "fit")
    fit = read_json(tmp_path / "fit/fit.json")
    assert fit["sigma_from"] == "declared"
    assert fit["dof"] == 60 - fit["rank"]
    assert 0.5 < fit["reduced_chi2"] < 1.6
    assert fit["fitted"]["rms_um"] < 2.5
    ids = {p["id"] for p in fit["parameters"]}
    assert {"X.dx.1", "X.dx.2", "Y.dx.2"} <= ids
    assert not ids & {"X.dy.2", "X.dz.2", "Y.dy.1", "Z.dz.1", "Z.ea.1"}
    assert all(abs(p["value"]) < 1 for p in fit["parameters"])  # none that hardly shows stands for its group


def test_a_survey_of_one_joint_is_simulated_fitted_and_predicted(tmp_path: Path) -> None:
    """Rows about X alone have no other position; its motions come back, and volumetric rows beside them are used."""
    x = np.linspace(-380, 380, 21)
    pd.DataFrame({"joint": "X", "X": x}).to_csv(tmp_path / "joint.csv", index=False)
    truth = write(tmp_path / "t.yaml", "parameters: {X.dx.2: 0.01, X.eb.1: 2.0e-5, Y.dx.2: 0.004}\n")
    done("simulate", MILL, tmp_path / "joint.csv", "--parameters", truth, "--out", tmp_path / "j.csv")
    table = pd.read_csv(tmp_path / "j.csv")
    np.testing.assert_allclose(table["dx"], 0.01 * (x / 380) ** 2, atol=1e-12)
    np.testing.assert_allclose(table["eb"], 2e-5 * x / 380, atol=1e-15)
    assert table[XYZ].isna().all(axis=None)
    done("fit", MILL, tmp_path / "j.csv", "--out", tmp_path / "joint_fit")
    values = {p["id"]: p["value"] for p in read_json(tmp_path / "joint_fit/fit.json")["parameters"]}
    assert values["X.dx.2"] == pytest.approx(0.01)
    assert values["X.eb.1"] == pytest.approx(2e-5)
    assert "Y.dx.2" not in values
    done("simulate", MILL, 40, "--parameters", truth, "--out", tmp_path / "v.csv")
    both = pd.concat([table.assign(run="joint"), pd.read_csv(tmp_path / "v.csv").assign(run="volume")])
    both.to_csv(tmp_path / "both.csv", index=False)
    done("fit", MILL, tmp_path / "both.csv", "--out", tmp_path / "fit")
    values = {p["id"]: p["value"] for p in read_json(tmp_path / "fit/fit.json")["parameters"]}
    assert values["X.dx.2"] == pytest.approx(0.01, rel=1e-4)
    assert values["Y.dx.2"] == pytest.approx(0.004, rel=1e-3)
    done("predict", tmp_path / "fit", tmp_path / "both.csv", "--out", tmp_path / "p.csv")
    predicted = pd.read_csv(tmp_path / "p.csv")
    np.testing.assert_allclose(predicted[XYZ][21:], both[XYZ][21:], atol=1e-6)
    assert predicted[XYZ][:21].isna().all(axis=None)


def test_ctrl_c_says_so_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("errormodel.survey.read_survey", stopped)
    (tmp_path / "s.csv").write_text("X,Y,Z,mx,my,mz\n")
    result = run("fit", MILL, tmp_path / "s.csv", "--out", tmp_path / "fit")
    assert result.code == 130
    assert "stopped" in result.err
    assert not (tmp_path / "fit").exists()
