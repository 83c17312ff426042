"""Records of interferometers, levels and straightness references as people have them: from the file to the tables."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from errormodel.approach import direction
from errormodel.exceptions import InputError
from errormodel.machine_file import read_machine
from errormodel.survey import Survey, read_survey
from identification.compensation.compensate import compensate
from identification.compensation.result import Compensation
from identification.diagnosis.pipeline import diagnose
from identification.estimation.fit import fit_machine
from identification.results.store import load, save
from identification.uncertainty.prediction import predict
from tests.helpers.commands import run
from tests.helpers.interferometer import (
    MILL,
    Motion,
    fitted,
    passes,
    play,
    positioning,
    record,
    screw,
    targets,
    written,
)  # fmt: skip
from tests.helpers.nightly import first_of


@pytest.fixture
def mill(tmp_path: Path) -> Path:
    path = tmp_path / "mill.yaml"
    path.write_text(MILL)
    return path


# ---- units


def test_deviations_in_um_are_not_taken_for_mm(tmp_path: Path, mill: Path):
    table = positioning(4)
    bare = tmp_path / "laser.csv"
    table.to_csv(bare, index=False)
    result = run("fit", mill, bare, "--out", tmp_path / "out")
    assert result.code == 2
    assert "laser.csv, column dx" in result.err
    assert "units: {dx: um}" in result.err
    assert not (tmp_path / "out").exists()
    survey = read_survey(written(tmp_path, table), read_machine(str(mill)))
    np.testing.assert_allclose(survey.table["dx"], table["dx"] / 1e3, rtol=1e-12)
    np.testing.assert_array_equal(survey.table["X"], table["X"])
    table["dx"] /= 1e3
    table.to_csv(bare, index=False)  # in mm nobody need say so
    assert read_survey(bare, read_machine(str(mill))).table["dx"].equals(table["dx"])


def test_millimetres_of_error_are_possible_where_they_are_stated(tmp_path: Path, mill: Path):
    machine, table = read_machine(str(mill)), positioning()
    path = written(tmp_path, table, dx="mm")
    np.testing.assert_array_equal(read_survey(path, machine).table["dx"], table["dx"])
    q = np.linspace(0, 350, 8)
    pd.DataFrame({"joint": "C", "C": q, "ec": 1e-2 * np.sin(q)}).to_csv(tmp_path / "level.csv", index=False)
    with pytest.raises(InputError, match=r"column ec: error motions of C that vary by .* rad.*units: \{ec: urad\}"):
        read_survey(tmp_path / "level.csv", machine)


def test_positions_are_no_deviations(tmp_path: Path, mill: Path):
    table = positioning().assign(dx=lambda t: t["X"] + t["dx"] / 1e3)
    with pytest.raises(InputError, match=r"column dx: it changes by 560 mm where X does.*measured minus commanded"):
        read_survey(written(tmp_path, table, dx="mm"), read_machine(str(mill)))


FACTORS = {"mm": 1.0, "um": 1e-3, "inch": 25.4, "m": 1e3}


@pytest.mark.long
@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from([*FACTORS]), st.sampled_from([*FACTORS]), st.sampled_from(["degC", "K", "degF"]),
    st.sampled_from(["", "um", "mm"]),
)  # fmt: skip
def test_units_of_columns(tmp_path_factory: pytest.TempPathFactory, dx: str, x: str, bed: str, u: str):
    """Each column is converted once, by its own unit; an uncertainty has the unit of its reading unless it is said."""
    folder = tmp_path_factory.mktemp("units")
    (folder / "mill.yaml").write_text(MILL)
    machine, table = read_machine(str(folder / "mill.yaml")), positioning()
    mm = table.assign(dx=table["dx"] / 1e3, u_dx=5e-4)
    kelvin = {"degC": mm["T_bed"], "K": mm["T_bed"] + 273.15, "degF": mm["T_bed"] * 1.8 + 32}[bed]
    theirs = mm.assign(X=mm["X"] / FACTORS[x], dx=mm["dx"] / FACTORS[dx], u_dx=5e-4 / FACTORS[u or dx], T_bed=kelvin)
    theirs["time"] /= 60
    path = written(folder, theirs, **{"dx": dx, "X": x, "T_bed": bed, "time": "min"} | ({"u_dx": u} if u else {}))
    found = read_survey(path, machine).table
    for name in ("X", "dx", "u_dx", "T_bed", "time"):
        np.testing.assert_allclose(found[name], mm[name], rtol=1e-9, err_msg=name)


@pytest.mark.parametrize(
    ("units", "where", "found", "cure"),
    [
        ("{dxx: um}", "key units.dxx", "'dxx' is neither a kind of unit nor a column", "did you mean 'dx'?"),
        ("{dy: um}", "key units.dy", "'dy' is neither", "Valid:"),
        ("{dx: urad}", "key units.dx", "'urad'", "mm, um, m or inch"),
        ("{X: degF}", "key units.X", "'degF'", "unit of length"),
        ("{T_bed: mm}", "key units.T_bed", "'mm'", "degC, K or degF"),
        ("{dx: 3}", "key units.dx", "3", "unit of length"),
        ("{run: mm}", "key units.run", "'run' is neither", "dx"),
        ("{w_level: um}", "key units.w_level", "witness", "w_level_um"),
        ("{feed: mm}", "key units.feed", "'mm'", "mm/min"),
    ],
)
def test_bad_units_of_columns(tmp_path: Path, mill: Path, units: str, where: str, found: str, cure: str):
    positioning().assign(w_level=1.0, feed=1000.0).to_csv(tmp_path / "data.csv", index=False)
    path = tmp_path / "survey.yaml"
    path.write_text(f"errormodel: 1\nfiles: [{{path: data.csv}}]\nunits: {units}\n")
    with pytest.raises(InputError) as caught:
        read_survey(path, read_machine(str(mill)))
    message = str(caught.value)
    assert f"survey.yaml, line 3, {where}" in message
    assert found in message
    assert cure.lower() in message.lower()


# ---- sides of arrival


@settings(max_examples=60, deadline=None)
@given(st.integers(3, 12), st.integers(1, 4), st.integers(1, 3), st.sampled_from(["", "cycle", "pass"]), st.booleans())
def test_sides_of_a_test_to_and_fro(count: int, cycles: int, readings: int, label: str, both: bool):
    """As ISO 230-2 has it: the joint overruns its last target, and comes to it again from the other side."""
    q, side, cycle = passes(np.linspace(0, 500, count), cycles, both)
    q, side, cycle = (np.repeat(v, readings) for v in (q, side, cycle))
    table = pd.DataFrame({"joint": "X", "X": q, "file": "a", "row": range(len(q))})
    table["run"] = {"": "1", "cycle": cycle.astype(str), "pass": (2 * cycle + (side < 0)).astype(str)}[label]
    if both or label or count > 3:  # unlabelled, a way back over two intervals may be a target of its own
        np.testing.assert_array_equal(direction(table, "X"), side)


def test_without_overrun_a_target_is_read_once_where_the_joint_turns():
    q = np.concatenate([np.arange(0, 500, 50.0), np.arange(500, -1, -50.0)])
    table = pd.DataFrame({"joint": "X", "X": q, "file": "a", "run": "1", "row": range(len(q))})
    np.testing.assert_array_equal(direction(table, "X"), np.where(np.arange(len(q)) < 11, 1, -1))


def test_backlash_without_a_column_of_sides(tmp_path: Path, mill: Path):
    table = positioning(5, columns=("run",))
    mill.write_text(MILL + "effects: [{effect: backlash, joint: X}]\n")
    survey = read_survey(written(tmp_path, table), read_machine(str(mill)))
    assert any("dir_X" in note and "order of the rows" in note for note in survey.notes)
    found = fit_machine(read_machine(str(mill)), survey).solution.named()["X.dx.backlash"]
    assert 1e3 * found == pytest.approx(5, abs=0.3)


# ---- fit, tables


def test_a_fit_says_what_it_leaves_of_the_readings(tmp_path: Path, mill: Path):
    table = positioning()
    out = fitted(tmp_path, mill, table)
    (line,) = json.loads((out / "fit.json").read_text())["motions"]
    assert (line["joint"], line["motion"], line["n"], line["unit"]) == ("X", "dx", len(table), "um")
    assert line["fitted"] == pytest.approx(0.4, abs=0.1)
    assert line["fitted"] < line["heldout"] < 0.7 < 2 < line["nominal"]
    rows = pd.read_csv(out / "residuals.csv")
    assert np.sqrt(np.mean(rows["residual_dx_um"] ** 2)) == pytest.approx(line["fitted"])
    result = run("fit", mill, tmp_path / "survey.yaml", "--out", tmp_path / "again")
    assert "EXX, um" in result.out
    page = (tmp_path / "again" / "report.html").read_text()
    assert "no positions were measured" not in page
    assert "none identified" not in page
    assert "Error motions fitted: EXX" in page


def at(result: Compensation, joint: str) -> tuple[float, float, float]:
    """Of held-out rows about a joint, um rms before, after an ideal compensation and after the tables."""
    (own,) = (f for f in result.usual.figures if f.poses.endswith(f"about {joint}"))
    return own.before.rms_um, own.ideal.rms_um, own.after.rms_um


BOTH_SIDES = ("linuxcnc-type0", "linuxcnc-type1", "siemens-cec", "twincat-nc")
ONE = ("aerotech-1d", "csv", "fanuc-pitch", "heidenhain", "isg", "pmac", "siemens-lec")


@pytest.mark.parametrize("name", first_of([*BOTH_SIDES, *ONE], 2))
def test_pitch_tables_from_an_interferometer(tmp_path: Path, mill: Path, name: str):
    """To the noise where tables know the sides; where they do not, to half of the backlash."""
    folder = fitted(tmp_path, mill, positioning(4), "effects: [{effect: backlash, joint: X}]\n")
    result = compensate(folder, name)
    before, best, after = at(result, "X")
    assert before > 3
    assert best < 0.6
    assert after < (1.25 * best if name in BOTH_SIDES else np.hypot(best, 2) * 1.1)
    assert {t.term.output for t in result.usual.tables} == ({"EXX"} if name == "isg" else {"X"})
    axes = {a.joint: a.measured for a in result.setup.axes}
    assert axes["X"] == (20.0, 580.0)
    assert axes["Y"][0] == axes["Y"][1]
    assert any("nothing was read of Y" in note for note in result.notes)


def test_tables_take_the_truth_away(tmp_path: Path, mill: Path):
    """Against the motion that made the record, at positions between the targets, by the file's own points."""
    folder = fitted(tmp_path, mill, positioning())
    (table,) = compensate(folder, "csv").usual.tables
    (grid,) = table.term.grids
    q = np.linspace(20, 580, 200)
    left = screw(q, q, q, q) + 1e3 * np.interp(q, grid, table.values.ravel())
    assert np.ptp(screw(q, q, q, q)) > 8
    assert np.std(left) < 0.35


def test_three_joints_each_by_itself(tmp_path: Path, mill: Path):
    tables = [positioning(joint=j, seed=k) for k, j in enumerate("XYZ")]
    result = compensate(fitted(tmp_path, mill, pd.concat(tables)), "siemens-lec")
    assert {t.term.output for t in result.usual.tables} == {*"XYZ"}
    for joint in "XY":  # Z has a model of one parameter, which the bow is not in
        before, best, after = at(result, joint)
        assert after < 1.1 * best < 0.3 * before
    assert not result.advice


def test_angles_alone_make_no_tables(tmp_path: Path, mill: Path):
    rng = np.random.default_rng(3)
    table = record("X", {"eb": screw}, targets(20, 580, 11, rng), rng)
    with pytest.raises(InputError, match=r"angles of X and no displacement.*Read dx, dy or dz"):
        compensate(fitted(tmp_path, mill, table), "csv")


def test_runout_of_a_table(tmp_path: Path, mill: Path):
    """Linear axes carry out what a rotary one needs; a format that has no such tables says so."""
    rng = np.random.default_rng(4)
    circle: dict[str, Motion] = {
        "dx": lambda q, *_: 5 * np.sin(np.radians(q)),
        "dy": lambda q, *_: 5 * np.cos(np.radians(q)),
    }
    folder = fitted(tmp_path, mill, record("C", circle, np.linspace(0, 350, 15), rng))
    for name in ("csv", "isg"):
        before, best, after = at(compensate(folder, name), "C")
        assert after < 1.1 * best < 0.2 * before
    for name in ("linuxcnc-type1", "klipper"):
        with pytest.raises(InputError, match="read of C can be taken away by tables of this format"):
            compensate(folder, name)


def test_a_lattice_needs_all_axes(tmp_path: Path, mill: Path):
    folder = fitted(tmp_path, mill, positioning())
    with pytest.raises(InputError, match=r"Y Z was not measured. Use --controller fanuc-pitch"):
        compensate(folder, "fanuc-3d")


def test_predictions_of_error_motions(tmp_path: Path, mill: Path):
    folder = fitted(tmp_path, mill, positioning(4), "effects: [{effect: backlash, joint: X}]\n")
    q = np.array([20.0, 110.0, 240.0, 500.0, 240.0])
    points = pd.DataFrame({"joint": "X", "X": q, "dir_X": [1, 1, 1, 1, -1]})
    points.to_csv(tmp_path / "p.csv", index=False)
    fit = load(folder)
    out = predict(fit, read_survey(tmp_path / "p.csv", fit.chain.machine, measured=False))
    truth = 1e-3 * play(4)(q, points["dir_X"].to_numpy(), q, q)
    gap = (out["dx"] - truth) - (out["dx"] - truth).iloc[0]
    assert np.abs(gap).max() < 6e-4
    assert out[["mx", "my", "mz"]].isna().all(axis=None)
    assert ((out["u_dx"] > 0) & (out["u_dx"] < 2e-3)).all()


# ---- diagnosis


def found(folder: Path, mill: Path, table: pd.DataFrame) -> list[tuple[str, str, float]]:
    machine = read_machine(str(mill))
    result = diagnose(machine, read_survey(written(folder, table), machine))
    return [(f.effect, f.where, f.probability) for f in result.diagnosis.findings]


def test_backlash_is_found_among_joints(tmp_path: Path, mill: Path):
    table = pd.concat([positioning(joint="Y"), positioning(5)])
    mill.write_text(MILL)
    machine = read_machine(str(mill))
    result = diagnose(machine, read_survey(written(tmp_path, table), machine))
    (one,) = result.diagnosis.findings
    assert (one.effect, one.where) == ("backlash", "X")
    assert one.probability > 0.9
    assert 1e3 * result.final.solution.named()["X.dx.backlash"] == pytest.approx(5, abs=0.3)
    assert result.diagnosis.verdict == "explained"
    assert result.diagnosis.noise_um == pytest.approx(0.4, abs=0.1)


def test_cyclic_errors_and_growth_are_found(tmp_path: Path, mill: Path):
    rng = np.random.default_rng(5)
    q = np.sort(np.concatenate([targets(20, 580, 11, rng), 200 + 1.7 * np.arange(24)]))
    wave = record("X", {"dx": lambda q, *_: screw(q, *_) + 3 * np.sin(2 * np.pi * q / 10)}, q, rng, runs=3)
    ((effect, where, p),) = found(tmp_path, mill, wave)
    assert (effect, where) == ("pitch-cyclic", "X")
    assert p > 0.8
    q = targets(20, 580, 11, rng)
    warm = record("X", {"dx": lambda q, s, t, bed: screw(q, s, t, bed) + 11.5e-3 * q * (bed - 20)}, q, rng, warm=3)
    ((effect, where, p),) = found(tmp_path, mill, warm)
    assert (effect, where) == ("scale-expansion", "X")


def test_few_targets_do_not_name_what_they_cannot_tell(tmp_path: Path, mill: Path):
    rng = np.random.default_rng(104)
    wave = record("Y", {"dy": lambda q, *_: 3 * np.sin(2 * np.pi * q / 10)}, targets(0, 450, 12, rng), rng)
    machine = read_machine(str(mill))
    findings = diagnose(machine, read_survey(written(tmp_path, wave), machine)).diagnosis.findings
    assert findings
    for one in findings:
        assert one.effect != "pitch-cyclic"
        assert one.probability <= 0.5
        assert "lead of a screw" in one.statement
        assert one.alternatives[0].effect == "pitch-cyclic"
        assert not one.alternatives[0].separable


@pytest.mark.long
@pytest.mark.parametrize("kind", ["zeros", "rounded", "angles", "one way", "six"])
def test_quiet_records_hold_nothing(tmp_path: Path, mill: Path, kind: str):
    rng = np.random.default_rng(11)
    q = targets(20, 580, 11, rng)
    bow: Motion = lambda q, *_: 0.02 * q + 3e-5 * q**2  # noqa: E731
    slope: Motion = lambda q, *_: 0.02 * q  # noqa: E731  of a straightedge, where it is across
    tables = {
        "zeros": lambda: record("X", {"dx": bow}, q, rng, zeros=2000.0),
        "rounded": lambda: record("X", {"dx": bow}, q, rng, noise=0.12, step=0.1),
        "angles": lambda: record("X", {"ea": bow, "eb": bow, "ec": bow}, q, rng, warm=3),
        "six": lambda: record("Z", dict.fromkeys(("dx", "dy", "dz", "ea", "eb", "ec"), slope), q[q < 390], rng),
        "one way": lambda: record("X", {"dx": bow}, q, rng, both=False, runs=8),
    }
    assert found(tmp_path, mill, tables[kind]()) == []


def test_a_diagnosis_is_compensated(tmp_path: Path, mill: Path):
    path = written(tmp_path, positioning(5))
    result = run("diagnose", mill, path, "--out", tmp_path / "d")
    assert result.code == 0
    assert "Backlash of X" in result.out
    page = (tmp_path / "d" / "report.html").read_text()
    assert "Backlash at X" in page
    assert "EYX" not in page.split("What this survey could not have shown")[0]  # was never read
    before, best, after = at(compensate(tmp_path / "d", "linuxcnc-type0"), "X")
    assert before > 2.5
    assert after < 1.25 * best < 1


def test_mixed_rows_stay_with_positions(tmp_path: Path, mill: Path):
    """Beside measured positions, readings of motions are part of the fit, and the volume is that of the positions."""
    rng = np.random.default_rng(2)
    machine = read_machine(str(mill))
    poses = pd.DataFrame({j.name: rng.uniform(*j.travel, 120) for j in machine.joints})
    poses["C"] = np.degrees(poses["C"])
    poses.to_csv(tmp_path / "poses.csv", index=False)
    assert run("simulate", mill, tmp_path / "poses.csv", "--noise", 0.001, "--out", tmp_path / "p.csv").code == 0
    points = pd.read_csv(tmp_path / "p.csv")
    laser = positioning().assign(dx=lambda t: t["dx"] / 1e3)
    survey = written(tmp_path, pd.concat([points, laser]).drop(columns=["run", "time", "T_bed"]), dx="mm")
    data: Survey = read_survey(survey, machine)
    fit = fit_machine(machine, data)
    assert fit.motions is not None
    assert fit.fitted.n == len(points)
    save(fit, tmp_path / "fit")
    figures = compensate(tmp_path / "fit", "csv").usual.figures
    assert [f.before.n for f in figures[1:]] == [len(points)]
    assert not any("about X" in f.poses for f in figures)
