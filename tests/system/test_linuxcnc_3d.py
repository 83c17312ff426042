"""The HAL component of the 3-D tables, built with halcompile and run in the real LinuxCNC."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from errormodel.chain import Chain
from errormodel.controllers.linuxcnc_3d import PREFIX, LinuxCnc3d
from errormodel.controllers.setup import Axis, Setup
from errormodel.controllers.tables import LONGER, Table, Tables
from errormodel.machine_file import read_machine
from identification.compensation.assessment import Error, emulated, nothing, remaining
from identification.compensation.rows import Rows
from identification.compensation.volume import Volume
from tests.helpers.chains import Array, errors
from tests.helpers.compensation import tables_of, volume_of
from tests.helpers.linuxcnc import Controller, built, halrun, needed
from tests.helpers.nightly import first_of
from tests.helpers.setups import plain_setup

WRITTEN = 1e-6  # mm: seven digits behind the point in the table, six in a sample of HAL
FAST = 20_000.0  # mm/s: travels of metres
LARGEST_CYCLE_US = 20.0  # of a servo cycle of 1 ms


@pytest.fixture(scope="module")
def component(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The component as LinuxCNC's own tool builds it."""
    needed("halcompile")
    return built(tmp_path_factory.mktemp("component"))


def left_by(volume: Volume, q: Array, motors: Array | None) -> Error:
    """What the machine leaves at commands q (mm, rad), its motors at `motors`, after the best frame."""
    tool = np.tile(np.asarray(volume.field.chain.machine.tool, dtype=np.float64), (len(q), 1))
    rows = Rows(q, np.ones_like(q), tool, np.zeros((len(q), 3)), np.full(len(q), "", dtype=object), "stops")
    return Error.of(remaining(volume, nothing if motors is None else lambda *_: motors, rows), q)


@pytest.mark.long
@pytest.mark.parametrize("name", first_of(["five_axis_table_quill", "fork_head_five_axis"]))
def test_the_real_controller_leaves_what_the_lattice_leaves(name: str, component: Path, tmp_path: Path) -> None:
    machine = read_machine(name)
    volume = volume_of(machine, errors(Chain(machine), 1), (0.02, 0.98))
    target, tables, setup = tables_of("linuxcnc-3d", volume)
    files = target.write(tables, setup)
    for file, text in files.items():
        (tmp_path / file).write_text(text)
    pins = {f"{PREFIX}.share": "f", f"{PREFIX}.time": "s"} | {f"{PREFIX}.{m}.correction": "f" for m in setup.movers}
    linuxcnc = Controller.of(setup, files, component, pins, FAST)
    ends = np.array([a.travel for a in setup.ordered])
    rng = np.random.default_rng(3)
    places = rng.uniform(ends[:, 0], ends[:, 1], (25, len(ends))).round(4)
    places[:2] = ends.T.round(4)
    q, motor, samples = linuxcnc.stands(tmp_path, places)
    moved = motor - q
    movers = [setup.place(m) for m in setup.movers]
    claimed = target.emulate(target.read(files, setup), setup, q)
    np.testing.assert_allclose(moved[:, movers], claimed, atol=WRITTEN)
    # what is left on the machine, inside the volume, against the plain lattice as it is emulated
    to_rad = np.where(volume.field.rotary, np.pi / 180, 1.0)
    inner, motors = q * to_rad, (q + moved) * to_rad
    inside = np.all((inner >= volume.low) & (inner <= volume.high), axis=1)
    csv, plain, _ = tables_of("csv", volume)
    by_csv = emulated(csv, plain, setup, volume)(inner[inside], np.ones_like(inner[inside]), None)
    before, after, lattice = (left_by(volume, inner[inside], m) for m in (None, motors[inside], by_csv))
    assert after.rms_um < 1.1 * lattice.rms_um
    assert after.rms_um < 0.1 * before.rms_um
    share, clocks, correction = samples.other[:, 0], samples.other[:, 1], samples.other[:, 2:]
    moving = (np.abs(np.diff(samples.position, axis=0)).max(axis=1) > 0) & (samples.line[1:] > 0)
    assert np.all(share[1:][moving] == 1.0)  # no motion before the correction is there
    assert np.abs(np.diff(correction, axis=0)).max() <= 5.0 * 1e-3 + 1e-6  # `rate` in a cycle of 1 ms
    assert all(abs(float(samples.pins[f"joint.{k}.f-error"])) < 1e-6 for k in range(len(ends)))
    cycle = clocks / clock_mhz()
    # the median: what the system does in between is not the component's
    assert np.median(cycle) < LARGEST_CYCLE_US


def table_of(setup: Setup, size: float = 0.02) -> tuple[LinuxCnc3d, Tables, dict[str, str]]:
    """Random tables of a setup, with those for the tool's length, and their files."""
    target = LinuxCnc3d()
    terms = target.terms(setup)
    rng = np.random.default_rng(0)
    units = {"": 1.0, LONGER: 1e-3}
    tables = tuple(Table(t, rng.uniform(-size, size, t.shape).round(7) * units[t.factor]) for t in terms)
    files = target.write(tables, setup)
    return target, target.read(files, setup), files


def in_hal(folder: Path, component: Path, lines: list[str], axes: str = "XYZ") -> list[str]:
    """What the lines print that ask HAL, the component loaded with the table in the folder, in a thread of 1 ms."""
    first = [
        "loadrt threads name1=servo-thread period1=1000000",
        f"loadrt errormodel_3d file=$(CONFIG_DIR)/errormodel_3d.table axes={axes} moves=XYZ",
        f"addf {PREFIX} servo-thread",
        *(f"setp {PREFIX}.{n}.homed 1" for n in axes),
    ]
    said = halrun(folder, "\n".join([*first, *lines, ""]), component)
    (folder / "said.txt").write_text(said)
    return [s for s in said.splitlines() if re.fullmatch(r"TRUE|FALSE|[-+\d.e]+", s)]


def asked(*names: str) -> list[str]:
    return [f"getp {PREFIX}.{n}" for n in names]


WAIT = "loadusr -w sleep 0.3"


def files_of_other_axes() -> str:
    plain = plain_setup()
    return table_of(replace(plain, axes=plain.axes[::-1]))[2]["errormodel_3d.table"]


def test_a_table_that_is_missing_cut_or_damaged_corrects_nothing_and_holds_the_feed(
    component: Path, tmp_path: Path
) -> None:
    _, _, files = table_of(plain_setup(tool=(0.0, 0.0, -100.0)))
    text = files["errormodel_3d.table"]
    middle = text.index("values ") + 40
    other = "7" if text[middle] != "7" else "8"
    cases = {
        "it cannot be opened": None,
        "its end is missing": text[: len(text) // 2],
        "its check sum is another": text[:middle] + other + text[middle + 1 :],
        "its axes are not those": files_of_other_axes(),
    }
    for k, (why, wrong) in enumerate(cases.items()):
        folder = tmp_path / str(k)
        folder.mkdir()
        if wrong is not None:
            (folder / "errormodel_3d.table").write_text(wrong)
        lines = [f"setp {PREFIX}.enable 1", f"setp {PREFIX}.X.motor-in 12.5", "start", WAIT]
        found = in_hal(folder, component, [*lines, *asked("valid", "inhibit", "X.motor-out")])
        assert found == ["FALSE", "TRUE", "12.5"], found
        said = (folder / "said.txt").read_text()
        assert "NOTHING IS CORRECTED" in said
        assert why in said


def test_it_is_ramped_limited_clamped_and_follows_the_tool(component: Path, tmp_path: Path) -> None:
    setup = plain_setup(tool=(0.0, 0.0, -100.0))
    target, tables, files = table_of(setup)
    (tmp_path / "errormodel_3d.table").write_text(files["errormodel_3d.table"])
    q, beyond = np.array([[-133.0, 77.0, -111.0]]), np.array([[4000.0, -20.0, -111.0]])

    def at(place: Array) -> list[str]:
        return [f"setp {PREFIX}.{n}.position {v}" for n, v in zip("XYZ", place[0], strict=True)]

    every = [f"{n}.correction" for n in "XYZ"]
    lines = [f"setp {PREFIX}.ramp-time 0.02", f"setp {PREFIX}.X.motor-in 7", f"setp {PREFIX}.X.feedback-in 8", *at(q)]
    lines += ["start", WAIT, *asked(*every, "active")]  # not enabled
    lines += [f"setp {PREFIX}.enable 1", f"setp {PREFIX}.Y.homed 0", WAIT, *asked(*every, "active")]  # not homed
    lines += [f"setp {PREFIX}.Y.homed 1", WAIT, *asked(*every, "active", "outside", "X.motor-out", "X.feedback-out")]
    lines += [
        f"setp {PREFIX}.tool-length 150",
        f"setp {PREFIX}.tool-reference 110",
        WAIT,
        *asked(*every),
    ]  # not asked for
    lines += [f"setp {PREFIX}.tool-follow 1", WAIT, *asked(*every)]
    lines += [f"setp {PREFIX}.tool-follow 0", *at(beyond), WAIT, *asked(*every, "outside")]
    lines += [f"setp {PREFIX}.limit 0.001", WAIT, *asked(*every, "limited")]
    lines += [f"setp {PREFIX}.limit 1", f"setp {PREFIX}.rate 0.00001", *at(q), WAIT, *asked("lagging", "active")]
    lines += [f"setp {PREFIX}.rate 5", f"setp {PREFIX}.X.position nan", WAIT, *asked(*every, "active")]
    found = iter(in_hal(tmp_path, component, lines))

    def numbers(count: int = 3) -> Array:
        return np.array([float(next(found)) for _ in range(count)])

    nothing_yet = [0.0, 0.0, 0.0]
    for _ in range(2):
        assert numbers().tolist() == nothing_yet
        assert next(found) == "FALSE"
    plain = target.emulate(tables, setup, q)[0]
    np.testing.assert_allclose(numbers(), plain, atol=1e-6)
    assert [next(found), next(found)] == ["TRUE", "FALSE"]
    np.testing.assert_allclose(numbers(2), [7 + plain[0], 8 - plain[0]], atol=1e-5)
    np.testing.assert_allclose(numbers(), plain, atol=1e-6)
    longer = target.emulate(tables, setup, q, None, np.array([40.0]))[0]
    assert np.abs(longer - plain).max() > 1e-4
    np.testing.assert_allclose(numbers(), longer, atol=1e-6)
    edge = target.emulate(tables, setup, beyond)[0]
    np.testing.assert_allclose(numbers(), edge, atol=1e-6)
    assert next(found) == "TRUE"
    np.testing.assert_allclose(numbers(), np.clip(edge, -0.001, 0.001), atol=1e-9)
    assert next(found) == "TRUE"
    assert [next(found), next(found)] == ["TRUE", "FALSE"]
    assert numbers().tolist() == nothing_yet
    assert [*found] == ["FALSE"]


def test_a_rotary_axis_of_a_full_turn_goes_round(component: Path, tmp_path: Path) -> None:
    plain = plain_setup()
    table = Axis("C", "C", True, (0.0, 360.0), (0.0, 360.0), (0.0, 0.0, 1.0), 6)
    setup = replace(plain, axes=(*plain.axes, table), tool=(0.0, 0.0, 0.0))
    target, tables, files = table_of(setup)
    assert "turns C" in files["errormodel_3d.table"]
    (tmp_path / "errormodel_3d.table").write_text(files["errormodel_3d.table"])
    lines = [f"setp {PREFIX}.enable 1", f"setp {PREFIX}.ramp-time 0", f"setp {PREFIX}.C.position -710", "start", WAIT]
    here = [f"setp {PREFIX}.{n}.position {v}" for n, v in zip("XYZ", (10.0, 20.0, -60.0), strict=True)]
    found = in_hal(tmp_path, component, [*here, *lines, *asked("X.correction", "outside")], "XYZC")
    wanted = target.emulate(tables, setup, np.array([[10.0, 20.0, -60.0, 10.0]]))[0, 0]
    assert float(found[0]) == pytest.approx(wanted, abs=1e-6)
    assert found[1] == "FALSE"


def clock_mhz() -> float:
    """Frequency of the processor's time stamps."""
    found = re.search(r"^cpu MHz\s*:\s*([\d.]+)", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    assert found is not None
    return float(found[1])
