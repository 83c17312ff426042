"""Printers' axes homed against a switch while they heat up: what moves the switch's position, and what does not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from errormodel.machine_file import read_machine
from errormodel.survey import read_survey
from identification.diagnosis.pipeline import diagnose
from identification.diagnosis.results.diagnosed import Diagnosed
from tests.helpers.nightly import first_of

# held out: 13.4 or 14.2, as the processor rounds (9.4 without the first thirty rows, before which no other rows show
# how it warms; 8.6 where these are called outliers, which a recording's beginning is not) and 2.5, 6.4 where a finding
# named again lost all refinements
LARGEST_UM = {"a": 15.0, "b": 3.0}


@cache
def heated(folder: Path, name: str) -> Diagnosed:
    machine = read_machine(folder)
    return diagnose(machine, read_survey(folder / f"homing_{name}.csv", machine))


@pytest.mark.parametrize("name", first_of(sorted(LARGEST_UM, reverse=True)))  # b is that of other tests too
def test_contiguous_blocks_are_predicted_from_the_temperatures(printers: Path, name: str) -> None:
    result = heated(printers, name)
    assert result.final.folds == 10
    assert result.final.heldout.rms_um <= LARGEST_UM[name]
    assert result.baseline.heldout.rms_um > 80  # nothing but a constant
    # what is left of a wanders with the time; of b it depends on the side from which Z arrives: no effect with a name
    rest = result.diagnosis.dependence
    assert rest is None or rest.channels in (("dir_Z",), ("time", "Z"), ("time",))
    assert rest is None or rest.size_um < LARGEST_UM[name]
    assert result.diagnosis.verdict == ("partly-explained" if result.diagnosis.unexplained else "explained")


@pytest.mark.parametrize("name", first_of(sorted(LARGEST_UM, reverse=True)))
def test_it_is_the_heat_and_late(printers: Path, name: str) -> None:
    first = heated(printers, name).diagnosis.findings[0]
    assert first.effect in ("structure-drift", "scale-expansion", "warm-up", "thermal-bending", "spindle-growth")
    assert first.driver
    assert all(d.startswith(("T_", "lag(T_")) for d in first.driver)
    assert "lag" in first.statement
    # look-alikes by other names (an expansion of the scale) count against it
    assert first.probability > 0.7


@pytest.mark.long  # tests/system/test_diagnosis_again.py has one too
def test_a_dead_sensor_drives_nothing_and_is_reported(printers: Path) -> None:
    """The chamber of `a` reads -180 degC throughout."""
    result = heated(printers, "a")
    used = {d for f in result.diagnosis.findings for d in f.driver} | {
        str(e) for e in result.final.chain.machine.effects
    }
    assert not [u for u in used if "T_chamber" in u]
    assert any(note.startswith("T_chamber drives nothing") for note in result.diagnosis.notes)


def test_a_working_sensor_of_the_same_name_is_used(printers: Path) -> None:
    result = heated(printers, "b")
    assert any("T_chamber" in str(e.options) for e in result.final.chain.machine.effects)
    assert not any("T_chamber" in note for note in result.diagnosis.notes)


def test_a_cause_that_was_left_out_is_asked_for_again(printers: Path) -> None:
    """Of the model of `b`, in which more than the bed acts, what the bed drives is deleted; it comes back, along Z."""
    whole = heated(printers, "b").final.chain.machine
    kept = tuple(e for e in whole.effects if "T_bed" not in str(e.options))
    assert 0 < len(kept) < len(whole.effects)
    found = diagnose(replace(whole, effects=kept), read_survey(printers / "homing_b.csv", whole))
    first = found.diagnosis.findings[0]
    assert first.effect == "structure-drift"
    assert "dz" in first.motion  # a form that turns the carriage as well is as near: only heights were probed
    assert "T_bed" in first.statement
    assert "dz of Z" in first.statement  # of one joint that moves, it may be its carriage or what carries the whole
    assert found.final.heldout.rms_um < 0.2 * found.baseline.heldout.rms_um
