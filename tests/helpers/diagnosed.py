"""Surveys to diagnose: with nothing in them but geometry and noise, and with some effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from errormodel.chain import Chain
from errormodel.instruments.base import Instrument
from errormodel.instruments.plain import Plain
from errormodel.machine import EffectSpec, Machine
from errormodel.simulation import measured_at, random_points
from errormodel.survey import Survey
from errormodel.truth import Truth
from identification.diagnosis.results.findings import Finding

FRAME = (500.0, -200.0, 100.0), (0.1, 0.2, 0.5)  # of the instrument: mm, rad
Shown = Sequence[tuple[EffectSpec, Sequence[float]]]  # effects and their first parameters
SIZES = {"mm": 0.01, "rad": 2e-5, "1": 2e-5, "rad/mm": 2e-8}


def empty_survey(machine: Machine, rows: int, seed: int, *, channels: bool, grid: bool) -> Survey:
    """Geometry of usual size, a tracker that stands anywhere, 5 um of noise; channels that have nothing to say."""
    rng = np.random.default_rng(seed)
    table = random_points(machine, rows, seed)
    if grid:
        for joint in machine.joints:
            table[joint.name] = rng.choice(np.linspace(*joint.travel, 6), rows)
    time = np.cumsum(rng.uniform(15, 50, rows))
    table = table.assign(run="1", file="a.csv", role="fit", row=np.arange(1, rows + 1))
    if channels:
        waves = {f"T_{k}": rng.uniform(0.3, 4) * np.sin(time / time[-1] * rng.uniform(2, 7)) for k in range(3)}
        table = table.assign(
            time=time,
            **{name: 21 + wave + rng.normal(0, 0.03, rows) for name, wave in waves.items()},
            feed=rng.choice([1500.0, 3000.0, 6000.0], rows),
            w_level=np.cumsum(rng.normal(0, 1, rows)),
        )
    chain = Chain(machine)
    errors = {p.id: rng.normal(0, SIZES[p.unit]) for p in chain.parameters if p.id in chain.machine_ids}
    measured = measured_at(machine, table, Truth(errors, *FRAME), 0.005, seed)
    table = pd.concat([table, measured[["mx", "my", "mz"]]], axis=1)
    return Survey(table, "shared", ("frame",), Plain(type="plain"), Path("a.csv"))


def showing(survey: Survey, machine: Machine, effects: Shown, noise: float | Instrument, seed: int = 3) -> Survey:
    """The survey as the machine would have measured it with some effects and no error of geometry, in noise (mm)."""
    chain = Chain(replace(machine, effects=tuple(spec for spec, _ in effects)))
    pairs = zip(chain.effect_ids, effects, strict=True)
    values = {n: v for names, (_, first) in pairs for n, v in zip(names, first, strict=False)}
    seen = measured_at(chain.machine, survey.table, Truth(values, *FRAME), noise, seed)
    return replace(survey, table=survey.table.assign(**{c: seen[c] for c in ("mx", "my", "mz")}))


def likely(finding: Finding) -> set[str]:
    """The finding's effect and those that it may be as well, with a probability of a tenth at least."""
    return {finding.effect, *(a.effect for a in finding.alternatives if (a.probability or 0) > 0.1)}
