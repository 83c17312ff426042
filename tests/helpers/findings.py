"""Findings of effects whose parameters are given."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

from errormodel.effects import make
from errormodel.effects.base import Effect
from errormodel.instruments.plain import Plain
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine
from errormodel.simulation import measured_at, random_points
from errormodel.survey import Survey
from errormodel.truth import Truth

NOISE = 0.003


def made(word: str, **options: object) -> Effect:
    return make(EffectSpec(word, options))


def known(machine: Machine, *effects: Effect) -> Machine:
    return replace(machine, effects=tuple(EffectSpec(e.effect, e.model_dump(exclude_defaults=True)) for e in effects))


def survey_of(machine: Machine, table: pd.DataFrame, values: dict[str, float], noise: float = NOISE) -> Survey:
    """A recording of known errors, with no uncertainty declared."""
    n = len(table)
    table = table.assign(run="1", file="a.csv", role="fit", row=np.arange(1, n + 1))
    measured = measured_at(machine, table, Truth(values), noise, 5)[["mx", "my", "mz"]]
    return Survey(pd.concat([table, measured], axis=1), "shared", ("frame",), Plain(type="plain"), Path("a.csv"))


@cache
def walked() -> pd.DataFrame:
    """Poses of which thirty are visited again, at other times."""
    machine = read_machine("vertical_three_axis")
    table = random_points(machine, 120, 8)
    return pd.concat([table, table.iloc[::4]], ignore_index=True)
