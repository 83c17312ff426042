"""What is only seen once something else is found: gross rows, and that a cause is too large to be one."""

from __future__ import annotations

from dataclasses import replace

import pytest

from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from identification.diagnosis import kept_findings
from identification.diagnosis.pipeline import diagnose
from tests.helpers.diagnosed import empty_survey, showing

MACHINE = read_machine("vertical_three_axis")
BAD = [20, 71, 133, 180]  # rows, from 0


@pytest.fixture(scope="module")
def survey() -> Survey:
    return empty_survey(MACHINE, 220, 11, channels=True, grid=False)


@pytest.mark.long
@pytest.mark.parametrize("far", [0.0, 0.05])
def test_gross_rows_that_an_effect_hides_are_found(survey: Survey, far: float) -> None:
    """Beside 120 um of play rows that are 50 um off stand out in no fit; beside 2 um of noise they do."""
    moved = showing(survey, MACHINE, [(EffectSpec("lost-motion", {"joint": "X"}), [0.12])], 0.002)
    table = moved.table.copy()
    table.loc[table.index[BAD], "mz"] += far
    found = diagnose(MACHINE, replace(moved, table=table)).diagnosis
    outliers = [f for f in found.findings if f.effect == "outliers"]
    assert [f.rows for f in outliers] == ([[r + 1 for r in BAD]] if far else [])
    assert [f.size_um for f in outliers] == ([pytest.approx(1e3 * far, rel=0.1)] if far else [])
    assert [f.where for f in found.findings if f.effect != "outliers"] == ["X"]


def test_what_no_member_does_has_no_name() -> None:
    """2 mm/K: the prior of sizes alone refuses the name. Something follows the temperature, and is predicted.

    A sensor that is dead is said to be so, and drives nothing.
    """
    survey = empty_survey(MACHINE, 220, 12, channels=True, grid=False)
    fields: dict[str, object] = {"element": "column", "motion": "dy", "sensor": "T_0"}
    moved = showing(survey, MACHINE, [(EffectSpec("structure-drift", fields), [2.0])], 0.003)
    told = diagnose(MACHINE, replace(moved, table=moved.table.assign(T_chamber=-180.0)))
    found = told.diagnosis
    assert [f.effect for f in found.findings] == ["unnamed"]
    assert "T_0" in found.findings[0].driver
    assert any(note.startswith("T_chamber drives nothing") for note in found.notes)
    assert not any("T_chamber" in str(e) for e in told.final.chain.machine.effects)
    after, before = found.final["heldout_rms_um"], found.baseline["heldout_rms_um"]
    assert after is not None
    assert before is not None
    assert after < 0.1 * before


@pytest.mark.long
def test_without_a_cause_that_is_too_large_it_is_looked_for_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """A member that moves by 80 um/K, where 30 are taken to be the most: something without that name is looked for."""
    monkeypatch.setattr(kept_findings, "LARGEST", 3.0)
    survey = empty_survey(MACHINE, 220, 12, channels=True, grid=False)
    fields: dict[str, object] = {"element": "column", "motion": "dy", "sensor": "T_0"}
    moved = showing(survey, MACHINE, [(EffectSpec("structure-drift", fields), [0.08])], 0.003)
    done = diagnose(MACHINE, moved)
    removed = {(d.effect, d.where) for d in done.log if (d.rule, d.outcome) == ("physical-size", "removed")}
    assert "structure-drift" in {effect for effect, _ in removed}
    assert not removed & {(f.effect, f.where) for f in done.diagnosis.findings}
    assert done.diagnosis.findings
    after = done.diagnosis.final["heldout_rms_um"]
    before = done.diagnosis.baseline["heldout_rms_um"]
    assert after is not None
    assert before is not None
    assert after < 1.1 * 3**0.5 * 3.0 < 0.2 * before  # um: the noise of a row
