"""CPU seconds and memory of whole commands ``errormodel diagnose``: ``python -m tests.benchmarks.diagnose_time``.

Every command is a process of its own with one thread of linear algebra, cold start and report included. Printed are its
user and system seconds and its largest resident memory, beside what is aimed at:

- library: every machine of the library, 300 and 600 rows, with nothing hidden and with one effect
- arms: 3000 rows of the six-axis arm with three targets and several effects, and of a measured one (UR10)
- ur10: series A of the UR10, 11 911 rows (where the recordings are: ``ERRORMODEL_DATA``)
- rows: a three-axis machine, 10^4 to 10^6 rows
- growth: the same commands with more rows, joints and temperature channels, and the exponents p of ``a + b x^p``

Several checkouts take turns on the same surveys; ratios are to the first one. ``--figure FILE`` draws the growth.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import statistics
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from errormodel import simulate
from errormodel.chain import Chain
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine
from errormodel.simulation import outward, random_points
from tests.benchmarks.cpu_time import ROOT, Used, used

NOISE = 0.002  # mm
ARM_NOISE = 0.03  # mm
SECONDS_A_POSE = 20.0
ARM = "six_axis_arm"
THREE_AXIS = "vertical_three_axis"
TARGETS = ((40.0, -100.0, 0.0), (-60.0, -90.0, 30.0), (10.0, -150.0, -80.0))  # mm, in the arm's flange
HIDDEN = 3.0  # times the usual size of an effect
LEVELS = {"library": (4.0, 8.0), "arms": (60.0, 60.0), "ur10": (120.0, 120.0), "rows": (60.0, 60.0)}
MEMORY = {"ur10": 1.5, "rows": 2.0}  # GB
GROUPS = ("library", "arms", "ur10", "rows", "growth")
DATA = Path(os.environ.get("ERRORMODEL_DATA", ROOT.parent / "shared/real"))


@dataclass(frozen=True)
class Case:
    """A survey of a machine, as files.

    Attributes
    ----------
    group : of the cases; `along` and `at` say what grows in it, and how far it has.
    machine : a file, or a name of the library.
    """

    group: str
    name: str
    machine: str
    survey: Path
    rows: int
    along: str = ""
    at: float = 0.0


def commands(machine: Machine, rows: int, sensors: int = 1, seed: int = 0) -> pd.DataFrame:
    """Random poses in a file's units, with a time and temperatures that drift."""
    table = outward(random_points(machine, rows, seed), machine)
    rng = np.random.default_rng(seed)
    table["time"] = SECONDS_A_POSE * np.arange(rows)
    phase = np.linspace(0, 2 * np.pi, rows)
    for k in range(sensors):
        day = rng.uniform(0.5, 2.0) * np.sin(rng.uniform(0.5, 1.5) * phase + rng.uniform(0, 6))
        table[f"T_s{k}"] = np.round(20 + day + rng.normal(0, 0.02, rows), 2)
    return table


def hidden(machine: Machine) -> list[EffectSpec]:
    """An effect that every such machine can have: play of its first slide, or a compliance of an arm's joint."""
    slide = next((j for j in machine.joints if j.type == "prismatic"), None)
    if slide is not None:
        return [EffectSpec("backlash", {"joint": slide.name})]
    return [EffectSpec("joint-compliance", {"joint": machine.joints[min(1, len(machine.joints) - 1)].name})]


def several() -> list[EffectSpec]:
    """What an arm has at once: joints that yield, gears that cycle, play."""
    return [
        *(EffectSpec("joint-compliance", {"joint": name}) for name in ("J2", "J3", "J4")),
        *(EffectSpec("gear-cyclic", {"joint": name, "per_turn": 1.0 + k}) for k, name in enumerate(("J1", "J5", "J6"))),
        *(EffectSpec("backlash", {"joint": name}) for name in ("J2", "J4")),
    ]


def measured(
    machine: Machine, table: pd.DataFrame, effects: Sequence[EffectSpec], folder: Path, noise: float, seed: int = 0
) -> pd.DataFrame:
    """Commands with what would be measured, on a machine with so many further effects."""
    whole = replace(machine, effects=(*machine.effects, *effects))
    chain, before = Chain(whole), set(Chain(machine).ids)
    rng = np.random.default_rng(seed)
    values = {i: float(rng.normal(0, 0.1 if ".d" in i else 1e-4)) for i in sorted(before) if len(i.split(".")) == 2}
    sizes = {p.id: HIDDEN * p.size for p in chain.parameters if p.id not in before}
    points = folder / "points.csv"
    table.to_csv(points, index=False)
    return simulate(whole, points, values | sizes, noise=noise, seed=seed, translation=(100.0, 50.0, 20.0))


def library(folder: Path) -> Iterator[Case]:
    for path in sorted((ROOT / "machines").glob("*.yaml")):
        machine = read_machine(path)
        for rows in (300, 600):
            for effects in ([], hidden(machine)):
                name = f"{path.stem}, {rows} rows, {'one effect' if effects else 'none'}"
                table = commands(machine, rows)
                yield _case(folder, "library", name, path.stem, measured(machine, table, effects, folder, NOISE))


def arms(folder: Path) -> Iterator[Case]:
    machine = read_machine(ROOT / f"machines/{ARM}.yaml")
    table = commands(machine, 1000)
    table = table.loc[np.repeat(table.index, len(TARGETS))].reset_index(drop=True)
    table[["tool_x", "tool_y", "tool_z"]] = np.tile(TARGETS, (1000, 1))
    survey = measured(machine, table, several(), folder, ARM_NOISE)
    yield _case(folder, "arms", f"{ARM}, 3 targets, eight effects", ARM, survey)
    yield from _recorded(folder, "arms", 3000)


def ur10(folder: Path) -> Iterator[Case]:
    yield from _recorded(folder, "ur10", None)


def _recorded(folder: Path, group: str, rows: int | None) -> Iterator[Case]:
    """Poses of series A of the UR10, evenly over the series."""
    path = DATA / "ur10/series_a.csv"
    if not path.exists():
        print(f"{group}: no {path} (ERRORMODEL_DATA)", file=sys.stderr)
        return
    table = pd.read_csv(path)
    if rows is not None:
        table = table.iloc[np.linspace(0, len(table) - 1, rows).astype(int)]
    yield _case(folder, group, f"UR10 series A, {len(table)} rows", str(DATA / "ur10/machine.yaml"), table)


def rows(folder: Path) -> Iterator[Case]:
    for count in (10_000, 100_000, 1_000_000):
        yield _of_rows(folder, "rows", count)


def _of_rows(folder: Path, group: str, count: int) -> Case:
    machine = read_machine(ROOT / f"machines/{THREE_AXIS}.yaml")
    survey = measured(machine, commands(machine, count), hidden(machine), folder, NOISE)
    return _case(folder, group, f"{THREE_AXIS}, {count} rows", THREE_AXIS, survey, "rows", count)


def growth(folder: Path) -> Iterator[Case]:
    for count in (300, 1000, 3000, 10_000, 30_000, 100_000):
        yield _of_rows(folder, "growth", count)
    arm = read_machine(ROOT / f"machines/{ARM}.yaml")
    for joints in range(1, 7):
        machine = replace(arm, elements=arm.elements[: 2 * joints])
        path = folder / f"arm_{joints}.yaml"
        _write_arm(path, joints)
        survey = measured(machine, commands(machine, 600), hidden(machine), folder, ARM_NOISE)
        yield _case(folder, "growth", f"arm of {joints} joints, 600 rows", str(path), survey, "joints", joints)
    machine = read_machine(ROOT / f"machines/{THREE_AXIS}.yaml")
    for sensors in (1, 2, 4, 8, 16):
        survey = measured(machine, commands(machine, 600, sensors), hidden(machine), folder, NOISE)
        name = f"{THREE_AXIS}, {sensors} temperatures, 600 rows"
        yield _case(folder, "growth", name, THREE_AXIS, survey, "channels", sensors)


def _write_arm(path: Path, joints: int) -> None:
    """The first joints of the library's arm as a machine file."""
    from ruamel.yaml import YAML

    yaml = YAML(typ="safe")
    text = yaml.load(ROOT / f"machines/{ARM}.yaml")
    text["chain"] = text["chain"][: 2 * joints]
    text["errors"]["joints"] = {f"J{k}": "none" for k in range(1, joints + 1)}
    yaml.dump(text, path)


def _case(
    folder: Path, group: str, name: str, machine: str, survey: pd.DataFrame, along: str = "", at: float = 0.0
) -> Case:
    path = folder / f"{group}_{re.sub('[^A-Za-z0-9]+', '_', name)}.csv"
    survey.to_csv(path, index=False)
    return Case(group, name, machine, path, len(survey), along, at)


def exponent(at: Sequence[float], seconds: Sequence[float]) -> tuple[float, float, float]:
    """The curve ``a + b x^p`` (a, b at least 0) with the least squares of relative deviations: a, b and p."""
    from scipy.optimize import nnls

    x, y = np.array(at, float), np.array(seconds)
    fits = []
    for p in np.linspace(0.05, 4.0, 80):
        design = np.column_stack([np.ones(len(x)), (x / x.max()) ** p])
        (a, b), left = nnls(design / y[:, None], np.ones(len(y)))
        fits.append((left, a, b / x.max() ** p, float(p)))
    return min(fits)[1:]


def draw(path: Path, measured: dict[str, list[tuple[float, float]]]) -> None:
    """Seconds along each of the things that grow, with the fitted curves."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3), layout="constrained")
    for axes, (along, points) in zip(
        figure.subplots(1, len(measured), squeeze=False)[0], measured.items(), strict=True
    ):
        x, y = zip(*sorted(points), strict=True)
        a, b, p = exponent(x, y)
        fine = np.geomspace(x[0], x[-1], 100)
        axes.plot(x, y, "o", color="C0")
        axes.plot(fine, a + b * fine**p, color="C0")
        axes.set(xlabel=along, ylabel="CPU seconds", title=f"exponent {p:.2f} beyond {a:.1f} s", ylim=(0, None))
        if along == "rows":
            axes.set_xscale("log")
    figure.savefig(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkouts", type=Path, nargs="*")
    parser.add_argument("--groups", nargs="+", choices=GROUPS, default=GROUPS)
    parser.add_argument("--only", default="", help="part of the names of the cases to run")
    parser.add_argument("--figure", type=Path, help="file to draw the growth in")
    arguments = parser.parse_args()
    checkouts = [c.resolve() for c in arguments.checkouts] or [ROOT]
    grown: dict[str, list[tuple[float, float]]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        warm = False
        for group in arguments.groups:
            seconds, most = [], 0.0
            for case in globals()[group](folder):
                if arguments.only in case.name:
                    if not warm:  # modules are compiled once, as where the program is installed
                        warm = bool([_run(c, case, folder) for c in checkouts])
                    shown = [_run(c, case, folder) for c in checkouts]
                    seconds.append(shown[-1].seconds)
                    most = max(most, shown[-1].gigabytes)
                    if case.along:
                        grown.setdefault(case.along, []).append((case.at, shown[-1].seconds))
                    print(f"{case.name:52} {_words(shown)}", flush=True)
                case.survey.unlink()
            if seconds and group in LEVELS:
                median, worst = LEVELS[group]
                print(
                    f"-- {group}: {statistics.median(seconds):.1f} s in the median (aim {median:g}), "
                    f"{max(seconds):.1f} at most (aim {worst:g}); {most:.2f} GB"
                    + (f" (aim {MEMORY[group]:g})" if group in MEMORY else "")
                )
    grown = {along: points for along, points in grown.items() if len(points) > 3}
    for along, points in grown.items():
        a, _, p = exponent(*zip(*sorted(points), strict=True))
        print(f"-- growth with {along}: {a:.2f} s and a part with exponent {p:.2f}")
    if arguments.figure and grown:
        draw(arguments.figure, grown)


def _run(checkout: Path, case: Case, folder: Path) -> Used:
    out = folder / "out"
    try:
        return used(checkout, ["diagnose", case.machine, str(case.survey), "--out", str(out), "--quiet"], folder)
    finally:
        shutil.rmtree(out, ignore_errors=True)


def _words(shown: Sequence[Used]) -> str:
    first = shown[0].seconds
    return "   ".join(
        f"{u.seconds:7.2f} s {u.gigabytes:5.2f} GB" + (f" {u.seconds / first:5.2f} x" if k else "")
        for k, u in enumerate(shown)
    )


if __name__ == "__main__":
    main()
