"""What the load moves: along a joint's travel, or a member that gives way."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import simulate
from errormodel.chain import Chain
from errormodel.effects import make
from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.diagnosis.pipeline import diagnose
from tests.helpers.commands import done
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


@pytest.mark.parametrize("joint", ["J2", "J3"])
def test_loads_of_runs_that_nobody_recorded_are_named_at_their_joint(joint: str) -> None:
    """Three payloads, each a run: what their levers twist; a correction table of two runs had the name."""
    arm = read_machine("six_axis_arm")
    survey = empty_survey(arm, 150, 5, channels=False, grid=False)
    survey = replace(survey, table=survey.table.assign(run=np.repeat(["empty", "half", "full"], 50)))
    spec = EffectSpec("payload-sag", {"joint": joint, "gravity": "-z", "run": ["half", "full"]})
    (found,) = diagnose(arm, showing(survey, arm, [(spec, [4e-8, 8e-8])], 0.005)).diagnosis.findings
    assert (found.effect, found.where, found.driver) == ("payload-sag", joint, ["run(full)", "run(half)", joint])
    assert [p.value for p in found.parameters] == pytest.approx([8e-8, 4e-8], rel=0.3)


def test_a_sag_by_run_is_of_a_rotary_joint_and_its_lever() -> None:
    with pytest.raises(InputError, match="by run is that of a rotary joint with gravity"):
        make(EffectSpec("payload-sag", {"joint": "X", "run": ["2"]}))


def test_commands_of_no_run_have_no_load_of_a_run_and_a_note_says_so(tmp_path: Path) -> None:
    """As a number of random poses, or rows of another run."""
    arm, out = tmp_path / "arm.yaml", tmp_path / "out.csv"
    arm.write_text(
        "errormodel: 1\nname: arm\nunits: {length: mm, angle: deg}\n"
        "chain: [{joint: C, type: rotary, axis: z, travel: [-90, 90]}]\ntool: [300, 0, 0]\nerrors: {}\n"
        'effects: [{effect: payload-sag, joint: C, gravity: -x, run: ["2"]}]\n'
    )
    machine = read_machine(arm)
    (lever,) = (p.id for p in Chain(machine).parameters if "payload" in p.id)
    values = {lever: 1e-5}
    rows = pd.DataFrame({"C": [30.0, 60.0], "tool_x": 300.0, "tool_y": 0.0, "tool_z": 0.0})
    moved = [np.ptp([simulate(machine, rows.assign(run=run), v)["mx"] for v in ({}, values)], axis=0) for run in "12"]
    assert moved[0].max() == 0.0
    assert moved[1].min() > 0.01
    assert simulate(machine, 5, values)["mx"].tolist() == simulate(machine, 5)["mx"].tolist()
    for commands in ("5", rows):
        if not isinstance(commands, str):
            rows.to_csv(tmp_path / "commands.csv", index=False)
        said = done("simulate", arm, commands if isinstance(commands, str) else tmp_path / "commands.csv", "--out", out)
        assert (
            "note: no command is of run 2: what the machine does in that run alone is zero here" in said.err + said.out
        )
