"""How often two standard deviations of a posterior hold the truth: python -m tests.benchmarks.bayes_coverage CASE [N].

Cases: closed (unknown noise, by quadrature), shape (a period and the noise, by emcee), outliers (a tenth of the rows up
to a metre away, by emcee in scaled groups). Prints the share over all groups and unknowns, which should be 94 to 96 %,
that of each unknown, and how many chains did not converge (they are not counted: they report nothing).
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from functools import cache
from unittest.mock import patch

import numpy as np

from errormodel.chain import Chain
from errormodel.machine import Basis, EffectSpec, Joint, Machine, Shape
from identification.bayes.inference import drawn, model_of
from identification.bayes.sampling import NotConvergedError
from identification.estimation import fit as estimation
from identification.estimation.fit import fit_machine
from tests.helpers.chains import Array, errors
from tests.helpers.surveys import measured, positions, survey

FIRST = Basis("first-order")
NOISE, PERIOD = 2e-3, 10.0
WAVE = EffectSpec("pitch-cyclic", {"joint": "X", "period": PERIOD})


def machine(effects: tuple[EffectSpec, ...] = ()) -> Machine:
    """Two linear axes: few parameters, so that hundreds of chains take minutes."""
    own = dict.fromkeys(("dx", "ea", "eb", "ec"), FIRST)
    x = Joint("X", "prismatic", (1.0, 0.0, 0.0), (0.0, 400.0), own)
    y = Joint("Y", "prismatic", (0.0, 1.0, 0.0), (0.0, 300.0), {"dy": FIRST, "ec": FIRST})
    elements = (x, Shape("slide", (0.0, 0.0, 200.0), motions=("ec",)), y)
    return Machine("two axes", elements, (50.0, 40.0, 100.0), effects)


@cache
def chain_of(case: str) -> Chain:
    """Traced once for all surveys."""
    return Chain(machine((WAVE,) if case == "shape" else ()))


@dataclass(frozen=True)
class Trial:
    """z: errors of means over standard deviations, of the groups and then of the unknowns that are not linear."""

    names: tuple[str, ...]
    z: Array
    method: str


def trial(case: str, seed: int, rows: int = 60) -> Trial:
    """One survey with its own noise, and its posterior."""
    chain = chain_of(case)
    true = chain.machine
    p = errors(chain, 1)
    if case == "shape":
        p[[chain.index[i] for i in chain.effect_ids[0]]] = 4e-3, 3e-3
    table = positions(measured(true, p, rows, 5, frame=((0, 0, 0), (0, 0, 0))))
    rng = np.random.default_rng(seed)
    table[["mx", "my", "mz"]] += rng.normal(0, NOISE, (rows, 3))
    if case == "outliers":
        bad = rng.choice(rows, rows // 10, replace=False)
        table.loc[bad, ["mx", "my", "mz"]] += rng.normal(size=(len(bad), 3)) * 10 ** rng.uniform(-1.5, 3)
    data = survey(table, frame="fixed")
    with patch.object(estimation, "Chain", lambda _: chain):
        fit = fit_machine(true, data, robust=case == "outliers")
    linear, whole, _ = model_of(fit, {}, None, case == "outliers")
    out, _ = drawn(fit, linear, whole, seed)
    groups = fit.solution.groups
    truth = groups.coefficients @ np.array([p[chain.index[u]] for u in fit.solution.unknowns])
    z = [(out.mean - truth) / np.sqrt(np.diag(out.covariance))]
    names = list(out.names)
    for k, (name, value) in enumerate((("noise.position", NOISE), ("X.pitch-cyclic.period", PERIOD))):
        found = [c.name for c in out.unknowns]
        if name in found:
            draws = out.coordinates[:, :, found.index(name)]
            z.append(np.array([(draws.mean() - value) / draws.std()]))
            names.append(found[k])
    return Trial(tuple(names), np.concatenate(z), out.method)


def main() -> None:
    case, count = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 500
    began, done, failed = time.perf_counter(), list[Trial](), 0
    for seed in range(count):
        try:
            done.append(trial(case, seed))
        except NotConvergedError:
            failed += 1
    z = np.array([t.z for t in done])
    inside = np.abs(z) <= 2
    print(
        f"{case}: {len(done)} posteriors by {done[0].method}, {failed} not converged, "
        f"{time.perf_counter() - began:.0f} s"
    )
    error = inside.mean(axis=1).std() / np.sqrt(len(inside))
    print(f"  within 2 standard deviations: {100 * inside.mean():.1f} ± {100 * error:.1f} %")
    for name, own, spread in zip(done[0].names, inside.T, z.T, strict=True):
        print(
            f"  {name:28} {100 * own.mean():5.1f} %   mean of z {spread.mean():+.2f}, its deviation {spread.std():.2f}"
        )


if __name__ == "__main__":
    main()
