"""Whether two checkouts give the same numbers: ``python -m tests.benchmarks.same_numbers OLD NEW [CASES...]``.

Fits and diagnoses every folder of CASES (each a `machine.yaml` beside a `survey.csv` or `data.csv`; the examples of the
library where none is given) with both checkouts, by their command lines, and prints the largest difference of
parameters, standard uncertainties, residual statistics and findings. Differences are in standard uncertainties of the
old result; 1e-3 of one is rounding of another order of summation.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
ROUNDING = 1e-3  # standard uncertainties


class RefusedError(Exception):
    """A command that ended with another code than 0, and its last words."""


def command(checkout: Path, *words: object) -> None:
    """Run a command of the checkout's program."""
    scripts = tomllib.loads((checkout / "pyproject.toml").read_text())["project"]["scripts"]
    module, name = scripts["errormodel"].split(":")
    program = f"from {module} import {name}; {name}()"
    environment = {**os.environ, "PYTHONPATH": str(checkout), "OMP_NUM_THREADS": "1"}
    words = tuple(map(str, words))
    done = subprocess.run(
        [sys.executable, "-c", program, *words], env=environment, capture_output=True, cwd=checkout, check=False
    )
    if done.returncode:
        raise RefusedError(f"{checkout.name} {words[0]}: {done.stderr.decode().splitlines()[-1]}")


def results(checkout: Path, case: Path, folder: Path) -> dict[str, Any]:
    """Numbers of a fit and of a diagnosis."""
    data = next(p for p in (case / "survey.yaml", case / "survey.csv", case / "data.csv") if p.exists())
    out: dict[str, Any] = {}
    for name in ("fit", "diagnose"):
        command(checkout, name, case, data, "--out", folder / name)
        out[name] = json.loads((folder / name / "fit.json").read_text())
    out["findings"] = json.loads((folder / "diagnose/diagnosis.json").read_text())["findings"]
    return out


def difference(old: dict[str, Any], new: dict[str, Any]) -> float:
    """Largest difference of two fits: of values in standard uncertainties, of the rest relative."""
    before = {p["id"]: p for p in old["parameters"]}
    after = {p["id"]: p for p in new["parameters"]}
    if before.keys() != after.keys():
        return math.inf
    worst = 0.0
    for name, p in before.items():
        worst = max(worst, abs(after[name]["value"] - p["value"]) / p["std"], abs(after[name]["std"] / p["std"] - 1))
    for kind in ("nominal", "fitted", "heldout"):
        worst = max(worst, abs(new[kind]["rms_um"] / old[kind]["rms_um"] - 1))
    return worst


def named(findings: list[dict[str, Any]]) -> list[tuple[str, str]]:
    return [(f["effect"], f["where"]) for f in findings]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("cases", type=Path, nargs="*")
    arguments = parser.parse_args()
    cases = [c.resolve() for c in arguments.cases] or sorted(
        p.parent for p in (ROOT / "machines/examples").glob("*/machine.yaml")
    )
    changed = 0
    for case in cases:
        with tempfile.TemporaryDirectory() as folder:
            try:
                both = [results(c, case, Path(folder) / str(k)) for k, c in enumerate((arguments.old, arguments.new))]
            except RefusedError as refused:
                print(f"{case.name:24} {refused}", flush=True)
                changed += 1
                continue
        old, new = both
        fit, extended = (difference(old[name], new[name]) for name in ("fit", "diagnose"))
        same = named(old["findings"]) == named(new["findings"])
        odds = max(
            (abs(a["probability"] - b["probability"]) for a, b in zip(old["findings"], new["findings"], strict=False)),
            default=0.0,
        )
        changed += not (same and fit < ROUNDING and extended < ROUNDING)
        print(
            f"{case.name:24} fit {fit:8.1e}  diagnosed {extended:8.1e}  probability {odds:8.1e}  "
            + ("same findings" if same else f"{named(old['findings'])} -> {named(new['findings'])}"),
            flush=True,
        )
    print(f"{len(cases) - changed} of {len(cases)} alike to {ROUNDING:g} of a standard uncertainty")


if __name__ == "__main__":
    main()
