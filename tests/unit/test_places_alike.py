"""Places that rows do not tell apart count for an effect together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.search.candidates import Candidates
from identification.diagnosis.search.scoring import posterior
from identification.diagnosis.search.shape_fit import optimise_shapes
from identification.estimation.fit import fit_machine
from tests.helpers.diagnosed import empty_survey, showing


def test_a_growth_at_one_of_several_members_is_as_likely_as_at_one() -> None:
    """All members of a machine without rotary axes grow alike: of eight places three are told apart, not eight."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 200, 5, channels=False, grid=False)
    timed = replace(survey, table=survey.table.assign(time=np.arange(200) * 60.0))
    member = machine.elements[-1].name
    grows = EffectSpec("warm-up", {"element": member, "motion": "translations", "tau": 3000.0})
    linear = set_up(fit_machine(machine, showing(timed, machine, [(grows, [0.01, -0.006, 0.02])], 0.003)))
    candidates = Candidates.of(linear)
    steps = [s for s in optimise_shapes(linear, candidates, 12) if s.effect.effect == "warm-up"]
    best, second = steps[:2]
    alike = [e for e, n in candidates.scores(linear).by_key() if candidates.effects[n].effect == "warm-up"]
    together = np.exp(np.array(alike) - alike[0]).sum()
    assert together > 2.5
    assert best.places == second.places == pytest.approx(candidates.places["warm-up"] / together)
    assert posterior(best) == pytest.approx(best.evidence - np.log(len(candidates.places) * best.places))
