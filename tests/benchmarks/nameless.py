"""Effects without a name, drawn at random: how many are seen, and how many get a name that is not theirs.

``python -m tests.benchmarks.nameless --cases 500`` draws machines, plans, noise and geometry as the proof does, and one
effect of `physics_nameless` in each recording, of a size that an oracle who knows its form detects: its projected size
is 15 to 60 standard uncertainties, a log likelihood ratio of 110 to 1800 (those that physics keeps below 10 do not
count). An effect is seen if it is found, or if the verdict is not adequate. With ``--after`` the poses to be predicted
come after the survey, for half as long, while what was hidden goes on; else they lie within the same hours. Of the
names that are not its own those are counted apart whose textbook form fits the effect so well that the recording cannot
tell them (`tests.proof.lookalike`): a shift by the position of one joint is a straightness of that joint. A
prediction is worse if its error is that of the plain fit and 2 % and a twentieth of the noise more. Cases that are done
are kept.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from threadpoolctl import threadpool_limits

from tests.proof.cases import Case, make, write
from tests.proof.catalogue import BUILDERS
from tests.proof.lookalike import Alike
from tests.proof.machines import BUILDERS as MACHINES
from tests.proof.physics_nameless import nameless
from tests.proof.run_case import run_case
from tests.proof.score import Scored, share
from tests.proof.specs import SEED, USUAL, Spec, walkable

KINDS = {"a": "composition", "b": "switching state", "c": "wandering", "d": "memory of the path"}
NAMELESS = "nameless"
NO_NAMES = {"unnamed", "outliers"}
LEAST = 10.0  # projected size, in standard uncertainties: a log likelihood ratio of 50


def specs(cases: int, after: bool = False) -> list[Spec]:
    """Cases of random machines, plans and noise; `after`: their held-out poses come after the survey."""
    rng, out = np.random.default_rng([SEED, 500]), []
    for k in range(cases):
        topology, plan = str(rng.choice(list(MACHINES))), str(rng.choice(USUAL))
        noise = str(rng.choice(["white", "white", "tracker", "coloured", "heavy"]))
        name, plan = f"{NAMELESS}-{k:03}", walkable(plan, topology)
        drawn = Spec(name, "unnamed", topology, plan, noise, (NAMELESS,), (15.0, 60.0), seed=500_000 + k)
        out.append(replace(drawn, after=after))
    return out


def one(spec: Spec, out: Path) -> dict[str, Any]:
    """What the tool says of one case, and what it was."""
    BUILDERS[NAMELESS] = nameless
    done = out / f"{spec.name}.json"
    if not done.exists():
        case = make(spec)
        write(case, out / "cases" / spec.name, out / "sealed")
        run_case(out / "cases" / spec.name, out / "results")
        result = json.loads((out / "results" / done.name).read_text())
        scored = Scored(case.truth, result)
        hidden = case.effects[0][0]
        said = result.get("diagnosis") or {"verdict": "error", "findings": []}
        found = [f["effect"] for f in said["findings"]]
        (entry,) = case.truth["effects"]
        about = {
            "delta": entry["delta"],
            "kind": hidden.note,
            "accept": hidden.accept,
            "alike": sorted(_alike(case)),
            "plan": spec.plan,
            "topology": spec.topology,
            "rms_um": {} if scored.broken else {which: scored.rms(which) for which in ("plain", "final")},
            "worse": scored.worse,
        }
        done.write_text(json.dumps({**about, "verdict": said["verdict"], "found": found, "noise": spec.noise}))
    return dict(json.loads(done.read_text()))


def _alike(case: Case) -> dict[str, list[str]]:
    """Names whose textbook form the recording cannot tell from the effect, and where."""
    ((hidden, amplitude),) = case.effects
    left = case.here.off(case.here.whitened(case.here.shift_of(hidden, amplitude)))
    return Alike(case.here, hidden, left, np.empty((len(left), 0))).names()


def report(results: list[dict[str, Any]]) -> list[str]:
    """The table, by kind."""
    heads = ("seen", "false names", "that it can tell", "predicted worse")
    lines = [f"{'':24}{'cases':>6}" + "".join(f"{head:>34}" for head in heads)]
    results = [r for r in results if r["delta"] >= LEAST]
    for kind, word in [*KINDS.items(), ("", "all")]:
        own = [r for r in results if kind in ("", r["kind"])]
        seen = sum(bool(r["found"]) or r["verdict"] not in ("adequate", "error") for r in own)
        false = sum(bool(_false(r)) for r in own)
        told = sum(bool(_false(r) - set(r["alike"])) for r in own)
        counts = (seen, false, told, sum(r["worse"] for r in own))
        lines.append(f"{word:24}{len(own):>6}" + "".join(f"{share(n, len(own)):>34}" for n in counts))
    errors = Counter(r["verdict"] for r in results)["error"]
    return [*lines, f"errors: {errors}"]


def _false(result: dict[str, Any]) -> set[str]:
    """Names that were found and are not the effect's."""
    return set(result["found"]) - NO_NAMES - set(result["accept"])


@click.command()
@click.option("--cases", default=500, show_default=True)
@click.option("--after", is_flag=True, help="Predict poses that come after the survey.")
@click.option("--workers", default=os.cpu_count(), show_default=True)
@click.option("--out", type=click.Path(path_type=Path), default=Path("nameless-out"), show_default=True)
def main(cases: int, after: bool, workers: int, out: Path) -> None:
    """Draw effects without a name, diagnose, and print the table."""
    (out / "results").mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(workers, initializer=threadpool_limits, initargs=(1,)) as pool:
        jobs = [pool.submit(one, spec, out) for spec in specs(cases, after)]
        with click.progressbar(as_completed(jobs), length=len(jobs), label="diagnosing") as bar:
            results = [job.result() for job in bar]
    click.echo("\n".join(report(results)))


if __name__ == "__main__":
    main()
