"""How much work `compensate` does: models evaluated, programmes solved; counted, as time is not the same twice."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from errormodel.chain import Chain
from errormodel.controllers import target
from errormodel.controllers.base import Controller
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.compensation import minimax, reduction
from identification.compensation.compensate import best_tables
from identification.compensation.designs import Design, Designs
from identification.compensation.field import Field, movers_of
from identification.compensation.inverse import CLOSED_MM, inverse
from identification.compensation.minimax import Slopes
from identification.compensation.reduction import _Task, leftover, reduce
from identification.compensation.sample import Sample
from identification.compensation.volume import Volume
from tests.helpers.chains import Array, errors
from tests.helpers.commands import MILL

PLAY = 0.024  # mm


def worn(share: float = 1.0, seed: int = 3) -> Volume:
    """A mill with random errors and, for a `share` above 0, play of X."""
    plain = read_machine(MILL)
    machine = replace(plain, effects=(EffectSpec("backlash", {"joint": "X"}),)) if share else plain
    chain, bare = Chain(machine), Chain(plain)
    values = dict(zip(bare.ids, errors(bare, seed).tolist(), strict=True))
    if share:
        values[chain.effect_ids[0][0]] = share * PLAY
    travel = np.array([j.travel for j in machine.joints])
    field = Field(chain, chain.vector(values), movers_of(chain), {})
    return Volume(field, travel[:, 0], travel[:, 1], True)


def controller_of(name: str) -> Controller:
    controller = target(name)
    assert isinstance(controller, Controller)
    return controller


@pytest.mark.long
def test_a_play_that_tables_cannot_hold_asks_for_few_programmes(monkeypatch: pytest.MonkeyPatch) -> None:
    volume, controller = worn(), controller_of("isg")
    setup, asked = volume.setup(None, None)[0], list[int]()
    solved = minimax._optimum

    def counted(problem: Any, x: Any) -> Array | None:
        asked.append(sum(c.size for c in problem.constraints))
        return solved(problem, x)

    monkeypatch.setattr(minimax, "_optimum", counted)
    sample = volume.sample(setup, 3000)
    tables = reduce(controller, setup, controller.structures(setup)[1], sample)
    assert 1 <= len(asked) <= 10  # 16 rounds and more, with 600 poses, where sides are drawn by chance
    assert max(asked) < 500  # scalars of a programme's constraints; thousands where every pose is active
    # no table without sides can do better than half the play; the search ends this close to what it knows to be best
    gap = 1 + minimax.BOUND_GAP_SHARE + minimax.DISTANCE_PRICE
    assert leftover(controller, setup, tables, sample) < gap * PLAY / 2


def test_states_of_a_machine_with_the_same_poses_share_their_designs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Errors differ from state to state, poses and tables do not: the second state factors no matrix again."""
    made = list[int]()
    of = Design.of.__func__  # type: ignore[attr-defined]

    def counted(cls: type[Design], *given: Any) -> Design:
        made.append(1)
        return of(cls, *given)  # type: ignore[no-any-return]

    monkeypatch.setattr(Design, "of", classmethod(counted))
    volume, controller, designs = worn(0.0), controller_of("siemens-cec"), Designs(2)
    setup = volume.setup(8, None)[0]
    warm = replace(volume, field=replace(volume.field, values=1.5 * volume.field.values))
    found, counts = [], []
    for state in (volume, warm):
        found.append(best_tables(controller, setup, state, designs))
        counts.append(len(made))
    assert counts[0] > 0
    assert counts[1] == counts[0]
    alone = best_tables(controller, setup, warm, Designs(2))
    assert [t.term for t in alone] == [t.term for t in found[1]]
    for one, other in zip(alone, found[1], strict=True):
        np.testing.assert_allclose(one.values, other.values, atol=1e-9)


def test_programmes_end_where_their_work_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is found by then is no worse than least squares, and close to what all rounds find."""
    volume, controller = worn(0.0), controller_of("aerotech-1d")
    setup = volume.setup(None, None)[0]
    sample = volume.sample(setup, 1000)
    worst, rounds = {}, list[int]()
    programme = minimax._Near.programme
    monkeypatch.setattr(minimax._Near, "programme", lambda *given: (rounds.append(1), programme(*given))[1])
    for work in (1.0, np.inf):
        rounds.clear()
        monkeypatch.setattr(reduction, "MOST_WORK", work)
        tables = reduce(controller, setup, controller.terms(setup), sample)
        worst[work] = leftover(controller, setup, tables, sample)
        assert len(rounds) == 2 if work == 1.0 else len(rounds) >= 2
    monkeypatch.setattr(_Task, "best", lambda task, work: task.least)
    least = leftover(controller, setup, reduce(controller, setup, controller.terms(setup), sample), sample)
    assert worst[np.inf] <= worst[1.0] * (1 + minimax.BOUND_GAP_SHARE)
    assert worst[1.0] <= least * (1 + 1e-6)


def test_a_table_without_sides_is_that_of_the_mean_of_both() -> None:
    """The tables of a mill with play are those of the same mill without, for a format that knows no sides."""
    controller = controller_of("aerotech-1d")
    values = []
    for share in (0.0, 1.0):
        volume = worn(share)
        setup = volume.setup(8, None)[0]
        sample = volume.sample(setup, 500)
        tables = reduce(controller, setup, controller.terms(setup), sample)
        values.append(tables)
        assert sample.sides == (2 if share else 1)
        assert_both_sides(sample)
    for plain, played in zip(*values, strict=True):
        span = np.ptp(plain.values)
        assert np.abs(plain.values - played.values).max() < max(0.25 * span, 0.002)


def assert_both_sides(sample: Sample) -> None:
    if sample.sides == 2:
        half = len(sample.q) // 2
        np.testing.assert_array_equal(sample.q[:half], sample.q[half:])
        np.testing.assert_array_equal(sample.direction[:half], -sample.direction[half:])


def test_the_last_value_runs_away_less_than_where_every_value_is_free(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond the measured region the last value is held: it should not serve the one pose in the corner."""
    volume, controller = worn(0.0, seed=1), controller_of("linuxcnc-type1")
    setup = volume.setup(None, None)[0]
    terms, sample = controller.terms(setup), volume.sample(setup, 3000)
    ends, worst = [], []
    for free in (False, True):
        if free:
            monkeypatch.setattr(Design, "moves", lambda design: None)
            monkeypatch.setattr(_Task, "_bends", lambda task: Slopes(task.design.kinks[:0], np.zeros(0)))
        tables = reduce(controller, setup, terms, sample)
        bends = [np.abs(np.diff(t.values, 2)) for t in tables if t.term.size >= 6]
        ends.append(max(max(b[0], b[-1]) / b[1:-1].max() for b in bends))
        worst.append(leftover(controller, setup, tables, sample))
    assert ends[0] < 0.5 * ends[1]
    assert ends[0] < 1.01  # the bend at an end is not larger than that within, but for the solver's accuracy
    assert worst[0] < 1.1 * worst[1]  # what that costs


def test_the_inverse_takes_its_derivative_once(monkeypatch: pytest.MonkeyPatch) -> None:
    volume, rows = worn(), list[int]()
    q, came = volume.poses(256, 1)
    jacobian = Field.jacobian

    def counted(self: Field, q: Array, direction: Array, tool: Array | None = None) -> Array:
        rows.append(len(q))
        return jacobian(self, q, direction, tool)

    monkeypatch.setattr(Field, "jacobian", counted)
    _, left = inverse(volume.field, q, came)
    assert sum(rows) == len(q)
    assert left.max() < CLOSED_MM
