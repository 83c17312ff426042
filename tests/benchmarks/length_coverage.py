"""Coverage of stated uncertainties by fits of lengths alone: 200 simulations that share no code with the product.

``python -m tests.benchmarks.length_coverage [simulations] [seed] [case]`` prints, for each set-up (or those whose words
begin with `case`), the share of groups (machine, stations, dead paths) whose 95 % interval holds the truth, with its
standard error, the root mean square of standardised errors, and as how many independent ones they scatter: the errors
of stations are those of a few directions, so that shares differ by more than their number suggests.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from errormodel.machine import Machine
from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from errormodel.surveys.observations import is_unknown
from identification.estimation.fit import fit_machine
from tests.helpers.lengths import Array, distances, entry, standardised, survey, truth

STATIONS = {
    "A": np.array([900.0, -700.0, -200.0]), "B": np.array([-900.0, -600.0, -100.0]),
    "C": np.array([100.0, 1100.0, 0.0]), "D": np.array([200.0, 300.0, 1500.0]),
}  # fmt: skip
NOISE = 3e-4  # mm: a tracking interferometer over a metre
Made = tuple[Machine, Survey, dict[str, float]]


def stations(machine: Machine, rng: np.random.Generator, count: int, rows: int, declared: bool) -> Made:
    """One interferometer in `count` places one after the other, each with a start of its own."""
    values = truth(machine, rng)
    places = {k: (p + rng.uniform(-80, 80, 3), float(rng.uniform(0, 500))) for k, p in [*STATIONS.items()][:count]}
    table = distances(machine, values, places, rows, NOISE, rng)
    sigma = {"sigma": [NOISE, 0.0]} if declared else {}
    entries = {k: entry(type="station-distance", dead_path="unknown", **sigma) for k in places}
    known = {f"observation[{k}].{a}": float(v) for k, (p, _) in places.items() for a, v in zip("xyz", p, strict=True)}
    known |= {f"observation[{k}].dead_path": d for k, (_, d) in places.items()}
    return machine, survey(machine, table, entries), {**values, **known}


def squared(machine: Machine) -> Machine:
    """The machine with the errors that lengths can see one by one: nothing moves or turns all of it."""
    keep = {"table": {}, "head": {}, "saddle": ("eb", "ec"), "column": ("ea",)}
    elements = tuple(
        replace(e, motions=tuple(m for m in e.motions if m in keep[e.name])) if e.name in keep else e
        for e in machine.elements
    )
    return replace(machine, elements=elements)


CASES: dict[str, Callable[[np.random.Generator], Made]] = {
    "four places, all errors, noise estimated": lambda rng: stations(
        read_machine("vertical_three_axis"), rng, 4, 120, declared=False
    ),
    "four places, squareness and error motions, noise declared": lambda rng: stations(
        squared(read_machine("vertical_three_axis")), rng, 4, 120, declared=True
    ),
    "three places, all errors, noise estimated": lambda rng: stations(
        read_machine("vertical_three_axis"), rng, 3, 120, declared=False
    ),
    "one place, all errors, noise estimated": lambda rng: stations(
        read_machine("vertical_three_axis"), rng, 1, 240, declared=False
    ),
}


def run(case: str, simulations: int, seed: int = 7) -> tuple[list[Array], list[Array]]:
    """Errors over standard uncertainties of the machine's groups, and of the set-ups', of each simulation."""
    machine_errors, set_ups = [], []
    for number in range(simulations):
        machine, data, values = CASES[case](np.random.default_rng([seed, number]))
        found = standardised(fit_machine(machine, data), values)
        own = [is_unknown(name) for name in found]
        z = np.array([*found.values()])
        machine_errors.append(z[~np.array(own)])
        set_ups.append(z[own])
    return machine_errors, set_ups


def main() -> None:
    simulations, seed = (int(sys.argv[k]) if len(sys.argv) > k else own for k, own in ((1, 200), (2, 7)))
    for case in (c for c in CASES if c.startswith(" ".join(sys.argv[3:]))):
        for what, each in zip(("machine", "set-ups"), run(case, simulations, seed), strict=True):
            inside = [np.mean(np.abs(z) < 1.96) for z in each]
            every = np.concatenate(each)
            share, error = 100 * np.mean(np.abs(every) < 1.96), 100 * np.std(inside) / np.sqrt(simulations)
            rms = np.sqrt(np.mean(every**2))
            size = min(map(len, each))
            spread = np.linalg.eigvalsh(np.cov(np.array([z[:size] for z in each]).T))
            alike = spread.sum() ** 2 / np.square(spread).sum()
            text = f"{case}; {what}: {share:.1f} +- {error:.1f} % of {len(every)}, rms {rms:.3f}"
            print(f"{text}, as {alike:.1f} independent of {size}", flush=True)


if __name__ == "__main__":
    main()
