"""What `predict` and `simulate` say of points that a fit knows little of, and what counts as the machine's error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.machine_file import read_machine
from tests.helpers.commands import MILL, XYZ, Fill, done, run, write

E = ["ex", "ey", "ez"]


@pytest.fixture(scope="module")
def mill(with_mill: Fill, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return with_mill(tmp_path_factory.mktemp("mill"))


def _mill_with(folder: Path, effects: str) -> Path:
    text = (Path(__file__).resolve().parents[2] / "machines" / f"{MILL}.yaml").read_text(encoding="utf-8")
    return write(folder / "machine.yaml", f"{text}\neffects: {effects}\n")


def test_points_beyond_what_was_measured_are_named(mill: Path, tmp_path: Path) -> None:
    """A survey of part of a travel says nothing of the rest, though the rest is within the travel."""
    whole = pd.read_csv(mill / "s.csv")
    part = whole.assign(X=whole["X"] / 10).drop(columns=XYZ)
    part.to_csv(tmp_path / "part.csv", index=False)
    done("simulate", MILL, tmp_path / "part.csv", "--noise", 0.002, "--out", tmp_path / "s.csv")
    done("fit", MILL, tmp_path / "s.csv", "--out", tmp_path / "fit")
    points = part.iloc[:3].assign(X=[0.0, 25.0, 300.0])
    points.to_csv(tmp_path / "p.csv", index=False)
    note = done("predict", tmp_path / "fit", tmp_path / "p.csv", "--out", tmp_path / "out.csv").err
    assert note.count("beyond what was measured") == 1
    assert "1 point lies beyond what was measured of X" in note
    assert "300 mm (" in note
    assert "p.csv, row 3)" in note
    quiet = done("predict", mill / "fit", tmp_path / "p.csv", "--out", tmp_path / "out.csv").err
    assert "beyond" not in quiet


def test_measured_columns_of_points_are_not_used_and_said_to_be(mill: Path, tmp_path: Path) -> None:
    """Once, and with --stream as without."""
    points = pd.read_csv(mill / "s.csv")
    said = []
    for name, table in (("with", points), ("without", points.drop(columns=XYZ))):
        table.to_csv(tmp_path / f"{name}.csv", index=False)
        for suffix, options in {"csv": (), "parquet": ("--stream",)}.items():
            out = ("--out", tmp_path / f"out_{name}.{suffix}", *options)
            said.append(done("predict", mill / "fit", tmp_path / f"{name}.csv", *out).err)
    assert [text.count("what was measured there is not used") for text in said] == [1, 1, 0, 0]
    assert (tmp_path / "out_with.csv").read_bytes() == (tmp_path / "out_without.csv").read_bytes()


def test_a_load_that_the_model_does_not_know_is_said(mill: Path, tmp_path: Path) -> None:
    """Points with 20 kg passed without a note, for a model of a survey without a load."""
    points, said = pd.read_csv(mill / "s.csv").drop(columns=XYZ), []
    for load in (0.0, 20.0):
        points.assign(load=load).to_csv(tmp_path / "p.csv", index=False)
        said.append(done("predict", mill / "fit", tmp_path / "p.csv", "--out", tmp_path / "out.csv").err)
    assert "load" not in said[0]
    assert "the model knows nothing of the load, 20 kg in row 1: the fitted survey has no column load" in said[1]


def test_a_temperature_that_never_was_is_named(tmp_path: Path) -> None:
    """So it is with what drives an effect."""
    machine = _mill_with(tmp_path, "[{effect: spindle-growth, sensor: T_spindle}]")
    done("simulate", MILL, 60, "--out", tmp_path / "poses.csv")
    poses = pd.read_csv(tmp_path / "poses.csv").drop(columns=XYZ)
    poses.assign(T_spindle=np.linspace(20, 30, 60)).to_csv(tmp_path / "c.csv", index=False)
    done("simulate", machine, tmp_path / "c.csv", "--noise", 0.002, "--out", tmp_path / "s.csv")
    done("fit", machine, tmp_path / "s.csv", "--out", tmp_path / "fit")
    for warm, named in ((25.0, False), (80.0, True)):
        poses.iloc[:5].assign(T_spindle=warm).to_csv(tmp_path / "p.csv", index=False)
        err = done("predict", tmp_path / "fit", tmp_path / "p.csv", "--out", tmp_path / "out.csv").err
        assert ("5 points lie beyond what was measured of T_spindle, 20 to 30 degC" in err) == named


def test_a_lag_depends_on_times(tmp_path: Path) -> None:
    machine = _mill_with(tmp_path, "[{effect: structure-drift, element: column, motion: dy, sensor: T_bed, tau: 900}]")
    done("simulate", MILL, 60, "--out", tmp_path / "poses.csv")
    poses = pd.read_csv(tmp_path / "poses.csv").drop(columns=XYZ)
    seen = poses.assign(T_bed=np.linspace(20, 30, 60), time=np.linspace(0, 3600, 60))
    seen.to_csv(tmp_path / "c.csv", index=False)
    done("simulate", machine, tmp_path / "c.csv", "--noise", 0.002, "--out", tmp_path / "s.csv")
    done("fit", machine, tmp_path / "s.csv", "--out", tmp_path / "fit")
    seen.iloc[:5].assign(time=np.linspace(9000, 9400, 5)).to_csv(tmp_path / "p.csv", index=False)
    err = done("predict", tmp_path / "fit", tmp_path / "p.csv", "--out", tmp_path / "out.csv").err
    assert "beyond what was measured of time, 0 to 3600 s" in err
    assert "carried on unproven" in err
    assert "nothing in the model depends" not in err


def test_what_a_lag_had_come_to_is_in_the_files_of_a_fit(tmp_path: Path) -> None:
    """Later commands are predicted as rows of the same recording would be; at earlier times it is said that not."""
    machine = _mill_with(tmp_path, "[{effect: structure-drift, element: column, motion: dy, sensor: T_bed, tau: 1800}]")
    done("simulate", MILL, 90, "--out", tmp_path / "poses.csv")
    time = 100.0 * np.arange(90)
    poses = pd.read_csv(tmp_path / "poses.csv").drop(columns=XYZ)
    poses = poses.assign(time=time, T_bed=20 + 30 * (1 - np.exp(-time / 1500)))
    poses.to_csv(tmp_path / "c.csv", index=False)
    (moved,) = (i for i in Chain(read_machine(machine)).ids if "structure-drift" in i)
    truth = write(tmp_path / "t.yaml", f"parameters: {{{moved}: 0.005}}\n")
    done("simulate", machine, tmp_path / "c.csv", "--parameters", truth, "--out", tmp_path / "all.csv")
    seen = pd.read_csv(tmp_path / "all.csv")
    seen.iloc[:60].to_csv(tmp_path / "s.csv", index=False)
    done("fit", machine, tmp_path / "s.csv", "--out", tmp_path / "fit")
    for back, said in ((0.0, False), (7000.0, True)):
        later = poses.iloc[60:].assign(time=time[60:] - back)
        later.to_csv(tmp_path / "p.csv", index=False)
        err = done("predict", tmp_path / "fit", tmp_path / "p.csv", "--out", tmp_path / "out.csv").err
        assert ("T_bed acts late" in err) == said
        left = np.abs(pd.read_csv(tmp_path / "out.csv")[XYZ].to_numpy() - seen[XYZ].to_numpy()[60:]).max()
        assert (left > 0.01) if said else (left < 1e-6)


def test_what_has_no_name_is_not_carried_on(tmp_path: Path) -> None:
    """Beyond the times that it was recorded in it tends to its mean: that is what is said of it."""
    known = "within: [[time, 0, 5900, 1500]], spread: [[Z, dz, 0.01]]"
    cubic = "form: cubic, center: 3000, half_range: 3000"
    form = f"{{effect: unnamed, element: Z, motion: dz, driver: time, {cubic}, {known}}}"
    drift = "{effect: warm-up, element: X, motion: dx, tau: 2000}"
    for effects, said in ((form, ("tends",)), (drift, ("carried",)), (f"{form}, {drift}", ("tends", "carried"))):
        machine = _mill_with(tmp_path, f"[{effects}]")
        done("simulate", MILL, 60, "--out", tmp_path / "poses.csv")
        poses = pd.read_csv(tmp_path / "poses.csv").drop(columns=XYZ).assign(time=100.0 * np.arange(60))
        poses.to_csv(tmp_path / "c.csv", index=False)
        done("simulate", machine, tmp_path / "c.csv", "--noise", 0.002, "--out", tmp_path / "s.csv")
        done("fit", machine, tmp_path / "s.csv", "--out", tmp_path / "fit")
        poses.assign(time=9000.0).to_csv(tmp_path / "p.csv", index=False)
        err = done("predict", tmp_path / "fit", tmp_path / "p.csv", "--out", tmp_path / "out.csv").err
        assert "beyond what was measured of time, 0 to 5900 s" in err
        assert ("what has no name (unnamed at Z) tends to its mean" in err) == ("tends" in said)
        assert ("is carried on unproven" in err) == ("carried" in said)


def test_a_station_that_moved_is_no_error_of_the_machine(tmp_path: Path) -> None:
    """It is in what would be measured; the machine stands where it stood."""
    machine = _mill_with(tmp_path, "[{effect: station-shift, at: 3000}]")
    done("simulate", MILL, 80, "--out", tmp_path / "poses.csv")
    poses = pd.read_csv(tmp_path / "poses.csv").drop(columns=XYZ).assign(time=60.0 * np.arange(80))
    poses.to_csv(tmp_path / "c.csv", index=False)
    truth = write(tmp_path / "t.yaml", "parameters: {frame.dx.station-shift: 0.05, X.dx.1: 0.01}\n")
    done("simulate", machine, tmp_path / "c.csv", "--parameters", truth, "--out", tmp_path / "s.csv")
    done("fit", machine, tmp_path / "s.csv", "--out", tmp_path / "fit")
    same = pd.concat([poses.iloc[:1]] * 2).assign(time=[0.0, 4000.0])
    same.to_csv(tmp_path / "p.csv", index=False)
    done("predict", tmp_path / "fit", tmp_path / "p.csv", "--out", tmp_path / "out.csv")
    before, after = (row for _, row in pd.read_csv(tmp_path / "out.csv").iterrows())
    assert np.linalg.norm((after[XYZ] - before[XYZ]).astype(float)) == pytest.approx(0.05, abs=1e-4)
    np.testing.assert_allclose(after[E].astype(float), before[E].astype(float), atol=1e-9)


def test_the_side_of_arrival_is_asked_for(tmp_path: Path) -> None:
    """With play in the model a pose has two answers: which one was given is said, unless the table says it."""
    machine = _mill_with(tmp_path, "[{effect: backlash, joint: X}]")
    done("simulate", machine, 80, "--noise", 0.001, "--out", tmp_path / "s.csv")
    done("fit", machine, tmp_path / "s.csv", "--out", tmp_path / "fit")
    points = pd.read_csv(tmp_path / "s.csv").drop(columns=XYZ).iloc[:4]
    for table, asked in ((points, True), (points.assign(dir_X=-1), False)):
        table.to_csv(tmp_path / "p.csv", index=False)
        err = done("predict", tmp_path / "fit", tmp_path / "p.csv", "--out", tmp_path / "out.csv").err
        assert ("dir_X" in err) == asked


def test_before_the_first_move_a_side_is_not_known(tmp_path: Path) -> None:
    """Midway between what is predicted from either side, and uncertain by half the difference."""
    machine = _mill_with(tmp_path, "[{effect: backlash, joint: X}]")
    truth = write(tmp_path / "t.yaml", "parameters: {X.dx.backlash: 0.02}\n")
    done("simulate", machine, 80, "--noise", 0.001, "--parameters", truth, "--out", tmp_path / "s.csv")
    done("fit", machine, tmp_path / "s.csv", "--out", tmp_path / "fit")
    points = pd.read_csv(tmp_path / "s.csv").drop(columns=XYZ).iloc[:4]
    points["X"] = [*points["X"].iloc[[0, 0, 0]], points["X"].iloc[0] + 50]

    def predicted(table: pd.DataFrame) -> pd.DataFrame:
        table.to_csv(tmp_path / "p.csv", index=False)
        done("predict", tmp_path / "fit", tmp_path / "p.csv", "--out", tmp_path / "out.csv")
        return pd.read_csv(tmp_path / "out.csv")

    untold, up, down = predicted(points), predicted(points.assign(dir_X=1)), predicted(points.assign(dir_X=-1))
    half = (up[XYZ] - down[XYZ]) / 2
    assert half["mx"].abs().to_numpy() == pytest.approx(0.01, abs=1e-3)
    np.testing.assert_allclose(untold[XYZ][:3], (up[XYZ] - half)[:3], atol=1e-9)
    np.testing.assert_allclose(untold["ux"][:3], np.hypot(up["ux"], half["mx"])[:3], rtol=0.05)
    np.testing.assert_allclose(untold.iloc[3][XYZ], up.iloc[3][XYZ], atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize(
    "blunder",
    [
        "column: X, factor: -1",
        "column: X, factor: 1, offset: 12.5",
        "column: X, swap: Y",
        "column: my, factor: -1",
        "column: mx, swap: mz",
    ],
)
def test_a_table_with_a_mistake_comes_back_as_it_was(tmp_path: Path, blunder: str) -> None:
    """What a command writes is read again with the same mistake: it fits, and commands are those that were asked."""
    machine = _mill_with(tmp_path, f"[{{effect: axis-blunder, {blunder}}}]")
    done("simulate", MILL, 60, "--out", tmp_path / "poses.csv")
    poses = pd.read_csv(tmp_path / "poses.csv").drop(columns=XYZ)
    poses.to_csv(tmp_path / "c.csv", index=False)
    truth = write(tmp_path / "t.yaml", "parameters: {X.dx.1: 0.01}\n")
    done("simulate", machine, tmp_path / "c.csv", "--parameters", truth, "--noise", 0.001, "--out", tmp_path / "s.csv")
    joints = [j.name for j in read_machine(machine).joints]
    np.testing.assert_allclose(pd.read_csv(tmp_path / "s.csv")[joints], poses[joints], rtol=1e-12)
    done("fit", machine, tmp_path / "s.csv", "--out", tmp_path / "fit")
    done("predict", tmp_path / "fit", tmp_path / "c.csv", "--out", tmp_path / "p.csv")
    predicted = pd.read_csv(tmp_path / "p.csv")
    np.testing.assert_allclose(predicted[joints], poses[joints], rtol=1e-12)
    np.testing.assert_allclose(predicted[XYZ], pd.read_csv(tmp_path / "s.csv")[XYZ], atol=0.01)
    assert np.abs(predicted[E].to_numpy()).max() < 0.05


def test_points_from_a_side_that_was_not_measured_are_said(tmp_path: Path) -> None:
    """X always comes from smaller positions: where it returns to the start of a line, it may have overrun it."""
    z, y, x = np.meshgrid(np.linspace(150, 600, 3), np.linspace(-200, 200, 4), np.linspace(-300, 300, 9), indexing="ij")
    rows = pd.DataFrame({"X": x.ravel(), "Y": y.ravel(), "Z": z.ravel()})
    points = rows.iloc[:30].assign(X=np.linspace(290, -290, 30), Y=100.0)
    said = {}
    for name, table in {"one": rows, "both": pd.concat([rows, rows.iloc[::-1]])}.items():
        table.to_csv(tmp_path / f"{name}.csv", index=False)
        points.to_csv(tmp_path / "p.csv", index=False)
        done("simulate", MILL, tmp_path / f"{name}.csv", "--noise", 0.002, "--out", tmp_path / "s.csv")
        done("fit", MILL, tmp_path / "s.csv", "--out", tmp_path / name)
        said[name] = done("predict", tmp_path / name, tmp_path / "p.csv", "--out", tmp_path / "out.csv").err
    assert "29 points by X (dir_X -1) are reached from the side from which no row was measured" in said["one"]
    assert "from which no row" not in said["both"]


def test_a_fit_that_leaves_more_than_the_declared_noise(mill: Path, tmp_path: Path) -> None:
    """What the model lacks is in no uncertainty: said where the residuals contradict what was declared."""
    seen = pd.read_csv(mill / "s.csv")
    points = seen.iloc[:3].drop(columns=XYZ)
    points.to_csv(tmp_path / "p.csv", index=False)
    for sigma, said in ((0.0003, True), (0.002, False)):
        seen.assign(sigma=sigma).to_csv(tmp_path / "s.csv", index=False)
        done("fit", MILL, tmp_path / "s.csv", "--out", tmp_path / "fit")
        note = done("predict", tmp_path / "fit", tmp_path / "p.csv", "--out", tmp_path / "out.csv").err
        assert ("times as large as the declared uncertainty: what its model lacks" in note) == said


def test_temperatures_that_nothing_depends_on(mill: Path, tmp_path: Path) -> None:
    """A plain model knows nothing of warmth: said where commands are warmer than what was recorded."""
    seen = pd.read_csv(mill / "s.csv")
    seen.assign(T_bed=20 + 0.01 * np.arange(len(seen))).to_csv(tmp_path / "s.csv", index=False)
    done("fit", MILL, tmp_path / "s.csv", "--out", tmp_path / "fit")
    for warm, said in ((21.2, False), (25.0, True)):
        seen.iloc[:3].drop(columns=XYZ).assign(T_bed=warm).to_csv(tmp_path / "p.csv", index=False)
        note = done("predict", tmp_path / "fit", tmp_path / "p.csv", "--out", tmp_path / "out.csv").err
        assert ("nothing in the model depends on it" in note) == said


@pytest.mark.parametrize(("name", "there", "beyond", "unit"), [("time", 900, 4000, "s"), ("load", 20, 50, "kg")])
def test_times_and_loads_that_nothing_depends_on(
    mill: Path, tmp_path: Path, name: str, there: float, beyond: float, unit: str
) -> None:
    seen = pd.read_csv(mill / "s.csv")
    seen.assign(**{name: np.linspace(0, there, len(seen))}).to_csv(tmp_path / "s.csv", index=False)
    done("fit", MILL, tmp_path / "s.csv", "--out", tmp_path / "fit")
    for value, said in ((there, False), (beyond, True)):
        seen.iloc[:3].drop(columns=XYZ).assign(**{name: value}).to_csv(tmp_path / "p.csv", index=False)
        note = done("predict", tmp_path / "fit", tmp_path / "p.csv", "--out", tmp_path / "out.csv").err
        assert (f"beyond what was measured of {name}, 0 to {there} {unit}" in note) == said


def test_a_component_that_no_row_has(mill: Path, tmp_path: Path) -> None:
    """A grid plate shows two components: the third is predicted from the machine's zero, and that is said."""
    survey = pd.read_csv(mill / "s.csv")
    survey.drop(columns="mz").to_csv(tmp_path / "plate.csv", index=False)
    done("fit", MILL, tmp_path / "plate.csv", "--out", tmp_path / "fit")
    survey.drop(columns=XYZ).to_csv(tmp_path / "p.csv", index=False)
    said = done("predict", tmp_path / "fit", tmp_path / "p.csv", "--out", tmp_path / "out.csv").err
    assert "no fitted row has mz: where the instrument has its zero along z is not known" in said
    assert "no fitted row has" not in done("predict", mill / "fit", tmp_path / "p.csv", "--out", tmp_path / "o.csv").err


def test_a_run_whose_frame_is_not_known(tmp_path: Path, mill: Path) -> None:
    """Rows of a run that was not fitted are predicted in another's frame, and that is said."""
    survey = pd.read_csv(mill / "s.csv").assign(run="1")
    survey.to_csv(tmp_path / "s.csv", index=False)
    write(tmp_path / "survey.yaml", "errormodel: 1\nfiles: [{path: s.csv, role: fit}]\nframe: per-run\n")
    done("fit", MILL, tmp_path / "survey.yaml", "--out", tmp_path / "fit")
    survey.drop(columns=XYZ).assign(run="2").to_csv(tmp_path / "p.csv", index=False)
    said = done("predict", tmp_path / "fit", tmp_path / "p.csv", "--out", tmp_path / "out.csv").err
    assert "run 2 was not fitted: predicted in the frame of run 1" in said
    assert "mx my mz of these rows may be off by that, which no uncertainty has" in said


@pytest.fixture(scope="module")
def recorded(mill: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fit of a survey with two temperatures on which nothing depends, and points ``p.csv``."""
    folder, whole = tmp_path_factory.mktemp("recorded"), pd.read_csv(mill / "s.csv")
    course = 20.9 + 0.5 * np.linspace(0, 1, len(whole))
    whole.assign(T_bed=course.round(3), T_air=(course + 1).round(3)).to_csv(folder / "s.csv", index=False)
    done("fit", MILL, folder / "s.csv", "--out", folder / "fit")
    whole.iloc[:5].drop(columns=XYZ).to_csv(folder / "p.csv", index=False)
    return folder


def test_points_without_the_temperatures_of_the_survey_are_said(recorded: Path, tmp_path: Path) -> None:
    points = pd.read_csv(recorded / "p.csv")
    said = "the recording had T_bed 20.9 to 21.4 degC and T_air 21.9 to 22.4 degC, and the rows have no such columns"
    for columns, there in (({}, True), ({"T_Bed": 21.0}, True), ({"T_bed": 21.0}, False)):
        points.assign(**columns).to_csv(tmp_path / "p.csv", index=False)
        note = done("predict", recorded / "fit", tmp_path / "p.csv", "--out", tmp_path / "out.csv").err
        assert note.count(said) == there
        assert ("T_Bed is perhaps T_bed" in note) == ("T_Bed" in columns)


def test_temperatures_of_points_in_another_unit_are_refused(recorded: Path, tmp_path: Path) -> None:
    """20 K beyond what was recorded are predicted, with a note; the cure that is said is one."""
    points, out = pd.read_csv(recorded / "p.csv"), ("--out", tmp_path / "out.csv")
    points.assign(T_bed=[21.0, 41.0, 21.0, 21.0, 21.0]).to_csv(tmp_path / "warm.csv", index=False)
    assert "beyond what was measured of T_bed" in done("predict", recorded / "fit", tmp_path / "warm.csv", *out).err
    points.assign(T_bed=294.15).to_csv(tmp_path / "k.csv", index=False)
    error = run("predict", recorded / "fit", tmp_path / "k.csv", *out)
    assert error.code == 2
    found = "k.csv, row 1, column T_bed: 294.15 degC, where 20.9 to 21.4 degC were recorded; in K it would be 21"
    assert found in error.err
    units = "errormodel: 1\nfiles: [{path: k.csv}]\nunits: {temperature: K}\n"
    done("predict", recorded / "fit", write(tmp_path / "k.yaml", units), *out)


def test_temperatures_of_rows_where_the_survey_has_none(mill: Path, tmp_path: Path) -> None:
    pd.read_csv(mill / "s.csv").drop(columns=XYZ).assign(T_bed=30.0).to_csv(tmp_path / "p.csv", index=False)
    said = done("predict", mill / "fit", tmp_path / "p.csv", "--out", tmp_path / "out.csv").err
    assert "T_bed is not used: the survey was fitted without temperatures" in said
