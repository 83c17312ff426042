"""The real LinuxCNC, headless, with tables that `compensate` wrote: what its motors do is what the tool claims."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.controllers import base as controllers
from errormodel.controllers import target
from errormodel.controllers.linuxcnc import MATRIX
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.compensation.assessment import Error, nothing, remaining
from identification.compensation.compensate import compensate
from identification.compensation.field import Field, movers_of
from identification.compensation.result import Compensation
from identification.compensation.rows import Rows, read_rows
from identification.compensation.volume import Volume
from identification.estimation.fit import fit_machine
from identification.results.store import load, save
from tests.helpers.chains import Array, errors
from tests.helpers.commands import MILL
from tests.helpers.firmware import source
from tests.helpers.linuxcnc import Controller, compiled, left_behind, needed, stop_programme
from tests.helpers.nightly import first_of
from tests.helpers.surveys import measured, positions, survey

pytestmark = pytest.mark.usefixtures("few_poses")
UM = 1e-3
LAG = -20 * UM  # of X behind its direction of travel
COVERED = 0.8  # of each travel, in its middle: beyond it tables hold their ends
# mm: six digits behind the point in the files, and as many in a sample of HAL at positions of some hundred mm
WRITTEN = 2e-6


@dataclass(frozen=True)
class Worn:
    """A mill with play in X whose survey covered the middle of its travels: what is true, and its fit."""

    truth: Field
    folder: Path


@pytest.fixture(scope="module")
def worn(tmp_path_factory: pytest.TempPathFactory) -> Worn:
    needed()
    machine = replace(read_machine(MILL), effects=(EffectSpec("backlash", {"joint": "X"}),))
    chain, plain = Chain(machine), Chain(read_machine(MILL))
    p = dict(zip(plain.ids, errors(plain, 3).tolist(), strict=True)) | {chain.effect_ids[0][0]: LAG}
    rng = np.random.default_rng(0)
    travel = np.array([j.travel for j in machine.joints])
    middle, half = travel.mean(axis=1), COVERED * np.ptp(travel, axis=1) / 2
    points = pd.DataFrame(
        rng.uniform(middle - half, middle + half, (150, 3)), columns=[j.name for j in machine.joints]
    ).assign(tool_x=0.0, tool_y=0.0, tool_z=-100.0)
    table = positions(measured(machine, chain.vector(p), seed=4, noise=0.5 * UM, points=points))
    folder = tmp_path_factory.mktemp("worn") / "fit"
    save(fit_machine(machine, survey(table)), folder)
    return Worn(Field(chain, chain.vector(p), movers_of(chain)), folder)


def ends_and_middle(result: Compensation, count: int) -> Array:
    """Random places over the travels, and each axis to both its ends, approached from both sides; (n, axes)."""
    rng = np.random.default_rng(5)
    axes = result.setup.ordered
    low, high = (np.array([a.travel[k] for a in axes]) for k in (0, 1))
    middle = (low + high) / 2
    there = np.linspace(low, high, 9)
    inside = rng.uniform(low, high, (count, len(axes)))
    return np.vstack([there, there[-2::-1], middle, inside]).round(4)


def came_from(places: Array, start: Array) -> Array:
    """Directions (n, axes) of the last motion of each axis; the controller begins with +1."""
    out, last = [], np.ones(places.shape[1])
    for step in np.diff(np.vstack([start, places]), axis=0):
        last = np.where(step != 0, np.sign(step), last)
        out.append(last)
    return np.array(out)


def left_by(field: Field, volume: Volume, q: Array, direction: Array, motors: Array | None) -> Error:
    """What the true machine leaves at commands q, its motors at `motors`, after the best frame; mm and rad."""
    truth = replace(volume, field=field)
    tool = np.tile(np.asarray(field.chain.machine.tool, dtype=np.float64), (len(q), 1))
    rows = Rows(q, direction, tool, np.zeros((len(q), 3)), np.full(len(q), "", dtype=object), "stops")
    return Error.of(remaining(truth, nothing if motors is None else lambda *_: motors, rows), field.outward(q))


@pytest.fixture(scope="module")
def matrixkins(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """LinuxCNC's own kinematics with a matrix, from a checkout: not every package of 2.9 has them."""
    needed("halcompile")
    place = "src/hal/components/matrixkins.comp"
    folder = tmp_path_factory.mktemp("matrixkins")
    shutil.copy(source("ERRORMODEL_LINUXCNC", place) / place, folder)
    done = compiled(folder / "matrixkins.comp")
    if done.returncode:
        pytest.skip(f"matrixkins of that checkout is not of the LinuxCNC that is installed: {done.stderr[-200:]}")
    return folder / "matrixkins.so"


def test_a_matrix_moves_the_joints_of_the_real_controller_as_claimed(
    matrixkins: Path, worn: Worn, tmp_path: Path
) -> None:
    """Squareness by matrixkins, screws by their files, which count where the matrix has put the joints."""
    result = compensate(worn.folder, "linuxcnc-matrix")
    (stated,) = result.sets
    for file, text in stated.files.items():
        (tmp_path / file).write_text(text)
    linuxcnc = Controller.of(result.setup, stated.files, matrixkins)
    places = ends_and_middle(result, 20)
    low, high = np.array([a.travel for a in result.setup.ordered]).T
    places = np.clip(places, low + 1.0, high - 1.0)  # limits are those of the joints, too
    samples = linuxcnc.run(tmp_path, stop_programme(linuxcnc.letters, places))
    matrix = np.reshape([float(v) for _, _, v in MATRIX.findall(stated.files["matrix.hal"])], (3, 3))
    assert np.abs(matrix - np.eye(3)).max() > 5e-6
    joints, motors = samples.stops(places @ matrix.T)
    np.testing.assert_allclose(joints, places @ matrix.T, atol=WRITTEN)
    order = [linuxcnc.letters.index(a.name) for a in result.setup.axes]
    came = came_from(places, (places[0] + places[8]) / 2)[:, order]
    controller, q = target("linuxcnc-matrix"), places[:, order]
    assert isinstance(controller, controllers.Controller)
    movers = [result.setup.place(m) for m in result.setup.movers]
    claimed = controller.emulate(stated.tables, result.setup, q, came)
    np.testing.assert_allclose((motors[:, order] - q)[:, movers], claimed, atol=WRITTEN)
    assert not left_behind()


@pytest.mark.parametrize("name", first_of(["linuxcnc-type1", "linuxcnc-type0"]))
def test_screw_tables_move_the_motors_of_the_real_controller_as_claimed(name: str, worn: Worn, tmp_path: Path) -> None:
    result = compensate(worn.folder, name)
    (stated,) = result.sets
    for file, text in stated.files.items():
        (tmp_path / file).write_text(text)
    linuxcnc = Controller.of(result.setup, stated.files)
    places = ends_and_middle(result, 30)
    q, motor, _ = linuxcnc.stands(tmp_path, places)
    moved = motor - q
    order = [linuxcnc.letters.index(a.name) for a in result.setup.axes]
    came = came_from(places, (places[0] + places[8]) / 2)[:, order]
    controller = target(name)
    assert isinstance(controller, controllers.Controller)
    claimed = controller.emulate(stated.tables, result.setup, q, came)
    movers = [result.setup.place(m) for m in result.setup.movers]
    np.testing.assert_allclose(moved[:, movers], claimed, atol=WRITTEN)
    # the play itself: the same place from both sides
    assert moved[7, 0] - moved[9, 0] == pytest.approx(-LAG, rel=0.2)
    # a survey of the middle 80 %: what the motors get at the upper end of the travel is the last node's
    last = {t.term.output: t.values[-1] for t in stated.tables if t.term.direction >= 0}
    np.testing.assert_allclose(moved[8, movers], [last[m] for m in result.setup.movers], atol=WRITTEN)
    # what the true machine has left where the real controller put its motors, and what the tool said
    fit = load(worn.folder)
    table = read_rows(worn.folder, fit.chain.machine)
    volume = Volume.of(Field.of(fit, table), table, True)
    inside = np.all((q >= volume.low) & (q <= volume.high), axis=1)
    before, after = (left_by(worn.truth, volume, q[inside], came[inside], m) for m in (None, (q + moved)[inside]))
    assert after.rms_um < 0.75 * before.rms_um
    # at some thirty stops a root mean square is known to a tenth or so
    assert after.rms_um == pytest.approx(stated.figures[0].after.rms_um, rel=0.2)
    assert not left_behind()
