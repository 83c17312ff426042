"""A simulated fleet of five types, 10 % ailing and a common fault of one type: `python -m tests.benchmarks.fleet`.

``drawn`` (some ten seconds of CPU): 3000 machines x 4 surveys, whose estimates are drawn from the covariances of real
fits of the five machines; hierarchical model and decisions are those of the command. ``fit`` and ``diagnose`` go the
whole way, from simulated rows through `errormodel fleet`; a survey takes 0.3 and 1 s of CPU.

    python -m tests.benchmarks.fleet drawn [--machines 600] [--surveys 4] [--repeats 1]
    python -m tests.benchmarks.fleet fit|diagnose [--machines 30] [--surveys 4] [--engine dask] [--folder DIR]
"""

from __future__ import annotations

import argparse
import json
import resource
import tempfile
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

from errormodel import read_machine, simulate
from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.machine import EffectSpec
from identification import fit, fleet, load
from identification.fleets.estimates import Estimates, of_fit
from tests.helpers.fleets import Kind, drawn_fleet, with_fault

TYPES = ("vertical_three_axis", "horizontal_three_axis", "bridge_cmm", "gantry_crossbeam_ram", "trunnion_five_axis")
FAULTY = "horizontal_three_axis"  # the type with a fault of its design
ROWS, NOISE_MM = 80, 0.002
SPREAD_MM = 0.004  # what each quantity of a normal machine moves the tool by, rms over a survey
BACKLASH_MM = 0.015
AILING = 0.1


@cache
def nominal(name: str) -> Estimates:
    """Quantities of a survey of a machine without errors: what they are, how well they are known, what they move."""
    result = fit(name, simulate(name, ROWS, {}, noise=NOISE_MM, seed=1))
    with tempfile.TemporaryDirectory() as folder:
        return of_fit(result.fit, load(result.save(f"{folder}/fit")).stored)


def varied(name: str) -> tuple[list[str], Array, Array]:
    """Parameters in which machines of a type differ, by how much, and the standard uncertainty of a survey."""
    known = nominal(name)
    own = [k for k, m in enumerate(known.moves) if np.isfinite(m) and m > 0]
    return [known.what[k].id for k in own], SPREAD_MM / known.moves[own], np.sqrt(np.diag(known.covariance))[own]


def drawn(machines: int, surveys: int, repeats: int) -> None:
    """Estimates from the sampling distribution of real fits."""
    kinds = []
    for name in TYPES:
        known = nominal(name)
        own = np.isfinite(known.moves) & (known.moves > 0)
        covariance = known.covariance[np.ix_(own, own)]
        spread = 2 * np.sqrt(np.diag(covariance))
        kinds.append(Kind(name, covariance, np.zeros(len(spread)), spread, 0.25 * spread))
    place = TYPES.index(FAULTY)
    kinds[place] = with_fault(kinds[place], 2, 3.0)
    counts = [len(k.mean) for k in kinds]
    print(f"{machines} machines of each of {len(TYPES)} types x {surveys} surveys, {counts} quantities")
    for seed in range(repeats):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
        d = drawn_fleet(kinds, machines, surveys, ailing=AILING, seed=seed)
        false, healthy = len(d.found - d.ailing), len(TYPES) * machines - len(d.ailing)
        common = d.result.common[d.result.common["common"]]
        seen, theory, std = d.ratio()
        print(
            f"seed {seed}: {len(d.found & d.ailing)} of {len(d.ailing)} ailing found; "
            f"false alarms {false} of {healthy} healthy ({100 * false / healthy:.2f} %), "
            f"{100 * false / max(len(d.found), 1):.2f} % of those found; in common: "
            f"{[(r['type'], r['name']) for _, r in common.iterrows()]}; mean squared error of pooled over single "
            f"{seen:.4f}, by theory {theory:.4f} (std {std:.4f}); "
            f"{resource.getrusage(resource.RUSAGE_SELF).ru_utime - before:.1f} s of CPU"
        )


@dataclass
class Fleet:
    """Files of a fleet, and what is true of it."""

    listing: Path
    ailing: dict[str, str]
    truth: dict[str, dict[str, float]]  # of healthy machines


def written(folder: Path, machines: int, surveys: int, effects: bool, seed: int = 7) -> Fleet:
    """Simulate all surveys; with `effects` half of the ailing machines, and all of the faulty type, have backlash."""
    rng = np.random.default_rng(seed)
    rows, ailing, truths = [], {}, {}
    for name in TYPES:
        ids, spread, std = varied(name)
        clear = np.flatnonzero(std <= spread)  # what a survey knows well enough to show it
        joint = next(j.name for j in read_machine(name).joints if j.type == "prismatic")
        other = [j.name for j in read_machine(name).joints if j.type == "prismatic"][-1]
        for i in range(machines):
            identity = f"{name}_{i:03d}"
            truth = dict(zip(ids, spread * rng.standard_normal(len(ids)), strict=True))
            slope, play = dict.fromkeys(ids, 0.0), []
            if name == FAULTY:
                if effects:
                    play.append(other)
                else:
                    truth[ids[2]] += 3 * spread[2]
            if rng.random() < AILING:
                j, sign = int(rng.choice(clear)), float(rng.choice([-1, 1]))
                ailing[identity] = kind = str(
                    rng.choice(["level", "wear" if surveys > 2 else "level", "backlash"][: 2 + effects])
                )
                if kind == "level":
                    truth[ids[j]] += sign * 10 * spread[j]
                elif kind == "wear":
                    slope[ids[j]] = sign * 10 * spread[j]  # a year
                else:
                    play.append(joint)
            else:
                truths[identity] = truth
            for s in range(surveys):
                at = {k: v + slope[k] * s / 4 for k, v in truth.items()}
                table = surveyed(name, at, play, int(rng.integers(2**31)))
                path = folder / "data" / f"{identity}_{s}.csv"
                path.parent.mkdir(parents=True, exist_ok=True)
                table.to_csv(path, index=False)
                date = pd.Timestamp("2024-01-15") + pd.Timedelta(days=round(91.3 * s))
                rows.append({"machine": name, "survey": f"data/{path.name}", "id": identity, "date": str(date.date())})
    pd.DataFrame(rows).to_csv(folder / "list.csv", index=False)
    return Fleet(folder / "list.csv", ailing, truths)


def surveyed(name: str, truth: dict[str, float], play: list[str], seed: int) -> pd.DataFrame:
    """A survey of a machine with these errors and backlash of these joints."""
    model = read_machine(name)
    model = replace(model, effects=tuple(EffectSpec("backlash", {"joint": j}) for j in play))
    sizes = dict.fromkeys((i for ids in Chain(model).effect_ids for i in ids), BACKLASH_MM)
    return simulate(model, ROWS, truth | sizes, noise=NOISE_MM, seed=seed)


def commanded(command: str, machines: int, surveys: int, engine: str, folder: Path) -> None:
    """The whole way through the command."""
    made = written(folder, machines, surveys, command == "diagnose")
    before = sum(resource.getrusage(who).ru_utime for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    result = fleet(
        made.listing, folder / "out", command=command, engine=engine, workers=2, announce=print,  # type: ignore[arg-type]
    )  # fmt: skip
    spent = sum(resource.getrusage(who).ru_utime for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) - before
    print(result.summary())
    found = set(result.found)
    missed = {i: kind for i, kind in made.ailing.items() if i not in found}
    false = sorted(found - set(made.ailing))
    healthy = len(TYPES) * machines - len(made.ailing)
    print(f"\n{command}: {len(TYPES)} x {machines} machines x {surveys} surveys, {spent:.0f} s of CPU")
    print(f"ailing {len(made.ailing)}, found {len(found & set(made.ailing))}, missed {json.dumps(missed)}")
    print(f"false alarms {len(false)} of {healthy} healthy: {false}")
    standing = result.standing[result.standing["id"].isin(list(made.truth))]
    true = np.array([made.truth[i].get(p, np.nan) for i, p in zip(standing["id"], standing["parameter"], strict=True)])
    known = np.isfinite(true)
    v = standing["std"].to_numpy(dtype=float)[known] ** 2
    pooled, single = (
        float(np.mean((standing[c].to_numpy(dtype=float)[known] - true[known]) ** 2 / v)) for c in ("pooled", "value")
    )
    spreads = {name: dict(zip(*varied(name)[:2], strict=True)) for name in TYPES}
    own = zip(standing["id"], standing["parameter"], strict=True)
    square = np.array([spreads[i.rsplit("_", 1)[0]].get(p, np.nan) for i, p in own])[known] ** 2
    print(
        f"squared error over stated variance: single {single:.3f}, pooled {pooled:.3f}, ratio {pooled / single:.4f}, "
        f"by theory {np.mean(square / (square + v)):.4f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=["drawn", "fit", "diagnose"])
    parser.add_argument("--machines", type=int)
    parser.add_argument("--surveys", type=int, default=4)
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--engine", default="local")
    parser.add_argument("--folder", type=Path)
    given = parser.parse_args()
    if given.what == "drawn":
        drawn(given.machines or 600, given.surveys, given.repeats)
        return
    with tempfile.TemporaryDirectory() as space:
        commanded(given.what, given.machines or 30, given.surveys, given.engine, given.folder or Path(space))


if __name__ == "__main__":
    main()
