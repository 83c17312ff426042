"""A machine with one effect more, or another in the place of one, fitted from the sums of the fit that is there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine
from identification.estimation import fit as fits
from identification.estimation.fit import fit_machine, parameters_of
from identification.estimation.result import Fit
from tests.helpers.commands import MILL
from tests.helpers.diagnosed import empty_survey, showing

WAVE = EffectSpec("higher-order-geometry", {"joint": "X", "motion": "dz", "every": 60.0})
SAME = EffectSpec("higher-order-geometry", {"joint": "X", "motion": "dz", "every": 90.0})
DENT = EffectSpec("local-defect", {"joint": "X", "motion": "dz", "at": 20.0, "width": 60.0})
PLAY = EffectSpec("backlash", {"joint": "Y"})
SIZES = 30.0  # standard deviation of the effects' prior, in usual sizes


@pytest.fixture(scope="module")
def fit() -> Fit:
    """Two curves of one motion, whose parameters have the same names but for a mark, and a play."""
    machine = replace(read_machine(MILL), effects=(WAVE, PLAY, SAME))
    survey = empty_survey(machine, 150, 1, channels=False, grid=False)
    return fit_machine(machine, showing(survey, machine, [(DENT, [0.02])], 0.002), effect_sizes=SIZES)


def with_effect(machine: Machine, number: int, spec: EffectSpec) -> Machine:
    """The machine with another effect, or one more."""
    return replace(machine, effects=(*machine.effects[:number], spec, *machine.effects[number + 1 :]))


@pytest.mark.parametrize(
    ("number", "spec"),
    [
        (0, DENT),
        (2, DENT),
        (3, DENT),
        (1, EffectSpec("backlash", {"joint": "X"})),
        (0, EffectSpec("backlash", {"joint": "Z"})),
        (3, EffectSpec("backlash", {"joint": "Y"})),
    ],
)
def test_as_fitted_by_itself(fit: Fit, number: int, spec: EffectSpec, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same parameters as by a fit of its own; sums over the rows are taken of the new columns alone."""
    machine = with_effect(fit.chain.machine, number, spec)
    alone = fit_machine(machine, fit.survey, effect_sizes=SIZES).solution
    monkeypatch.setattr(fits, "solve", None)  # all is taken from the fit's own sums
    found = parameters_of(machine, fit, SIZES)
    assert list(found) == list(alone.unknowns)
    base = [alone.unknowns[j] for j in alone.groups.base]
    std = dict(zip(base, np.sqrt(np.diag(alone.covariance)), strict=True))
    for name, value in alone.named().items():
        assert found[name] == pytest.approx(value, abs=1e-6 * std.get(name, 0.0), rel=0), name


def test_two_that_differ(fit: Fit) -> None:
    """Machines that differ in two effects are fitted by themselves."""
    machine = with_effect(with_effect(fit.chain.machine, 0, DENT), 1, EffectSpec("backlash", {"joint": "X"}))
    alone = fit_machine(machine, fit.survey, effect_sizes=SIZES).solution.named()
    assert parameters_of(machine, fit, SIZES) == pytest.approx(alone, rel=1e-6, abs=1e-12)
