"""How often `monitor` cries wolf, and what it sees: `python -m tests.benchmarks.monitor` (about ten minutes).

The first tables judge values drawn from the covariance of a real fit, plus a scatter of the machine between cycles:
none, the same for all, one quantity that scatters a hundred times more (a scale in a shop without climate), and one
that grows from quantity to quantity. The last goes the whole way, from simulated rows through the fit.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache

import numpy as np
import pandas as pd

from errormodel.arrays import Array
from errormodel.machine import Machine
from errormodel.machine_file import read_machine
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit
from identification.monitoring.control_limits import judge
from identification.monitoring.quantities import Cycle, Watched, measured, watched
from identification.results.analysis import Analysis
from identification.results.store import as_json
from tests.helpers.surveys import measured as simulated
from tests.helpers.surveys import survey

COUNTS = (3, 5, 10, 20, 40)  # earlier cycles
SHIFTS = (5.0, 10.0)  # of one quantity, in standard deviations of its cycles
DRIFT = 0.3  # a cycle, in the same
DRIFTING = 30  # cycles of it


@cache
def mill() -> tuple[Machine, Fit, tuple[Watched, ...]]:
    machine = read_machine("vertical_three_axis")
    fit = cycle_fit(machine, 0)
    analysis = Analysis(fit)
    kept = analysis.stored
    kept.data.update(as_json(analysis))
    return machine, fit, watched(kept)


def cycle_fit(machine: Machine, seed: int, wear: Array | None = None) -> Fit:
    """A fit of 60 poses of the mill, the same in every cycle, with noise of its own."""
    from errormodel.chain import Chain
    from errormodel.simulation import random_points

    p = np.zeros(len(Chain(machine).ids)) if wear is None else wear
    table = simulated(machine, p, seed=seed, noise=0.002, points=random_points(machine, 60, 1))
    return fit_machine(machine, survey(pd.DataFrame(table.drop(columns=["mrx", "mry", "mrz"]))))


def scatters(shape: Array) -> dict[str, Array]:
    """Standard deviations of the machine itself between cycles, (k,), by name."""
    std, k = np.sqrt(np.diag(shape)), len(shape)
    one = np.zeros(k)
    one[0] = 10.0
    return {
        "noise only": 0 * std,
        "machine as noise": std,
        "one quantity x 10": one * std,
        "0 to 10 x noise": np.linspace(0, 10, k) * std,
    }


def draws(rng: np.random.Generator, shape: Array, scatter: Array, n: int) -> Array:
    """Values (n, k) of quiet cycles."""
    return rng.multivariate_normal(np.zeros(len(shape)), shape, n, method="cholesky") + scatter * rng.normal(
        size=(n, len(shape))
    )


def percent(alarms: Callable[[np.random.Generator], bool], draws: int, *cell: int) -> float:
    """How often, in a cell of a table: each cell has random numbers of its own."""
    rng = np.random.default_rng(cell)
    return 100 * float(np.mean([alarms(rng) for _ in range(draws)]))


def quiet(shape: Array, scatter: Array, n: int, shift: float = 0.0) -> Callable[[np.random.Generator], bool]:
    """Whether the cycle after `n` quiet ones raises an alarm; one quantity of it may have moved."""

    def alarms(rng: np.random.Generator) -> bool:
        values = draws(rng, shape, scatter, n + 1)
        k = int(rng.integers(len(shape)))
        values[-1, k] += shift * np.sqrt(shape[k, k] + scatter[k] ** 2)
        cycles = [Cycle(v, shape) for v in values]
        return judge(cycles[:-1], cycles[-1]).alarm

    return alarms


def drift_seen(shape: Array, scatter: Array, n: int) -> Callable[[np.random.Generator], float]:
    """After how many cycles a drift is found, nan if never; cycles in alarm do not enter the range."""

    def found(rng: np.random.Generator) -> float:
        values = draws(rng, shape, scatter, n + DRIFTING)
        k = int(rng.integers(len(shape)))
        step = DRIFT * float(np.sqrt(shape[k, k] + scatter[k] ** 2))
        values[n:, k] += step * np.arange(1, DRIFTING + 1)
        cycles = [Cycle(v, shape) for v in values]
        normal = cycles[:n]
        for number, cycle in enumerate(cycles[n:], start=1):
            judged = judge(normal, cycle)
            if judged.flagged[k]:
                return float(number)
            if not judged.alarm:
                normal.append(cycle)
        return float("nan")

    return found


def whole_way(machines: int, cycles: int) -> tuple[int, int]:
    """Alarms, and cycles judged, of quiet machines from rows to verdict."""
    machine, _, what = mill()
    raised = judged = 0
    for m in range(machines):
        normal: list[Cycle] = []
        for c in range(cycles):
            cycle = measured(what, cycle_fit(machine, 1000 * (m + 1) + c))
            result = judge(normal, cycle)
            judged += not result.learning
            raised += result.alarm
            if not result.alarm:
                normal.append(cycle)
    return raised, judged


def main(draws: int = 4000) -> None:
    machine, fit, what = mill()
    shape = measured(what, fit).covariance
    shape = shape[:-1, :-1]  # of the groups: the scatter's logarithm is one more of their kind
    print(f"{machine.name}: {len(shape)} quantities; {draws} draws a cell, {draws // 10} for what is found")
    print("\nfalse alarms, % of cycles (promised: at most 1)")
    print(f"{'earlier cycles':20}" + "".join(f"{n:8}" for n in COUNTS))
    for row, (name, scatter) in enumerate(scatters(shape).items()):
        rates = [percent(quiet(shape, scatter, n), draws, row, n) for n in COUNTS]
        print(f"{name:20}" + "".join(f"{r:8.2f}" for r in rates), flush=True)
    for shift in SHIFTS:
        print(f"\nfound, %: one quantity moved by {shift:g} standard deviations of its cycles")
        for row, (name, scatter) in enumerate(scatters(shape).items()):
            rates = [percent(quiet(shape, scatter, n, shift), draws // 10, row, n, int(shift)) for n in COUNTS]
            print(f"{name:20}" + "".join(f"{r:8.1f}" for r in rates), flush=True)
    print(
        f"\na drift of {DRIFT:g} standard deviations a cycle: cycles until it is found (median), found in {DRIFTING}, %"
    )
    for n in (10, 20, 40):
        times = [drift_seen(shape, 0 * shape[0], n)(np.random.default_rng(s)) for s in range(draws // 100)]
        print(f"after {n:3} quiet ones {np.nanmedian(times):8.0f}{100 * np.mean(np.isfinite(times)):8.0f}", flush=True)
    raised, judged = whole_way(10, 20)
    print(f"\nfrom rows to verdict: {raised} alarms in {judged} cycles of 10 quiet machines")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
