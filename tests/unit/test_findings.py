"""What a diagnosis says of an effect: its size, its sentence, its probability."""

from __future__ import annotations

import math
import re
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from errormodel.chain import Chain
from errormodel.conventions import unit_of
from errormodel.effects.base import Effect
from errormodel.exceptions import InputError
from errormodel.machine import Machine
from errormodel.machine_file import read_machine
from errormodel.simulation import random_points
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.pipeline import _moved, diagnose
from identification.diagnosis.results.driver_words import causes
from identification.diagnosis.results.effect_size import Whole, whole_of
from identification.diagnosis.results.findings import (
    BETTER,
    CHOSEN,
    alternatives_of,
    look_alikes,
    probabilities_of,
    probability_of,
)
from identification.diagnosis.results.statements import (
    alike_of,
    brief_of,
    next_measurement,
    period_of,
    statement_of,
)
from identification.diagnosis.search.scoring import Step
from identification.estimation.fit import fit_machine
from identification.results.text import comparison, forms_said
from tests.helpers import effect_battery as battery
from tests.helpers.findings import NOISE, known, made, survey_of


def whole(machine: Machine, effects: list[Effect], values: list[float], table: pd.DataFrame | None = None) -> Whole:
    """Effects of the given sizes, recorded and fitted, as one finding."""
    extended = known(machine, *effects)
    chain = Chain(extended)
    ids = [i for own in chain.effect_ids for i in own]
    if table is None:
        table = battery.table(machine.name).drop(columns=["run", "file", "role", "row"])
    truth = dict(zip(ids, values, strict=True))
    return whole_of(fit_machine(extended, survey_of(extended, table, truth)), effects, range(len(effects)))


def said(found: Whole, machine: Machine, probability: float = 0.98) -> str:
    return statement_of(found, machine, 0.4, probability, ["lost-motion of X"])


def test_each_effect_knows_its_parameters() -> None:
    """Whatever element they sit at, and however many effects of one word there are."""
    effects = [
        made("scale-expansion", joint="Y", sensor="T_drive"),
        made("clock-offset"),
        made("scale-expansion", joint="Y", sensor="T_bed"),
        made("pitch-cyclic", joint="X", period=10.0),
    ]
    assert Chain(known(battery.GANTRY, *effects)).effect_ids == (
        ("Y.dy.scale-expansion",),
        ("frame.dx.clock-offset",),
        ("Y.dy.scale-expansion'",),
        ("X.dx.pitch-cyclic-sin", "X.dx.pitch-cyclic-cos"),
    )
    assert Chain(battery.GANTRY).effect_ids == ()


def test_parameters_at_another_element_are_found() -> None:
    found = whole(battery.GANTRY, [made("clock-offset")], [2e-3])
    (amount,) = found.amounts
    assert amount.name == "frame.dx.clock-offset"
    assert amount.unit == "s"
    assert abs(amount.value - 2e-3) < 4 * amount.std
    text = said(found, battery.GANTRY)
    assert text.startswith("Clock-offset of the instrument, driven by feed: 1.99")
    assert " ms (positive: it measures later than the controller states the position), within what is usual" in text
    assert "(up to 2 ms)" in text


def test_size_is_that_at_the_tip() -> None:
    found = whole(battery.GANTRY, [made("backlash", joint="X")], [0.03])
    assert found.size_um == pytest.approx(15, abs=1)  # half of it on either side
    value, std = found.range(("X", "dx"))
    assert abs(value - 0.03) < 4 * std < 0.004
    text = said(found, battery.GANTRY)
    assert "driven by the side from which X arrives" in text
    assert "moves dx of X (EXX) by 3" in text
    assert "the geometry had hidden 40 % of it" in text
    assert text.endswith("Probability 0.98.")


def test_backlash_of_the_wrong_sign_is_told() -> None:
    """Positive: arriving from minus, the axis is farther than its command. A worn drive stays behind."""
    ahead, behind = (
        said(whole(battery.GANTRY, [made("backlash", joint="X")], [s]), battery.GANTRY) for s in (3e-2, -3e-2)
    )
    assert "and X is ahead of its command, which no worn drive makes: a compensation of backlash set too large" in ahead
    assert "what is usual" not in ahead
    assert "ahead" not in behind
    assert "within what is usual" in behind


def test_a_size_that_the_data_do_not_determine_is_none() -> None:
    found = whole(battery.GANTRY, [made("backlash", joint="X")], [0.03])
    assert "by 30 um (EXX)" in brief_of(found, battery.GANTRY)
    vague = replace(found, covariance=found.covariance + 0.05**2)
    text = said(vague, battery.GANTRY)
    assert ": the data do not determine this size; the geometry" in text
    assert "usual" not in text
    assert "at the tip" not in text
    shown = said(replace(vague, seen_um=4.2), battery.GANTRY)
    assert "; beyond what the geometry could be as well they show 4.2 um rms of it; the geometry" in shown
    assert brief_of(vague, battery.GANTRY) == "backlash of X of a size that the data do not determine (EXX)"


def test_a_doubtful_name_is_called_doubtful() -> None:
    found = whole(battery.GANTRY, [made("backlash", joint="X")], [0.03])
    text = said(found, battery.GANTRY, 0.5)
    assert text.endswith("Probability 0.50: the name is uncertain, it may as well be lost-motion of X.")


def test_two_lags_of_one_sensor_are_one_expansion() -> None:
    effects = [made("scale-expansion", joint="Y", sensor="T_drive", tau=tau) for tau in (0.0, 600.0)]
    found = whole(battery.GANTRY, effects, [30e-6, -20e-6])
    assert [a.name for a in found.amounts] == ["Y.dy.scale-expansion", "Y.dy.scale-expansion'"]
    text = said(found, battery.GANTRY)
    assert "driven by T_drive, at once and behind a lag of 10 min: " in text
    value = float(text.split(": ")[1].split(" +- ")[0])
    assert value == pytest.approx(10, abs=1)
    assert "um/m/K at steady state, well within what is usual (up to 24 um/m/K)" in text
    assert "'" not in text


def test_two_sensors_are_told_apart() -> None:
    effects = [made("scale-expansion", joint="Y", sensor=s) for s in ("T_drive", "T_bed")]
    text = said(whole(battery.GANTRY, effects, [80e-6, 10e-6]), battery.GANTRY)
    assert "driven by T_drive and T_bed: " in text
    assert "um/m/K of T_drive and " in text
    assert "um/m/K of T_bed, far larger than what is usual" in text


def test_a_refined_form_has_no_coefficient_of_its_own() -> None:
    more = made("unnamed", element="Y", motion="dy", driver="T_drive", form="square", center=23.0, half_range=3.0)
    effects = [made("scale-expansion", joint="Y", sensor="T_drive"), more]
    text = said(whole(battery.GANTRY, effects, [10e-6, 0.01, 0.01]), battery.GANTRY)
    assert "um/m/K" not in text
    assert "moves dy of Y (EYY) by 124.4 +- 3.5 um peak to peak over the rows" in text  # of the expansion alone
    assert "with 1 further term that refines its form (189.1 +- 2.6 um with it);" in text


def test_a_bow_is_told_by_its_middle() -> None:
    effect = made("thermal-bending", joint="Y", motion="dz", sensor="T_top", minus="T_bed")
    size = 3e-8  # 1/(mm K): 1500 mm bow by 8.4 um/K
    text = said(whole(battery.GANTRY, [effect], [size, 0.0]), battery.GANTRY)
    assert "driven by T_top less T_bed: 8." in text
    assert "um/K at mid-travel, well within what is usual" in text


def test_rotary_periods_are_degrees() -> None:
    effect = made("wobble", joint="B", harmonic=2)
    found = whole(battery.FIVE_AXIS, [effect], [1e-5, 0.0, 0.0, 1e-5])
    assert period_of(effect, battery.FIVE_AXIS) == pytest.approx(180)
    text = said(found, battery.FIVE_AXIS)
    assert "Wobble of B, driven by B, with a period of 180 deg (2 a turn): moves e" in text
    assert "urad peak to peak" in text
    assert period_of(made("pitch-cyclic", joint="X", period=10.0), battery.FIVE_AXIS) == 10.0
    assert period_of(made("backlash", joint="X"), battery.FIVE_AXIS) is None


def test_a_curve_of_many_splines_is_summed_up() -> None:
    effect = made("higher-order-geometry", joint="B", motion="eb", every=math.radians(10), size=3e-5)
    chain = Chain(known(battery.FIVE_AXIS, effect))
    (ids,) = chain.effect_ids
    q = np.arange(len(ids)) * 2 * math.pi / len(ids) - math.pi
    found = whole(battery.FIVE_AXIS, [effect], list(5e-5 * np.sin(5 * q)))
    rms, peak = found.amounts
    assert (rms.unit, peak.unit) == (unit_of("eb"), "rad")
    smoothed = 5e-5 * (2 / 3 + 1 / 3 * math.cos(10 * math.pi / len(ids)))  # what cubic splines make of such values
    assert abs(rms.value - smoothed / math.sqrt(2)) < 0.05 * rms.value
    assert 0 < rms.std < 0.1 * rms.value
    assert peak.value == pytest.approx(2 * smoothed, rel=0.15)
    text = said(found, battery.FIVE_AXIS)
    assert "as a curve of splines 10 deg apart: 3" in text
    assert " urad rms; moves eb of B (EBB) by " in text


def test_causes_in_words() -> None:
    assert causes([made("warm-up", joint="X", tau=1800.0)]) == "time, settling with time constant of 30 min"
    assert causes([made("station-shift", run="3")]) == "run 3"
    table = made("compensation-active", joint="X", points=5, run=("3", "4"))
    assert causes([table]) == "X and runs 3, 4"
    lagged = made("structure-drift", element="T1", motion="dx", sensor="T_bed", tau=7200.0)
    assert causes([lagged]) == "T_bed behind a lag of 2 h"


def test_what_cannot_be_told_apart_is_named() -> None:
    backlash, lost = made("backlash", joint="X"), made("lost-motion", joint="X")
    far = made("hysteresis", joint="X", width=20.0)
    step = Step(backlash, 50.0, 60.0, 0.3, alternatives=(Step(lost, 48.0, 58.0, 0.3), Step(far, 20.0, 30.0, 0.3)))
    table = battery.table("gantry").drop(columns=["run", "file", "role", "row"])
    linear = set_up(fit_machine(battery.GANTRY, survey_of(battery.GANTRY, table, {})))
    probability = probability_of(step)
    first, second = alternatives_of(step, linear, probability)
    assert (first.effect, first.separable, first.driver, first.motion) == ("lost-motion", False, ["dir_X"], ["dx"])
    assert (second.effect, second.separable) == ("hysteresis", True)
    assert look_alikes(step) == [lost]
    assert first.probability is not None
    assert second.probability is not None
    assert second.probability < first.probability < probability < 1 - first.probability - second.probability
    text = next_measurement(backlash, lost, {})
    assert text.startswith("this data cannot tell backlash of X from lost-motion of X: ")
    assert text.endswith(backlash.separate)
    assert next_measurement(backlash, None, {}) == backlash.separate


RIVALS = [
    made("lost-motion", joint="X"),
    made("hysteresis", joint="X", width=20.0),
    made("backlash", joint="Y"),
    made("warm-up", joint="X", tau=1800.0),
    made("unnamed", element="X", motion="dx", driver="dir_X"),
    made("unnamed", element="Y", motion="dx", driver="dir_X"),
]


@cache
def _gantry() -> LinearModel:
    table = battery.table("gantry").drop(columns=["run", "file", "role", "row"])
    return set_up(fit_machine(battery.GANTRY, survey_of(battery.GANTRY, table, {})))


@settings(deadline=None, max_examples=150)
@given(
    evidence=st.floats(5, 400),
    order=st.permutations(range(len(RIVALS))),
    more=st.lists(st.floats(-900, 30), max_size=len(RIVALS)),
    witness=st.floats(0.01, 0.999),
)
def test_probabilities_of_all_explanations_belong_together(
    evidence: float, order: list[int], more: list[float], witness: float
) -> None:
    """Whatever the rivals: one distribution, and a reason wherever something fits better than what was chosen."""
    ranked = zip(sorted(more, reverse=True), order, strict=False)
    rivals = tuple(Step(RIVALS[k], evidence + nats, 1.1 * evidence, 0.3) for nats, k in ranked)
    step = Step(made("backlash", joint="X"), evidence, 1.1 * evidence, 0.3, alternatives=rivals, trials=50)
    for probability in (probability_of(step), witness):  # as evidence has it, and after a witness was asked
        listed = alternatives_of(step, _gantry(), probability)
        own = [a.probability for a in listed if a.probability is not None]
        assert sum(own) <= 1 - probability + 1e-9
        assert own == sorted(own, reverse=True)
        for a in listed:
            assert (a.probability is None) == (a.effect == "backlash")
            assert bool(a.reason) == (a.log10_bayes_factor > BETTER)
            words = "; ".join(comparison(a))
            assert ("fits this data better, but" in words) == (a.log10_bayes_factor > BETTER)


def test_all_names_are_equally_likely_beforehand_and_of_one_name_all_its_places() -> None:
    """So many times the places, so much less likely: as the evidence is, and all the rest, the same."""
    lost = made("lost-motion", joint="X")

    def odds(own: int, others: int) -> float:
        rival = Step(lost, 50.0, 60.0, 0.3, places=others)
        names = probabilities_of(Step(made("backlash", joint="X"), 50.0, 60.0, 0.3, alternatives=(rival,), places=own))
        return names["lost-motion"] / names["backlash"]

    assert odds(1, 1) == pytest.approx(math.exp(-CHOSEN))
    assert odds(3, 6) == pytest.approx(odds(1, 1) / 2)
    assert odds(6, 3) == odds(1, 1)  # no other name counts for more than the chosen one


def test_no_physics_that_may_be_it_is_crowded_out() -> None:
    """Curves without a name that fit as well at many places leave room for a name."""
    forms = [made("unnamed", element=e, motion="dx", driver="dir_X") for e in ("X", "Y", "Z", "frame", "tool")]
    rivals = tuple(Step(f, 49.0, 59.0, 0.3) for f in forms)
    lost, warm = Step(made("lost-motion", joint="X"), 47.0, 57.0, 0.3), Step(RIVALS[3], 46.0, 56.0, 0.3)
    step = Step(made("backlash", joint="X"), 50.0, 60.0, 0.3, alternatives=(*rivals, lost, warm))
    listed = alternatives_of(step, _gantry(), probability_of(step))
    assert {"lost-motion", "warm-up"} <= {a.effect for a in listed}


def test_a_rival_that_fits_better_says_why_it_was_not_chosen() -> None:
    warm, model = made("warm-up", joint="X", tau=1800.0), made("backlash", joint="X")
    form = made("unnamed", element="X", motion="dx", driver="time")
    step = Step(model, 50.0, 60.0, 0.3, alternatives=(Step(form, 50.3, 60.3, 0.3), Step(warm, 50.2, 60.2, 0.3)))
    words = {a.effect: "; ".join(comparison(a)) for a in alternatives_of(step, _gantry(), probability_of(step))}
    assert "a curve without a name can follow anything: known physics is preferred" in words["unnamed"]
    assert "fits this data better, but" in words["warm-up"]
    assert "odds" not in " ".join(words.values())


def test_moved_where_rows_are_thinned() -> None:
    """What backlash hides in is found again, also from a part of the rows and with components missing."""
    effect = made("backlash", joint="X")
    extended = known(battery.GANTRY, effect)
    table = random_points(battery.GANTRY, 4000, 2)
    survey = survey_of(extended, table, {"X.dx.backlash": 0.05})
    survey.table.loc[::7, "my"] = np.nan
    before = fit_machine(battery.GANTRY, survey)
    linear = set_up(before)
    assert len(np.unique(linear.index)) < 3000
    columns, values = linear.estimates([effect])
    moved = _moved(before, linear, columns[:, : len(linear.index)], values)
    assert moved
    after = fit_machine(extended, survey).solution.named()
    for name, step in moved.items():
        assert after[name] - before.solution.named()[name] == pytest.approx(step, rel=0.2, abs=1e-6)


@pytest.mark.long
def test_a_blunder_is_told_by_held_out_errors() -> None:
    machine = read_machine("vertical_three_axis")
    survey = survey_of(machine, random_points(machine, 120, 3), {})
    survey.table["Z"] *= -1
    stages = []

    def progress(text: str) -> AbstractContextManager[None]:
        stages.append(text)
        return nullcontext()

    result = diagnose(machine, survey, progress)
    assert len(stages) == 6
    (finding,) = result.diagnosis.findings
    assert finding.effect == "axis-blunder"
    assert finding.heldout_rms_um.after == pytest.approx(NOISE * 1e3 * math.sqrt(3), rel=0.4)
    assert finding.heldout_rms_um.before == result.diagnosis.baseline["heldout_rms_um"]
    assert re.search(r": the nominal machine misses by \d+\.\d mm, with it put right by \d\.\d um", finding.statement)
    assert finding.heldout_rms_um.before > 100 * finding.heldout_rms_um.after
    assert result.diagnosis.verdict == "explained"
    assert result.ranking == []


@pytest.mark.parametrize("column", ["mx", "Y"])
def test_a_reflection_that_several_columns_explain_is_put_right_by_nobody(column: str) -> None:
    """X and Y reach as far on either side of zero: the mirrored table is the same, whichever column was mirrored."""
    machine = read_machine("vertical_three_axis")
    survey = survey_of(machine, random_points(machine, 120, 3), {"column.ec": 8e-5})
    survey.table[column] *= -1
    with pytest.raises(InputError) as error:
        diagnose(machine, survey)
    text = str(error.value)
    for words in ("mx my mz are left-handed", "column X is wrong", "column Y is wrong", "squarenesses"):
        assert words in text
    assert "Move each of X Y by hand in its positive direction" in text
    assert "puts it right" not in text


@pytest.mark.parametrize(("tool", "words", "sign"), [(-120, "outward, dz falls", -1), (120, "outward, dz rises", 1)])
@pytest.mark.parametrize("effect", [made("spindle-growth", sensor="T_spindle"), made("warm-up", tau=1800.0)])
def test_the_sign_of_growth_is_said(effect: Effect, tool: float, words: str, sign: int) -> None:
    """What the words promise is what the machine does: growth of +1 moves the tool so."""
    machine = replace(battery.GANTRY, tool=(0.0, 0.0, tool))
    assert effect.positive(machine) == words
    late = {"time": 1e6, "T_spindle": 21.0}
    (term,) = effect.terms(late.__getitem__, machine)
    assert np.sign(float(term.motion["dz"])) == sign


def test_motions_that_are_one_at_the_tip_are_said() -> None:
    places = [("Y", "dy"), ("Z", "dy"), ("Z", "ec")]
    machine = read_machine("vertical_three_axis")
    assert alike_of([], machine) == ""
    assert alike_of(places[:1], machine).startswith("At the tip dy of Y (EYY) would be the same: ")
    assert "dy of Y (EYY), dy of Z (EYZ) or ec of Z (ECZ) would be" in alike_of(places, machine)


def test_what_plus_minus_holds_beside_the_noise_is_said() -> None:
    """Of effects with a textbook form; a play has none, and what has no name follows any."""
    names = ("spindle-growth", "backlash", "unnamed", "outliers", "beam-sag")
    said = forms_said([SimpleNamespace(effect=name) for name in names])  # type: ignore[misc]
    assert "(spindle-growth 9 % of its size, beam-sag 6 % of its size)" in said
    assert not forms_said([SimpleNamespace(effect="backlash")])  # type: ignore[list-item]
