"""Time and memory of whole commands, and how they grow: ``python -m tests.benchmarks.growth [--figure FILE]``.

``fit``, ``fit --bayes``, ``predict`` (with uncertainties), ``compensate``, ``plan`` and ``register``, each a process of
its own with one thread of linear algebra, cold start and report included, while one thing grows and the others stay as
they are: rows (poses to fit or to predict, points of a plan, points of a cloud), parameters (the degree of a three-axis
machine's error motions), effects (backlash and pitch errors of its axes). Printed are user and system seconds, largest
resident memory, and the exponents p of ``a + b x^p``.

    python -m tests.benchmarks.growth --commands predict plan --along rows --most 1e6
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from errormodel.chain import Chain
from errormodel.machine_file import read_machine
from tests.benchmarks.cpu_time import ROOT, Used, used
from tests.benchmarks.diagnose_time import NOISE, THREE_AXIS, exponent
from tests.helpers import crossbeam as sim

MACHINE = (ROOT / f"machines/{THREE_AXIS}.yaml").read_text(encoding="utf-8")
USUAL = {"rows": 1000, "parameters": 2, "effects": 1}  # what does not grow
SIZES = {
    "fit": {"rows": (1000, 10_000, 100_000, 1_000_000), "parameters": (1, 2, 4, 8), "effects": (0, 1, 3, 6)},
    "bayes": {"rows": (300, 1000, 10_000, 100_000), "parameters": (1, 2, 4), "effects": (0, 1, 3, 6)},
    "predict": {"rows": (1000, 10_000, 100_000, 10_000_000), "parameters": (1, 2, 4, 8), "effects": (0, 1, 3, 6)},
    "compensate": {"rows": (1000, 10_000, 100_000), "parameters": (1, 2, 4), "effects": (0, 1, 2, 3)},
    "plan": {"rows": (50, 100, 200, 400), "parameters": (1, 2, 4), "effects": (0, 1, 3, 6)},
    "register": {"rows": (10_000, 40_000, 160_000)},
}  # fmt: skip
COMMANDS, ALONG = tuple(SIZES), tuple(USUAL)
IN_MEMORY = 1_000_000  # rows from which `predict` streams


@dataclass(frozen=True)
class Run:
    """A command that was run: what grew, how far, and what it used."""

    command: str
    along: str
    at: float
    used: Used


def machine_file(folder: Path, degree: int, effects: int) -> Path:
    """The three-axis machine with polynomials of this degree, and with so many effects."""
    path = folder / f"machine_{degree}_{effects}.yaml"
    head, _, _ = MACHINE.partition("errors:")
    listed = [f"  - {{effect: backlash, joint: {j}}}" for j in "XYZ"]
    listed += [f"  - {{effect: pitch-cyclic, joint: {j}, period: 10}}" for j in "XYZ"]
    lines = [f"    {j}: {{polynomial: {degree}}}" for j in "XYZ"]
    text = "\n".join(["errors:", "  shapes: all", "  joints:", *lines, *(["effects:"] if effects else [])])
    path.write_text(head + "\n".join([text, *listed[:effects], ""]), encoding="utf-8")
    return path


def setting(along: str, at: int) -> tuple[int, int, int]:
    """Rows, degree and effects where one of them is as asked."""
    given = USUAL | {along: at}
    return given["rows"], given["parameters"], given["effects"]


class Bench:
    """Inputs, which are made once, and the commands on them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.fitted = cache(self._fitted)

    def made(self, *words: object) -> None:
        used(ROOT, [*map(str, words), "--quiet"], self.folder)

    def survey(self, rows: int, degree: int, effects: int, seed: int = 0) -> tuple[Path, Path]:
        """Machine and survey files."""
        machine = machine_file(self.folder, degree, effects)
        path = self.folder / f"s_{rows}_{degree}_{effects}_{seed}.csv"
        if not path.exists():
            self.made("simulate", machine, rows, "--noise", NOISE, "--seed", seed, "--out", path)
        return machine, path

    def _fitted(self, rows: int, degree: int, effects: int) -> Path:
        out = self.folder / f"fit_{rows}_{degree}_{effects}"
        self.made("fit", *self.survey(rows, degree, effects), "--out", out)
        return out

    def words(self, command: str, rows: int, degree: int, effects: int) -> list[object]:
        """The command line."""
        out = self.folder / "out"
        match command:
            case "fit":
                return ["fit", *self.survey(rows, degree, effects), "--out", out]
            case "bayes":
                return ["fit", *self.survey(rows, degree, effects), "--bayes", "--out", out]
            case "plan":
                machine = machine_file(self.folder, degree, effects)
                return [
                    "plan",
                    machine,
                    "--points",
                    100 if rows == USUAL["rows"] else rows,
                    "--out",
                    out.with_suffix(".csv"),
                ]
            case "compensate":
                return ["compensate", self.fitted(rows, degree, effects), "--controller", "csv", "--out", out]
            case "predict" if rows > IN_MEMORY:  # without play, whose side comes from the order of all rows
                return ["predict", self.fitted(USUAL["rows"], degree, 0), self.points(rows), "--stream",
                        "--out", out.with_suffix(".parquet")]  # fmt: skip
            case "predict":
                _, points = self.survey(rows, degree, effects, seed=1)
                return [
                    "predict",
                    self.fitted(USUAL["rows"], degree, effects),
                    points,
                    "--out",
                    out.with_suffix(".csv"),
                ]
        return ["register", *self.clouds(rows), "--out", out.with_suffix(".csv")]

    def points(self, rows: int) -> Path:
        """Poses in a Parquet file."""
        path = self.folder / f"points_{rows}.parquet"
        if not path.exists():
            self.made("simulate", THREE_AXIS, rows, "--stream", "--out", path)
        return path

    def clouds(self, points: int) -> list[object]:
        """Clouds of one artefact with about so many points, cold and warm, and the profiler's file."""
        folder = self.folder / f"clouds_{points}"
        profiler = folder / "profiler.yaml"
        if not profiler.exists():
            rng, artefact = np.random.default_rng(11), sim.Artefact.random(0)
            side = round(points**0.5)
            x, y = np.linspace(-20, 20, side), np.linspace(-20, 20, side)
            for name, minutes in {"cold": 0, "t_030min": 30}.items():
                there = sim.displaced(sim.warm_up(350.0, minutes))
                cloud = sim.disturbed(sim.scan(artefact, there, y, x, rng=rng), rng)
                sim.write_csv(cloud, folder / name / "artefact_01.csv")
            mount = f"mount: {{translation: {list(sim.MOUNT[:3])}, rotation: {list(sim.MOUNT[3:])}}}"
            profiler.write_text(f"joint: Y\npositions: [350.0]\nlever: {list(sim.LEVER)}\n{mount}\n", encoding="utf-8")
        return [folder / "cold", folder / "t_030min", "--profiler", profiler]

    def run(self, command: str, along: str, at: int) -> Run:
        rows, degree, effects = setting(along, at)
        words = self.words(command, rows, degree, effects)
        took = used(ROOT, [*map(str, words), "--quiet"], self.folder)
        for name in ("out", "out.csv", "out.parquet"):
            path = self.folder / name
            shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)
        place = float(at)
        if along == "parameters":
            place = float(len(Chain(read_machine(machine_file(self.folder, degree, effects))).machine_ids))
        return Run(command, along, place, took)


def runs(bench: Bench, commands: list[str], along: list[str], most: float) -> Iterator[Run]:
    for command in commands:
        for what in along:
            for at in SIZES[command].get(what, ()):
                if at <= most:
                    yield bench.run(command, what, at)


def draw(path: Path, found: dict[tuple[str, str], list[Run]]) -> None:
    """Seconds (left) and memory (right) of each command along each of the things that grow."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 6), layout="constrained")
    axes = figure.subplots(2, len(ALONG), sharey="row", squeeze=False)
    for (command, along), own in found.items():
        column, x = ALONG.index(along), [r.at for r in own]
        color = f"C{COMMANDS.index(command)}"
        axes[0, column].plot(x, [r.used.seconds for r in own], "o-", color=color, label=command, ms=4)
        axes[1, column].plot(x, [r.used.gigabytes for r in own], "o-", color=color, ms=4)
    for column, along in enumerate(ALONG):
        axes[1, column].set_xlabel(along)
        for row in axes[:, column]:
            row.set_yscale("log")
            row.grid(alpha=0.3)
            if along == "rows":
                row.set_xscale("log")
    axes[0, 0].set_ylabel("CPU seconds")
    axes[1, 0].set_ylabel("memory, GB")
    axes[0, 0].legend(fontsize=8)
    figure.savefig(path, dpi=130)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--commands", nargs="+", choices=COMMANDS, default=list(COMMANDS))
    parser.add_argument("--along", nargs="+", choices=ALONG, default=list(ALONG))
    parser.add_argument("--most", type=float, default=1e7, help="largest number of rows")
    parser.add_argument("--figure", type=Path, help="file to draw the growth in")
    given = parser.parse_args()
    found: dict[tuple[str, str], list[Run]] = {}
    with tempfile.TemporaryDirectory() as name:
        bench = Bench(Path(name))
        bench.made("describe", THREE_AXIS)  # modules are compiled once, as where the program is installed
        for run in runs(bench, given.commands, given.along, given.most):
            found.setdefault((run.command, run.along), []).append(run)
            print(
                f"{run.command:12}{run.along:12}{run.at:12g}{run.used.seconds:9.2f} s{run.used.gigabytes:7.2f} GB",
                flush=True,
            )
    for (command, along), own in found.items():
        if len(own) > 2:
            a, _, p = exponent([max(r.at, 0.5) for r in own], [r.used.seconds for r in own])
            print(f"-- {command} along {along}: {a:.2f} s and a part with exponent {p:.2f}")
    if given.figure:
        draw(given.figure, found)


if __name__ == "__main__":
    main()
