"""Wrong joins that survive an import, and right ones that are refused, in random trials.

``python -m tests.benchmarks.joins [trials] [seed]`` draws a machine of the library, a plan (random, a grid, lines along
the axes), its number of rows, errors of the machine, noise and the place of the instrument; writes a point list and a
plan; and imports them as they are and with one mistake. It prints, for each mistake, how many of how many survived.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from errormodel import InputError, read_machine, simulate
from errormodel.chain import Chain
from errormodel.machine import Machine
from identification import import_survey
from tests.helpers.importing import spatialanalyzer
from tests.helpers.lengths import Array, truth

MACHINES = (
    "vertical_three_axis",
    "bridge_cmm",
    "trunnion_five_axis",
    "gantry_crossbeam_ram",
    "six_axis_arm",
    "fork_head_five_axis",
)
ROWS = (12, 20, 40, 80)
NOISE = (0.001, 0.005, 0.03)  # mm
SCALES = (0.3, 1.0, 3.0)  # times the errors of a good machine
PLANS = ("random", "grid", "lines")
UNITS = (25.4, 1e3, 1e-3)  # mm a unit

Wrong = Callable[[Array, Array, np.random.Generator], Array]


def exchanged(points: Array, commanded: Array, rng: np.random.Generator) -> Array:
    """Two rows exchanged that were commanded at least 1 mm apart."""
    for _ in range(100):
        i, j = rng.choice(len(points), 2, replace=False)
        if np.linalg.norm(points[i] - points[j]) > 1.0:
            break
    out = points.copy()
    out[[i, j]] = points[[j, i]]
    return out


WRONG: dict[str, Wrong] = {
    "right": lambda p, q, rng: p,
    "shifted by one row": lambda p, q, rng: np.roll(p, rng.choice([-1, 1]), axis=0),
    "two rows exchanged": exchanged,
    "other sign": lambda p, q, rng: p * np.where(np.arange(3) == rng.integers(3), -1, 1),
    "two columns exchanged": lambda p, q, rng: p[:, [[1, 0, 2], [0, 2, 1], [2, 1, 0]][rng.integers(3)]],
    "another unit": lambda p, q, rng: p / rng.choice(UNITS),
    "reversed": lambda p, q, rng: p[::-1],
    "another order": lambda p, q, rng: p[rng.permutation(len(p))],
}


def plan(machine: Machine, kind: str, rows: int, rng: np.random.Generator) -> pd.DataFrame:
    """Commands over the middle 80 % of the travels."""
    ends = {}
    for joint in machine.joints:
        low, high = joint.travel
        middle, half = (low + high) / 2, 0.4 * (high - low)
        turn = np.degrees(1) if joint.type == "rotary" else 1.0
        ends[joint.name] = (turn * (middle - half), turn * (middle + half))
    names = [*ends]
    low, high = np.array([*ends.values()]).T
    if kind == "random":
        table = rng.uniform(low, high, (rows, len(names)))
    elif kind == "grid":
        steps = int(np.ceil(rows ** (1 / len(names)))) + 1
        axes = [np.linspace(a, b, steps) for a, b in zip(low, high, strict=True)]
        nodes = np.array(np.meshgrid(*axes, indexing="ij")).reshape(len(names), -1).T
        table = nodes[np.sort(rng.choice(len(nodes), min(rows, len(nodes)), replace=False))]
    else:  # one joint after the other, the others in the middle
        table = np.tile((low + high) / 2, (rows, 1))
        for k, part in enumerate(np.array_split(np.arange(rows), len(names))):
            table[part, k] = np.linspace(low[k], high[k], len(part))
    return pd.DataFrame(np.round(table, 3), columns=names)


def trial(rng: np.random.Generator, folder: Path) -> tuple[str, dict[str, str]]:
    """A set-up in words, and for each mistake the message it was refused with; empty: it survived."""
    machine = read_machine(str(rng.choice(MACHINES)))
    kind, rows = str(rng.choice(PLANS)), int(rng.choice(ROWS))
    noise, scale = float(rng.choice(NOISE)), float(rng.choice(SCALES))
    commands = plan(machine, kind, rows, rng)
    values = {k: scale * v for k, v in truth(machine, rng).items()}
    place = {
        "translation": tuple(rng.uniform(-3000, 3000, 3)),
        "rotation": (*rng.uniform(-5, 5, 2), float(rng.uniform(-180, 180))),
    }
    chain = Chain(machine)
    known = {k: v for k, v in values.items() if k in chain.machine_ids}
    seed = int(rng.integers(2**31))
    made = simulate(machine, commands, known, noise=noise, seed=seed, **place)  # type: ignore[arg-type]
    points = made[["mx", "my", "mz"]].to_numpy()
    commands.to_csv(folder / "plan.csv", index=False)
    out = {}
    for what, mistake in WRONG.items():
        measured = mistake(points, commands.to_numpy(), rng)
        (folder / "tracker.txt").write_text(spatialanalyzer(measured))
        try:
            import_survey(folder / "tracker.txt", machine, commands=folder / "plan.csv", match="order")
            out[what] = ""
        except InputError as error:
            out[what] = f"{error.found}. {error.cure}"
    return f"{machine.name}, {kind}, {rows} rows, {1e3 * noise:g} um, {scale:g} times", out


def main() -> None:
    trials, seed = (int(sys.argv[k]) if len(sys.argv) > k else own for k, own in ((1, 100), (2, 7)))
    survived: Counter[str] = Counter()
    for number in range(trials):
        rng = np.random.default_rng([seed, number])
        with tempfile.TemporaryDirectory() as folder:
            words, out = trial(rng, Path(folder))
        for what, message in out.items():
            survived[what] += not message
            if (what == "right") == bool(message):
                print(f"{number}: {words}: {what}: {message or 'survived'}", flush=True)
    for what in WRONG:
        print(f"{what}: {survived[what]} of {trials} went through")


if __name__ == "__main__":
    main()
