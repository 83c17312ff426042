"""Building M and fitting, ours against what a competent user would take: one run, turns taken, ratios.

    python -m tests.benchmarks.speed
    python -m tests.benchmarks.speed --poses 100000 1000000 --rivals numpy,sympy-blocks --json out.json

The rivals are the optional dependencies ``bench``; one that is not installed is left out and said so. Nothing printed
is stored anywhere: all figures are of this run on this machine.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

if __package__ in (None, ""):  # started as a file
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from errormodel.kernel import compiled
from identification.runtime.parallel import one_core
from tests.benchmarks import five_axis, limits, ours, timing
from tests.benchmarks.five_axis import Array
from tests.benchmarks.rivals import RIVALS, competent_numpy, stacked_numpy

Row = dict[str, Any]
CLOCKS = {"wall": time.perf_counter, "cpu": time.process_time}
CHECKED = 20  # poses on which M is compared with 60 digits


@dataclass(frozen=True)
class Contender:
    """A function under test: where it is, what the table calls it, on how many poses at most, and what M it gives."""

    label: str
    module: Any
    function: str
    limit: int | None = None

    @property
    def call(self) -> Callable[..., Any]:
        return getattr(self.module, self.function)

    def poses(self, n: int) -> int:
        return min(n, self.limit or n)

    def error(self) -> float | None:
        """Relative error of M; None where the result is not a matrix of known columns, or mpmath is missing."""
        if self.function != "build" or (accuracy := _accuracy()) is None:
            return None
        q = five_axis.poses(CHECKED)
        result = self.call(q)
        design = self.module.as_design(result, q) if hasattr(self.module, "as_design") else result
        return accuracy.design_error(design.reshape(CHECKED, 3, -1), self.module.IDS, q)


def rivals(names: list[str]) -> Iterator[Contender]:
    """The rivals that can be imported, in the order asked for."""
    for name in names:
        module, label, package = RIVALS[name]
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                loaded = importlib.import_module(f"tests.benchmarks.rivals.{module}")
        except ImportError as error:
            print(f"{name} is left out: {error}. Install {package}.", file=sys.stderr)
            continue
        yield Contender(label, loaded, "build", getattr(loaded, "MAX_POSES", None))


def race(contenders: list[Contender], inputs: tuple[Array, ...], repeats: int, memory: bool, clock: str) -> list[Row]:
    """Time the contenders turn by turn on the first rows of the inputs; ratios are to the first, which is ours.

    The first turn (compilation, first use) is not counted.
    """
    n = len(inputs[0])
    tasks = {c.label: partial(c.call, *(i[: c.poses(n)] for i in inputs)) for c in contenders}
    seconds = timing.interleaved(tasks, repeats, CLOCKS[clock])
    rows = [
        {
            "name": c.label,
            "poses": c.poses(n),
            "ns": timing.summary(seconds[c.label], c.poses(n)),
            "error": c.error(),
            "bytes": timing.peak_memory(c.module.__name__, c.function, c.poses(n)) if memory else None,
        }
        for c in contenders
    ]
    for row in rows:
        row["ratio"] = row["ns"]["median"] / rows[0]["ns"]["median"]
    return rows


def build(n: int, repeats: int, others: list[Contender], memory: bool, clock: str) -> list[Row]:
    """M at `n` poses."""
    own = [
        *([Contender("ours, M streamed, compiled", ours, "stream_compiled")] if compiled(sys.maxsize) else []),
        Contender("ours, M streamed", ours, "stream"),
        Contender("ours, M without repetitions", ours, "build_compact"),
        Contender("ours, dense M", ours, "build"),
    ]
    return race([*own, *others], (five_axis.poses(n),), repeats, memory, clock)


def fit(n: int, repeats: int, memory: bool, clock: str) -> list[Row]:
    """Parameters, covariance and residual statistics at `n` poses, from commands and measurements in memory."""
    q = five_axis.poses(n)
    measured = five_axis.measured(q, ours.as_design(ours.build(q), q))
    fast = [Contender("ours, compiled", ours, "fit_compiled")] if compiled(sys.maxsize) else []
    own, *rest = solvers("fit")
    own = Contender(own.label, ours, "fit_numpy")
    return race([*fast, own, *rest], (q, measured), repeats, memory, clock)


def solvers(function: str) -> list[Contender]:
    """Ours and the competent user's."""
    found = [Contender("ours", ours, function), Contender("NumPy tuned, lstsq, inv", competent_numpy, function)]
    if function == "fit":
        found.append(Contender("NumPy stacks, lstsq, inv", stacked_numpy, function))
    return found


def exactness(poses: int = 400) -> list[Row]:
    """Relative errors of the scaled parameters against 60 digits."""
    if (accuracy := _accuracy()) is None:
        return []
    rows = []
    for travel, share in (("full", 1.0), ("1 %", 0.01)):
        problem = accuracy.Problem(poses, share)
        for question in ("fit", "solve"):
            rows += [
                {"name": c.label, "travel": travel, "from": _FROM[question]} | problem.error(question, c.call)
                for c in solvers(question)
            ]
    return rows


_FROM = {"fit": "measured positions", "solve": "volumetric errors"}


@cache
def _accuracy() -> Any:
    try:
        return importlib.import_module("tests.benchmarks.accuracy")
    except ImportError as error:
        print(f"nothing is compared with the exact answer: {error}. Install mpmath.", file=sys.stderr)
        return None


def show(title: str, rows: list[Row]) -> None:
    """One table of a race."""
    print(f"\n{title}\n{'':<44}{'poses':>9}{'ns a pose':>12}{'min - max':>21}{'ratio':>9}{'peak MB':>9}{'error':>9}")
    for row in rows:
        ns = row["ns"]
        spread = f"{ns['min']:.0f} - {ns['max']:.0f}"
        error = _cell(row["error"], ".0e")
        size = _cell(row["bytes"] and row["bytes"] / 1e6, ".0f")
        print(
            f"{row['name']:<44}{row['poses']:>9}{ns['median']:>12.0f}{spread:>21}{row['ratio']:>9.2f}{size:>9}{error:>9}"
        )


def _cell(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def main() -> None:
    """Run what was asked for and print it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, nargs="+", default=[100_000])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--rivals", default=",".join(RIVALS), help=f"of {','.join(RIVALS)}")
    parser.add_argument("--parts", default="build,fit,accuracy,limits", help="of build,fit,accuracy,limits")
    parser.add_argument("--clock", choices=CLOCKS, default="wall", help="cpu: user and system seconds of all threads")
    parser.add_argument("--one-core", action="store_true", help="ours and BLAS in one thread")
    parser.add_argument("--no-memory", action="store_true", help="skip the separate runs that take the peak memory")
    parser.add_argument("--json", type=Path, help="write all figures there")
    options = parser.parse_args()
    with one_core() if options.one_core else nullcontext():
        run(parser, options)


def run(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """What the options ask for."""
    names, parts = [n for n in options.rivals.split(",") if n], options.parts.split(",")
    if unknown := sorted({*names} - {*RIVALS}):
        parser.error(f"no rival {', '.join(unknown)}; there are {', '.join(RIVALS)}")

    system = {"python": platform.python_version(), "numpy": np.__version__, "cores": os.cpu_count()}
    threads = "one" if options.one_core else os.environ.get("OMP_NUM_THREADS", "as the libraries choose")
    system |= {"machine": platform.machine(), "threads": threads}
    print(", ".join(f"{key} {value}" for key, value in system.items()))
    report: dict[str, Any] = {"system": system, "build": {}, "fit": {}, "accuracy": []}
    others = list(rivals(names)) if "build" in parts else []
    for n in options.poses:
        if "build" in parts:
            report["build"][n] = build(n, options.repeats, others, not options.no_memory, options.clock)
            show(
                f"Build M, 3 x {len(five_axis.IDS)} a pose, {n} poses; error of M relative to its columns",
                report["build"][n],
            )
        if "fit" in parts:
            report["fit"][n] = fit(n, options.repeats, not options.no_memory, options.clock)
            show(f"Fit: {five_axis.RANK} parameters, covariance, residual statistics, {n} poses", report["fit"][n])
    if "accuracy" in parts:
        report["accuracy"] = exactness()
        print("\nRelative error of the scaled parameters, against 60 digits")
        for row in report["accuracy"]:
            where = f"{row['travel']} travel, from {row['from']}, {row['rank']} parameters"
            print(f"{row['name']:<26}{where:<55}{row['error']:>9.0e}")
    if "limits" in parts:
        report["limits"] = limits.measured()
        limits.show(report["limits"])
        report["parts"] = {"NumPy alone": limits.parts(report["limits"])}
        if compiled(sys.maxsize):
            report["parts"]["the compiled loops, one thread"] = limits.compiled_parts(report["limits"])
        for how, took in report["parts"].items():
            limits.show_parts(how, took)
    if options.json:
        options.json.write_text(json.dumps(report, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
