"""Raw files into a survey: joined with their commands, mapped, proved; a wrong join is refused."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import InputError, read_machine, read_survey, simulate
from identification import fit, import_survey
from identification.importing.matching import plain_name
from identification.importing.nearest import find_pairing
from tests.helpers import importing
from tests.helpers.commands import done as finished
from tests.helpers.commands import run
from tests.helpers.importing import CLOCK, MILL, NOISE, ROWS, points, poses, programme, spatialanalyzer

COMMANDS = poses()


def done(*words: object) -> str:
    """What a command prints that must succeed."""
    return finished(*words).out


def refused(*words: object) -> str:
    """The one message of a command that must end with exit code 2."""
    result = run(*words)
    assert result.code == 2, result.out
    assert "Traceback" not in result.err
    return result.err


MEASURED = points(COMMANDS)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "tracker.txt").write_text(spatialanalyzer(MEASURED))
    (tmp_path / "other.txt").write_text(spatialanalyzer(MEASURED))
    (tmp_path / "survey.nc").write_text(programme(COMMANDS))
    named = COMMANDS.copy()
    named.insert(0, "name", [f"p{k}" for k in range(1, ROWS + 1)])
    named.to_csv(tmp_path / "plan.csv", index=False)
    return tmp_path


def test_a_tracker_file_and_a_programme_become_a_survey(folder: Path) -> None:
    """Raw files stay byte for byte; the survey is what a plain table of the same data is, and so is its fit."""
    said = done(
        "import", folder / "tracker.txt", "--machine", MILL, "--commands", folder / "survey.nc", "--out", folder / "s"
    )
    assert f"joined {ROWS} of {ROWS} readings with {ROWS} commands by order" in said
    for name in ("tracker.txt", "survey.nc"):
        assert (folder / "s/raw" / name).read_bytes() == (folder / name).read_bytes()
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() in (folder / "s/survey.yaml").read_text()
    assert (folder / "s/join.png").read_bytes()[:4] == b"\x89PNG"
    assert (folder / "s/import.txt").read_text() in said
    table = COMMANDS.copy()
    table[["mx", "my", "mz"]] = MEASURED.round(6)
    table.to_csv(folder / "plain.csv", index=False)
    own, plain = (read_survey(p, read_machine(MILL)) for p in (folder / "s", folder / "plain.csv"))
    columns = ["X", "Y", "Z", "mx", "my", "mz"]
    pd.testing.assert_frame_equal(own.table[columns], plain.table[columns])
    assert set(own.table["dir_Z"]) == {-1.0}  # the programme overruns downwards
    assert set(own.table["feed"]) == {2000.0}
    np.testing.assert_allclose(
        fit(MILL, folder / "s").parameters["value"], fit(MILL, folder / "plain.csv").parameters["value"], atol=1e-12
    )
    done("verify", folder / "s")


def test_the_same_input_gives_the_same_bytes(folder: Path) -> None:
    for out in ("a", "b"):
        done(
            "import",
            folder / "tracker.txt",
            "--machine",
            MILL,
            "--commands",
            folder / "survey.nc",
            "--out",
            folder / out,
        )
    for file in sorted(p.relative_to(folder / "a") for p in (folder / "a").rglob("*") if p.is_file()):
        assert (folder / "a" / file).read_bytes() == (folder / "b" / file).read_bytes(), file


@pytest.mark.parametrize("match", ["auto", "order", "name", "nearest"])
def test_every_way_of_joining_gives_the_same(match: str, folder: Path) -> None:
    result = import_survey(folder / "tracker.txt", MILL, commands=folder / "plan.csv", match=match)  # type: ignore[arg-type]
    np.testing.assert_array_equal(result.survey.commands(["X", "Y", "Z"]), COMMANDS.to_numpy())


def test_what_is_missing_or_unnamed_finds_its_command(folder: Path) -> None:
    """Of 40 commands three were not measured, and the file is in no order: the nearest after an alignment."""
    order = np.random.default_rng(0).permutation(np.delete(np.arange(ROWS), [3, 4, 20]))
    (folder / "bare.txt").write_text("\n".join("\t".join(f"{v:.4f}" for v in MEASURED[k]) for k in order))
    result = import_survey(folder / "bare.txt", MILL, commands=folder / "survey.nc")
    np.testing.assert_array_equal(result.survey.commands(["X", "Y", "Z"]), COMMANDS.to_numpy()[order])
    # four lines above, three a pose, the last of them waits
    assert "not measured: 3 commands (line 16, 19, 67)" in result.summary()


WRONG = {
    "shifted by one row": (np.roll(MEASURED, -1, axis=0), "1 row too early in all rows", "--match nearest 40 of 40"),
    "two rows exchanged": (MEASURED[[*range(10), 11, 10, *range(12, ROWS)]], "in another order", "rows 11 to 12"),
    "other hand": (MEASURED * [1, -1, 1], "mirror image", "--columns mz=-Z"),
    "columns exchanged": (MEASURED[:, [1, 0, 2]], "mirror image", "mx=Y,my=X"),
    "inches": (MEASURED / 25.4, "in inch they fit", "--units mx=inch"),
    "metres": (MEASURED / 1e3, "in m they fit", "--units mx=m"),
    "no order": (MEASURED[np.random.default_rng(1).permutation(ROWS)], "nothing to do", "--match nearest 40 of 40"),
    "another machine": (np.random.default_rng(2).uniform(-400, 400, (ROWS, 3)), "nothing to do", "its own command"),
}


@pytest.mark.parametrize("what", WRONG)
def test_a_wrong_join_is_refused_with_what_fits_instead(what: str, folder: Path) -> None:
    measured, found, instead = WRONG[what]
    (folder / "wrong.txt").write_text(spatialanalyzer(measured))
    words = ("import", folder / "wrong.txt", "--machine", MILL, "--commands", folder / "survey.nc", "--match", "order")
    message = refused(*words, "--out", folder / "s")
    assert found in message
    assert instead in message
    assert not (folder / "s").exists()


def test_two_of_twenty_that_changed_places_are_found(folder: Path) -> None:
    order = [15 if k == 7 else 7 if k == 15 else k for k in range(20)]
    (folder / "few.txt").write_text(spatialanalyzer(MEASURED[:20][order]))
    (folder / "few.nc").write_text(programme(COMMANDS[:20]))
    with pytest.raises(InputError, match=r"rows 8, 16 are exchanged|in 2 rows \(8, 16\)"):
        import_survey(folder / "few.txt", MILL, commands=folder / "few.nc")


@pytest.mark.parametrize("order", [[0, 1, 3, 2, 4, 5, 6, 7], [1, 2, 3, 4, 5, 6, 7, 0]])
def test_of_few_rows_an_exchange_and_a_shift_are_found_too(order: list[int], folder: Path) -> None:
    (folder / "few.txt").write_text(spatialanalyzer(MEASURED[:8][order]))
    (folder / "few.nc").write_text(programme(COMMANDS[:8]))
    with pytest.raises(InputError, match=r"exchanged|shifted"):
        import_survey(folder / "few.txt", MILL, commands=folder / "few.nc")
    (folder / "few.txt").write_text(spatialanalyzer(MEASURED[:8]))
    assert len(import_survey(folder / "few.txt", MILL, commands=folder / "few.nc").survey) == 8


def test_commands_without_names_are_taken_in_the_usual_order(folder: Path) -> None:
    """X Y Z for a machine of letters; a column that counts the rows is none of them."""
    for columns in (COMMANDS, COMMANDS.reset_index()):
        columns.to_csv(folder / "bare.txt", index=False, header=False, sep=" ")
        result = import_survey(folder / "tracker.txt", MILL, commands=folder / "bare.txt")
        np.testing.assert_array_equal(result.survey.commands(["X", "Y", "Z"]), COMMANDS.to_numpy())
    COMMANDS.set_axis(["a", "b", "c"], axis=1).to_csv(folder / "bare.txt", index=False)
    with pytest.raises(InputError, match="no command of X, Y, Z among its columns a, b, c"):
        import_survey(folder / "tracker.txt", MILL, commands=folder / "bare.txt")


def test_a_target_that_stays_while_joints_turn_is_in_no_dwell(tmp_path: Path) -> None:
    """Of a head that turns about the target, each row is a reading; a dwell of them would throw the others away."""
    fork = read_machine("fork_head_five_axis")
    rows, rng = 60, np.random.default_rng(2)
    table = pd.DataFrame({j.name: np.zeros(rows) for j in fork.joints})
    for joint in fork.joints:
        if joint.type == "prismatic":
            table[joint.name] = np.where(np.arange(rows) < 40, rng.uniform(*joint.travel, rows), np.mean(joint.travel))
    table.loc[40:, "C"] = np.linspace(-60, 60, rows - 40)
    table = table.round(3)
    made = simulate(fork, table, None, translation=(500, 900, 0), rotation=(0, 1, 30), noise=0.002, seed=1)
    assert np.ptp(made[["mx", "my", "mz"]].to_numpy()[40:], axis=0).max() < 0.02
    made[["mx", "my", "mz"]].to_csv(tmp_path / "m.csv", index=False)
    table.to_csv(tmp_path / "plan.csv", index=False)
    assert len(import_survey(tmp_path / "m.csv", fork, commands=tmp_path / "plan.csv").survey) == rows
    made.to_csv(tmp_path / "one.csv", index=False)
    assert len(import_survey(tmp_path / "one.csv", fork).survey) == rows


def test_a_correction_is_a_line_in_the_map(folder: Path) -> None:
    """Turned hand: a sign in columns; and a file that was changed since is refused."""
    (folder / "hand.csv").write_text(
        "E;N;U\n" + "\n".join(";".join(f"{v:.4f}" for v in p) for p in MEASURED * [1, -1, 1])
    )
    columns = {"mx": "E", "my": "-N", "mz": "U"}
    import_survey(folder / "hand.csv", MILL, commands=folder / "survey.nc", columns=columns).save(folder / "s")
    text = (folder / "s/survey.yaml").read_text()
    assert "my: -N" in text
    np.testing.assert_allclose(read_survey(folder / "s", read_machine(MILL)).measured, MEASURED.round(4))
    pairs = (folder / "s/pairs.csv").read_text().splitlines()
    (folder / "s/pairs.csv").write_text("\n".join(pairs[:-1]) + "\n")
    assert len(read_survey(folder / "s", read_machine(MILL))) == ROWS - 1
    (folder / "s/pairs.csv").write_text("\n".join([*pairs, "99,1,1"]) + "\n")
    with pytest.raises(InputError, match=r"row 99 of raw/survey\.nc, which has 40"):
        read_survey(folder / "s", read_machine(MILL))
    (folder / "s/raw/hand.csv").write_text((folder / "hand.csv").read_text() + "1;2;3\n")
    with pytest.raises(InputError, match="not the file that was imported"):
        read_survey(folder / "s", read_machine(MILL))


def test_dwells_in_logs_of_two_clocks(tmp_path: Path) -> None:
    """Poses, means and the offset of the clocks come out; the scatter within dwells is the tracker's."""
    q = importing.logs(tmp_path)
    result = import_survey(tmp_path / "tracker.csv", MILL, commands=tmp_path / "controller.csv")
    (pairs, _) = result.imported.pairs
    assert pairs is not None
    assert pairs.offset == pytest.approx(CLOCK + 0.03, abs=0.02)  # the drives are 30 ms late; rows of 20 and 50 ms
    commands = result.survey.commands(["X", "Y", "Z"])
    assert len(commands) >= len(q) - 2  # the log begins and ends within dwells that may be too short
    np.testing.assert_array_equal(commands, q.to_numpy()[[int(np.abs(q - c).sum(axis=1).argmin()) for c in commands]])
    assert "X was read back" in result.summary()
    assert result.imported.proof.dwell_um == pytest.approx(3.0, rel=0.15)  # 3 um, by 25 readings and more a dwell
    assert "w_readback_X_mm" in result.survey.table
    exact = points(pd.DataFrame(commands, columns=["X", "Y", "Z"]), noise=0.0)
    assert np.abs(result.survey.measured - exact).max() < 0.003  # 3 um over the root of 25 readings, five times


def test_stations_and_temperatures(folder: Path) -> None:
    """Two trackers elsewhere have frames of their own; a logger on its own clock is read at the times of the rows."""
    second = points(COMMANDS, seed=4, translation=(-1000, 2500, 300), rotation=(1, 2, -120))
    for name, measured in (("one.csv", MEASURED), ("two.csv", second)):
        rows = "".join(
            f"p{k + 1};{x:.4f};{y:.4f};{z:.4f};11.10.2022 15:{k:02d}:00\n" for k, (x, y, z) in enumerate(measured)
        )
        (folder / name).write_bytes(("Messung Grün\nName;X [mm];Y [mm];Z [mm];Zeit\n" + rows.replace(".", ",").replace(
            "11,10,", "11.10.")).encode("cp1252"))  # fmt: skip
    log = "".join(f"11/10/2022\t14:{m:02d}:00\t{20 + m / 100:.3f}\n" for m in range(60))
    (folder / "log.txt").write_text(f"Logger\nDate\tTime\tBed [°C]\n{log}", encoding="utf-16")
    files = [folder / n for n in ("one.csv", "two.csv", "log.txt")]
    with pytest.raises(InputError, match=r"14:00:00 to .*, the measurements from .*15:00:00"):
        import_survey(files, MILL, commands=folder / "plan.csv", dates="day-first")
    result = import_survey(files, MILL, commands=folder / "plan.csv", dates="day-first", log_offset=3600.0)
    assert result.survey.frame == "per-file"
    np.testing.assert_allclose(result.survey.table["T_Bed"], np.tile(20 + np.arange(ROWS) / 100, 2), atol=1e-9)
    assert result.imported.proof.rms_um < 30


def test_reflectors_on_a_flange_are_placed(tmp_path: Path) -> None:
    """Three reflectors at places that nobody stated: found to the noise, and a line of the map each."""
    arm = read_machine("six_axis_arm")
    rng = np.random.default_rng(7)
    names = [j.name for j in arm.joints]
    joints = pd.DataFrame({j.name: 0.5 * np.degrees(rng.uniform(*j.travel, 30)) for j in arm.joints}).round(3)
    places = np.array([[30.0, 0, 120], [-40, 25, 110], [5, -60, 140]])
    seen = []
    for place in places:
        table = joints.assign(tool_x=place[0], tool_y=place[1], tool_z=place[2])
        own = simulate(
            arm, table, None, translation=(500, -3000, 200), rotation=(1, 2, 170), noise=0.01, seed=len(seen)
        )
        seen.append(own[["mx", "my", "mz"]].to_numpy())
    np.savetxt(tmp_path / "three.txt", np.column_stack([*seen, joints[names]]))
    result = import_survey(tmp_path / "three.txt", arm)
    (pairs,) = result.imported.pairs
    assert pairs is not None
    found = np.array([pairs.targets[str(k)] for k in (1, 2, 3)])
    assert np.abs(found - places).max() < 0.01  # 10 um over the root of 30 poses, five times
    assert result.imported.proof.rms_um < 20  # 10 um a coordinate


def test_two_reflectors_on_a_mill(folder: Path) -> None:
    """Nothing turns: one reflector is the tool's point, the other lies beside it; two readings a command."""
    second = points(COMMANDS.assign(tool_x=60.0, tool_y=-20.0, tool_z=-150.0), seed=8)
    rows = [f"{name};{x:.4f};{y:.4f};{z:.4f}" for pair in zip(MEASURED, second, strict=True)
            for name, (x, y, z) in zip(("A", "B"), pair, strict=True)]  # fmt: skip
    (folder / "two.csv").write_text("\n".join(["Reflector;X [mm];Y [mm];Z [mm]", *rows]) + "\n")
    result = import_survey(folder / "two.csv", MILL, commands=folder / "survey.nc")
    (pairs, _) = result.imported.pairs
    assert pairs is not None
    assert "2 readings a command" in pairs.how
    tool = np.array(read_machine(MILL).tool)
    np.testing.assert_allclose(pairs.targets["A"], tool)
    # the errors of the mill, 20 um, bend the places of the reflectors by about as much
    np.testing.assert_allclose(pairs.targets["B"], [60.0, -20.0, -150.0], atol=0.02)
    assert result.imported.proof.rms_um < 25


def test_a_symmetric_grid_without_names_or_order_is_not_guessed() -> None:
    grid = np.array(np.meshgrid([0, 100, 200], [0, 100, 200], [0, 100, 200])).reshape(3, -1).T.astype(float)
    rng = np.random.default_rng(3)
    measured = grid[rng.permutation(27)] + rng.normal(0, 1e-3, (27, 3))
    found = find_pairing(grid, measured)
    assert found is not None
    assert found.ways > 1
    ordered = find_pairing(grid, grid + 5.0)
    assert ordered is not None
    assert ordered.ways == 1
    np.testing.assert_array_equal(ordered.command, np.arange(27))


@pytest.mark.parametrize(
    ("order", "factor", "found"),
    [(range(20), 1.0, ""), (range(19, -1, -1), 1.0, "reversed order"), ([*range(1, 20), 0], 1.0, "1 row"),
     (range(20), 1 / 25.4, "in inch"), (range(20), -1.0, "the other sign|reversed order")],
)  # fmt: skip
def test_of_one_component_order_unit_and_sign_are_looked_at(
    order: list[int], factor: float, found: str, tmp_path: Path
) -> None:
    """An interferometer along X, which no alignment in three directions can judge."""
    commands = pd.DataFrame({"X": np.linspace(-300, 280, 20) ** 3 / 9e4, "Y": 0.0, "Z": 300.0}).round(3)
    commands.to_csv(tmp_path / "plan.csv", index=False)
    measured = points(commands, translation=(0, 0, 0), rotation=(0, 0, 0))[:, 0][[*order]] * factor
    (tmp_path / "laser.csv").write_text("mx\n" + "\n".join(f"{v:.6f}" for v in measured) + "\n")
    if not found:
        assert len(import_survey(tmp_path / "laser.csv", MILL, commands=tmp_path / "plan.csv").survey) == 20
        return
    with pytest.raises(InputError, match=found):
        import_survey(tmp_path / "laser.csv", MILL, commands=tmp_path / "plan.csv")


@pytest.mark.parametrize(("one", "other"), [("P1*", "p1"), (" P 1 ", "p 1"), ("12.0", "12")])
def test_names_are_compared_as_people_would(one: str, other: str) -> None:
    assert plain_name(one) == plain_name(other)


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ((), "no command of X, Y, Z in it"),
        (("--commands", "plan.csv", "--columns", "mx=Qx"), "no column 'Qx'"),
        (("--commands", "plan.csv", "--units", "mx=second"), "the unit 's'"),
        (("--commands", "plan.csv", "--format", "leica"), "Did you mean 'leica-tracker'"),
        (("--commands", "plan.csv", "--format", "leica-tracker"), "does not look like an export of a Leica"),
        (("--commands", "nothing.csv",), "no such file"),
        (("--commands", "plan.csv", "--match", "time"), "no time"),
        (("--commands", "other.txt"), "no command of X, Y, Z"),
    ],
)  # fmt: skip
def test_bad_input_ends_with_one_message(words: tuple[str, ...], found: str, folder: Path) -> None:
    given = [str(folder / w) if w.endswith((".csv", ".txt")) else w for w in words]
    assert found in refused("import", folder / "tracker.txt", "--machine", MILL, *given, "--out", folder / "s")
    assert not (folder / "s").exists()


def test_a_template_is_filled_in_and_taken_back(tmp_path: Path) -> None:
    done("template", MILL, "--out", tmp_path / "t.csv")
    head, example = (tmp_path / "t.csv").read_text().splitlines()
    rows = [f"{x},{y},{z},{a:.4f},{b:.4f},{c:.4f},1,{60 * k},20.5" for k, ((x, y, z), (a, b, c)) in enumerate(
        zip(COMMANDS.to_numpy(), MEASURED, strict=True))]  # fmt: skip
    assert len(example.split(",")) == len(head.split(",")) == len(rows[0].split(","))
    (tmp_path / "filled.csv").write_text("\n".join([head, *rows]) + "\n")
    said = done("import", tmp_path / "filled.csv", "--machine", MILL, "--out", tmp_path / "s")
    assert f"{ROWS} rows with their commands in filled.csv" in said
    survey = read_survey(tmp_path / "s", read_machine(MILL))
    assert set(survey.table["T_air"]) == {20.5}
    assert "joint" in done("template", MILL, "--joint", "Y").splitlines()[0]


def test_check_says_what_a_survey_holds(folder: Path) -> None:
    import_survey(folder / "tracker.txt", MILL, commands=folder / "survey.nc").save(folder / "s")
    said = done("check", MILL, folder / "s")
    for text in ("40 rows with x, y and z", "X: -3", "% of its travel", "no temperatures", "30 groups", "um rms"):
        assert text in said
    low, high = COMMANDS["X"].min(), COMMANDS["X"].max()
    assert f"X: {low:g} to {high:g} mm ({100 * (high - low) / 760:.0f} % of its travel)" in said
    message = refused("check", MILL, folder / "tracker.txt")
    assert "a point list of SpatialAnalyzer" in message
    assert "errormodel import" in message
    assert NOISE < 1
    assert json.loads((folder / "s/manifest.json").read_text())["holds"] == "survey"


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (("--offset", "G54=X0,Y0,Z0"), "--offset: none of the files is an NC programme"),
        (("--at", "start=X0"), "--at: none of the files is an NC programme"),
        (("--dialect", "fanuc"), "--dialect: none of the files is a programme in G-code"),
        (("--joint", "X"), "--joint: none of the files is a table of readings of one joint"),
        (("--centre", "X=0,Y=0,Z=300"), "--centre: none of the files is a trace of a ballbar"),
        (("--dates", "day-first"), "--dates: none of the files has dates"),
        (("--log-offset", "5"), "--log-offset: none of the files is a log"),
        (("--units", "length=inch"), "--units: length=inch, and no column is read in it"),
        (("--units", "temperature=degF"), "--units: temperature=degF, and no column is read in it"),
        (("--command-units", "temperature=degF"), "--command-units: temperature=degF"),
        (("--observation", "station-distance"), "no file with a column of single readings"),
    ],
)
def test_an_option_that_nothing_follows_is_refused(words: tuple[str, ...], found: str, folder: Path) -> None:
    given = ("--machine", MILL, "--commands", str(folder / "plan.csv"), *words)
    assert found in refused("import", folder / "tracker.txt", *given, "--out", folder / "s")
    assert not (folder / "s").exists()


def test_a_way_of_joining_without_commands_is_refused(folder: Path) -> None:
    import_survey(folder / "tracker.txt", MILL, commands=folder / "plan.csv").survey.table.to_csv(folder / "whole.csv")
    given = ("--machine", MILL, "--match", "order", "--out", folder / "s")
    assert "--match: no --commands" in refused("import", folder / "whole.csv", *given)
