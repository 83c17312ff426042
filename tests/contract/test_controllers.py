"""What holds for every controller: files read back to the same correction, wrong ones are refused, signs are right."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from errormodel.controllers import isg, klipper_probe, registry, siemens, target
from errormodel.controllers.base import Controller, Rewriter
from errormodel.controllers.grids import anchored_grid, even_grid, hats
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Table, Tables, Term
from errormodel.controllers.thermal import Growth, laws_of
from errormodel.exceptions import InputError
from tests.helpers.setups import filled, plain_setup, setups

TABLED = sorted(n for n, kind in registry().items() if issubclass(kind, Controller))
few = settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def tabled(name: str) -> Controller:
    controller = target(name)
    assert isinstance(controller, Controller)
    return controller


def written(name: str, setup: Setup, seed: int = 0) -> tuple[Controller, Tables, dict[str, str]]:
    controller = tabled(name)
    terms = controller.structures(setup)[-1]
    tables = filled(controller, setup, terms[: controller.most_tables], np.random.default_rng(seed))
    return controller, tables, controller.write(tables, setup)


@pytest.mark.parametrize("name", TABLED)
@given(setup=setups(), seed=st.integers(0, 1000))
@few
def test_files_read_back_to_the_same_correction(name: str, setup: Setup, seed: int) -> None:
    controller, tables, files = written(name, setup, seed)
    again = controller.read(files, setup)
    rng = np.random.default_rng(seed)
    travel = np.array([a.travel for a in setup.axes])
    q = rng.uniform(travel[:, 0], travel[:, 1], (200, len(setup.axes)))
    came = rng.choice([-1.0, 1.0], q.shape)
    before, after = (controller.emulate(t, setup, q, came) for t in (tables, again))
    assert np.abs(before).max() > 0
    count = max(sum(t.term.output == o for t in tables) for o in {t.term.output for t in tables})
    assert np.abs(after - before).max() <= count * controller.quantum(setup) * 1.001
    assert controller.write(again, setup) == files  # and a second time to the same bytes


@given(
    values=st.lists(st.floats(-0.3, 0.3), min_size=2, max_size=33),
    ends=st.tuples(st.integers(-300, 100), st.integers(150, 400)),
    rates=st.tuples(st.floats(-0.01, 0.01), st.floats(-1e-4, 1e-4)),
)
@few
def test_probe_and_temperature_files_read_back_to_the_same_correction(
    values: list[float], ends: tuple[int, int], rates: tuple[float, float]
) -> None:
    setup = plain_setup(probe=(20.0, -5.0))
    twist = klipper_probe.Twist(*map(float, ends), np.array(values))
    again = klipper_probe.read(klipper_probe.write({"X": twist, "Y": twist}, setup))
    x = np.linspace(ends[0] - 1.0, ends[1] + 1.0, 100)
    for back in again.values():
        assert np.abs(back.at(x) - twist.at(x)).max() < 2e-6
    law = Growth("X", *rates, "T_x.1", 21.3)
    for write in (siemens.temperature_file, isg.temperature_file):
        (back_law,) = [g for text in write([law]).values() for g in laws_of(text)]
        moved, moved_again = (g.at({"T_x.1": 30.0}, x) for g in (law, back_law))
        assert np.abs(moved - moved_again).max() < 1e-6


@pytest.mark.parametrize("name", TABLED)
def test_a_file_that_was_cut_is_refused_or_read_never_a_crash(name: str) -> None:
    setup = plain_setup()
    controller, _, files = written(name, setup)
    rng, refused = np.random.default_rng(1), 0
    for file, text in files.items():
        for cut in rng.integers(0, len(text), 25):
            try:
                controller.read({**files, file: text[:cut]}, setup)
            except InputError:
                refused += 1
        with pytest.raises(InputError):
            controller.read({}, setup)
    assert refused > 5


@pytest.mark.parametrize("name", TABLED)
def test_beyond_the_table_the_edge_holds(name: str) -> None:
    setup = plain_setup()
    controller, tables, _ = written(name, setup)
    tables = tuple(t for t in tables if t.term.inputs and not t.term.factor and len(t.term.output) == 1)
    low = np.array([[a.measured[0] for a in setup.axes]])
    grids = [g[0] for t in tables for g in t.term.grids[:1]]
    if not grids:
        pytest.skip("error parameters: their levers grow with the position")
    inside, outside = np.minimum(low, min(grids)), np.minimum(low, min(grids)) - 500.0
    np.testing.assert_allclose(controller.emulate(tables, setup, inside), controller.emulate(tables, setup, outside))


@pytest.mark.parametrize("name", [n for n in TABLED if tabled(n).doubt])
def test_what_is_doubtful_says_so_in_its_files_and_names_the_check(name: str) -> None:
    _, _, files = written(name, plain_setup())
    text = "\n".join(files.values())
    assert "NOT CERTAIN" in text
    assert "sign_test/steps.txt" in text.lower()


@pytest.mark.parametrize("name", TABLED)
def test_every_controller_declares_what_is_its_own(name: str) -> None:
    controller = tabled(name)
    assert isinstance(controller.backlash_parameter, str)
    assert controller.comment is None or controller.comment.start
    assert controller.sign_known or (controller.doubt and controller.other_sign)
    assert controller.dialect is None or controller.dialect.source
    assert "{}" in controller.number_form
    assert controller.address(plain_setup(), "X")


def gridded(controller: Controller, setup: Setup, change: Callable[[tuple[float, ...]], tuple[float, ...]]) -> Tables:
    """Tables of zeros for all terms over the first axis that has a table, its positions changed."""
    terms = controller.structures(setup)[-1]
    first = next((t.inputs[0] for t in terms if t.inputs), "")
    if not first:
        pytest.skip("skew alone: no tables over positions")
    grids = [tuple(change(g) if i == first else g for i, g in zip(t.inputs, t.grids, strict=True)) for t in terms]
    new = [replace(t, grids=g) for t, g in zip(terms, grids, strict=True)]
    return tuple(Table(t, np.zeros(t.shape)) for t in new[: controller.most_tables])


# formats that state every position
UNEVEN = (
    "linuxcnc-type0",
    "linuxcnc-type1",
    "linuxcnc-3d",
    "heidenhain",
    "isg",
    "etalon",
    "csv",
)


@pytest.mark.parametrize("name", TABLED)
def test_too_many_points_are_refused(name: str) -> None:
    controller, setup = tabled(name), plain_setup()
    most = controller.most_points

    def more(grid: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(float(round(grid[0] + (grid[-1] - grid[0]) * k / 2**15, 9)) for k in range(most + 1))

    with pytest.raises(InputError, match=f"{most + 1} points"):
        controller.write(gridded(controller, setup, more), setup)
    with pytest.raises(InputError, match="--points"):
        controller.structures(replace(setup, points=10_001))


@pytest.mark.parametrize("name", TABLED)
def test_positions_that_do_not_increase_are_refused(name: str) -> None:
    controller, setup = tabled(name), plain_setup()
    with pytest.raises(InputError, match="positions do not increase"):
        controller.write(gridded(controller, setup, lambda g: (*g[:-2], g[-1], g[-2])), setup)


@pytest.mark.parametrize("name", TABLED)
def test_a_step_that_does_not_divide_the_range_is_refused_or_kept(name: str) -> None:
    controller, setup = tabled(name), plain_setup()
    tables = gridded(controller, setup, lambda g: (*g[:-1], g[-1] + 0.4 * (g[-1] - g[-2])))
    try:
        files = controller.write(tables, setup)
    except InputError as refused:
        assert "no step divides evenly" in refused.found  # noqa: PT017  one of two good ends
        assert name not in UNEVEN
    else:
        assert {t.term.grids for t in controller.read(files, setup)} == {t.term.grids for t in tables}


@pytest.mark.parametrize("name", UNEVEN)
def test_a_format_that_states_every_position_takes_uneven_ones(name: str) -> None:
    controller, setup = tabled(name), plain_setup()
    tables = gridded(controller, setup, lambda g: (*g[:-1], g[-1] + 0.4 * (g[-1] - g[-2])))
    again = controller.read(controller.write(tables, setup), setup)
    assert {t.term.grids for t in again} == {t.term.grids for t in tables}


def test_pmac_refuses_more_tables_than_motors() -> None:
    table = Table(Term("X", ("X",), ((0.0, 100.0, 200.0),)), np.zeros(3))
    with pytest.raises(InputError, match="33 tables"):
        tabled("pmac").write((table,) * 33, plain_setup())


def test_siemens_refuses_a_step_that_does_not_fit_its_number_of_points() -> None:
    controller, _, files = written("siemens-lec", plain_setup())
    text = re.sub(r"(COMP_STEP\[0,X1\]=).*", r"\g<1>6.73", files["AX_EEC.INI"])
    with pytest.raises(InputError, match=r"in steps of 6\.73"):
        controller.read({"AX_EEC.INI": text}, plain_setup())


def test_fanuc_refuses_what_an_increment_cannot_hold() -> None:
    setup = plain_setup()
    table = Table(Term("X", ("X",), ((0.0, 100.0, 200.0),)), np.array([0.0, 0.02, 0.03]))
    with pytest.raises(InputError, match="a step of 20 detection units"):
        tabled("fanuc-pitch").write((table,), setup)
    tabled("fanuc-pitch").write((table,), replace(setup, resolution=0.005))  # coarser units hold it


def test_pmac_refuses_a_value_at_the_motors_zero() -> None:
    table = Table(Term("X", ("X",), ((0.0, 100.0, 200.0),)), np.array([0.01, 0.02, 0.03]))
    with pytest.raises(InputError, match="at the motor's zero"):
        tabled("pmac").write((table,), plain_setup())


def test_duet_refuses_more_points_than_the_board_holds() -> None:
    grid = tuple(np.linspace(0, 300, 22).round(6).tolist())
    with pytest.raises(InputError, match="22 points"):
        tabled("duet").write((Table(Term("Z", ("X", "Y"), (grid, grid)), np.zeros((22, 22))),), plain_setup())


@pytest.mark.parametrize("low", [120.0, -620.0])
def test_fanuc_has_the_reference_point_among_the_points(low: float) -> None:
    """Machine zero outside the travel: the edge holds up to there, and 3620 lies between 3621 and 3622."""
    plain = plain_setup()
    x = replace(plain.axis("X"), travel=(low, low + 500.0), measured=(low, low + 500.0))
    setup = replace(plain, axes=(x, *plain.axes[1:]))
    controller, tables, files = written("fanuc-pitch", setup)
    number = {k: int(v) for k, v in re.findall(r"N(362[0-2])A1P(-?\d+)", files["pitch.txt"])}
    assert number["3621"] <= number["3620"] <= number["3622"]
    assert number["3622"] - number["3621"] < controller.most_points
    q = np.array([[x, 0.0, -100.0] for x in np.linspace(low - 50.0, low + 550.0, 40)])
    before, after = (controller.emulate(t, setup, q) for t in (tables, controller.read(files, setup)))
    assert np.abs(after - before).max() <= controller.quantum(setup)


def test_fanuc_increments_add_up_within_one_unit() -> None:
    """Rounding each increment by itself would drift; the sum is rounded instead."""
    grid = tuple(float(x) for x in range(0, 1000, 10))
    values = 0.0004 * np.arange(100)
    setup = plain_setup()
    text = tabled("fanuc-pitch").write((Table(Term("X", ("X",), (grid,)), values),), setup)["pitch.txt"]
    steps = [int(v) for v in re.findall(r"N1\d{4}P(-?\d+)", text)]
    assert {*steps} == {0, 1}
    assert np.abs(0.001 * np.cumsum(steps) - values).max() <= 0.0005 + 1e-12


def test_klipper_follows_its_firmware() -> None:
    """skew_correction.py: x - y f_xy - z (f_xz - f_xy f_yz), y - z f_yz; bed_mesh.py adds to z."""
    setup = plain_setup()
    xy, xz, yz = 1e-3, -2e-3, 3e-3
    skews = [Term("X", (), (), "Y"), Term("X", (), (), "Z"), Term("Y", (), (), "Z")]
    tables = tuple(Table(t, np.array(-1000 * f)) for t, f in zip(skews, (xy, xz, yz), strict=True))
    x, y, z = 50.0, 120.0, -70.0
    moved = tabled("klipper").emulate(tables, setup, np.array([[x, y, z]]))[0]
    np.testing.assert_allclose(moved, [-y * xy - z * (xz - xy * yz), -z * yz, 0], atol=1e-12)


@pytest.mark.parametrize("name", ["klipper", "duet"])
def test_a_height_map_is_looked_up_where_the_skew_has_put_the_axes(name: str) -> None:
    setup, (mesh,) = plain_setup(), [t for t in tabled(name).terms(plain_setup()) if t.inputs]
    slope = 0.01  # mm of height a mm of X
    heights = np.broadcast_to(slope * np.array(mesh.grids[0])[:, None], mesh.shape)
    tables = (Table(Term("X", (), (), "Y"), np.array(5.0)), Table(mesh, heights))
    x, y = 50.0, 120.0
    moved = tabled(name).emulate(tables, setup, np.array([[x, y, -70.0]]))[0]
    np.testing.assert_allclose(moved, [0.005 * y, 0, slope * (x + 0.005 * y)], atol=1e-12)


def test_linuxcnc_has_a_column_for_each_direction() -> None:
    setup = plain_setup(reversing=frozenset({"X"}))
    controller, tables, files = written("linuxcnc-type1", setup)
    assert {t.term.direction for t in tables if t.term.output == "X"} == {1, -1}
    first = files["joint_0_X.comp"].split()
    assert first[1] != first[2]
    q = np.full((2, 3), -100.0)
    up, down = controller.emulate(tables, setup, q, np.array([[1.0] * 3, [-1.0] * 3]))
    assert up[0] != down[0]
    assert up[1] == down[1]


@given(st.floats(-1e4, 1e4), st.floats(0.5, 1e4), st.integers(1, 300))
@few
def test_grids_cover_what_was_measured(low: float, span: float, intervals: int) -> None:
    for make in (even_grid, anchored_grid):
        grid = np.array(make(low, low + span, intervals))
        assert grid[0] <= low + 1e-6 and grid[-1] >= low + span - 1e-6  # noqa: PT018
        assert len(grid) <= max(intervals, 2) + 1
        np.testing.assert_allclose(np.diff(grid), grid[1] - grid[0], rtol=1e-6)
    step = np.array(anchored_grid(low, low + span, intervals))
    number = step / np.diff(step).mean()
    np.testing.assert_allclose(number, np.rint(number), atol=1e-5)


def test_hats_interpolate_what_is_linear_in_each_axis() -> None:
    grids = ((0.0, 1.0, 3.0), (-2.0, 5.0))
    q = np.random.default_rng(0).uniform([0, -2], [3, 5], (50, 2))
    nodes = np.stack(np.meshgrid(*grids, indexing="ij"), axis=-1).reshape(-1, 2)
    values = 2 + nodes[:, 0] - 3 * nodes[:, 1] + 0.5 * nodes.prod(axis=1)
    np.testing.assert_allclose(hats(grids, q) @ values, 2 + q[:, 0] - 3 * q[:, 1] + 0.5 * q.prod(axis=1))


def test_every_target_cites_its_source_and_has_a_checklist() -> None:
    setup = plain_setup()
    for name, kind in registry().items():
        made = target(name)
        assert kind.source
        assert len(made.checklist(setup)) >= 2
        assert isinstance(made, Controller | Rewriter)


def test_an_unknown_controller_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(InputError, match="Did you mean 'klipper'"):
        target("kliper")
