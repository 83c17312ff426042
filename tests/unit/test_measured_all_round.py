"""Which rotary axes count as measured all round: the part of the turn that was left out is no wider than the steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.machine_file import read_machine
from identification.compensation.assessment import emulated
from identification.compensation.seams import seams
from identification.compensation.volume import Volume
from identification.uncertainty.measured_range import all_round, beyond_notes, covered
from tests.helpers.chains import Array, errors
from tests.helpers.compensation import tables_of, volume_of

STEPS = np.arange(0, 360, 22.5)
RNG = np.random.default_rng(3)


@pytest.mark.parametrize(
    ("positions", "round_"),
    [
        pytest.param(STEPS, True, id="equal steps"),
        pytest.param(STEPS - 180, True, id="from another start"),
        pytest.param(RNG.permutation(np.repeat(STEPS, 3)), True, id="in any order, again and again"),
        pytest.param(STEPS + RNG.normal(0, 0.1, 16), True, id="as the scale reads them"),
        pytest.param(np.arange(0, 360, 45), True, id="eight steps"),
        pytest.param(np.arange(0, 360, 120), True, id="three steps"),
        pytest.param(np.append(STEPS, 360), True, id="with both ends"),
        pytest.param(np.arange(0, 330, 5), True, id="a tenth of a turn is open"),
        pytest.param(RNG.uniform(0, 360, 60), True, id="at random"),
        pytest.param(np.linspace(-90, 400, 50), True, id="more than a turn"),
        pytest.param(np.append(STEPS, np.nan), True, id="one is not known"),
        pytest.param(np.arange(0, 280, 22.5), False, id="a gap of 90 at the end"),
        pytest.param(np.arange(0, 320, 22.5), False, id="one step is missing"),
        pytest.param(np.arange(0, 320, 5), False, id="a gap of many fine steps"),
        pytest.param(np.array([0, 180]), False, id="two positions"),
        pytest.param(np.array([0, 10, 20, 200]), False, id="half a turn is open"),
        pytest.param(RNG.uniform(0, 180, 60), False, id="half a turn at random"),
        pytest.param(np.array([30.0]), False, id="one position"),
        pytest.param(np.array([np.nan, np.nan]), False, id="none"),
    ],
)
def test_what_counts_as_measured_all_round(positions: Array, round_: bool) -> None:
    assert all_round(np.radians(positions)) == round_


def trunnion(turn: Array, travel: tuple[float, float] = (0.0, 360.0)) -> tuple[Volume, pd.DataFrame]:
    """A trunnion whose table C was measured at these places, deg, and its rows, mm and rad."""
    machine = read_machine("trunnion_five_axis")
    low, high = np.radians(travel).tolist()
    parts = tuple(replace(e, travel=(low, high)) if e.name == "C" else e for e in machine.elements)
    machine = replace(machine, elements=parts)  # type: ignore[arg-type]
    volume = volume_of(machine, errors(Chain(machine), 2))
    q = np.random.default_rng(0).uniform(volume.low, volume.high, (20 * len(turn), len(volume.low)))
    q[:, 0] = np.radians(np.tile(turn, 20))
    table = pd.DataFrame(q, columns=[j.name for j in machine.joints])
    return Volume.of(volume.field, table, True), table.assign(file="a.csv", row=np.arange(len(q)))


def test_equal_steps_without_the_end_of_the_turn_leave_no_step_there() -> None:
    """Sixteen positions, none at 360 deg: that is the one at 0."""
    volume, _ = trunnion(STEPS)
    controller, tables, setup = tables_of("csv", volume)
    assert setup.axis("C").measured == (0.0, 360.0)
    assert setup.axis("C").turns
    assert not seams(volume, setup, emulated(controller, tables, setup, volume), 0)


@pytest.mark.parametrize(
    ("positions", "travel"),
    [(STEPS[:12], (0.0, 360.0)), (np.arange(-170, 171, 20), (-170.0, 170.0)), (STEPS, (0.0, 345.0))],
    ids=["a part of the turn", "it cannot turn round", "nor can this"],
)
def test_an_axis_that_does_not_go_round_keeps_its_ends(positions: Array, travel: tuple[float, float]) -> None:
    volume, _ = trunnion(positions, travel)
    axis = volume.setup(None, None)[0].axis("C")
    assert not axis.turns
    np.testing.assert_allclose(axis.measured, (positions.min(), positions.max()), atol=1e-9)


def test_nothing_lies_beyond_what_was_measured_all_round() -> None:
    """Eight steps of 45 deg reach 315 only; half of them are a part of the turn."""
    eight = np.arange(0, 360, 45)
    for turn, said in ((eight, False), (eight[:5], True)):
        volume, table = trunnion(turn)
        chain = volume.field.chain
        ranges = covered(chain, table)
        assert ranges["C"] == pytest.approx([0, 180 if said else 360])
        notes = [*beyond_notes(chain, ranges, table.assign(C=np.radians(350)), {})]
        assert any("beyond what was measured of C" in note for note in notes) == said
