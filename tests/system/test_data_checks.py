"""The gate before any physics: mistakes in a recording are found, put right and named; honest recordings pass."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pandas as pd
import pytest

from errormodel.approach import direction
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.machine import Joint, Machine
from errormodel.machine_file import read_machine
from errormodel.simulation import random_points
from errormodel.survey import Survey
from errormodel.surveys.columns import MEASURED
from errormodel.surveys.file import SurveyUnits
from errormodel.surveys.plausibility import check_sizes
from identification.diagnosis.data_checks.approach_direction import contrary_sides
from identification.diagnosis.data_checks.checks import find_blunders
from identification.diagnosis.data_checks.duplicates_and_clock import copied_rows
from identification.diagnosis.pipeline import diagnose
from tests.helpers.chains import errors
from tests.helpers.nightly import first_of
from tests.helpers.surveys import measured, positions
from tests.helpers.surveys import survey as survey_of

XYZ = list(MEASURED)
MACHINES = ("vertical_three_axis", "h_gantry_dual_drive", "five_axis_table_quill", "trunnion_five_axis", "six_axis_arm")
ALL = (*MACHINES, "bridge_cmm", "horizontal_three_axis", "fork_head_five_axis", "gantry_crossbeam_ram")
ROWS, NOISE = 160, 0.005
Edit = Callable[[pd.DataFrame, Machine], pd.DataFrame]


@cache
def machine_of(name: str) -> Machine:
    return read_machine(name)


@cache
def honest(name: str, walk: str = "random", noise: float = NOISE) -> Survey:
    """Usual errors, two tools by turns, a clock, and a tracker that stands anywhere."""
    machine = machine_of(name)
    tools = (machine.tool, (machine.tool[0] + 35, machine.tool[1] - 20, machine.tool[2] - 80))
    points = {"random": None, "grid": grid(machine), "repeats": repeats(machine)}[walk]
    table = positions(measured(machine, errors(Chain(machine)), ROWS, 1, noise, tools, points=points))
    time = np.cumsum(np.random.default_rng(2).uniform(15, 50, len(table)))
    return survey_of(table.assign(time=time, T_air=20 + np.sin(time / 900)))


def grid(machine: Machine) -> pd.DataFrame:
    """Walked like a plotter, the last joint there and back."""
    count = 6 if len(machine.joints) < 4 else 3
    rows = []
    for k, place in enumerate(product(range(count), repeat=len(machine.joints) - 1)):
        rows += [(*place, n) for n in (range(count) if k % 2 == 0 else reversed(range(count)))]
    levels = np.array(rows)[:400] / (count - 1)
    table = random_points(machine, len(levels))
    return table.assign(**{j.name: np.interp(levels[:, k], (0, 1.1), j.travel) for k, j in enumerate(machine.joints)})


def repeats(machine: Machine) -> pd.DataFrame:
    """Poses of which each comes again after forty others."""
    return pd.concat([random_points(machine, 40, 5)] * 4, ignore_index=True)


def spoilt(name: str, edit: Edit) -> Survey:
    survey, machine = honest(name), machine_of(name)
    return replace(survey, table=edit(survey.table.copy(), machine))


def one(table: pd.DataFrame, column: str, values: object, rows: slice = slice(None)) -> pd.DataFrame:
    table.loc[table.index[rows], column] = values
    return table


def swapped(table: pd.DataFrame, first: str, second: str, rows: slice = slice(None)) -> pd.DataFrame:
    here = table.index[rows]
    table.loc[here, [first, second]] = table.loc[here, [second, first]].to_numpy()
    return table


def ordered(table: pd.DataFrame, order: np.ndarray) -> pd.DataFrame:
    """What was measured, from other rows; nothing from row -1."""
    table[XYZ] = np.where((order >= 0)[:, None], table[XYZ].to_numpy()[order], np.nan)
    return table


def late(first: int, last: int, by: int) -> np.ndarray:
    """From row `first` to before `last`, what was measured stands so many rows too late."""
    order = np.arange(ROWS)
    source = np.arange(first, last) - by
    order[first:last] = np.where((source >= first) & (source < last), source, -1)
    return order


def joint_of(machine: Machine, kind: str, number: int = 0) -> Joint:
    """A joint whose position shows, wherever the measuring frame stands."""
    found = [j for j in machine.joints if j.type == kind]
    if len(found) <= number:
        pytest.skip(f"{machine.name} has no such joint")
    return found[number]


COLUMNS: dict[str, tuple[Edit, Callable[[Machine], str]]] = {
    "sign of the last joint": (
        lambda t, m: one(t, m.joints[-1].name, -t[m.joints[-1].name]),
        lambda m: m.joints[-1].name,
    ),
    "slide in inch": (
        lambda t, m: one(t, (n := joint_of(m, "prismatic").name), t[n] / 25.4),
        lambda m: joint_of(m, "prismatic").name,
    ),
    "slide in m": (
        lambda t, m: one(t, (n := joint_of(m, "prismatic", 1).name), t[n] / 1000),
        lambda m: joint_of(m, "prismatic", 1).name,
    ),
    "rotary in rad": (
        lambda t, m: one(t, (n := joint_of(m, "rotary").name), np.radians(t[n])),
        lambda m: joint_of(m, "rotary").name,
    ),
    "joints swapped": (
        lambda t, m: swapped(t, m.joints[-2].name, m.joints[-1].name),
        lambda m: m.joints[-2].name,
    ),
    "mz in inch": (lambda t, _: one(t, "mz", t["mz"] / 25.4), lambda _: "instrument"),
    "mx in m": (lambda t, _: one(t, "mx", t["mx"] / 1000), lambda _: "instrument"),
    "tool in inch": (lambda t, _: one(t, "tool_z", t["tool_z"] / 25.4), lambda _: "tool"),
    "tool swapped": (lambda t, _: swapped(t, "tool_x", "tool_z"), lambda _: "tool"),
}


@pytest.mark.parametrize("name", first_of(MACHINES))
@pytest.mark.parametrize("kind", COLUMNS)
def test_a_wrong_column_is_put_right(name: str, kind: str) -> None:
    edit, where = COLUMNS[kind]
    machine = machine_of(name)
    if kind == "joints swapped" and machine.joints[-1].type != machine.joints[-2].type:
        pytest.skip("of two kinds: see below")
    (found,) = find_blunders(machine, spoilt(name, edit))
    assert (found.effect, found.where) == ("axis-blunder", where(machine))
    pd.testing.assert_frame_equal(found.survey.table, honest(name).table, rtol=1e-9)
    assert found.before_um is not None
    assert found.after_um is not None
    assert found.before_um > 20 * found.after_um


@pytest.mark.parametrize("name", first_of(MACHINES, 2))
def test_a_left_handed_frame_is_told_as_one(name: str) -> None:
    """Which of mx my mz is mirrored, or whether two are swapped, cannot be told where the frame may stand anyhow."""
    for edit in (lambda t, _: one(t, "my", -t["my"]), lambda t, _: swapped(t, "mx", "mz")):
        (found,) = find_blunders(machine_of(name), spoilt(name, edit))
        assert found.where == "instrument"
        assert found.text.startswith("mx my mz are left-handed")
        assert not find_blunders(machine_of(name), found.survey)


@pytest.mark.parametrize("name", ["five_axis_table_quill", "trunnion_five_axis"])
def test_a_slide_and_a_table_swapped_as_they_were_read(name: str) -> None:
    def edit(table: pd.DataFrame, machine: Machine) -> pd.DataFrame:
        a, b = joint_of(machine, "prismatic").name, joint_of(machine, "rotary").name
        return table.assign(**{a: np.degrees(table[b]), b: np.radians(table[a])})

    (found,) = find_blunders(machine_of(name), spoilt(name, edit))
    assert "are swapped" in found.text
    pd.testing.assert_frame_equal(found.survey.table, honest(name).table, rtol=1e-9)


def test_all_angles_in_rad_are_one_mistake() -> None:
    def edit(table: pd.DataFrame, machine: Machine) -> pd.DataFrame:
        return table.assign(**{j.name: np.radians(table[j.name]) for j in machine.joints})

    (found,) = find_blunders(machine_of("six_axis_arm"), spoilt("six_axis_arm", edit))
    assert found.text.startswith("each of columns J1, J2, J3, J4, J5 and J6 is in another unit")
    pd.testing.assert_frame_equal(found.survey.table, honest("six_axis_arm").table, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "column", "by"),
    [("six_axis_arm", "J3", 0.4), ("five_axis_table_quill", "X", 60.0), ("fork_head_five_axis", "A", 0.05)],
)
def test_another_zero_of_a_column(name: str, column: str, by: float) -> None:
    (found,) = find_blunders(machine_of(name), spoilt(name, lambda t, _: one(t, column, t[column] + by)))
    assert found.where == column
    assert "another zero" in found.text
    assert found.changes[0].offset == pytest.approx(-by, rel=0.01)


def test_a_zero_that_the_frame_takes_up_is_no_mistake() -> None:
    survey = spoilt("vertical_three_axis", lambda t, _: one(t, "X", t["X"] + 100))
    assert not find_blunders(machine_of("vertical_three_axis"), survey)


ORDERS = {
    "all late": (late(0, ROWS, 1), "1 row too late"),
    "early": (late(0, ROWS, -2), "2 rows too early"),
    "late from the middle on": (late(ROWS // 2, ROWS, 1), "1 row too late in rows 82 to 160"),
    "a point lost, found again": (late(60, 120, 1), "1 row too late in rows 62 to 120"),
    "two exchanged": (np.r_[:50, 51, 50, 52:ROWS], "in another order than the commands in rows 51 to 52"),
    "a block backwards": (np.r_[:60, 119:59:-1, 120:ROWS], "in another order than the commands in rows 61 to 120"),
}


@pytest.mark.parametrize("name", first_of(["h_gantry_dual_drive", "trunnion_five_axis", "six_axis_arm"]))
@pytest.mark.parametrize("kind", ORDERS)
def test_rows_in_another_order(name: str, kind: str) -> None:
    order, said = ORDERS[kind]
    (found,) = find_blunders(machine_of(name), spoilt(name, lambda t, _: ordered(t, order)))
    assert (found.effect, found.where) == ("axis-blunder", "instrument")
    assert said in found.text
    right, wanted = found.survey.measured, honest(name).measured
    seen = np.isfinite(right).all(axis=1)
    assert np.array_equal(right[seen], wanted[seen])
    assert seen.sum() >= ROWS - 2
    assert not found.changes  # nothing of it belongs into a model


@pytest.mark.parametrize("name", first_of(MACHINES))
def test_a_column_that_is_wrong_in_some_rows(name: str) -> None:
    joint = machine_of(name).joints[-1].name
    rows = slice(100, 150)
    for edit, where in (
        (lambda t, _: one(t, joint, -t[joint].iloc[rows], rows), joint),
        (lambda t, _: swapped(t, "mx", "my", rows), "instrument"),
    ):
        (found,) = find_blunders(machine_of(name), spoilt(name, edit))
        assert found.where == where
        assert found.text.endswith("in rows 101 to 150")
        pd.testing.assert_frame_equal(found.survey.table, honest(name).table)


def test_rows_with_the_label_of_another_run() -> None:
    machine = machine_of("bridge_cmm")
    parts = [
        positions(measured(machine, errors(Chain(machine)), 60, k, NOISE, frame=((900.0 * k, 50, 0), (0, 0, k))))
        for k in (1, 2)
    ]
    table = pd.concat([part.assign(run=str(k)) for k, part in enumerate(parts, 1)], ignore_index=True)
    right = survey_of(table.assign(row=np.arange(1, 121)), frame="per-run")
    assert not find_blunders(machine, right)
    wrong = replace(right, table=one(right.table.copy(), "run", "1", slice(60, 66)))
    (found,) = find_blunders(machine, wrong)
    assert "rows 61 to 66 of run 1 lie in the frame of run 2" in found.text
    pd.testing.assert_frame_equal(found.survey.table, right.table)


def test_a_station_that_was_moved_without_a_word_is_refused() -> None:
    def edit(table: pd.DataFrame, _: Machine) -> pd.DataFrame:
        turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        table.loc[90:, XYZ] = table.loc[90:, XYZ].to_numpy() @ turn.T + 700
        return table

    with pytest.raises(InputError, match=r"rows 91 to 160 lie in another measuring frame .* frame: per-run"):
        find_blunders(machine_of("trunnion_five_axis"), spoilt("trunnion_five_axis", edit))


@pytest.mark.long
@pytest.mark.parametrize("name", ["vertical_three_axis", "six_axis_arm"])
def test_points_of_other_commands_are_refused(name: str) -> None:
    order = np.random.default_rng(0).permutation(ROWS)
    with pytest.raises(InputError, match="nothing to do with the commands"):
        find_blunders(machine_of(name), spoilt(name, lambda t, _: ordered(t, order)))


@pytest.mark.long
def test_two_mistakes_at_once() -> None:
    def edit(table: pd.DataFrame, _: Machine) -> pd.DataFrame:
        return one(one(table, "J2", -table["J2"]), "J5", np.radians(table["J5"]))

    found = find_blunders(machine_of("six_axis_arm"), spoilt("six_axis_arm", edit))
    assert {c.column for b in found for c in b.changes} == {"J2", "J5"}
    pd.testing.assert_frame_equal(found[-1].survey.table, honest("six_axis_arm").table, rtol=1e-9)


def test_rows_that_were_copied_are_left_out() -> None:
    def again(table: pd.DataFrame, _: Machine) -> pd.DataFrame:
        return pd.concat([table, table.iloc[20:50]], ignore_index=True).assign(row=np.arange(1, ROWS + 31))

    def frozen(table: pd.DataFrame, _: Machine) -> pd.DataFrame:
        table.loc[31:34, XYZ] = table.loc[[30] * 4, XYZ].to_numpy()
        return table

    machine = machine_of("bridge_cmm")
    for edit, rows in ((again, range(ROWS + 1, ROWS + 31)), (frozen, range(32, 36))):
        (found,) = find_blunders(machine, spoilt("bridge_cmm", edit))
        assert (found.effect, found.rows) == ("outliers", tuple(rows))
        assert np.isnan(found.survey.measured).all(axis=1).sum() == len(rows)


def test_repeats_made_up_by_copying() -> None:
    survey = honest("bridge_cmm", "repeats")
    table = survey.table.copy()
    table.loc[120:139, XYZ] = table.loc[80:99, XYZ].to_numpy()
    (found,) = find_blunders(machine_of("bridge_cmm"), replace(survey, table=table))
    assert found.rows == tuple(range(121, 141))


@pytest.mark.parametrize("noise", [0.0, 0.0005])
def test_repeats_that_agree_are_no_copies(noise: float) -> None:
    """Without noise they must, and with readings to a hundredth of a millimetre they often do."""
    survey = honest("bridge_cmm", "repeats", noise)
    table = survey.table.assign(**{n: survey.table[n].round(2) for n in XYZ})
    assert table.duplicated(subset=XYZ).sum() > 20
    assert not find_blunders(machine_of("bridge_cmm"), replace(survey, table=table))


def test_nearly_equal_rows_that_agree_are_no_copies() -> None:
    """Of two thousand within some micrometres, a few agree; poses that repeat, and differ, say nothing about these."""
    rng = np.random.default_rng(1)
    survey, machine = honest("bridge_cmm"), machine_of("bridge_cmm")
    table = survey.table.iloc[np.zeros(2000, dtype=int)].reset_index(drop=True)
    joints = [j.name for j in machine.joints]
    table[joints] += rng.normal(0, 1e-3, (2000, len(joints))).round(5)
    table.loc[:4, joints] = table.loc[5:9, joints].to_numpy()
    table[XYZ] = (table[XYZ] + rng.normal(0, 2e-3, (2000, 3))).round(4)
    table["time"] = 0.0
    survey = replace(survey, table=table)
    assert table.duplicated(subset=XYZ).sum() > 2
    assert copied_rows(Chain(machine), survey) is None
    table.loc[100:119, XYZ] = table.loc[200:219, XYZ].to_numpy()
    found = copied_rows(Chain(machine), replace(survey, table=table))
    assert found is not None


def test_a_clock_that_was_set_back() -> None:
    survey = honest("bridge_cmm")
    time = survey.table["time"].to_numpy()
    (found,) = find_blunders(
        machine_of("bridge_cmm"),
        replace(survey, table=survey.table.assign(time=np.r_[time[:90], time[90:] - time[90]])),
    )
    assert (found.effect, found.where, found.rows) == ("clock-offset", "instrument", (91,))
    assert (np.diff(found.survey.table["time"]) > 0).all()
    # a visit that stands after a later one in the file has its own hours, and shuffled rows are only shuffled
    for order in (np.r_[90:ROWS, :90], np.random.default_rng(0).permutation(ROWS)):
        honest_table = survey.table.iloc[order].reset_index(drop=True)
        assert not find_blunders(machine_of("bridge_cmm"), replace(survey, table=honest_table))


@pytest.mark.parametrize("name", first_of(ALL, 2))
@pytest.mark.parametrize("walk", ["random", "grid", "repeats"])
def test_honest_recordings_pass(name: str, walk: str) -> None:
    survey = honest(name, walk)
    assert not find_blunders(machine_of(name), survey)
    table = survey.table.copy()  # nor do outliers of any size, or a third of the rows a step aside
    table.loc[::20, XYZ] += np.random.default_rng(3).normal(0, 7.0, table.loc[::20, XYZ].shape)
    table.loc[len(table) // 3 :, "mz"] += 0.2
    assert not find_blunders(machine_of(name), replace(survey, table=table))


@pytest.mark.long
def test_the_rest_of_the_diagnosis_sees_what_was_put_right() -> None:
    """Empty but for mistakes in rows: they are the only findings, and noise is what noise is."""
    name = "bridge_cmm"

    def edit(table: pd.DataFrame, machine: Machine) -> pd.DataFrame:
        return one(ordered(table, late(100, 121, 1)), "X", -table["X"])

    found = diagnose(machine_of(name), spoilt(name, edit)).diagnosis
    assert [f.effect for f in found.findings] == ["axis-blunder"] * 2
    assert found.findings[1].rows == list(range(102, 122))
    assert found.noise_um == pytest.approx(1e3 * NOISE, rel=0.15)
    assert all(re.search(r"misses by .* with it put right by", f.statement) for f in found.findings)


def said(**columns: object) -> list[str]:
    machine = machine_of("bridge_cmm")
    table = honest("bridge_cmm").table.drop(columns="T_air").assign(**columns)
    return check_sizes(table, machine, SurveyUnits(), "s.csv", measured=True)


def test_units_of_time_and_temperature_that_look_wrong_are_noted() -> None:
    time = honest("bridge_cmm").table["time"].to_numpy()
    assert "write units: {temperature: degF}" in said(T_a=68.0, T_b=71.0)[0]
    assert "write units: {time: min} or {time: h}" in said(time=time / 3600)[0]
    assert "write units: {time: ms}" in said(time=time * 1000)[0]
    assert not said(T_a=20.0, T_motor=70.0, time=time)
    assert not said(T_hotend=75.0)


def test_a_side_of_arrival_against_the_order_of_the_rows() -> None:
    survey = honest("vertical_three_axis")
    right = survey.table.assign(dir_X=direction(survey.table, "X"))
    by_detour = np.random.default_rng(2).choice([-1.0, 1.0], len(right))
    for sides in (right["dir_X"], by_detour, -1.0):
        assert not list(contrary_sides(replace(survey, table=right.assign(dir_X=sides))))
    [said] = contrary_sides(replace(survey, table=right.assign(dir_X=-right["dir_X"])))
    assert said.startswith("column dir_X says the opposite of how X came in the order of the rows, in 160 of 160")
