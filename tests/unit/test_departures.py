"""Small parts of what a finding does are departures from its form; a curve may be a part of what two positions move."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from errormodel.machine_file import read_machine
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.results.curve_of_axis import part_of_more
from identification.diagnosis.results.departures import with_departures_merged
from identification.diagnosis.results.nameless_alternative import refusal
from identification.diagnosis.search.model import EffectModel, done_by_groups, replayed
from identification.diagnosis.search.scoring import Step
from identification.estimation.fit import fit_machine
from tests.helpers.diagnosed import empty_survey, showing
from tests.helpers.findings import known, made

TORSION = made("beam-torsion", joint="X", load_joint="Y")
TWIST = made("higher-order-geometry", joint="X", motion="ea", degrees=(4, 5))
PITCH = made("higher-order-geometry", joint="X", motion="eb", degrees=(4, 5))
OTHER = made("higher-order-geometry", joint="Y", motion="ea", degrees=(4, 5))
DENT = made("local-defect", joint="X", motion="ea", at=2000.0, width=300.0)
WAVE = made("rail-waviness", joint="X", motion="ea", period=300.0)
BULGE = {"element": "X", "motion": "dz", "center": 2000.0, "half_range": 2000.0, "form": "square"}
SURFACE = made("unnamed", **BULGE, driver="X", by="Y", by_center=900.0, by_half_range=900.0, by_form="square")
ALONG = made("unnamed", **BULGE, driver="X")
CURVE = made("higher-order-geometry", joint="X", motion="dz", degrees=(4, 5))
LEVEL = made("higher-order-geometry", joint="Y", motion="dx", degrees=(4, 5))


def model(values: Mapping[Any, float], channels: bool = False) -> EffectModel:
    """Effects with such first parameters, each a finding, in a survey of a gantry that shows them all."""
    machine = read_machine("gantry_crossbeam_ram")
    survey = empty_survey(machine, 300, 5, channels=channels, grid=False)
    specs = known(machine, *values).effects
    shown = [(spec, [value]) for spec, value in zip(specs, values.values(), strict=True)]
    fit = fit_machine(machine, showing(survey, machine, shown, 1e-4))
    return replayed(set_up(fit), [Step(e, 100.0, 100.0, 0.1) for e in values])


def test_sizes_are_of_all_that_a_finding_does() -> None:
    """Twice the error is four times the size, of each of two findings that the geometry hides in different parts."""
    once, twice = (done_by_groups(model({TORSION: 1e-4 * n, CURVE: 0.1 * n})) for n in (1, 2))
    # of rows weighed by the noise that the plain fit leaves, which is twice as large, too
    ratios = [float(a @ a) / float(b @ b) for a, b in (once, twice)]
    assert ratios[0] == pytest.approx(ratios[1], rel=0.05)


@pytest.mark.parametrize(
    ("part", "value", "outcome"),
    [
        (TWIST, 3e-6, "merged"),
        (TWIST, 1e-4, "kept"),  # as large
        (PITCH, 3e-6, ""),  # another motion
        (OTHER, 3e-6, ""),  # of another joint, elsewhere
        (WAVE, 3e-6, ""),  # no smooth curve
        (DENT, 3e-6, ""),  # has a form of its own
    ],
)
def test_a_small_curve_of_what_a_finding_moves_is_a_part_of_it(part: Any, value: float, outcome: str) -> None:
    log = DecisionLog()
    found = with_departures_merged(model({TORSION: 1e-4, part: value}), log).findings
    merged = outcome == "merged"
    assert [[s.effect for s in g] for g in found] == ([[TORSION, part]] if merged else [[TORSION], [part]])
    assert [d.outcome for d in log if d.rule == "departure-of-form"] == ([outcome] if outcome else [])


@pytest.mark.parametrize(
    ("part", "merged"),
    [
        (made("station-shift", at=3000.0), True),
        (made("tracker-drift", tau=900.0), True),
        (made("structure-drift", element="frame", motion="dz", sensor="T_0"), False),  # another cause
        (made("structure-drift", element="crossbeam", motion="dz", sensor="T_0"), False),  # another place
    ],
)
def test_what_an_instrument_sees_by_one_cause_is_one_finding(part: Any, merged: bool) -> None:
    drift = made("tracker-drift", tau=3600.0)
    found = with_departures_merged(model({drift: 0.2, part: 0.005}, channels=True), DecisionLog()).findings
    assert len(found) == (1 if merged else 2)


@pytest.mark.parametrize(("share", "named"), [(0.3, True), (3.0, False)])
def test_a_name_does_more_than_what_refines_it(share: float, named: bool) -> None:
    found = model({TORSION: 1e-4, TWIST: 1e-4 * share})
    of_one = replayed(found.start, [found.steps[0], replace(found.steps[1], parent=0)])
    refused = refusal(of_one, of_one.findings[0], [], DecisionLog())
    assert (refused is None) == named
    assert named or "what refines its form" in refused.reason


@pytest.mark.parametrize(
    ("curve", "other", "values", "refused"),
    [
        (CURVE, SURFACE, (0.05, 0.1), True),
        (CURVE, SURFACE, (0.2, 0.01), False),  # small beside the curve
        (CURVE, ALONG, (0.05, 0.1), False),  # by the axis alone
        (LEVEL, SURFACE, (0.05, 0.1), False),  # another axis's motion
        (TORSION, SURFACE, (1e-5, 0.1), False),  # no curve of any form
    ],
)
def test_a_curve_may_be_a_part_of_what_two_positions_move(
    curve: Any, other: Any, values: tuple[float, float], refused: bool
) -> None:
    found = model(dict(zip((curve, other), values, strict=True)))
    assert bool(part_of_more(found, found.findings[0], DecisionLog())) == refused
