"""A small curve beside a finding of its kind departs from its form; an axis's curve may be a part of a nameless one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from errormodel.machine_file import read_machine
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.results.curve_of_axis import part_of_more
from identification.diagnosis.search.departures import with_departures_merged
from identification.diagnosis.search.model import EffectModel, replayed, sizes_of_groups
from identification.diagnosis.search.scoring import Step
from identification.estimation.fit import fit_machine
from tests.helpers.diagnosed import empty_survey, showing
from tests.helpers.findings import known, made

TORSION = made("beam-torsion", joint="X", load_joint="Y")
TWIST = made("higher-order-geometry", joint="X", motion="ea", degrees=(4, 5))
PITCH = made("higher-order-geometry", joint="X", motion="eb", degrees=(4, 5))
OTHER = made("higher-order-geometry", joint="Y", motion="ea", degrees=(4, 5))
WAVE = made("rail-waviness", joint="X", motion="ea", period=300.0)
BULGE = {"element": "X", "motion": "dz", "center": 2000.0, "half_range": 2000.0, "form": "square"}
SURFACE = made("unnamed", **BULGE, driver="X", by="Y", by_center=900.0, by_half_range=900.0, by_form="square")
ALONG = made("unnamed", **BULGE, driver="X")
CURVE = made("higher-order-geometry", joint="X", motion="dz", degrees=(4, 5))
LEVEL = made("higher-order-geometry", joint="Y", motion="dx", degrees=(4, 5))


def model(values: Mapping[Any, float]) -> EffectModel:
    """Effects with such first parameters, each a finding, in a survey of a gantry that shows them all."""
    machine = read_machine("gantry_crossbeam_ram")
    survey = empty_survey(machine, 300, 5, channels=False, grid=False)
    specs = known(machine, *values).effects
    shown = [(spec, [value]) for spec, value in zip(specs, values.values(), strict=True)]
    fit = fit_machine(machine, showing(survey, machine, shown, 1e-4))
    return replayed(set_up(fit), [Step(e, 100.0, 100.0, 0.1) for e in values])


def test_sizes_are_of_all_that_a_finding_does() -> None:
    """Twice the error is four times the size, of each of two findings that the geometry hides in different parts."""
    once, twice = (sizes_of_groups(model({TORSION: 1e-4 * n, CURVE: 0.1 * n})) for n in (1, 2))
    # of rows weighed by the noise that the plain fit leaves, which is twice as large, too
    assert twice[0] / twice[1] == pytest.approx(once[0] / once[1], rel=0.05)


@pytest.mark.parametrize(
    ("part", "value", "merged"),
    [
        (TWIST, 3e-6, True),
        (TWIST, 1e-4, False),  # as large
        (PITCH, 3e-6, False),  # another motion
        (OTHER, 3e-6, False),  # another place
        (WAVE, 3e-6, False),  # no smooth curve
    ],
)
def test_a_small_curve_of_what_a_finding_moves_is_a_part_of_it(part: Any, value: float, merged: bool) -> None:
    log = DecisionLog()
    found = with_departures_merged(model({TORSION: 1e-4, part: value}), log).findings
    assert [[s.effect for s in g] for g in found] == ([[TORSION, part]] if merged else [[TORSION], [part]])
    assert [d.outcome for d in log if d.rule == "departure-of-form"] == (
        [] if part in (PITCH, OTHER, WAVE) else ["merged" if merged else "kept"]
    )


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
