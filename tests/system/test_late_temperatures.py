"""Tables for a temperature that acts late say for which machine they are, and advice says at which temperature."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.estimation.fit import fit_machine
from identification.results.store import save
from tests.helpers.commands import MILL, done
from tests.helpers.compensation import UM
from tests.helpers.surveys import measured, positions, survey

LAG = 2400.0  # s


@pytest.fixture(scope="module")
def warming(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fit of a mill whose X screw grows with a temperature that was recorded 40 min before it acts."""
    folder = tmp_path_factory.mktemp("late")
    spec = EffectSpec("scale-expansion", {"joint": "X", "sensor": "T_x", "tau": LAG})
    machine = replace(read_machine(MILL), effects=(spec,))
    chain = Chain(machine)
    rng = np.random.default_rng(0)
    time = np.linspace(0, 6 * 3600, 150)
    points = pd.DataFrame({j.name: rng.uniform(*j.travel, 150) for j in machine.joints})
    points = points.assign(tool_x=0.0, tool_y=0.0, tool_z=-100.0, time=time, T_x=20 + 6 * np.sin(time / 3000))
    table = positions(
        measured(
            machine, chain.vector({chain.effect_ids[0][0]: 11e-6, "X.dx.1": 3e-4}), seed=4, noise=UM, points=points
        )
    )
    save(fit_machine(machine, survey(table)), folder / "fit")
    return folder / "fit"


def text_of(folder: Path, out: Path, controller: str) -> str:
    return " ".join(done("compensate", folder, "--controller", controller, "--out", out).out.split())


def test_tables_for_a_temperature_are_for_a_machine_that_has_settled(warming: Path, tmp_path: Path) -> None:
    said = "errors follow T_x late (behind a lag of 40 min): what is written for a temperature is right once"
    text = text_of(warming, tmp_path / "a", "linuxcnc-type1")
    assert f"{said} the machine has had it for 2 h" in text
    assert "behind that lag" not in text
    # 6 K either way, of which 4.7 arrive
    beyond = r"late had 1[56]\.\d to 24\.\d degC in the survey: the tables for 14\.\d and 25\.\d degC are carried on"
    assert re.search(beyond, text)
    # a control that has the temperature itself needs more
    text = text_of(warming, tmp_path / "b", "siemens-lec")
    assert "A control that corrects by T_x itself takes it behind that lag: filter it so in the PLC" in text


def test_a_scale_to_set_is_stated_with_its_temperature(warming: Path, tmp_path: Path) -> None:
    """With the growth of a screw it is another one at every temperature."""
    text = text_of(warming, tmp_path / "c", "klipper")
    assert "adjust before compensating (largest first; sizes at T_x = " in text
