"""A tool that is entered wrongly is refused by every command that reads a survey; usual offsets of targets are not."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine
from errormodel.simulation import measured_at
from errormodel.survey import Survey
from errormodel.surveys.columns import MEASURED, TOOL_COLUMNS
from errormodel.truth import Truth
from identification.diagnosis.data_checks.gate import passed
from identification.diagnosis.data_checks.tool_lengths import NOTED_MM, WRONG_MM, other_tool
from identification.diagnosis.pipeline import diagnose
from identification.estimation.fit import fit_machine
from identification.importing.check import check_lines, check_survey
from tests.helpers.chains import Array
from tests.helpers.diagnosed import FRAME, SIZES, empty_survey

STEP = 80.0  # mm, of the second tool
SAID = r"the tool at .* mm lie .* if these are right, it is at .*near"


def with_two_tools(machine: Machine, wrong: float, second: Array) -> Survey:
    """Rows in `second` have a tool that is longer along z by `STEP` as written, and by so much more in truth."""
    survey = empty_survey(machine, len(second), 5, channels=False, grid=False)
    rng = np.random.default_rng(8)
    chain = Chain(machine)
    errors = {p.id: rng.normal(0, SIZES[p.unit]) for p in chain.parameters if p.id in chain.machine_ids}
    written = np.tile(np.asarray(machine.tool, float), (len(second), 1))
    written[second, 2] -= STEP
    real = written.copy()
    real[second, 2] -= wrong
    table = survey.table.assign(**dict(zip(TOOL_COLUMNS, real.T, strict=True)))
    seen = measured_at(machine, table, Truth(errors, *FRAME), 0.005, 4)
    table = table.assign(**dict(zip(TOOL_COLUMNS, written.T, strict=True)), **{c: seen[c] for c in MEASURED})
    return replace(survey, table=table)


@pytest.mark.parametrize("name", ["vertical_three_axis", "gantry_crossbeam_ram", "fork_head_five_axis"])
@pytest.mark.parametrize("wrong", [0.0, 0.5 * WRONG_MM, 1.5 * WRONG_MM, 45.0])
@pytest.mark.parametrize("part", [0.5, 0.1])
def test_a_tool_is_named_from_a_millimetre_on(name: str, wrong: float, part: float) -> None:
    machine = read_machine(name)
    second = np.arange(200) % round(1 / part) == 0
    found = other_tool(Chain(machine), with_two_tools(machine, wrong, second))
    if wrong < WRONG_MM:
        assert found is None
        return
    assert found is not None
    # either may be the wrong one: their distance is what is known
    apart = abs(found.shown[2] - found.beside[2]) - STEP
    assert apart == pytest.approx(wrong, abs=0.05)
    assert found.size_mm == pytest.approx(wrong, rel=0.02)


@pytest.mark.parametrize("wrong", [5.0, 45.0])
def test_what_signs_a_survey_refuses_it(wrong: float) -> None:
    """Also where half of the rows have it, which neither side can call the wrong one."""
    machine = read_machine("vertical_three_axis")
    survey = with_two_tools(machine, wrong, np.arange(200) % 2 == 0)
    for command in (check_survey, lambda m, s: passed(m, s, lambda: fit_machine(m, s))):
        with pytest.raises(InputError, match=SAID):
            command(machine, survey)


def test_a_small_error_of_a_tool_is_noted() -> None:
    """0.3 mm go into the parameters of the machine, at many standard uncertainties, and are said."""
    machine = read_machine("fork_head_five_axis")
    half = np.arange(200) % 2 == 0
    for wrong in (0.0, 0.3):
        survey = with_two_tools(machine, wrong, half)
        fitted = passed(machine, survey, lambda survey=survey: fit_machine(machine, survey))
        for said in (fitted.notes, check_lines(check_survey(machine, survey))):
            assert bool([text for text in said if re.search(SAID, text)]) == bool(wrong)


@pytest.mark.parametrize("zero_deg", [0.5, 2.0])
def test_the_zero_of_a_wrist_is_no_error_of_reflectors(zero_deg: float) -> None:
    """It turns all of them about the last axis: what an arm is calibrated for."""
    machine = read_machine("six_axis_arm")
    survey = empty_survey(machine, 120, 5, channels=False, grid=False)
    chain = Chain(machine)
    errors = {p.id: 0.0 for p in chain.parameters if p.id in chain.machine_ids}
    errors["L6.eb"] = np.radians(zero_deg)
    places = np.array([[80.0, -100.0, 0.0], [-40.0, -130.0, -70.0], [-40.0, -100.0, 70.0]])
    table = survey.table.assign(**dict(zip(TOOL_COLUMNS, places[np.arange(120) % 3].T, strict=True)))
    seen = measured_at(machine, table, Truth(errors, *FRAME), 0.02, 4)
    survey = replace(survey, table=table.assign(**{c: seen[c] for c in MEASURED}))
    assert other_tool(chain, survey, NOTED_MM) is None


def test_a_diagnosis_names_it_while_an_effect_describes_it() -> None:
    machine = read_machine("vertical_three_axis")
    half = np.arange(200) % 2 == 0
    found = diagnose(machine, with_two_tools(machine, 5.0, half)).diagnosis
    assert [f.where for f in found.findings] == ["tool"]
    assert [n for n in found.notes if re.search(SAID, n)]
    with pytest.raises(InputError, match=SAID):
        diagnose(machine, with_two_tools(machine, 45.0, half))


def test_tools_that_the_survey_is_to_find_are_not_refused() -> None:
    machine = read_machine("vertical_three_axis")
    survey = with_two_tools(machine, 5.0, np.arange(200) % 2 == 0)
    tool = [*map(float, survey.tool[0])]
    open_place = replace(machine, effects=(EffectSpec("target-offset", {"tool": tool, "std": "unknown"}),))
    assert other_tool(Chain(open_place), survey) is None
    assert passed(open_place, survey, lambda: fit_machine(open_place, survey)).fitted.rms_um < 20


def test_tools_with_parts_of_the_travel_of_their_own_are_no_mistake() -> None:
    """What the short tool measures up here and the long one down there are errors of the machine as well."""
    machine = read_machine("vertical_three_axis")
    height = empty_survey(machine, 200, 5, channels=False, grid=False).table["Z"]
    second = (height < height.median()).to_numpy()
    assert other_tool(Chain(machine), with_two_tools(machine, 0.3, second)) is None
