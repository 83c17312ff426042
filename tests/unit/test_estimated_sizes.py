"""What no row determines of a term without a name stays small in the extended machine, and in every later fit of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from errormodel.effects import make
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.search.candidates import WIDEST
from identification.diagnosis.search.model import replayed, with_estimated_sizes
from identification.diagnosis.search.scoring import Step
from identification.estimation.fit import fit_machine
from tests.helpers.diagnosed import empty_survey, showing

AMPLITUDE_MM = 0.01


def test_the_sine_of_a_wave_that_was_seen_at_its_zeros_stays_small() -> None:
    """Z has levels half a period apart: the cosine is known there, the sine is anything without a size."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 200, 4, channels=False, grid=False)
    low, high = machine.joints[-1].travel
    levels = np.linspace(low, high, 8)
    rng = np.random.default_rng(4)
    # a micrometre beside the levels: a column of rounding alone would be left out
    table = survey.table.assign(**{machine.joints[-1].name: rng.choice(levels, 200) + rng.normal(0, 1e-3, 200)})
    period = 2 * float(levels[1] - levels[0])
    wave = {"element": machine.joints[0].name, "motion": "dx", "driver": machine.joints[-1].name, "period": period}
    own = EffectSpec("unnamed", wave)
    shown = showing(replace(survey, table=table), machine, [(own, [AMPLITUDE_MM * np.cos(0.0), 0.0])], 0.003)
    fit = fit_machine(machine, shown)
    model = replayed(set_up(fit), [Step(make(own), 50.0, 100.0, 0.1)])
    (effect,) = with_estimated_sizes(model)
    assert effect.size is not None  # type: ignore[attr-defined]
    assert 0.3 * AMPLITUDE_MM < effect.size < 3 * AMPLITUDE_MM  # type: ignore[attr-defined]
    for spec, largest in ((EffectSpec("unnamed", {**wave, "size": effect.size}), 3.0), (own, None)):  # type: ignore[attr-defined]
        fitted = fit_machine(replace(machine, effects=(spec,)), shown)
        named = fitted.solution.named()
        values = np.abs([named[i] for i in fitted.chain.effect_ids[0] if i in named])
        if largest is None:
            assert values.max() > 30 * AMPLITUDE_MM
        else:
            assert values.max() < largest * AMPLITUDE_MM


def test_points_of_a_table_that_no_row_is_near_stay_small() -> None:
    """Five places of X along a table of nine points that acts in the second run only: two of three are between."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 240, 6, channels=False, grid=False)
    rng = np.random.default_rng(6)
    low, high = machine.joints[0].travel
    places = rng.choice(low + (high - low) * np.array([0.06, 0.28, 0.53, 0.76, 0.94]), 240) + rng.normal(0, 0.05, 240)
    table = survey.table.assign(**{machine.joints[0].name: places, "run": np.where(np.arange(240) < 160, "1", "2")})
    own = EffectSpec("compensation-active", {"joint": machine.joints[0].name, "points": 9, "run": "2"})
    values = [0.001, 0.004, -0.003, 0.002, 0.005, -0.004, 0.001, 0.003, -0.002]
    shown = showing(replace(survey, table=table), machine, [(own, values)], 0.001)
    model = replayed(set_up(fit_machine(machine, shown)), [Step(make(own), 50.0, 100.0, 0.1)])
    (effect,) = with_estimated_sizes(model)
    assert 0.001 < effect.size < 0.01  # type: ignore[attr-defined]
    largest = []
    for spec, wide in ((effect.spec, None), (own, WIDEST)):
        fitted = fit_machine(replace(machine, effects=(spec,)), shown, effect_sizes=wide)
        named = fitted.solution.named()
        largest.append(max(abs(named[i]) for i in fitted.chain.effect_ids[0] if i in named))
    assert largest[0] < 0.012 < largest[1]
