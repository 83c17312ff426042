"""Raw lists of lengths and angles with an NC programme: joined, mapped, proved, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import InputError, read_machine, read_survey
from identification import fit, import_survey, iso
from tests.helpers.commands import run
from tests.helpers.importing import MILL, poses, programme
from tests.helpers.lengths import standardised, tips, truth
from tests.helpers.nightly import first_of

MACHINE = read_machine(MILL)
TRUE = truth(MACHINE, np.random.default_rng(4))
PLACES = {"A": [900.0, -700.0, -200.0], "B": [-900.0, -600.0, -100.0], "C": [100.0, 1100.0, 0.0]}
STATION = "station-distance"
ROWS = 40
NOISE = 3e-4  # mm


def listed(folder: Path, name: str, lengths: np.ndarray, head: str = "No;Length [mm]") -> Path:
    """A list as the programs of interferometers export it: a number, a length."""
    rows = "".join(f"{k};{v:.5f}\n" for k, v in enumerate(lengths, start=1))
    (folder / name).write_text(f"Tracking interferometer\n{head}\n{rows}")
    return folder / name


@pytest.fixture(scope="module")
def lengths() -> dict[str, np.ndarray]:
    """Lengths from each place, which lack 137 mm of the distance."""
    rng = np.random.default_rng(6)
    at = tips(MACHINE, TRUE, poses(5, ROWS))
    return {k: np.linalg.norm(at - p, axis=1) - 137.0 + rng.normal(0, NOISE, ROWS) for k, p in PLACES.items()}


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    (tmp_path / "survey.nc").write_text(programme(poses(5, ROWS)))
    return tmp_path / "survey.nc"


def test_lists_from_three_places_and_a_programme_become_a_fit(
    lengths: dict[str, np.ndarray], plan: Path, tmp_path: Path
) -> None:
    files = [listed(tmp_path, f"{k}.txt", own) for k, own in lengths.items()]
    result = import_survey(files, MILL, commands=plan, observation=STATION)
    result.save(tmp_path / "s")
    survey = read_survey(tmp_path / "s", MACHINE)
    table = survey.table
    assert [*survey.observations] == ["A", "B", "C"]
    np.testing.assert_allclose(table["length"], np.concatenate([*lengths.values()]), atol=5.1e-6)  # as printed
    np.testing.assert_allclose(table[["X", "Y", "Z"]], np.tile(poses(5, ROWS), (3, 1)), atol=1e-9)
    assert {"dir_X", "feed"} <= {*table}
    for name, data in zip(("A", "B", "C"), files, strict=True):
        assert (tmp_path / f"s/raw/{name}.txt").read_bytes() == data.read_bytes()
    said = result.summary()
    assert said.count(f"joined {ROWS} of {ROWS} readings with {ROWS} commands by order") == 3
    assert "set-up of A, roughly (mm, rad): x 900" in said
    assert "no shift of the readings, no other order, unit or sign fits better" in said
    assert (tmp_path / "s/join.png").stat().st_size > 1000
    errors = standardised(fit(MACHINE, survey).fit, TRUE | set_ups())
    assert np.sqrt(np.mean(np.square([*errors.values()]))) < 1.6  # 36 correlated ones about 1; a wrong row gives 100


def set_ups() -> dict[str, float]:
    known = {f"observation[{k}].{a}": v for k, p in PLACES.items() for a, v in zip("xyz", p, strict=True)}
    return known | {f"observation[{k}].dead_path": 137.0 for k in PLACES}


@pytest.mark.long
def test_one_column_of_all_passes_asks_whether_the_instrument_was_moved(
    lengths: dict[str, np.ndarray], plan: Path, tmp_path: Path
) -> None:
    every = np.concatenate([*lengths.values()])
    (tmp_path / "all.txt").write_text("".join(f"{v:.5f}\n" for v in every))
    words = "station: per-run, dead_path: per-run"
    with pytest.raises(InputError, match=f"a set-up of its own for each pass fits.*--observation '{STATION}, {words}'"):
        import_survey(tmp_path / "all.txt", MILL, commands=plan, observation=STATION)
    result = import_survey(tmp_path / "all.txt", MILL, commands=plan, observation=f"{STATION}, {words}")
    assert result.survey.table["run"].tolist() == [str(k + 1) for k in range(3) for _ in range(ROWS)]
    np.testing.assert_allclose(result.survey.table["length"], every, atol=5.1e-6)


def test_a_column_may_say_from_which_place(lengths: dict[str, np.ndarray], plan: Path, tmp_path: Path) -> None:
    rows = "".join(f"{k},{v:.5f}\n" for k, own in lengths.items() for v in own)
    (tmp_path / "all.csv").write_text("Station,Distance [mm]\n" + rows)
    result = import_survey(tmp_path / "all.csv", MILL, commands=plan, observation=STATION)
    assert [*result.survey.observations] == ["A", "B", "C"]
    np.testing.assert_allclose(result.survey.table["length"], np.concatenate([*lengths.values()]), atol=5.1e-6)


GAUGE = pd.DataFrame({"X": np.arange(-150, 151, 30.0), "Y": 0.0, "Z": 300.0})


@pytest.mark.parametrize(
    ("what", "how", "start"),
    [
        ("from the first", "from the first command", [0] * 10),
        ("with the zero", "from the first command, where the first reading is of", [0] * 10),
        ("steps", "from the command before", [*range(10)]),
        ("three passes", "from the first command, 3 passes", [0] * 30),
    ],
)
def test_a_step_gauge_says_itself_from_where_it_counts(what: str, how: str, start: list[int], tmp_path: Path) -> None:
    at = tips(MACHINE, TRUE, GAUGE)
    from_first = np.linalg.norm(at - at[0], axis=1)
    steps = np.linalg.norm(np.diff(at, axis=0), axis=1) * 1.0
    values = {
        "from the first": from_first[1:], "with the zero": from_first, "steps": steps,
        "three passes": np.tile(from_first[1:], 3),
    }[what]  # fmt: skip
    (tmp_path / "gauge.nc").write_text(programme(GAUGE))
    file = listed(tmp_path, "gauge.txt", values)
    result = import_survey(file, MILL, commands=tmp_path / "gauge.nc", observation="pose-distance")
    assert f"by order, {how}\n" in result.summary()
    table = result.survey.table
    np.testing.assert_array_equal(table["from_X"], GAUGE["X"].to_numpy()[start])
    assert "not measured" not in result.summary()
    nominal = np.abs(table["X"] - table["from_X"])
    np.testing.assert_allclose(table["length"], nominal, atol=0.1)  # errors of a machine


@pytest.mark.parametrize("match", ["auto", "order"])
def test_a_plan_with_both_poses_in_each_row_says_from_where_lengths_count(match: str, tmp_path: Path) -> None:
    """Lengths from one end of a gauge would fit the first command as well, were it not for the poses in the plan."""
    first = GAUGE.iloc[0]
    plan = GAUGE.iloc[1:].assign(from_X=first["X"], from_Y=first["Y"], from_Z=first["Z"])
    at = tips(MACHINE, TRUE, GAUGE)
    plan.to_csv(tmp_path / "plan.csv", index=False)
    data = listed(tmp_path, "gauge.txt", np.linalg.norm(at[1:] - at[0], axis=1))
    result = import_survey(data, MILL, commands=tmp_path / "plan.csv", match=match, observation="pose-distance")
    table = result.survey.table
    assert len(table) == len(plan)
    np.testing.assert_allclose(table["X"], plan["X"])
    assert (table["from_X"] == first["X"]).all()
    assert "as the commands have both poses" in result.summary()


def test_a_ball_bar_is_two_commands_a_reading(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    middle, way = rng.uniform([-150, -100, 250], [150, 100, 400], (8, 3)), rng.normal(size=(8, 3))
    way *= 100 / np.linalg.norm(way, axis=1)[:, None]
    both = np.stack([middle - way, middle + way], axis=1).reshape(-1, 3).round(3)
    commands = pd.DataFrame(both, columns=["X", "Y", "Z"])
    (tmp_path / "bar.nc").write_text(programme(commands))
    at = tips(MACHINE, TRUE, commands)
    file = listed(tmp_path, "bar.txt", np.linalg.norm(at[1::2] - at[::2], axis=1))
    table = import_survey(file, MILL, commands=tmp_path / "bar.nc", observation="pose-distance").survey.table
    np.testing.assert_allclose(table[["from_X", "from_Y", "from_Z"]], both[::2], atol=1e-9)
    np.testing.assert_allclose(table[["X", "Y", "Z"]], both[1::2], atol=1e-9)


def test_deviations_of_a_ballbar_at_standing_poses_and_their_unit(tmp_path: Path) -> None:
    angle = np.radians(np.arange(0, 360, 15))
    circle = pd.DataFrame({"X": 100 * np.cos(angle), "Y": 100 * np.sin(angle), "Z": 300.0}).round(4)
    (tmp_path / "circle.nc").write_text(programme(circle))
    at = tips(MACHINE, TRUE, circle)
    um = 1e3 * (np.linalg.norm(at - at.mean(axis=0), axis=1) - 100)
    (tmp_path / "um.txt").write_text("Deviation [um]\n" + "".join(f"{v:.2f}\n" for v in um))
    (tmp_path / "bare.txt").write_text("".join(f"{v:.2f}\n" for v in um))
    where = {"commands": tmp_path / "circle.nc", "observation": "ballbar-circle, calibrated: 100"}
    result = import_survey(tmp_path / "um.txt", MILL, **where)  # type: ignore[arg-type]
    np.testing.assert_allclose(result.survey.table["length"], um / 1e3, atol=6e-6)
    with pytest.raises(InputError, match=r"in um they fit.*--units length=um"):
        import_survey(tmp_path / "bare.txt", MILL, **where)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("change", "says"),
    first_of(
        [
            ("shifted", "taken 1 row (earlier|later) they fit"),
            ("exchanged", "the lengths of rows 11 and 31 are exchanged"),
            ("inches", "in inch they fit.*--units length=inch"),
            ("sign", "with the other sign they fit"),
            ("every second", f"{ROWS // 2} readings and {ROWS} commands"),
            ("another plan", "fit a station nowhere|lie .* off their commands"),
        ],
        2,
    ),
)
def test_a_wrong_join_of_lengths_is_refused_with_what_fits(
    change: str, says: str, lengths: dict[str, np.ndarray], plan: Path, tmp_path: Path
) -> None:
    own = lengths["A"].copy()
    if change == "exchanged":
        own[[10, 30]] = own[[30, 10]]
    values = {
        "shifted": np.roll(own, 1), "inches": own / 25.4, "sign": -own, "every second": own[::2],
        "another plan": np.random.default_rng(3).permutation(own),
    }.get(change, own)  # fmt: skip
    file = listed(tmp_path, "A.txt", values, "No;Length")
    with pytest.raises(InputError, match=says):
        import_survey(file, MILL, commands=plan, observation=STATION)


@pytest.mark.parametrize(("kept", "says"), [(slice(0, 25), "the first 25"), (slice(8, None), f"the last {ROWS - 8}")])
def test_a_list_that_was_broken_off_has_the_first_commands_or_the_last(
    kept: slice, says: str, lengths: dict[str, np.ndarray], plan: Path, tmp_path: Path
) -> None:
    file = listed(tmp_path, "A.txt", lengths["A"][kept], "No;Length")
    result = import_survey(file, MILL, commands=plan, observation=STATION)
    assert f"by order, {says} commands" in result.summary()
    every = np.arange(ROWS)[kept]
    (pairs,) = [p for p in result.imported.pairs if p is not None]
    np.testing.assert_array_equal(pairs.command, every)


@pytest.mark.long
@pytest.mark.parametrize("gone", [[0], [17], [3, 30]])
def test_readings_that_are_missing_are_found(
    gone: list[int], lengths: dict[str, np.ndarray], plan: Path, tmp_path: Path
) -> None:
    file = listed(tmp_path, "A.txt", np.delete(lengths["A"], gone), "Count;Length [mm]")
    result = import_survey(file, MILL, commands=plan, observation=STATION)
    np.testing.assert_allclose(result.survey.table["X"], np.delete(poses(5, ROWS)["X"].to_numpy(), gone), atol=1e-9)
    assert f"not measured: {len(gone)} command" in result.summary()


def test_a_lost_beam_is_told_where_a_run_can_be_given(
    lengths: dict[str, np.ndarray], plan: Path, tmp_path: Path
) -> None:
    """The import takes it in, since its order is right; the run is a column of the pairs, no edit of the raw file."""
    own = lengths["A"] + np.where(np.arange(ROWS) >= 25, 0.5, 0.0)
    result = import_survey(listed(tmp_path, "A.txt", own), MILL, commands=plan, observation=STATION)
    assert "from reading 26 of 40 on 0.5" in result.summary()
    assert "a column run of pairs.csv" in result.summary()
    result.save(tmp_path / "s")
    pairs = pd.read_csv(tmp_path / "s/pairs.csv")
    pairs.assign(run=np.where(np.arange(ROWS) >= 25, 2, 1)).to_csv(tmp_path / "s/pairs.csv", index=False)
    assert read_survey(tmp_path / "s", MACHINE).table["run"].tolist() == ["1"] * 25 + ["2"] * 15


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "of single readings --observation, one of ballbar-circle, line-angle"),
        (["--observation", "station-distanc"], "Did you mean 'station-distance'?"),
        (["--observation", "line-straightness"], "the key 'along' is missing"),
        (["--observation", "station-distance, dead_path: often"], "dead_path"),
        (["--observation", "line-angle, axis: [0, 1, 0]"], "the unit 'mm'"),
        (["--observation", STATION, "--match", "nearest"], "no place of their own"),
    ],
)
def test_what_single_readings_are_is_asked_for(
    words: list[str], says: str, lengths: dict[str, np.ndarray], plan: Path, tmp_path: Path
) -> None:
    file = listed(tmp_path, "A.txt", lengths["A"])
    result = run("import", file, "--machine", MILL, "--commands", plan, *words, "--out", tmp_path / "s")
    assert result.code == 2
    assert says in result.err
    assert "Traceback" not in result.err
    assert not (tmp_path / "s").exists()


def test_angles_need_a_unit(plan: Path, tmp_path: Path) -> None:
    """Angles of an autocollimator are seldom in the unit of the joints."""
    values = 3 + np.random.default_rng(0).normal(0, 1.0, ROWS)
    file = listed(tmp_path, "pitch.txt", values, "No;Angle")
    where = {"commands": plan, "observation": "line-angle, axis: [0, 1, 0]"}
    with pytest.raises(InputError, match="angles without a unit"):
        import_survey(file, MILL, **where)  # type: ignore[arg-type]
    table = import_survey(file, MILL, units={"angle": "arcsec"}, **where).survey.table  # type: ignore[arg-type]
    np.testing.assert_allclose(table["angle"], np.radians(values.round(5) / 3600), rtol=1e-12)


BESIDE = {"length:A": "Laser 1", "length:B": "Laser 2", "length:C": "Laser 3"}


def side_by_side(lengths: dict[str, np.ndarray], folder: Path, unit: str = "mm", factor: float = 1.0) -> Path:
    """Lengths of three interferometers that read one target together: a row a pose."""
    table = pd.DataFrame({f"Laser {k} [{unit}]": factor * own for k, own in enumerate(lengths.values(), start=1)})
    table.to_csv(folder / "wide.csv", index_label="No", sep=";")
    return folder / "wide.csv"


@pytest.mark.long
@pytest.mark.parametrize(("unit", "factor"), [("mm", 1.0), ("m", 1e-3)])
def test_readings_of_several_instruments_side_by_side(
    lengths: dict[str, np.ndarray], plan: Path, tmp_path: Path, unit: str, factor: float
) -> None:
    wide = side_by_side(lengths, tmp_path, unit, factor)
    with pytest.raises(InputError, match="no column of a single length among") as error:
        import_survey(wide, MILL, commands=plan, observation=STATION)
    assert "'length:A=Laser 1,length:B=Laser 2'" in error.value.cure
    near = f"B={STATION}, near: {PLACES['B']}"
    result = import_survey(wide, MILL, commands=plan, observation=[STATION, near], columns=BESIDE)
    result.save(tmp_path / "s")
    survey = read_survey(tmp_path / "s", MACHINE)
    np.testing.assert_allclose(survey.table["length"], np.concatenate([*lengths.values()]), atol=1e-9)
    np.testing.assert_allclose(survey.table[["X", "Y", "Z"]], np.tile(poses(5, ROWS), (3, 1)), atol=1e-9)
    stated = {k: o.model_dump(exclude_defaults=True).get("near") for k, o in survey.observations.items()}
    assert stated == {"A": None, "B": PLACES["B"], "C": None}
    errors = standardised(fit(MACHINE, survey).fit, TRUE | set_ups())
    assert np.sqrt(np.mean(np.square([*errors.values()]))) < 1.6  # as of one list an instrument


@pytest.mark.parametrize(
    ("said", "words"),
    [
        (["A=station-distance", "A=station-distance"], "A twice"),
        (["A=station-distance", "line-angle, axis: [0, 0, 1]"], "several types"),
        (["A=station-distance"], "nothing of 'B'"),
        ([STATION, "D=station-distance"], "'D', which is read nowhere"),
    ],
)
def test_observations_by_label_are_each_of_something(
    lengths: dict[str, np.ndarray], plan: Path, tmp_path: Path, said: list[str], words: str
) -> None:
    wide = side_by_side(lengths, tmp_path)
    with pytest.raises(InputError, match=words):
        import_survey(wide, MILL, commands=plan, observation=said, columns=BESIDE)


def test_readings_of_two_kinds_side_by_side_are_refused(
    lengths: dict[str, np.ndarray], plan: Path, tmp_path: Path
) -> None:
    wide = side_by_side(lengths, tmp_path)
    with pytest.raises(InputError, match="name readings of one kind"):
        import_survey(wide, MILL, commands=plan, observation=STATION, columns={**BESIDE, "length": "No"})


def diagonals(folder: Path) -> tuple[Path, Path, np.ndarray]:
    """Two body diagonals there and back, a run each, as a displacement interferometer along each reads them."""
    share = np.concatenate([np.linspace(0, 1, 11), np.linspace(0, 1, 11)[::-1]])[:, None]
    corner, way = np.array([-250.0, -150.0, 100.0]), np.array([500.0, 300.0, 400.0])
    lines = [corner + share * way, corner + [500, 0, 0] + share * way * [-1, 1, 1]]
    commands = pd.DataFrame(np.vstack(lines), columns=[*"XYZ"])
    commands.to_csv(folder / "plan.csv", index=False)
    lengths = []
    for line in lines:
        at = tips(MACHINE, TRUE, pd.DataFrame(line, columns=[*"XYZ"]))
        unit = (line[10] - line[0]) / np.linalg.norm(line[10] - line[0])
        lengths.append((at - at[0]) @ unit)
    table = pd.DataFrame({"Run": np.repeat([1, 2], 22), "Length [mm]": np.concatenate(lengths).round(5)})
    table.to_csv(folder / "d.csv", index=False)
    return folder / "d.csv", folder / "plan.csv", np.concatenate(lengths)


def test_displacements_along_diagonals_are_taken_in(tmp_path: Path) -> None:
    data, plan, lengths = diagonals(tmp_path)
    by_run = "station-distance, station: per-run, dead_path: per-run"
    result = import_survey(data, MILL, commands=plan, observation=by_run)
    assert "where the instrument stood does not show" in result.summary()
    result.save(tmp_path / "s")
    survey = read_survey(tmp_path / "s", MACHINE)
    np.testing.assert_allclose(survey.table["length"], lengths, atol=5.1e-6)
    assert [*survey.table["run"]] == ["1"] * 22 + ["2"] * 22
    assert {"+X+Y+Z.E", "-X+Y+Z.E"} <= {*iso("230-6", MILL, tmp_path / "s").figures["name"]}
    with pytest.raises(InputError, match=r"points on a straight line.*Write near:"):
        fit(MILL, tmp_path / "s")
    with pytest.raises(InputError, match="a set-up of its own for each pass fits"):
        import_survey(data, MILL, commands=plan, observation="station-distance")


def test_a_unit_is_named_only_where_readings_fit_in_it(tmp_path: Path) -> None:
    """An offset that is known stays where it is, and a file's own unit is where another is counted from."""
    data, plan, lengths = diagonals(tmp_path)
    with pytest.raises(InputError, match="off their commands") as error:
        import_survey(data, MILL, commands=plan, observation="pose-distance")
    assert "--units" not in str(error.value)
    pd.DataFrame({"Run": np.repeat([1, 2], 22), "Length [um]": lengths.round(5)}).to_csv(data, index=False)
    by_run = "station-distance, station: per-run, dead_path: per-run"
    with pytest.raises(InputError, match=r"in mm they fit.*--units length=mm"):
        import_survey(data, MILL, commands=plan, observation=by_run)
