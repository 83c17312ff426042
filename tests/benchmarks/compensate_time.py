"""CPU seconds of the whole command ``errormodel compensate``, cold start included, for machines and controllers.

``python -m tests.benchmarks.compensate_time [CASE ...] [--controller NAME ...] [--most SECONDS]``

Machines of the library and a plain mill are simulated with random errors, some with play, sag, growth and waves, fitted
with these effects, and compensated by the command in a process of its own with one thread. What is counted is user and
system time of that process. *rms, worst*: what the tables leave over the measured volume as the command says, um.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen

import numpy as np

from errormodel.chain import Chain
from errormodel.controllers import registry
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine
from errormodel.simulation import random_points
from identification.estimation.fit import fit_machine
from identification.results.store import save
from tests.helpers.chains import errors
from tests.helpers.surveys import measured, positions, survey

Values = tuple[float, ...]
Effect = tuple[str, Mapping[str, object], Values]

MILL = "vertical_three_axis"
QUILL = "five_axis_table_quill"
FORK = "fork_head_five_axis"
TRUNNION = "trunnion_five_axis"
CALL = "from identification.command_line.main import entry; entry()"


def play(joint: str, size: float) -> Effect:
    return "backlash", {"joint": joint}, (size,)


GROWTH: Effect = ("spindle-growth", {"sensor": "T_spindle"}, (0.002,))
WARM: Effect = ("warm-up", {"tau": 1900.0}, (0.012,))
TEN: tuple[Effect, ...] = (
    *(play(j, s) for j, s in (("X", 0.012), ("Y", 0.008), ("Z", 0.015), ("C", 5e-5), ("A", 4e-5))),
    ("ram-sag", {"joint": "Z"}, (0.03, 2e-5)),
    ("beam-sag", {"joint": "Y"}, (0.04, 1e-5)),
    ("lost-motion", {"joint": "X"}, (0.006, 0.004)),
    ("eccentricity", {"joint": "C", "harmonic": 3}, (3e-5, 2e-5)),
    GROWTH,
)


@dataclass(frozen=True)
class Case:
    """A machine with effects, and how often and at how many temperatures or times it was surveyed."""

    machine: str
    effects: tuple[Effect, ...] = ()
    poses: int = 200
    times: int = 0  # it was measured at so many times; 0: as the rows come
    channels: tuple[str, ...] = field(default=("time", "T_spindle"))

    def fit(self, folder: Path, seed: int = 1) -> None:
        """Survey and fit it into `folder`."""
        plain = read_machine(self.machine)
        machine = replace(plain, effects=tuple(EffectSpec(kind, dict(keys)) for kind, keys, _ in self.effects))
        chain, bare = Chain(machine), Chain(plain)
        values = dict(zip(bare.ids, errors(bare, seed).tolist(), strict=True))
        for ids, (_, _, given) in zip(chain.effect_ids, self.effects, strict=True):
            values |= dict(zip(ids, given, strict=False))
        table = self._survey(machine, chain, values, seed)
        save(fit_machine(machine, survey(table)), folder)

    def _survey(self, machine: Machine, chain: Chain, values: Mapping[str, float], seed: int):  # type: ignore[no-untyped-def]
        rng = np.random.default_rng(seed)
        points = random_points(machine, self.poses, seed)
        if self.effects:
            time = 30.0 * np.arange(self.poses)
            if self.times:
                time = np.sort(np.resize(600.0 * np.arange(self.times), self.poses))
            warm = 20 + 8 * (1 - np.exp(-time / 2000)) + rng.normal(0, 0.02, self.poses)
            points = points.assign(time=time, T_spindle=warm)
        return positions(measured(machine, chain.vector(values), seed=seed + 10, noise=0.002, points=points))


CASES: dict[str, Case] = {
    "mill": Case(MILL),
    "mill, play of X, growth": Case(MILL, (play("X", 0.010), GROWTH)),
    "mill, play of X, warm-up": Case(MILL, (play("X", 0.010), WARM)),
    "mill, play of 24 um": Case(MILL, (play("X", 0.024),)),
    "mill, play of X, Y, Z": Case(MILL, (play("X", 0.012), play("Y", 0.015), play("Z", 0.008))),
    "mill at 16 times": Case(MILL, (play("X", 0.010), WARM), 320, times=16),
    "mill, pitch": Case(MILL, (("pitch-cyclic", {"joint": "X", "period": 10.0}, (0.004, 0.002)),)),
    "bridge": Case("bridge_cmm"),
    "gantry": Case("gantry_crossbeam_ram"),
    "gantry, play of X, Y": Case("gantry_crossbeam_ram", (play("X", 0.012), play("Y", 0.015))),
    "h gantry": Case("h_gantry_dual_drive"),
    "horizontal": Case("horizontal_three_axis"),
    "quill": Case(QUILL),
    "quill, play of X, B": Case(QUILL, (play("X", 0.012), play("B", 5e-5))),
    "fork": Case(FORK),
    "fork, ten effects": Case(FORK, TEN, 400),
    "trunnion": Case(TRUNNION),
    "trunnion, play of X, C": Case(TRUNNION, (play("X", 0.012), play("C", 5e-5))),
    "arm": Case("six_axis_arm"),
}


@dataclass(frozen=True)
class Line:
    """One run of the command: CPU seconds, and what it left; no figures where it refused."""

    seconds: float
    rms_um: float | None
    worst_um: float | None
    said: str

    @classmethod
    def of(cls, fit: Path, controller: str, out: Path, most: float) -> Line:
        """Run ``compensate`` in a process of its own that ends after `most` seconds of CPU."""
        limit = f'ulimit -t {most:.0f}; exec "$0" "$@"'
        arguments = ["compensate", str(fit), "--controller", controller, "--out", str(out), "--quiet"]
        one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "RAYON_NUM_THREADS"), "1")
        process = Popen(
            ["/bin/sh", "-c", limit, sys.executable, "-c", CALL, *arguments],
            env={**os.environ, **one}, stdout=DEVNULL, stderr=PIPE, text=True,
        )  # fmt: skip
        said = process.stderr.read() if process.stderr else ""
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        seconds = used.ru_utime + used.ru_stime
        if process.returncode == 2:
            return cls(seconds, None, None, "refused")
        if process.returncode:
            return cls(seconds, None, None, said.strip().splitlines()[-1] if said.strip() else "ended")
        sets = json.loads((out / "compensation.json").read_text())["sets"]
        after = [s["figures"][0]["after"] for s in sets]
        return cls(seconds, max(a["rms_um"] for a in after), max(a["worst_um"] for a in after), "")


def lines(cases: list[str], controllers: list[str], most: float, work: Path) -> Iterator[tuple[str, str, Line]]:
    for case in cases:
        fit = work / "fits" / case.replace(" ", "_").replace(",", "")
        if not (fit / "fit.json").exists():
            CASES[case].fit(fit)
        for controller in controllers:
            with tempfile.TemporaryDirectory() as out:
                yield case, controller, Line.of(fit, controller, Path(out) / "out", most)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", default=list(CASES))
    parser.add_argument("--controller", action="append")
    parser.add_argument("--most", type=float, default=60.0, help="CPU seconds after which a run is ended")
    parser.add_argument("--work", type=Path, help="folder that keeps the fits")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as spare:
        slowest = ("", "", 0.0)
        print(f"{'machine':28}{'controller':16}{'CPU s':>8}{'rms':>9}{'worst':>9}  um")
        found = lines(given.cases, given.controller or list(registry()), given.most, given.work or Path(spare))
        for case, controller, line in found:
            left = line.said if line.rms_um is None else f"{line.rms_um:9.3f}{line.worst_um:9.3f}"
            print(f"{case:28}{controller:16}{line.seconds:8.2f}{left}", flush=True)
            slowest = max(slowest, (case, controller, line.seconds), key=lambda s: s[2])
        print(f"slowest: {slowest[0]}, {slowest[1]}: {slowest[2]:.1f} s")


if __name__ == "__main__":
    main()
