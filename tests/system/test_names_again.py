"""A form without a name that does not lead a name clearly, beside all that was found, has that name."""

from __future__ import annotations

from dataclasses import replace

import pytest

from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.diagnosis.decisions.constants import CLEARLY
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.pipeline import diagnose
from identification.diagnosis.results.findings import probability_of
from identification.diagnosis.results.nameless_alternative import with_names_again
from identification.diagnosis.search.model import EffectModel, of_groups
from tests.helpers.diagnosed import empty_survey, showing


@pytest.fixture(scope="module")
def found() -> EffectModel:
    """A survey in which X has play."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 200, 5, channels=True, grid=False)
    spec = EffectSpec("backlash", {"joint": "X"})
    return diagnose(machine, showing(survey, machine, [(spec, [0.012])], 0.003)).model


@pytest.mark.long
@pytest.mark.parametrize(("lead", "named"), [(CLEARLY - 1, True), (CLEARLY + 1, False)])
def test_a_form_leads_clearly_or_has_the_name(found: EffectModel, lead: float, named: bool) -> None:
    ((name, *_),) = found.findings
    assert name.effect.effect == "backlash"
    form = next(s for s in name.alternatives if s.effect.empirical)
    form = replace(form, evidence=name.evidence + lead, alternatives=(name,))
    log = DecisionLog()
    ((step,),) = with_names_again(of_groups(found.start, [[form]]), log).findings
    assert step.effect == (name if named else form).effect
    assert [d.outcome for d in log if d.rule == "name-again"] == ["preferred"] * named
    # the probability is of what was chosen
    assert probability_of(step) > 0.5


@pytest.mark.long
def test_no_name_is_there_twice(found: EffectModel) -> None:
    """A finding that has the name of another one refines that, or is the same."""
    ((name, *_),) = found.findings
    ((step,),) = with_names_again(of_groups(found.start, [[name], [name]]), DecisionLog()).findings
    assert step.effect == name.effect
