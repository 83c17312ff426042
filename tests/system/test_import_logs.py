"""Two continuous logs of as many rows, side by side: dwells are found, and rows that move are left out."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import InputError
from identification import check, import_survey
from tests.helpers.importing import MILL, logs, points, poses

LATE = 2  # rows that the machine is behind its commands
POSES = 8


@pytest.fixture(scope="module")
def sides(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, pd.DataFrame, np.ndarray]:
    """A log of commands at 50 Hz with dwells, the poses, and what is measured at the same instants."""
    folder = tmp_path_factory.mktemp("logs")
    driven = logs(folder, rows=POSES)
    log = pd.read_csv(folder / "controller.csv", sep=";", decimal=",")[["X_cmd", "Y_cmd", "Z_cmd"]]
    log.set_axis(["X", "Y", "Z"], axis=1).to_csv(folder / "c.csv", index=False)
    exact = points(log.set_axis(["X", "Y", "Z"], axis=1), noise=0.0)
    late = np.vstack([exact[:1].repeat(LATE, axis=0), exact[:-LATE]])
    return folder, driven, late + np.random.default_rng(0).normal(0, 0.003, late.shape)


def written(folder: Path, columns: dict[str, np.ndarray]) -> Path:
    path = folder / "m.csv"
    pd.DataFrame(columns).round(5).to_csv(path, index=False)
    return path


def test_dwells_of_two_logs_side_by_side(sides: tuple[Path, pd.DataFrame, np.ndarray]) -> None:
    folder, driven, seen = sides
    file = written(folder, dict(zip(("mx", "my", "mz"), seen.T, strict=True)))
    result = import_survey(file, MILL, commands=folder / "c.csv")
    assert f"joined {POSES} of {POSES} dwells" in result.summary()
    assert "by row, of two logs side by side" in result.summary()
    np.testing.assert_allclose(result.survey.table[["X", "Y", "Z"]], driven, atol=1e-4)
    assert result.imported.proof.rms_um < 20  # 3 um of noise, 20 um of the machine's errors over 740 mm
    assert np.median(result.survey.table["sigma_x"]) == pytest.approx(0.003, rel=0.3)


def test_logs_that_do_not_run_side_by_side_are_refused(sides: tuple[Path, pd.DataFrame, np.ndarray]) -> None:
    folder, _, seen = sides
    file = written(folder, dict(zip(("mx", "my", "mz"), np.roll(seen, 40, axis=0).T, strict=True)))
    with pytest.raises(InputError, match=r"do not run side by side.*--columns time="):
        import_survey(file, MILL, commands=folder / "c.csv")


def test_a_log_of_lengths_has_dwells_too(sides: tuple[Path, pd.DataFrame, np.ndarray]) -> None:
    """The scatter within a dwell is the uncertainty of its length, as it is of a point's coordinates."""
    folder, driven, seen = sides
    file = written(folder, {"length": np.linalg.norm(seen - [3000.0, 500.0, 200.0], axis=1)})
    result = import_survey(file, MILL, commands=folder / "c.csv", observation="station-distance, dead_path: 0")
    assert f"joined {POSES} of {POSES} dwells" in result.summary()
    np.testing.assert_allclose(result.survey.table[["X", "Y", "Z"]], driven, atol=1e-4)
    assert np.median(result.survey.table["u_length"]) == pytest.approx(0.003, rel=0.3)


@pytest.mark.parametrize("match", ["auto", "order", "nearest"])
def test_single_readings_are_joined_to_the_rests_of_a_log(
    sides: tuple[Path, pd.DataFrame, np.ndarray], match: str
) -> None:
    """A row on the way may lie nearer to a reading than the one at rest, by what the machine is off."""
    folder, driven, _ = sides
    file = written(folder, dict(zip(("mx", "my", "mz"), points(driven, noise=0.2).T, strict=True)))
    result = import_survey(file, MILL, commands=folder / "c.csv", match=match)
    assert f"{POSES} rests in a log of " in result.summary()
    np.testing.assert_allclose(result.survey.table[["X", "Y", "Z"]], driven, atol=1e-4)


def test_a_rest_that_was_not_measured_is_named(sides: tuple[Path, pd.DataFrame, np.ndarray]) -> None:
    folder, driven, _ = sides
    left = driven.drop(index=3)
    file = written(folder, dict(zip(("mx", "my", "mz"), points(left, noise=0.2).T, strict=True)))
    result = import_survey(file, MILL, commands=folder / "c.csv")
    assert "not measured: 1 rest (line " in result.summary()
    np.testing.assert_allclose(result.survey.table[["X", "Y", "Z"]], left, atol=1e-4)


@pytest.mark.long
@pytest.mark.parametrize("gone", [[], [3]])
def test_lengths_are_joined_to_the_rests_of_a_log(
    sides: tuple[Path, pd.DataFrame, np.ndarray], gone: list[int], tmp_path: Path
) -> None:
    """A list of lengths, one a rest, beside a log of thousands of rows; a rest that was not measured is named."""
    driven = logs(tmp_path, seed=11, rows=20)
    log = pd.read_csv(tmp_path / "controller.csv", sep=";", decimal=",")[["X_cmd", "Y_cmd", "Z_cmd"]]
    log.set_axis(["X", "Y", "Z"], axis=1).to_csv(tmp_path / "c.csv", index=False)
    kept = driven.drop(index=gone)
    lengths = np.linalg.norm(kept.to_numpy() - [900.0, -700.0, -200.0], axis=1) - 50.0
    file = written(tmp_path, {"length": lengths})
    result = import_survey(file, MILL, commands=tmp_path / "c.csv", observation="station-distance")
    assert "20 rests in a log of " in result.summary()
    assert ("not measured: 1 rest (line " in result.summary()) == bool(gone)
    np.testing.assert_allclose(result.survey.table[["X", "Y", "Z"]], kept, atol=1e-4)


def test_a_clock_that_goes_back_is_named(tmp_path: Path) -> None:
    logs(tmp_path, seed=3, rows=12)
    log = pd.read_csv(tmp_path / "tracker.csv")
    at = 3 * len(log) // 5
    log.loc[at:, "Time [s]"] -= 7.5
    log.to_csv(tmp_path / "t.csv", index=False)
    with pytest.raises(InputError, match=rf"t.csv: its clock goes back by 7.45 s before row {at + 1}"):
        import_survey(tmp_path / "t.csv", MILL, commands=tmp_path / "controller.csv")


def test_a_clock_that_was_set_between_a_plan_and_a_list_is_named(tmp_path: Path) -> None:
    """Both have a time a pose; extra readings behind the last command are none of this."""
    driven = poses(rows=20)
    when = np.cumsum(np.random.default_rng(2).uniform(5, 15, 20))
    driven.assign(time=when).to_csv(tmp_path / "plan.csv", index=False)
    seen = points(driven)
    own = when + 100.0
    own[13:] += 3600.0
    columns = {"mx": seen[:, 0], "my": seen[:, 1], "mz": seen[:, 2], "time": own}
    with pytest.raises(InputError, match=r"from row 14 on its clock is 3600 s further ahead"):
        import_survey(written(tmp_path, columns), MILL, commands=tmp_path / "plan.csv", match="time")
    columns["time"] = when + 100.0
    result = import_survey(written(tmp_path, columns), MILL, commands=tmp_path / "plan.csv", match="time")
    assert "joined 20 of 20 readings" in result.summary()


def test_a_list_in_the_order_of_its_names_is_joined_by_its_times(tmp_path: Path) -> None:
    """Its times go back, and no clock was set."""
    driven = poses(rows=20)
    when = np.cumsum(np.random.default_rng(2).uniform(5, 15, 20))
    driven.assign(time=when).to_csv(tmp_path / "plan.csv", index=False)
    order = np.random.default_rng(3).permutation(20)
    seen = points(driven)[order]
    columns = {"mx": seen[:, 0], "my": seen[:, 1], "mz": seen[:, 2], "time": when[order] + 100.0}
    result = import_survey(written(tmp_path, columns), MILL, commands=tmp_path / "plan.csv", match="time")
    np.testing.assert_array_equal(result.survey.table[["X", "Y", "Z"]], driven.iloc[order])


def test_many_readings_of_one_command_are_a_dwell(tmp_path: Path) -> None:
    """One command is no R-test, of which many are at one place."""
    driven = poses(rows=1)
    driven.to_csv(tmp_path / "plan.csv", index=False)
    seen = points(pd.concat([driven] * 30, ignore_index=True))
    file = written(tmp_path, {"mx": seen[:, 0], "my": seen[:, 1], "mz": seen[:, 2]})
    assert len(import_survey(file, MILL, commands=tmp_path / "plan.csv").survey) == 1


@pytest.fixture
def tracked(tmp_path: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Poses and a tracker's log, for commands that have no clock."""
    driven = logs(tmp_path, seed=3, rows=12)
    driven.to_csv(tmp_path / "plan.csv", index=False)
    return driven, pd.read_csv(tmp_path / "tracker.csv")


def test_times_of_a_clock_that_was_set_are_left_out(tracked: tuple[pd.DataFrame, pd.DataFrame], tmp_path: Path) -> None:
    """Joined by order, the rows are right and their times are not: drift and sides of arrival would follow them."""
    driven, log = tracked
    at = 3 * len(log) // 5
    log.loc[at:, "Time [s]"] -= 3600
    log.to_csv(tmp_path / "t.csv", index=False)
    result = import_survey(tmp_path / "t.csv", MILL, commands=tmp_path / "plan.csv")
    np.testing.assert_allclose(result.survey.table[["X", "Y", "Z"]], driven[1:-1], atol=1e-9)  # the log began late
    note = next(n for n in result.notes if "clock" in n)
    assert f"t.csv: its clock goes back by 3600 s before row {at + 1}" in note
    assert "times were left out" in note
    assert "time" not in result.survey.table
    result.save(tmp_path / "s")
    assert note in check(MILL, tmp_path / "s").notes
    room = pd.DataFrame({"Time [s]": [-4000.0, 4000.0], "T room [°C]": [20.0, 21.0]})
    room.to_csv(tmp_path / "room.csv", index=False)
    with pytest.raises(InputError, match="its clock goes back by 3600 s"):
        import_survey([tmp_path / "t.csv", tmp_path / "room.csv"], MILL, commands=tmp_path / "plan.csv")


def test_readings_that_changed_places_are_no_clock_that_was_set(
    tracked: tuple[pd.DataFrame, pd.DataFrame], tmp_path: Path
) -> None:
    _, log = tracked
    log.loc[40, "Time [s]"] = log.loc[39, "Time [s]"] - 1e-3
    log.to_csv(tmp_path / "t.csv", index=False)
    result = import_survey(tmp_path / "t.csv", MILL, commands=tmp_path / "plan.csv")
    assert "time" in result.survey.table
    assert not result.notes


def test_a_list_whose_times_go_back_says_so(tmp_path: Path) -> None:
    driven = poses(3, 20)
    driven.to_csv(tmp_path / "plan.csv", index=False)
    when = 10.0 * np.arange(20) - 3600 * (np.arange(20) >= 12)
    frame = pd.DataFrame(points(driven), columns=["mx", "my", "mz"]).assign(time=when)
    frame.to_csv(tmp_path / "t.csv", index=False)
    result = import_survey(tmp_path / "t.csv", MILL, commands=tmp_path / "plan.csv")
    assert any("goes back by 3590 s before row 13" in n and "--columns time=-" in n for n in result.notes)
    frame.assign(run=np.where(np.arange(20) < 12, "1", "2")).to_csv(tmp_path / "t.csv", index=False)
    assert not import_survey(tmp_path / "t.csv", MILL, commands=tmp_path / "plan.csv").notes  # a run begins anew


def turning(folder: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Poses and logs at 10 Hz of commands and of a length that turns back on its way: 2.5 s of rest each, 50 mm/s."""
    driven = poses(17, 24)
    path = [driven.to_numpy()[[0]].repeat(25, axis=0)]
    for a, b in pairwise(driven.to_numpy()):
        steps = int(np.linalg.norm(b - a) / 5)
        path += [a + (b - a) * np.linspace(0, 1, steps + 1)[1:-1, None], b[None].repeat(25, axis=0)]
    way = pd.DataFrame(np.vstack(path), columns=["X", "Y", "Z"])
    length = np.linalg.norm(points(way, noise=0.0) - [2000.0, -2700.0, 500.0], axis=1)
    length += np.random.default_rng(5).normal(0, 3e-4, len(length))
    when = 0.1 * np.arange(len(way))
    way.assign(time=when).to_csv(folder / "controller.csv", index=False)
    driven.to_csv(folder / "plan.csv", index=False)
    return driven, pd.DataFrame({"time": when + 77.0, "length": length})


@pytest.mark.long
@pytest.mark.parametrize("commands", ["plan.csv", "controller.csv"])
def test_a_length_that_turns_back_on_its_way_is_at_no_rest(commands: str, tmp_path: Path) -> None:
    driven, log = turning(tmp_path)
    file = written(tmp_path, {n: log[n].to_numpy() for n in log})
    for match in ["order", "time"] if commands == "controller.csv" else ["order"]:
        kind = "station-distance, dead_path: 0"
        result = import_survey(file, MILL, commands=tmp_path / commands, observation=kind, match=match)
        assert f"joined {len(driven)} of {len(driven)} dwells" in result.summary()
        assert "no rest but a turn of the way: rows " in result.summary()
        np.testing.assert_allclose(result.survey.table[["X", "Y", "Z"]], driven, atol=1e-3)


def test_a_dwell_too_many_is_named(tmp_path: Path) -> None:
    """The machine waited on its way, for a shorter time than at the poses."""
    driven, log = turning(tmp_path)
    at = 25 + int(np.linalg.norm(np.diff(driven.to_numpy()[:2], axis=0)) / 5) // 2
    stop = log.iloc[[at]].loc[np.repeat(at, 12)] + np.random.default_rng(1).normal(0, 3e-4, (12, 2))
    log = pd.concat([log[:at], stop, log[at:]], ignore_index=True)
    file = written(tmp_path, {"length": log["length"].to_numpy()})
    with pytest.raises(
        InputError,
        match=rf"25 dwells and 24 commands; the shortest: rows {at + 1} to {at + 13}, of 13 readings where 25",
    ):
        import_survey(file, MILL, commands=tmp_path / "plan.csv", observation="station-distance, dead_path: 0")


@pytest.mark.long
def test_dwells_that_lie_on_the_way_from_one_row_on_say_that_a_clock_was_set(tmp_path: Path) -> None:
    """Its clock was set by less than a dwell and the way to the next are long: the offset of the first part holds."""
    logs(tmp_path, rows=30)
    table = pd.read_csv(tmp_path / "tracker.csv")
    half = len(table) // 2
    table.loc[half:, "Time [s]"] += 1.3
    table.to_csv(tmp_path / "tracker.csv", index=False)
    with pytest.raises(InputError, match=r"clock .*set"):
        import_survey(tmp_path / "tracker.csv", MILL, commands=tmp_path / "controller.csv")
    part = import_survey(
        tmp_path / "tracker.csv", MILL, commands=tmp_path / "controller.csv", leave_out=[f"{half}-{len(table)}"]
    )
    assert len(part.survey) >= 13
