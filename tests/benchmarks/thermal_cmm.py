"""Thermal models of a simulated CMM over seeds: `python -m tests.benchmarks.thermal_cmm [SEEDS] [parts]`.

For each seed 12 drift recordings, another thermal cycle at other positions, and a ring gauge at eight places at 20 and
at 26 degC. Printed: what stepwise regressions at each position and what lagged temperatures leave; some 20 s a seed.
With `parts`, instead: what the lags are worth, and the prior, each left out in turn.
"""

from __future__ import annotations

import sys
from contextlib import ExitStack
from typing import Any
from unittest.mock import patch

import numpy as np
import pandas as pd

from errormodel.machine_file import read_machine
from identification.thermal_drift import drift_model, selection
from tests.helpers.ring_gauge import ring_errors, thermal_model

FIRST = 101  # no seed that anything was tried on


def main(seeds: int) -> None:
    machine = read_machine("bridge_cmm")
    motions, rings = [], []
    for seed in range(FIRST, FIRST + seeds):
        result = thermal_model(machine, seed)
        own = pd.DataFrame(
            [{k: getattr(m, k) / m.noise for k in ("drift", "stepwise", "lagged")} for m in result.motions]
        )
        ring = pd.concat([ring_errors(result, seed, level) for level in (0.0, 6.0)])
        motions.append(own)
        rings.append(ring)
        print(f"seed {seed}: {_motions(own)}; {_rings(ring)}", flush=True)
    whole = pd.concat(motions)
    print(f"all {seeds}: {_motions(whole)}; {_rings(pd.concat(rings))}")
    print(
        f"motions predicted worse than by regression: {100 * (whole['lagged'] > 1.05 * whole['stepwise']).mean():.0f} %"
    )


def parts(seeds: int) -> None:
    machine = read_machine("bridge_cmm")
    without: dict[str, list[Any]] = {
        "all of it": [],
        "no lags": [patch.object(drift_model, "_lags", lambda taken: [])],
        "no prior": [patch.object(selection, "WIDTHS", (1e4,))],
        "neither": [patch.object(drift_model, "_lags", lambda taken: []), patch.object(selection, "WIDTHS", (1e4,))],
    }
    for name, patches in without.items():
        motions = []
        with ExitStack() as stack:
            for each in patches:
                stack.enter_context(each)
            for seed in range(FIRST, FIRST + seeds):
                result = thermal_model(machine, seed)
                motions += [{k: getattr(m, k) / m.noise for k in ("stepwise", "lagged")} for m in result.motions]
        print(f"{name:10} {_motions(pd.DataFrame(motions))}", flush=True)


def _motions(own: pd.DataFrame) -> str:
    """Root mean square beyond the noise, in noise."""
    left = {k: np.sqrt(np.mean(np.maximum(own[k] ** 2 - 1, 0))) for k in own}
    return "other cycle " + ", ".join(f"{k} {v:.2f}" for k, v in left.items())


def _rings(ring: pd.DataFrame) -> str:
    said = []
    for kind in ("regressions", "lags"):
        removed = 1 - (ring[kind] / ring["measured"]).abs()
        said.append(f"{kind} remove {100 * removed.min():.1f} % at least, {100 * removed.mean():.1f} % in the mean")
    return "ring " + ", ".join(said)


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    if "parts" in sys.argv:
        parts(count)
    else:
        main(count)
