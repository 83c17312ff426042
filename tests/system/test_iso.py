"""`errormodel iso`: figures from surveys and from fitted models against the errors that were simulated."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from errormodel import read_machine, simulate
from errormodel.machine import Joint
from identification import fit, iso, standards
from identification.iso_standards import series
from tests.helpers.commands import MILL, done, run, tree, write

CMM = "bridge_cmm"
TRUNNION = "trunnion_five_axis"
SCALE, SQUARE = 20e-6, 30e-6  # of X; of Y against X, rad
TRUTH = {"X.dx.1": SCALE * 380, "saddle.ec": SQUARE}
TRUE_FILE = f"parameters: {{X.dx.1: {SCALE * 380}, saddle.ec: {SQUARE}}}\n"


def figures(folder: Path, standard: str, *words: object) -> dict[str, Any]:
    """Quantities of a fit or a survey by their names."""
    out = folder / "figures.json"
    done("iso", standard, *words, "--json", out)
    found = json.loads(out.read_text())["standards"][0]["quantities"]
    return {q["name"]: q for q in found}


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mill with a scale and a squareness, measured with a noise of 0.1 um: ``s.csv fit/``."""
    folder = tmp_path_factory.mktemp("fitted")
    write(folder / "truth.yaml", TRUE_FILE)
    done("simulate", MILL, 150, "--parameters", folder / "truth.yaml", "--noise", 1e-4, "--out", folder / "s.csv")
    done("fit", MILL, folder / "s.csv", "--out", folder / "fit")
    return folder


@pytest.fixture(scope="module")
def travel(fitted: Path) -> dict[str, float]:
    """Lengths of the measured travels, mm."""
    table = pd.read_csv(fitted / "s.csv")
    return {name: float(np.ptp(table[name])) for name in "XYZ"}


def close(quantity: dict[str, Any], expected: float) -> bool:
    """Whether a value is the true one within its uncertainty (twice U: a few of many may lie beyond U)."""
    return bool(abs(quantity["value"] - expected) <= 2 * quantity["expanded_uncertainty"])


def test_positioning_of_a_fit_is_the_scale(fitted: Path, travel: dict[str, float]) -> None:
    found = figures(fitted, "230-2", fitted / "fit")
    assert set(found) == {"X.E", "Y.E", "Z.E"}  # the model has no play, and repeats itself exactly
    assert close(found["X.E"], SCALE * travel["X"])
    assert found["X.E"]["expanded_uncertainty"] < 5e-4
    assert found["Y.E"]["value"] < 5e-4


def test_squareness_of_a_fit(fitted: Path) -> None:
    found = figures(fitted, "230-1", fitted / "fit")
    assert close(found["EC(0X)Y"], SQUARE)
    assert close(found["EB(0X)Z"], 0.0)
    assert found["EYX"]["value"] < 5e-4  # a straight line: its slope is no straightness error


def test_a_model_without_curvature_says_nothing_of_straightness(fitted: Path, tmp_path: Path) -> None:
    """Its straightness would be 0 with an uncertainty of 0, and pass any tolerance."""
    whole = read_machine(MILL)
    rigid = (replace(e, models={}) if isinstance(e, Joint) else e for e in whole.elements)
    found = iso("230-1", fit(replace(whole, elements=tuple(rigid)), fitted / "s.csv").save(tmp_path / "fit"))
    symbols = {q.symbol for q in found.evaluations[0].quantities}
    assert "EC(0X)Y" in symbols
    assert not symbols & {"EYX", "EZX", "EYX minimum zone"}
    assert any("says nothing of it" in note and "EYX" in note for note in found.notes)


def test_face_diagonals_of_a_fit_by_the_formula_of_textbooks(fitted: Path, travel: dict[str, float]) -> None:
    """``ex = s x - g y``: along (X, Y) the error grows by (s X^2 - g X Y) / D, along (-X, Y) by (s X^2 + g X Y) / D."""
    found = figures(fitted, "230-6", fitted / "fit")
    x, y = travel["X"], travel["Y"]
    length = np.hypot(x, y)
    assert close(found["+X+Y.E"], abs(SCALE * x**2 - SQUARE * x * y) / length)
    assert close(found["-X+Y.E"], abs(SCALE * x**2 + SQUARE * x * y) / length)
    assert found["+X+Y.E"]["length"] == pytest.approx(length)
    largest = max(found[f"{n}.E"]["value"] for n in ("+X+Y+Z", "+X-Y+Z", "-X+Y+Z", "-X-Y+Z"))
    assert found["E body"]["value"] == pytest.approx(largest)


def test_a_circle_of_a_fit(fitted: Path) -> None:
    """Scale s and squareness g: radial ``r (s cos^2 - g sin cos)``, an ellipse of width r hypot(s, g)."""
    out = iso("230-4", fitted / "fit")
    data = out.evaluations[0].data["XY"]
    found = {q.name: q for q in out.evaluations[0].quantities}
    assert found["XY.G(b)"].value == pytest.approx(data["radius"] * np.hypot(SCALE, SQUARE), rel=0.05)
    assert found["XY.D"].value == pytest.approx(data["radius"] * SCALE / 2, rel=0.1)


def test_lengths_of_a_fit_are_read_short_by_the_scale(fitted: Path) -> None:
    """The machine goes too far: what it reads is less than what it went."""
    found = figures(fitted, "10360-2", fitted / "fit")
    along = [q for name, q in found.items() if name.startswith("X ")]
    assert len(found) == 35
    assert len(along) == 5
    for q in along:
        assert close(q, -SCALE * q["length"])


def test_the_volume_of_a_fit(fitted: Path, travel: dict[str, float]) -> None:
    """Scale s and squareness g in a box: the best rotation takes the share Y^2 / (X^2 + Y^2) of g."""
    found = figures(fitted, "volume", fitted / "fit")
    x, y = travel["X"], travel["Y"]
    turned = SQUARE * y**2 / (x**2 + y**2)
    left, up = SCALE * x + (SQUARE - turned) * y, turned * x  # ranges in x and y
    assert found["VX"]["value"] == pytest.approx(left, rel=0.05)  # poses are random within the box
    assert found["VY"]["value"] == pytest.approx(up, rel=0.05)
    assert found["volume"]["value"] == pytest.approx(np.hypot(left, up) / 2, rel=0.05)  # at a corner
    assert found["volume 95 %"]["value"] < found["volume"]["value"]


def rows_on_lines() -> pd.DataFrame:
    """Two runs along X and Y, both ways, and two body diagonals."""
    steps = [-1.0, -0.55, -0.2, 0.1, 0.65, 1.0]
    there_and_back = [*steps, *steps[::-1]]
    rows = []
    for run_of in range(3):
        rows += [{"X": 300 * x, "Y": 0.0, "Z": 300.0, "run": f"x{run_of}"} for x in there_and_back]
        rows += [{"X": 10.0, "Y": 180 * y, "Z": 310.0, "run": f"y{run_of}"} for y in there_and_back]
    for sign in (1, -1):
        rows += [{"X": 300 * s, "Y": sign * 150 * s, "Z": 375 + 200 * s, "run": f"d{sign}"} for s in there_and_back]
    return pd.DataFrame(rows)


@pytest.fixture(scope="module")
def lines() -> pd.DataFrame:
    """The same machine seen by a tracker that stands anywhere, with a declared noise of 0.2 um."""
    where = {"translation": (900.0, -400.0, 300.0), "rotation": (0.0, 0.0, 40.0)}
    table = simulate(MILL, rows_on_lines(), TRUTH, noise=2e-4, seed=3, **where)  # type: ignore[arg-type]
    return table[["X", "Y", "Z", "run", "mx", "my", "mz"]].assign(sigma=2e-4)


def test_lines_of_a_survey(lines: pd.DataFrame) -> None:
    result = iso("230-2,230-1,230-6", MILL, lines)
    found = {q.name: q.as_json() for e in result.evaluations for q in e.quantities}
    at_x, at_y = "X (Y 0, Z 300)", "Y (X 10, Z 310)"
    assert close(found[f"{at_x}.E"], SCALE * 600)
    assert found[f"{at_x}.B"]["value"] < 1e-3
    assert found[f"{at_x}.R"]["value"] < 3e-3
    assert found[f"{at_y}.E"]["value"] < 1e-3
    assert close(found["EC(0X)Y"], SQUARE)
    assert found[f"{at_x}.EYX"]["value"] < 1e-3
    length = np.sqrt(600**2 + 300**2 + 400**2)
    for name, sign in (("+X+Y+Z", 1), ("+X-Y+Z", -1)):
        expected = abs(SCALE * 600**2 - sign * SQUARE * 600 * 300) / length
        assert close(found[f"{name}.E"], expected), name
        assert found[f"{name}.E"]["length"] == pytest.approx(length)
    assert sum(name.endswith("Z.E") for name in found) == 2


def test_a_circle_of_a_survey() -> None:
    angle = np.radians(np.arange(0.0, 361.0, 4.0))
    commands = pd.DataFrame({"X": 100 * np.cos(a), "Y": 100 * np.sin(a), "Z": 300.0} for a in (*angle, *angle[::-1]))
    table = simulate(MILL, commands, TRUTH, noise=2e-4, seed=5)[["X", "Y", "Z", "mx", "my"]].assign(sigma=2e-4)
    result = iso("230-4", MILL, table)
    found = {q.name: q for q in result.evaluations[0].quantities}
    # the frame is free: its rotation takes half of the squareness, which leaves the ellipse as it is
    assert found["XY.G(b)"].value == pytest.approx(100 * np.hypot(SCALE, SQUARE), abs=1.2e-3)  # six sigma of noise
    assert found["XY.D"].value == pytest.approx(100 * SCALE / 2, abs=1e-4)


def test_a_rotary_axis_is_evaluated_in_angles() -> None:
    """Eccentricity of 20 urad and a play of 20 urad, by hand; three runs that differ by 1 urad (s = 1 urad)."""
    rows = [
        {"joint": "C", "C": c, "ec": 2e-5 * np.sin(np.radians(c)) + 1e-5 * side + 1e-6 * n, "u_ec": 1e-6, "run": str(n)}
        for n in range(3)
        for side in (1, -1)
        for c in np.arange(0.0, 361.0, 45.0)[::side]
    ]
    result = iso("230-2", TRUNNION, pd.DataFrame(rows), tolerance={"C.A": "15 arcsec", "C.B": "3 arcsec"})
    found = {q.symbol: q for q in result.evaluations[0].quantities}
    for symbol, value in {"E": 60e-6, "M": 40e-6, "B": 20e-6, "R↑": 4e-6, "R": 24e-6, "A": 64e-6}.items():
        assert found[symbol].value == pytest.approx(value, rel=1e-9), symbol
        assert found[symbol].unit == "rad"
    assert [(j.quantity.name, j.verdict) for j in result.conformity.judgements] == [("C.A", "passes"), ("C.B", "fails")]


def test_sides_from_zeros_of_their_own_do_not_compare(tmp_path: Path) -> None:
    """Each pass a run: what lies between the sides is that of the zeros, and no figure may contain it."""
    rng = np.random.default_rng(4)
    x = np.array([0.0, 90.0, 210.0, 305.0, 400.0])
    rows = [
        {
            "joint": "X",
            "X": q,
            "dx": 1e-5 * q + 3e-3 * side + zero,
            "dir_X": side,
            "run": f"{n}{side:+d}",
            "pair": str(n),
        }
        for n in range(5)
        for side in (1, -1)
        for zero in [2e-3 * rng.normal()]
        for q in x[::side]
    ]
    table = pd.DataFrame(rows)
    result = iso("230-2", CMM, table.drop(columns="pair"), tolerance={"B": "50 um", "M": "9 um"}, decision="simple")
    found = {q.symbol: q for q in result.evaluations[0].quantities}
    for symbol in ("A", "E", "R", "B", "B mean"):
        assert np.isnan(found[symbol].value)
        assert found[symbol].as_json()["basis"].startswith("each run goes one way only and has a zero of its own")
    assert found["E↑"].value == found["E↓"].value == found["M"].value == pytest.approx(4e-3)
    assert [(j.quantity.symbol, j.verdict) for j in result.conformity.judgements] == [
        ("M", "passes"), ("B", "cannot be decided"),
    ]  # fmt: skip
    assert any("frame: fixed where one zero held for all runs" in note for note in result.notes)
    result.save(tmp_path / "out")
    written = json.loads((tmp_path / "out/evaluation.json").read_text())["standards"][0]["quantities"]
    assert {q["symbol"] for q in written if q["value"] is None} == {"A", "E", "R", "B", "B mean"}
    page = (tmp_path / "out/certificate.html").read_text()
    assert "Not determined: X.A, X.E, X.R, X.B, X.B mean (each run goes one way only" in page
    assert result.summary().count("not determined  ") == 5
    assert len(result.evaluations[0].sheets[0].head) == 6  # target, mean and s of both sides, their mean: no B, no R
    paired = iso("230-2", CMM, table.drop(columns="run").rename(columns={"pair": "run"}))
    assert {q.symbol: q.value for q in paired.evaluations[0].quantities}["B"] == pytest.approx(6e-3, abs=4e-3)
    table.drop(columns="pair").to_csv(tmp_path / "t.csv", index=False)
    write(tmp_path / "s.yaml", "errormodel: 1\nfiles: [{path: t.csv}]\nframe: fixed\n")
    assert np.isfinite([q.value for q in iso("230-2", CMM, tmp_path / "s.yaml").evaluations[0].quantities]).all()


def test_drift_over_the_time(tmp_path: Path) -> None:
    time = np.arange(0.0, 3 * 3600.0 + 1, 300.0)
    dz = 0.012 * (1 - np.exp(-time / 3000))
    table = pd.DataFrame({"X": 0.0, "Y": 0.0, "Z": 300.0, "time": time, "mx": 0.0, "my": 0.0, "mz": 200.0 + dz})
    table["T_spindle"] = 20 + 500 * dz
    table.to_csv(tmp_path / "d.csv", index=False)
    survey = write(tmp_path / "d.yaml", "errormodel: 1\nfiles: [{path: d.csv}]\nframe: fixed\n")
    found = figures(tmp_path, "230-3", MILL, survey)
    assert found["dz"]["value"] == pytest.approx(np.ptp(dz))
    assert found["dz first hour"]["value"] == pytest.approx(np.ptp(dz[time <= 3600]))
    assert found["dz last hour"]["value"] == pytest.approx(np.ptp(dz[time >= 2 * 3600]))
    assert found["dx"]["value"] == 0.0


def test_a_drift_along_the_axes_of_a_turning_workpiece_says_so(tmp_path: Path) -> None:
    joints = {j.name: 0.0 for j in read_machine(TRUNNION).joints}
    time = np.arange(0.0, 7200.0, 300.0)
    points = {"mx": 0.0, "my": 0.0, "mz": 200.0}
    standing = pd.DataFrame({**joints, "time": time, **points})
    turned = standing.assign(C=np.where(np.arange(len(time)) % 2, 90.0, 0.0))
    for table, said in ((standing, False), (turned, True)):
        table.to_csv(tmp_path / "d.csv", index=False)
        survey = write(tmp_path / "d.yaml", "errormodel: 1\nfiles: [{path: d.csv}]\nframe: fixed\n")
        notes = iso("230-3", TRUNNION, survey).evaluations[0].notes
        assert any("along the workpiece's axes, which C turns" in n for n in notes) == said


def test_a_rotary_axis_in_a_survey_and_in_the_fit_are_one(tmp_path: Path) -> None:
    """C turns and X, Y follow: rows of a perfect instrument give what the fitted model gives on the same path."""
    truth = {"C.dz.cos1": 0.006, "C.dx.sin2": 0.004, "C.ec.sin1": 3e-5}
    simulate(TRUNNION, 320, truth, noise=1e-5, seed=2).to_csv(tmp_path / "s.csv", index=False)
    done("fit", TRUNNION, tmp_path / "s.csv", "--out", tmp_path / "fit")
    model = iso("10791-6", tmp_path / "fit").evaluations[0]
    data = model.data["C"]
    turn = np.radians(np.array(data["q"]))
    # the table's own C moves the point: the linear axes have to turn the other way
    machine = read_machine(TRUNNION)
    radius = data["radius"]
    path = pd.DataFrame(
        {"C": np.degrees(turn), "A": 0.0, "X": radius * np.cos(turn), "Y": -radius * np.sin(turn), "Z": 300.0}
    )
    table = simulate(machine, path, truth, noise=0.0)[["C", "A", "X", "Y", "Z", "mx", "my", "mz"]]
    table.to_csv(tmp_path / "r.csv", index=False)
    survey = write(tmp_path / "r.yaml", "errormodel: 1\nfiles: [{path: r.csv}]\nframe: fixed\n")
    found = {q.name: q.value for q in iso("10791-6", machine, survey).evaluations[0].quantities}
    assert set(found) == {"C.axial", "C.radial", "C.tangential"}
    assert found["C.axial"] == pytest.approx(0.012, rel=0.01)  # cos over a whole turn has the range 2
    fit = {q.name: q for q in model.quantities}
    assert fit["C.axial"].value == pytest.approx(0.012, rel=0.1)  # at another A
    assert fit["C.axial"].expanded is not None


@pytest.mark.long
def test_uncertainties_of_a_fit_cover_the_truth() -> None:
    """E of X in 25 simulated surveys: inside U (k = 2) in all but a few."""
    inside = 0
    for seed in range(25):
        survey = simulate(MILL, 40, TRUTH, noise=2e-3, seed=seed)
        from identification import fit

        q = next(q for q in _of(fit(MILL, survey)) if q.name == "X.E")
        reach = float(np.ptp(survey["X"]))
        assert q.expanded is not None
        inside += abs(q.value - SCALE * reach) <= q.expanded
    assert inside >= 20  # of 25 at 95 %, fewer than 20 come once in 800 such tests


def _of(result: Any, standard: str = "230-2") -> Any:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        return iso(standard, result.save(Path(folder) / "fit")).evaluations[0].quantities


def test_what_a_survey_of_lines_does_not_identify_is_in_the_uncertainty_of_diagonals(fitted: Path) -> None:
    """Three lines say nothing of the angles that act on the diagonals: pitch and yaw of X and Y."""
    middle = {"X": 0.0, "Y": 0.0, "Z": 375.0}
    ends = {"X": 370.0, "Y": 200.0, "Z": 250.0}
    rows = [middle | {j: middle[j] + s * ends[j]} for j in ends for s in np.linspace(-1, 1, 15)]
    survey = simulate(MILL, pd.DataFrame(rows), TRUTH | {"Y.ec.1": 4e-5}, noise=1e-4, seed=1)
    from identification import fit

    lines = _of(fit(MILL, survey[["X", "Y", "Z", "mx", "my", "mz"]]), "230-6")
    volume = figures(fitted, "230-6", fitted / "fit")
    sure = volume["+X+Y+Z.E"]["expanded_uncertainty"]
    (diagonal,) = (q for q in lines if q.name == "+X+Y+Z.E")
    assert diagonal.expanded > 10 * sure


def test_all_that_a_source_allows(fitted: Path) -> None:
    result = iso("all", fitted / "fit")
    assert {e.number for e in result.evaluations} == set(standards()) - {"10791-6", "230-3"}
    assert result.verdict is None


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["230-9", "fit"], "Did you mean '230-6'"),
        (["230-2"], "DIR, or MACHINE and SURVEY, is missing"),
        (["230-3", "fit"], "evaluated from measured rows"),
        (["volume", MILL, "s.csv"], "evaluated from a fitted model"),
        (["230-4", MILL, "s.csv"], "no rows lie on a circle"),
        (["10791-6", "fit"], "no rotary joint"),
        (["230-2", MILL], "no folder of a fit"),
        (["230-2", "fit", "--tolerance", "X.E"], "a limit with its unit"),
        (["230-2", "fit", "--tolerance", "X.E=8"], "with its unit"),
        (["230-2", "fit", "--tolerance", "X.Q=8 um"], "no quantity of this evaluation"),
        (["230-2", "fit", "--tolerance", "X.E=8 arcsec"], "in a unit of that kind"),
        (["230-2", "fit", "--tolerance", "X.E=8 um", "--decision", "coin"], "guard-band"),
        (["230-2", "fit", "--out", "fit"], "errormodel fit"),
    ],
)
def test_wrong_words_end_with_one_message(
    words: list[str], said: str, fitted: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(fitted)
    before = tree(fitted)
    ended = run("iso", *words, *([] if "--out" in words else ["--out", "no"]))
    assert ended.code == 2
    assert said in ended.err, ended.err
    assert ended.err.count("error:") == 1
    assert tree(fitted) == before


def test_series_are_found_once_for_their_doubts_and_all_standards(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    found = series._of_points
    monkeypatch.setattr(series, "_of_points", lambda *of: asked.append(of) or found(*of))
    table = pd.DataFrame({"X": np.tile(np.linspace(0.0, 300.0, 7), 4), "Y": 0.0, "Z": 0.0})
    iso("all", MILL, simulate(MILL, table, noise=0.001, seed=1))
    assert len(asked) == 1
    iso("230-2", MILL, simulate(MILL, table, noise=0.001, seed=2))  # another survey
    assert len(asked) == 2
