"""The position of a gantry's second drive, recorded beside the joint's: what it is ahead by turns the bridge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from errormodel.channels import channel, lacking, root
from errormodel.effects.gantry_racking import GantryRacking
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from identification.compensation.field import Field
from identification.diagnosis.pipeline import diagnose
from tests.helpers.diagnosed import empty_survey, showing

AHEAD = "w_other less X"


@pytest.fixture(scope="module")
def gantry() -> Machine:
    return read_machine("gantry_crossbeam_ram")


@pytest.fixture(scope="module")
def racked(gantry: Machine) -> Survey:
    """A bridge that yaws by 0.5 urad a um of what the second drive is ahead, whose column has no telling name."""
    survey = empty_survey(gantry, 240, 4, channels=False, grid=False)
    wander = np.cumsum(np.random.default_rng(3).normal(0, 0.004, 240))
    table = survey.table.assign(w_other=12.0 + survey.table["X"] + wander, w_load=survey.table["X"] ** 2)
    spec = EffectSpec("gantry-racking", {"joint": "X", "channel": AHEAD})
    return showing(replace(survey, table=table), gantry, [(spec, [5e-4])], 0.003)


def test_the_channel_is_what_it_is_ahead(racked: Survey) -> None:
    table = racked.table
    assert channel(table, AHEAD) == pytest.approx(table["w_other"] - table["X"])
    assert root(AHEAD) == "w_other"
    assert lacking({"X"}, [AHEAD]) == ["w_other"]
    named_so = table.assign(**{AHEAD: 1.0})  # a column of that name is itself
    assert (channel(named_so, AHEAD) == 1.0).all()


def test_it_is_known_by_its_values(gantry: Machine, racked: Survey) -> None:
    names = [j.name for j in gantry.joints] + ["w_other", "w_load"]
    scene = Scene(gantry, {n: racked.table[n].to_numpy() for n in names})
    channels = {e.channel for e in GantryRacking.proposals(scene) if isinstance(e, GantryRacking)}
    assert {c for c in channels if c.startswith("w_")} == {AHEAD}


def test_it_is_found_and_its_tables_are_for_drives_in_step(gantry: Machine, racked: Survey) -> None:
    found = diagnose(gantry, racked)
    (finding,) = found.diagnosis.findings
    assert (finding.effect, finding.where, *finding.driver) == ("gantry-racking", "X", AHEAD)
    assert [p.value for p in finding.parameters][:1] == pytest.approx([5e-4], rel=0.2)
    chain = found.final.chain
    field = Field.without_errors(chain, racked.table)
    assert field.conditions[AHEAD] == pytest.approx(float(np.median(channel(racked.table, AHEAD))))
    place = chain.channels.index(AHEAD)
    q = np.array([[100.0, 0.0, -10.0], [3000.0, 0.0, -10.0]])
    rows = field.rows(q, np.ones_like(q))
    assert rows[place] == pytest.approx(field.conditions[AHEAD])  # wherever X is


def test_a_load_that_is_near_a_position_in_a_few_rows_is_no_encoder(gantry: Machine) -> None:
    """It has to follow the joint to within two per cent of where that goes."""
    x = np.linspace(0.0, 3000.0, 50)
    columns = {"X": x, "Y": x[::-1] / 2, "Z": -x / 3, "w_a": x + 100 * np.sin(x), "w_b": x.copy()}
    assert not {c.channel for c in GantryRacking.proposals(Scene(gantry, columns)) if "less" in c.channel}  # type: ignore[attr-defined]
