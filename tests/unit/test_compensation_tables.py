"""From errors of a machine to tables: inverse, reduction to a format's structure, region, advice."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.controllers import target
from errormodel.controllers.base import Controller
from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec
from errormodel.machine_file import library, read_machine
from identification.compensation import reduction
from identification.compensation.advice import mechanical_advice, scale_advice
from identification.compensation.assessment import Error, assess, emulated, fresh_rows, nothing, remaining
from identification.compensation.conditions import richer
from identification.compensation.designs import Designs
from identification.compensation.field import Field, movers_of
from identification.compensation.inverse import CLOSED_MM, closing, inverse
from identification.compensation.reduction import leftover, reduce
from identification.compensation.result import in_words
from identification.compensation.rows import Rows, held_out, read_rows
from identification.compensation.seams import seams
from identification.compensation.volume import Volume, levels
from identification.estimation.fit import fit_machine
from identification.results.store import load, save
from tests.benchmarks.compensation import Case, judged
from tests.helpers.chains import errors
from tests.helpers.commands import MILL
from tests.helpers.compensation import UM, tables_of, volume_of
from tests.helpers.nightly import first_of
from tests.helpers.surveys import measured, positions, survey

pytestmark = pytest.mark.usefixtures("few_poses")


def mill(seed: int = 3, share: tuple[float, float] = (0.0, 1.0)) -> Volume:
    machine = read_machine(MILL)
    return volume_of(machine, errors(Chain(machine), seed), share)


@pytest.mark.parametrize("name", first_of(library(), 5))
def test_the_inverse_reaches_the_wanted_point(name: str) -> None:
    machine = read_machine(name)
    volume = volume_of(machine, errors(Chain(machine), 5, um=200.0, urad=200.0))
    field = volume.field
    q, came = volume.poses(256, 1)
    reached, left = inverse(field, q, came)
    gap = field.actual(reached, came) - field.nominal(q)
    np.testing.assert_allclose(np.linalg.norm(gap, axis=1), left, atol=CLOSED_MM)
    jacobian = field.jacobian(reached, came)
    reach = np.linalg.matrix_rank(jacobian[0], tol=1e-3)
    if reach == 3:
        assert left.max() < CLOSED_MM < 0.01 * UM
        other = closing(field.jacobian(q, -came))  # of the other direction of approach: good enough to start with
        assert inverse(field, q, came, close=other)[1].max() < CLOSED_MM
    else:  # what the axes can do is done: the rest stands square to all of them
        assert np.abs(np.einsum("nim,ni->nm", jacobian, gap)).max() < 0.01 * UM
    still = [k for k in range(len(machine.joints)) if k not in field.movers]
    assert np.array_equal(reached[:, still], q[:, still])


def test_axes_that_run_alike_are_corrected_by_the_longer_one() -> None:
    machine = read_machine("five_axis_table_quill")
    names = [machine.joints[k].name for k in movers_of(Chain(machine))]
    assert sorted(names) == ["X", "Y", "Z"]  # not W, which runs along Z


def test_reduction_finds_the_least_worst_error_of_its_structure(monkeypatch: pytest.MonkeyPatch) -> None:
    volume = replace(mill(), free=False)
    setup = volume.setup(None, None)[0]
    controller = target("heidenhain")
    assert isinstance(controller, Controller)
    terms, sample = controller.terms(setup), volume.sample(setup, 400, seed=1)
    usual = leftover(controller, setup, reduce(controller, setup, terms, sample), sample)
    monkeypatch.setattr(reduction, "GIVEN_UP_SHARE", 10.0)  # everything given up for the worst pose
    monkeypatch.setattr(reduction, "MOST_RMS_INCREASE", 10.0)
    tables = reduce(controller, setup, terms, sample)
    least = leftover(controller, setup, tables, sample)
    assert least < usual < leftover(controller, setup, (), sample)
    rng = np.random.default_rng(0)
    for size in (1 * UM, 0.1 * UM, 0.01 * UM) * 20:
        pushed = tuple(replace(t, values=t.values + rng.normal(0, size, t.values.shape)) for t in tables)
        assert leftover(controller, setup, pushed, sample) > 0.9995 * least


def test_reduction_gives_up_little_of_the_mean_for_the_worst_pose(monkeypatch: pytest.MonkeyPatch) -> None:
    volume = mill()
    setup = volume.setup(None, None)[0]
    for name in ("heidenhain", "fanuc-pitch", "klipper"):
        controller = target(name)
        assert isinstance(controller, Controller)
        terms, sample = controller.terms(setup), volume.sample(setup, 2000, seed=1)
        figures = []
        for share in (reduction.GIVEN_UP_SHARE, 1e-9):
            monkeypatch.setattr(reduction, "GIVEN_UP_SHARE", share)
            tables = reduce(controller, setup, terms, sample)
            worst = leftover(controller, setup, tables, sample)
            rms = assess(volume, emulated(controller, tables, setup, volume), None, 0)[0]
            figures.append((rms.before.rms_um - rms.after.rms_um, worst))
        monkeypatch.undo()
        (removed, worst), (most, usual) = figures  # the second are least squares
        assert removed > 0.96 * most, name
        assert worst < usual, name


def test_slopes_stay_within_the_format() -> None:
    volume = mill()
    steep = replace(volume, field=replace(volume.field, values=12 * volume.field.values))
    controller, tables, setup = tables_of("fanuc-pitch", steep)
    shares = []
    for table in (t for t in tables if t.term.inputs):
        slope = np.abs(np.diff(table.values)).max() / np.diff(table.term.grids[0])[0]
        shares.append(slope / (controller.most_slope(setup, table.term) or 0))
    assert 0.99 < max(shares) < 1.001  # at the bound, not beyond
    controller.write(tables, setup)


@pytest.mark.parametrize("name", ["csv", "linuxcnc-type1", "isg"])
def test_nothing_is_extrapolated_beyond_what_was_measured(name: str) -> None:
    volume = mill(share=(0.25, 0.75))
    controller, tables, setup = tables_of(name, volume)
    correct = emulated(controller, tables, setup, volume)
    travel = np.array([j.travel for j in volume.field.joints])
    edge = volume.corners()[0]
    far = travel[None, :, 1]
    inside, outside = (np.abs(correct(q, np.ones_like(q), None) - q).max() for q in (edge, far))
    assert inside > 0
    # levers of angles may still grow with the position, tables may not
    grows = np.max(np.abs(far) / np.abs(edge).max(axis=0)) if name == "isg" else 1.0
    assert outside <= grows * inside + 0.1 * UM


def test_tables_of_a_rotary_table_do_not_move_the_workpiece() -> None:
    """Errors are judged after the best frame: tables that follow a motion of it by millimetres would gain nothing."""
    machine = read_machine("five_axis_table_quill")
    volume, controller = volume_of(machine, errors(Chain(machine), 1)), target("siemens-cec")
    assert isinstance(controller, Controller)
    setup = volume.setup(None, None)[0]
    sample = volume.sample(setup, 600)
    design = Designs().design(controller, setup, controller.structures(setup)[-1], sample)
    values = design.scale * design.least(sample.errors.T.ravel())
    frame = values[sum(t.size for t in design.terms) :]
    assert np.abs(np.einsum("nik,k->ni", sample.frame, frame)).max() < 0.1 * UM  # 17 um where it is free
    assert np.abs(values).max() > 5 * UM


def test_a_lattice_follows_waves_along_one_axis() -> None:
    """75 periods of a screw's error need a thousand positions along X, and a few along the others."""
    machine = replace(read_machine(MILL), effects=(EffectSpec("pitch-cyclic", {"joint": "X", "period": 10.0}),))
    chain = Chain(machine)
    volume = volume_of(machine, chain.vector(dict(zip(chain.effect_ids[0], (4 * UM, 2 * UM), strict=True))))
    controller, tables, setup = tables_of("csv", volume)
    figures = assess(volume, emulated(controller, tables, setup, volume), None, 0)[0]
    assert figures.before.rms_um > 3
    assert figures.after.rms_um < 0.1
    both = replace(machine, effects=tuple(EffectSpec("pitch-cyclic", {"joint": j, "period": 5.0}) for j in "XYZ"))
    chain = Chain(both)
    waves = volume_of(both, chain.vector({i: 4 * UM for ids in chain.effect_ids for i in ids}))
    with pytest.raises(InputError, match="more than 100000 nodes, 1025 along X"):
        tables_of("csv", waves)


def test_why_not_to_load_tables_is_said_once_for_all_states() -> None:
    said = {"T_x_18.0": "a", "T_x_21.0": "b", "T_x_30.0": "c"}
    assert in_words(said, 3) == ["in all 3 states (figures of T_x_21.0): b"]
    assert in_words({"T_x_18.0": "a", "T_x_30.0": "c"}, 3) == ["in T_x_18.0 and T_x_30.0 (figures of T_x_30.0): c"]
    assert in_words({"T_x_18.0": "a"}, 3) == ["in T_x_18.0: a"]
    assert in_words({"": "a"}, 1) == ["a"]
    assert in_words({}, 3) == []


def test_what_can_take_away_more_is_what_can_hold_this_machine() -> None:
    setup = mill().setup(None, None)[0]
    wanted = {
        "csv": ["gcode"], "linuxcnc-3d": ["gcode"], "duet": ["csv", "gcode"],
        "siemens-lec": ["siemens-cec", "csv", "gcode"],
    }  # fmt: skip
    for name, others in wanted.items():
        controller = target(name)
        assert isinstance(controller, Controller)
        assert richer(controller, setup) == others


def test_the_model_outside_is_that_of_the_edge() -> None:
    volume = mill(share=(0.25, 0.75))
    q, came = np.array([volume.high + 50.0]), np.ones((1, 3))
    edge = volume.clamp(q)
    np.testing.assert_allclose(volume.ideal(q, came) - q, volume.ideal(edge, came) - edge, atol=1e-12)


def test_error_is_removed_as_well_as_each_structure_allows() -> None:
    """The short form of ``python -m tests.benchmarks.compensation``."""
    case = Case.of(MILL, 100)
    for name, full in (("isg", True), ("csv", True), ("heidenhain", False)):
        line = judged(case, name)
        # on its own sample at most MOST_RMS_INCREASE is given up for the worst pose; these are others
        assert line.after.rms_um <= (1.01 + reduction.MOST_RMS_INCREASE) * line.best.rms_um, line
        assert line.of_ideal >= (0.97 if full else 0.2), line


def test_direction_matters_where_the_format_knows_it() -> None:
    machine = replace(read_machine(MILL), effects=(EffectSpec("backlash", {"joint": "X"}),))
    p = Chain(machine).vector({"X.dx.backlash": 20 * UM, "X.dx.1": 30 * UM})
    volume = volume_of(machine, p)
    left = {}
    for name in ("linuxcnc-type1", "siemens-lec"):
        controller, tables, setup = tables_of(name, volume)
        assert setup.reversing == {"X"}
        left[name] = assess(volume, emulated(controller, tables, setup, volume), None, 0)[0].after.rms_um
    assert left["linuxcnc-type1"] < 1.0 < 5.0 < left["siemens-lec"]


def test_errors_of_instrument_frame_and_target_are_nobodys_to_compensate(tmp_path: Path) -> None:
    machine = replace(read_machine(MILL), effects=(EffectSpec("target-offset", {"tool": [40.0, 25.0, -180.0]}),))
    chain, plain = Chain(machine), Chain(replace(machine, effects=()))
    p = chain.vector(dict(zip(plain.ids, errors(plain, 1).tolist(), strict=True)))
    table = positions(measured(machine, p, 80, 1, noise=2 * UM))
    save(fit_machine(machine, survey(table)), tmp_path)
    fit = load(tmp_path)
    outside = {*chain.frame_ids, *chain.tool_ids, *chain.effect_ids[0]}
    fit = replace(fit, values={**fit.values, **dict.fromkeys(outside, 0.1)})
    field = Field.of(fit, read_rows(tmp_path, fit.chain.machine))
    assert all(field.values[field.chain.index[i]] == 0 for i in outside)
    assert np.count_nonzero(field.values) > 5


def test_a_test_file_in_a_frame_of_its_own_is_judged_in_the_machines_axes(tmp_path: Path) -> None:
    machine = read_machine(MILL)
    p = errors(Chain(machine), 2)
    fit_rows = positions(measured(machine, p, 120, 1, noise=1 * UM))
    turned = ((300.0, -900.0, 50.0), (0.3, -1.2, 2.0))
    test_rows = positions(measured(machine, p, 60, 2, noise=1 * UM, frame=turned, file="b.csv", role="test"))
    save(fit_machine(machine, survey(fit_rows, test_rows, frame="per-file")), tmp_path)
    fit = load(tmp_path)
    table = read_rows(tmp_path, fit.chain.machine)
    held = held_out(fit, table)
    assert held is not None
    assert held.what == "60 rows of test files"
    volume = Volume.of(Field.of(fit, table), table, True)
    controller, tables, setup = tables_of("isg", volume)
    figures = assess(volume, emulated(controller, tables, setup, volume), held, 0)[1]
    truth = volume_of(machine, p)
    before = assess(truth, truth.ideal, None, 0)[0].before.rms_um
    assert figures.before.rms_um == pytest.approx(before, rel=0.25)
    assert figures.after.rms_um < 2.5  # the noise, 1 um a coordinate


def test_squareness_is_advised_to_be_adjusted_largest_first() -> None:
    machine = read_machine(MILL)
    chain = Chain(machine)
    p = chain.vector({"saddle.ec": 80e-6, "column.ea": -30e-6})  # Y turned against X, Z against Y
    first, second = mechanical_advice(volume_of(machine, p), 20.0)[:2]
    assert "Y against X" in first.what
    assert abs(first.angle) == pytest.approx(80e-6, rel=0.05)
    assert first.effect_um == pytest.approx(80e-6 * 410 * 1e3, rel=0.05)
    assert "Z against Y" in second.what
    assert mechanical_advice(volume_of(machine, 0.01 * p), 0.2) == []


def test_a_twisted_bed_is_advised_to_be_levelled() -> None:
    machine = read_machine(MILL)
    chain = Chain(machine)
    found = mechanical_advice(volume_of(machine, chain.vector({"X.ea.1": 60e-6})), 10.0)
    advice = next(a for a in found if "twist along X" in a.what)
    assert advice.angle == pytest.approx(120e-6, rel=0.02)  # from one end to the other


def test_levels_are_states_that_were_there() -> None:
    table = pd.DataFrame({"T_a": [20.0, 21, 25, 30], "T_b": [30.0, 29, 25, 20.5], "T_c": [20.0, 20.1, 20.2, 20.1]})
    states = levels(table, ["T_a", "T_a", "T_b", "T_c", "T_none"])  # of two effects
    assert all({*s} == {"T_a", "T_b"} for s in states)
    assert all(((table["T_a"] == s["T_a"]) & (table["T_b"] == s["T_b"])).any() for s in states)
    assert levels(table, ["T_c"]) == [{}]


def test_a_lattice_that_follows_the_tool_holds_for_a_longer_one() -> None:
    """Angles of the axes move a longer tool's tip further: a lattice for one tool does not know it."""
    machine = read_machine("fork_head_five_axis")
    volume = volume_of(machine, errors(Chain(machine), 1))
    q, came = volume.poses(200, 3)
    tip = np.tile(np.asarray(machine.tool) + np.array([0.0, 0.0, -80.0]), (len(q), 1))
    rows = Rows(q, came, tip, np.zeros((len(q), 3)), np.full(len(q), "", dtype=object), "80 mm longer")
    left = {}
    for name in ("csv", "linuxcnc-3d"):
        controller, tables, setup = tables_of(name, volume)
        left[name] = Error.of(remaining(volume, emulated(controller, tables, setup, volume), rows), q).rms_um
    before = Error.of(remaining(volume, nothing, rows), q).rms_um
    assert left["linuxcnc-3d"] < 0.8 * left["csv"] < 0.8 * before, (left, before)


def turntable(part: tuple[float, float]) -> Volume:
    """A trunnion of which the survey covered that part of the table's turn."""
    machine = read_machine("trunnion_five_axis")
    volume = volume_of(machine, errors(Chain(machine), 2))
    rng = np.random.default_rng(0)
    q = rng.uniform(volume.low, volume.high, (400, len(volume.low)))
    q[:2, 0], q[2:, 0] = 2 * np.pi * np.array(part), rng.uniform(*(2 * np.pi * np.array(part)), 398)
    table = pd.DataFrame(q, columns=[j.name for j in machine.joints])
    return Volume.of(volume.field, table, True)


@pytest.mark.parametrize(
    "name", first_of(["isg", "csv", "siemens-cec", "heidenhain", "aerotech-2d", "linuxcnc-3d", "pmac"])
)
def test_a_table_that_goes_round_is_alike_at_both_ends_of_its_turn(name: str) -> None:
    """A survey never reaches 0 and 360 deg themselves, which are one place: there must be no jump."""
    controller, tables, setup = tables_of(name, turntable((0.0005, 0.9992)))
    tables = controller.read(controller.write(tables, setup), setup)
    axis = setup.axis("C")
    assert axis.turns
    assert axis.measured == (0.0, 360.0)
    q = np.tile([[(a.measured[0] + a.measured[1]) / 2 for a in setup.axes]], (4, 1))
    q[:, setup.place("C")] = [0.0, 360.0, 359.9999, 720.0]
    moved = controller.emulate(tables, setup, q)
    # written with six digits behind the point, or in whole sixteenths of a count
    np.testing.assert_allclose(moved - moved[0], 0.0, atol=2e-6)
    if name == "pmac":
        text = "\n".join(controller.write(tables, setup).values())
        spans = re.findall(r"DEFINE COMP \d+,#5D,#\d+,(\d+)", text)
        assert spans
        assert set(spans) == {"360000"}  # counts of a turn: the control rolls the position over there
    if name == "siemens-cec":
        text = "\n".join(controller.write(tables, setup).values())
        numbers = re.findall(r"CEC_INPUT_AXIS\[(\d+)\]=\(C1\)", text)
        assert numbers == re.findall(r"CEC_IS_MODULO\[(\d+)\]=1", text)
        assert numbers


def test_a_part_of_a_turn_does_not_go_round() -> None:
    _, _, setup = tables_of("csv", turntable((0.1, 0.8)))
    assert not setup.axis("C").turns


@pytest.mark.long
@pytest.mark.parametrize("name", ["siemens-cec", "linuxcnc-3d", "csv"])
def test_the_step_where_a_part_of_a_turn_begins_anew_is_that_of_the_control(name: str) -> None:
    """C measured over a third of its turn: a control that counts modulo 360 steps there."""
    volume = turntable((0.0, 1 / 3))
    controller, tables, setup = tables_of(name, volume)
    (seam,) = seams(volume, setup, emulated(controller, tables, setup, volume), 0)
    q = volume.field.outward(fresh_rows(volume, 0).q)
    ends = [np.where(np.arange(q.shape[1]) == setup.place("C"), v, q) for v in (359.999, 0.0)]
    high, low = (controller.emulate(tables, setup, e) for e in ends)
    moved = 1e3 * np.linalg.norm(high - low, axis=1).max()
    assert moved > 5.0
    assert seam.step_um == pytest.approx(moved, rel=0.02)
    assert (seam.joint, seam.travel) == ("C", (0.0, 360.0))
    assert not seam.line(2 * moved).split("FIRST: ")[0]
    assert "more than the 1.0 um rms" in seam.line(1.0)


def test_a_turn_that_was_measured_all_round_has_no_step() -> None:
    volume = turntable((0.0005, 0.9992))
    controller, tables, setup = tables_of("siemens-cec", volume)
    assert not seams(volume, setup, emulated(controller, tables, setup, volume), 0)


@pytest.mark.parametrize(
    ("name", "words", "power"),
    [("klipper", "rotation_distance of [stepper_y]", 1), ("marlin", "M92 Y", -1), ("duet", "M92 Y in config.g", -1)],
)
def test_a_scale_that_no_table_of_a_printer_holds_is_set_beside_them(name: str, words: str, power: int) -> None:
    """An axis that goes too far: its motor's turn is longer than was set, and a mm is fewer steps."""
    machine = read_machine(MILL)
    chain = Chain(machine)
    span = next(b - a for j in machine.joints if j.name == "Y" for a, b in [j.travel])
    volume = volume_of(machine, chain.vector({"Y.dy.1": 0.001 * span / 2}))
    joint = next(k for k, j in enumerate(machine.joints) if j.name == "Y")
    q = np.tile((volume.low + volume.high) / 2, (2, 1))
    q[:, joint] = volume.low[joint], volume.high[joint]
    came = np.ones_like(q)
    ends = volume.field.actual(q, came), volume.field.nominal(q)
    gone, asked = (float(np.linalg.norm(np.diff(p, axis=0))) for p in ends)
    (found,) = scale_advice(volume, volume.setup(None, None)[0], target(name))
    assert found.joint == "Y"
    assert found.scale == pytest.approx(gone / asked - 1, abs=1e-6)
    assert abs(found.scale) == pytest.approx(0.001, rel=0.01)
    assert words in found.line()
    assert f"multiply by {(gone / asked) ** power:.5f}" in found.line()
    assert not scale_advice(volume, volume.setup(None, None)[0], target("isg"))
    (csv,) = scale_advice(volume, volume.setup(None, None)[0], target("csv"))
    assert "or leave it, since this table holds it as well" in csv.line()
