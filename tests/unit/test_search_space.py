"""Where effects are looked for: what a machine's file says of which member is a ram and which a beam."""

from __future__ import annotations

import numpy as np
import pytest

from errormodel.effects import registry
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.travel import is_ram
from errormodel.machine_file import read_machine


@pytest.mark.parametrize(
    ("name", "rams"),
    [
        ("five_axis_table_quill", ["W"]),
        ("gantry_crossbeam_ram", ["Z"]),
        ("bridge_cmm", ["Z"]),
        ("h_gantry_dual_drive", []),  # its sensor hangs beside the beam
        ("vertical_three_axis", []),  # its tool stands out across the column's travel
        ("fork_head_five_axis", []),  # a fork is between the ram and the tool
    ],
)
def test_a_ram_carries_out_the_tool(name: str, rams: list[str]) -> None:
    machine = read_machine(name)
    assert [j.name for j in machine.joints if j.type == "prismatic" and is_ram(machine, j)] == rams


def test_a_ram_is_no_beam() -> None:
    machine = read_machine("five_axis_table_quill")
    here = Scene(machine, {j.name: np.linspace(*j.travel, 9) for j in machine.joints})
    sags = {e.where for e in registry()["beam-sag"].proposals(here)}
    assert sags == {"X", "Y", "Z"}
    assert "W" in {e.where for e in registry()["ram-sag"].proposals(here)}
