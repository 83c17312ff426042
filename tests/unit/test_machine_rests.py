"""A warm-up cools while the machine rests, in a recording and after it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

from errormodel.chain import Chain
from errormodel.channels import channel, root
from errormodel.effects import make
from errormodel.exceptions import EffectError
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from errormodel.machine_rests import longest_step, rests, resumed, resumed_name
from errormodel.simulation import random_points
from identification.uncertainty.unknown_rests import rested, with_other_use

TAU, END, STEP = 1800.0, 7200.0, 900.0


def test_rests_are_pauses_much_longer_than_the_steps() -> None:
    time = np.concatenate([np.arange(0, 3000, 30), 9000 + np.arange(0, 1500, 30), 10800 + np.arange(0, 600, 30)])
    assert rests(time) == [(2970.0, 9000.0)]  # 330 s are none
    assert longest_step(time) == 600.0
    assert rests(np.full(5, 60.0)) == rests(np.arange(0, 36000, 3600.0)) == []
    assert longest_step(np.arange(0, 36000, 3600.0)) == 36000.0


def test_a_warm_up_follows_the_use_of_the_machine() -> None:
    used = [(600.0, 3000.0), (6600.0, 9000.0), (20000.0, 1e9)]
    effect = make(EffectSpec("warm-up", {"tau": TAU, "start": 600.0, "rests": [[3000, 6600], [9000, 20000]]}))
    machine = read_machine("vertical_three_axis")
    time = np.linspace(0, 30000, 301)
    (term,) = effect.terms(lambda name: time, machine)
    assert effect.channels(machine) == ["time"]

    def rate(t, x):
        return (any(a <= t < b for a, b in used) - x) / TAU

    exact = solve_ivp(rate, (0, 30000), [0.0], t_eval=time, max_step=20.0).y[0]
    np.testing.assert_allclose(np.abs(next(iter(term.motion.values()))), exact, atol=6e-3)


def test_without_rests_nothing_changes() -> None:
    machine, time = read_machine("vertical_three_axis"), np.linspace(0, END, 50)
    table = pd.DataFrame({"time": time})
    plain, known = (
        make(EffectSpec("warm-up", {"tau": TAU, "start": 100.0, **more})) for more in ({}, {"until": END, "step": STEP})
    )
    one, other = (e.terms(lambda name: channel(table, name), machine)[0].motion for e in (plain, known))
    assert one.keys() == other.keys()
    np.testing.assert_allclose(*(np.array([*m.values()]) for m in (one, other)), atol=1e-15)


@pytest.mark.parametrize(
    ("later", "again"),
    [
        (END + 600 + np.arange(0, 900, 30.0), END),  # goes on
        (END + 9000 + np.arange(0, 900, 30.0), END + 9000),  # after a rest
        (np.full(5, END + 9000), END),  # states
        (END + 9000 + np.arange(0, 36000, 3600.0), END),  # a course in hours: its own steps are as long
        (np.arange(0, END, 60.0), END),
    ],
)
def test_work_is_resumed_after_a_rest(later, again) -> None:
    assert set(resumed(later, END, STEP)) == {again}


def test_rests_follow_one_another() -> None:
    with pytest.raises(EffectError, match="must follow one another in time"):
        make(EffectSpec("warm-up", {"rests": [[3000, 6600], [5000, 7000]]}))


@pytest.mark.parametrize(("own_rests", "share"), [([[3000, 6600]], 0.0), ([], 0.5)])
def test_later_commands_after_a_rest_begin_cold_and_say_so(own_rests: list[list[float]], share: float) -> None:
    """A machine that rested in the recording has done so again; of another nothing tells, and the mean is predicted."""
    spec = EffectSpec("warm-up", {"tau": TAU, "rests": own_rests, "until": END, "step": STEP})
    chain = Chain(replace(read_machine("vertical_three_axis"), effects=(spec,)))
    name = resumed_name(END, STEP)
    assert name in chain.channels
    assert root(name) == "time"
    table = random_points(chain.machine, 40, 1).assign(time=50000 + 30.0 * np.arange(40), file="s.csv")
    channels = chain.columns(table)
    p = np.zeros(len(chain.ids))
    p[chain.index[chain.effect_ids[0][0]]] = 0.02

    def predict(rows, labels):
        actual, nominal = chain.kernel("actual", outputs=(0, 1, 2)), chain.kernel("nominal", outputs=(0, 1, 2))
        moved = (actual(rows, p) - nominal(rows)).T
        return np.hstack([moved, moved, np.full((len(moved), 3), 1e-3)])

    cold = predict(channels, None)
    grown = np.linalg.norm(cold[:, :3], axis=1)
    np.testing.assert_allclose(grown, 0.02 * (1 - np.exp(-30.0 * np.arange(40) / TAU)), atol=2e-6)
    out = with_other_use(chain, channels, np.zeros(40), cold, predict)
    warm = 0.02 * np.exp(-30.0 * np.arange(40) / TAU)  # which it would be more, had it worked on
    for own in (slice(0, 3), slice(3, 6)):
        np.testing.assert_allclose(np.linalg.norm(out[:, own], axis=1), grown + share * warm, rtol=2e-3)
    np.testing.assert_allclose(np.linalg.norm(out[:, 6:], axis=1), np.hypot(warm / 2, 1e-3 * 3**0.5), rtol=2e-3)
    (note,) = rested(chain, table)
    words = "whether the machine rested" if share else "the machine is taken to have rested"
    assert note.startswith(f"the rows begin 12 h after the recording's end: {words}")
    soon = table.assign(time=END + 30.0 * np.arange(40))
    assert not list(rested(chain, soon))
    np.testing.assert_array_equal(with_other_use(chain, chain.columns(soon), np.zeros(40), cold, predict), cold)
