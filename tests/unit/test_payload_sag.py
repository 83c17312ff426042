"""What the load moves: along a joint's travel, or a member that gives way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from errormodel.effects import make
from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.diagnosis.pipeline import diagnose
from tests.helpers.diagnosed import empty_survey, showing
from tests.helpers.findings import made

MACHINE = read_machine("vertical_three_axis")


def test_a_member_gives_way_by_the_load_alone() -> None:
    member = MACHINE.shapes[0].name
    effect = made("payload-sag", element=member, degree=0, motion="ea")
    (term,) = effect.terms({"load": np.array([0.0, 10.0, 20.0])}.__getitem__, MACHINE)
    assert (effect.where, effect.drivers, term.element, term.unit) == (member, ("load",), member, "rad/kg")
    assert np.asarray(term.motion["ea"]).tolist() == [0.0, 10.0, 20.0]


@pytest.mark.parametrize("fields", [{}, {"joint": "X", "element": "column"}, {"element": "column", "degree": 1}])
def test_it_has_one_place(fields: dict[str, object]) -> None:
    with pytest.raises(InputError, match="that of a joint or of an element with degree: 0"):
        make(EffectSpec("payload-sag", fields))


@pytest.mark.long
def test_a_member_that_the_load_tilts_is_named() -> None:
    survey = empty_survey(MACHINE, 200, 5, channels=False, grid=False)
    loads = np.random.default_rng(1).choice([0.0, 40.0, 80.0], len(survey.table))
    loaded = replace(survey, table=survey.table.assign(load=loads))
    spec = EffectSpec("payload-sag", {"element": MACHINE.shapes[0].name, "degree": 0, "motion": "ea"})
    found = diagnose(MACHINE, showing(loaded, MACHINE, [(spec, [2e-6])], 0.002)).diagnosis
    assert [f.effect for f in found.findings] == ["payload-sag"]
