"""What holds for every controller of reversal errors: each is said, and what is said of it is what is left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from errormodel.chain import Chain
from errormodel.controllers import registry, target
from errormodel.controllers.base import Controller
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.compensation.assessment import Correct, emulated, fresh_rows
from identification.compensation.compensate import best_tables
from identification.compensation.reversal_effects import ReversalError, reversal_errors
from identification.compensation.volume import Volume
from tests.helpers.chains import Array
from tests.helpers.commands import FIVE, MILL
from tests.helpers.compensation import UM, volume_of

TABLED = sorted(n for n, kind in registry().items() if issubclass(kind, Controller))
BY_DIRECTION = ("linuxcnc-type0", "linuxcnc-type1", "linuxcnc-matrix", "siemens-cec", "twincat-nc")
WIDTH = 40.0  # mm
pytestmark = pytest.mark.usefixtures("few_poses")

ALONG = EffectSpec("hysteresis", {"joint": "X", "width": WIDTH})
YAW = EffectSpec("hysteresis", {"joint": "X", "width": WIDTH, "motion": "ec"})
BACKLASH = EffectSpec("backlash", {"joint": "X"})
SIZES = {"X.dx.hysteresis": 20 * UM, "X.ec.hysteresis": 50e-6, "X.dx.backlash": -16 * UM}


def reversing(effects: Sequence[EffectSpec], name: str = MILL, short: str = "X", **more: float) -> Volume:
    """A machine without other errors but a scale of X; `short`: the joint of which most strokes were short, if any."""
    machine = replace(read_machine(name), effects=tuple(effects))
    values = {i: v for i, v in {**SIZES, "X.dx.1": 30 * UM, **more}.items() if i in Chain(machine).index}
    volume = volume_of(machine, Chain(machine).vector(values))
    return replace(volume, field=replace(volume.field, short=frozenset({short} if short else ())))


def said_of(name: str, volume: Volume) -> tuple[list[ReversalError], Correct]:
    controller = target(name)
    assert isinstance(controller, Controller)
    setup = volume.planned.setup(None, None)[0]
    tables = best_tables(controller, setup, volume.planned)
    correct = emulated(controller, tables, setup, volume)
    return list(reversal_errors(volume, correct, 0, controller, setup, tables, [], [])), correct


def at_reversal(volume: Volume, correct: Correct, joint: int = 0) -> tuple[Array, Array, Array]:
    """Halves of the difference of both directions of a joint at the tip (n, 3), um, without tables, with them after
    long strokes, and with them at once after a joint turned round, when a play has moved nothing yet."""
    field, rows = volume.field, fresh_rows(volume, 0)
    up, down = rows.direction.copy(), rows.direction.copy()
    up[:, joint], down[:, joint] = 1.0, -1.0
    plays = np.ones((len(up), len(field.plays)))
    turned_up, turned_down = np.hstack([up, -plays]), np.hstack([down, plays])
    before = field.actual(rows.q, up) - field.actual(rows.q, down)
    after, short = (
        field.actual(correct(rows.q, a, None), a) - field.actual(correct(rows.q, b, None), b)
        for a, b in ((up, down), (turned_up, turned_down))
    )
    return 500 * before, 500 * after, 500 * short


def rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(np.square(errors).sum(axis=1))))


@pytest.mark.parametrize("effect", [ALONG, YAW], ids=["along", "yaw"])
@pytest.mark.parametrize("name", TABLED)
def test_a_hysteresis_is_said_and_is_never_made_larger(name: str, effect: EffectSpec) -> None:
    """No control knows how far an axis has moved since it turned: by direction, short strokes get twice the error.

    Where the survey had mostly such strokes tables hold the mean.
    """
    volume = reversing([effect])
    (said,), correct = said_of(name, volume)
    before, after, short = at_reversal(volume, correct)
    assert (said.effect, said.joint, said.held, said.width) == ("hysteresis", "X", "none", WIDTH)
    assert said.size_um == pytest.approx(rms(before), rel=1e-6)
    assert said.size_um > 2.0
    assert said.left_um == pytest.approx(rms(after), rel=1e-6)
    assert said.worst_um == pytest.approx(np.linalg.norm(before, axis=1).max(), rel=1e-6)
    assert np.linalg.norm(short, axis=1).max() < 1.01 * said.worst_um
    what = {"along": "position of X, 20 um", "yaw": "turn of X about z (ECX), 50 urad"}[
        "along" if effect is ALONG else "yaw"
    ]
    assert said.line().startswith(f"{what} peak to peak, on reversal (hysteresis within 40 mm), ")
    assert "not in these tables, which hold the mean of both directions" in said.line()
    assert "after strokes shorter than 40 mm up to" in said.line()


@pytest.mark.parametrize("effect", [ALONG, YAW], ids=["along", "yaw"])
@pytest.mark.parametrize("name", TABLED)
def test_a_hysteresis_of_long_strokes_follows_the_direction(name: str, effect: EffectSpec) -> None:
    """As backlash does, where a control has tables for it; what is left after short strokes is said."""
    volume = reversing([effect], short="")
    (said,), correct = said_of(name, volume)
    before, after, short = at_reversal(volume, correct)
    assert said.left_um == pytest.approx(rms(after), rel=1e-6)
    assert (said.held == "none") == (rms(after) > 0.9 * rms(before))
    if effect is ALONG:
        assert (said.held != "none") == (name in BY_DIRECTION)
    assert np.linalg.norm(short, axis=1).max() < 2.02 * said.worst_um
    assert ("after strokes shorter than 40 mm up to" in said.line()) == (said.held != "none")


@pytest.mark.parametrize("name", TABLED)
def test_backlash_beside_a_hysteresis_is_said_apart_from_it(name: str) -> None:
    volume = reversing([BACKLASH, YAW])
    (backlash, yaw), correct = said_of(name, volume)
    _, after, _ = at_reversal(volume, correct)
    assert yaw.held == "none"
    assert "not in these tables" in yaw.why
    assert backlash.held == ("all" if name in BY_DIRECTION else "none")
    assert ("by direction of travel" in backlash.why) == (name in BY_DIRECTION)
    assert backlash.size_um == pytest.approx(8.0, abs=0.1)
    if name in BY_DIRECTION:
        assert np.hypot(backlash.left_um, yaw.left_um) == pytest.approx(rms(after), rel=0.02)


def test_a_tilt_of_a_rotary_axis_is_said_in_degrees() -> None:
    machine = read_machine(FIVE)
    table = next(j.name for j in machine.joints if j.type == "rotary")
    spec = EffectSpec("hysteresis", {"joint": table, "width": float(np.radians(21)), "motion": "ea"})
    volume = reversing([spec], FIVE, table, **{f"{table}.ea.hysteresis": 50e-6})
    (said,), _ = said_of("siemens-cec", volume)
    assert said.line().startswith(f"tilt of {table} about x (EA{table}), 50 urad peak to peak, on reversal (hysteresis")
    assert "within 21 deg" in said.line()
    assert said.outside.probability is None
    assert said.outside.line().startswith(f"hysteresis of {table}, ")
