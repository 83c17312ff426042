"""A shift of the measuring frame in words: its axis, and its size in all."""

from __future__ import annotations

import re

import numpy as np

from errormodel.chain import Chain
from errormodel.effects.base import Effect
from errormodel.machine import Machine
from identification.diagnosis.results.effect_size import Whole, whole_of
from identification.diagnosis.results.statements import brief_of, motion_name, statement_of
from identification.estimation.fit import fit_machine
from tests.helpers import effect_battery as battery
from tests.helpers.findings import known, made, survey_of


def whole(machine: Machine, effects: list[Effect], values: list[float]) -> Whole:
    """Effects of the given sizes, recorded and fitted, as one finding."""
    extended = known(machine, *effects)
    chain = Chain(extended)
    ids = [i for own in chain.effect_ids for i in own]
    table = battery.table(machine.name).drop(columns=["run", "file", "role", "row"])
    truth = dict(zip(ids, values, strict=True))
    return whole_of(fit_machine(extended, survey_of(extended, table, truth)), effects, range(len(effects)))


def test_a_shift_of_the_frame_is_along_the_machines_axes_and_in_all() -> None:
    """88 um were said of 99, "dx of the measuring frame", whose own axes were turned by 37 degrees."""
    shift = [0.08, -0.03, 0.02]
    middle = float(battery.table("gantry")["time"].median())
    found = whole(battery.GANTRY, [made("station-shift", at=middle, turned=False)], shift)
    value, std = found.shift(("frame", "dx")) or (0.0, 0.0)
    assert abs(value - np.linalg.norm(shift)) < 4 * std < 0.02
    total = r"in all by 8[78]\.\d+"  # the length of the shift, 87.7 um
    axis = "dx of the measuring frame along x of the machine"
    said = statement_of(found, battery.GANTRY, 0.0, 0.95, [])
    assert re.search(rf"moves {axis} by [\d.]+ \+- [\d.]+ um, {total} \+- [\d.]+ um, peak to peak", said), said
    assert re.search(
        rf"station-shift of the measuring frame by \d+ um \({axis}, {total} um\)", brief_of(found, battery.GANTRY)
    )
    assert motion_name(("frame", "eb"), battery.GANTRY) == "eb of the measuring frame about y of the machine"
    alone = whole(battery.GANTRY, [made("backlash", joint="X")], [0.02])
    assert "in all" not in statement_of(alone, battery.GANTRY, 0.0, 0.95, [])
