"""Thermal models of a simulated CMM over seeds: `python -m tests.benchmarks.thermal_cmm [SEEDS]`.

For each seed 12 drift recordings, another thermal cycle at other positions, and a ring gauge at eight places at 20 and
at 26 degC. Printed: what stepwise regressions at each position and what lagged temperatures leave; some 20 s a seed.
"""

from __future__ import annotations

import sys

import numpy as np
import pandas as pd

from errormodel.schema import read_machine
from tests.ring_gauge import ring_errors, thermal_model

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
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10)
