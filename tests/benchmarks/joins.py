"""Wrong joins that survive an import, and right ones that are refused, in random trials.

``python -m tests.benchmarks.joins [trials] [seed]`` draws a machine of the library, a plan (random, a grid, lines along
the axes), its number of rows, errors of the machine, noise and the place of the instrument; writes a point list and a
plan; and imports them as they are and with one mistake. It prints, for each mistake, how many of how many survived.

``python -m tests.benchmarks.joins circles [trials] [seed]`` does so with circles of a ballbar: errors of the machine,
play, spikes where axes reverse, a ball that drifts, one ball or three. What must be said and not refused (a row that is
missing, an arc) counts as survived where nothing is said. Mistakes are drawn above ten times the noise, since what is
smaller does not show.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from errormodel import InputError, read_machine, simulate
from errormodel.chain import Chain
from errormodel.machine import Machine
from identification import import_survey
from tests.helpers.circles import PLANES, circles, middle, trace
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


@dataclass(frozen=True)
class Ballbar:
    """Circles of a ballbar, and what is known of them."""

    table: pd.DataFrame
    noise: float
    named: bool  # whether the file has a column of directions

    def plane(self, mistake: str, rng: np.random.Generator) -> pd.DataFrame | None:
        """Readings in XY with a mistake; None where none of it is large enough."""
        part = self.table[self.table["plane"] == "XY"].reset_index(drop=True).copy()
        n, y = len(part), part["length"].to_numpy().copy()
        angle = np.radians(part["angle"])
        large = 10 * self.noise
        if mistake == "sense":
            part["angle"] = (360 - part["angle"]) % 360
        elif mistake == "sense of one direction":
            part.loc[n // 2 :, "angle"] = (360 - part.loc[n // 2 :, "angle"]) % 360
        elif mistake == "two readings exchanged":
            pairs = [(i, j) for i in range(4, n - 4) for j in range(i + 9, n - 4, 7) if abs(y[i] - y[j]) > 2 * large]
            i, j = pairs[rng.integers(len(pairs))]
            y[[i, j]] = y[[j, i]]
        elif mistake == "rows shifted":
            wave = 2 * float(np.hypot(np.mean(y * np.cos(angle)), np.mean(y * np.sin(angle))))
            sizes = [k for k in range(1, n // 5) if 2 * wave * np.sin(2 * np.pi * k / (n / 2)) > max(large, 0.012)]
            if not sizes:
                return None
            y = np.roll(y, int(rng.choice([-1, 1])) * int(rng.choice(sizes)))
        elif mistake == "two balls":
            place = rng.uniform(0, 2 * np.pi)
            y[n // 2 :] += max(large, 0.03) * np.cos(angle[n // 2 :] - place)
        elif mistake == "a row missing":
            part = part.drop(index=int(rng.integers(5, n // 2 - 5)))
            y = y[part.index]
        elif mistake == "an arc":
            part, y = part.iloc[: int(0.36 * n)], y[: int(0.36 * n)]
        elif mistake == "mm for um":
            y = 1e3 * y
        return part.assign(length=y)


CIRCLE_SAID = {
    "a row missing": " a gap of ", "an arc": "of 360 degrees only", "rows shifted": "apart in the two senses",
    "two balls": "apart in the two senses", "sense of one direction": "angles of both directions in one order",
}  # fmt: skip
SAID = "said: "
CIRCLE_WRONG = (
    "right", "sense", "two readings exchanged", "mm for um", *CIRCLE_SAID,
)  # fmt: skip
OF_COLUMN = ("sense", "sense of one direction")  # which nothing but the file's own column shows


def ballbar(machine: Machine, rng: np.random.Generator) -> Ballbar:
    """Errors of a machine, play, spikes where an axis reverses, drift of the ball, and one ball or three."""
    noise = float(rng.choice([2e-4, 5e-4, 1e-3]))
    values = {k: float(rng.choice(SCALES)) * v for k, v in truth(machine, rng).items()}
    play = {a: float(rng.choice([0.0, 0.002, 0.008])) for a in "XYZ"}
    each = int(rng.choice([120, 180, 360, 720]))
    ball = rng.normal(0, 0.03, 3) if rng.integers(2) else None
    table = circles(machine, values, rng, play, noise, each, ball)
    spike, drift = float(rng.choice([0.0, 0.003, 0.01])), float(rng.choice([0.0, 0.001, 0.002]))
    turn, time = np.radians(table["angle"]), np.tile(np.linspace(-1, 1, 2 * each), 3)
    table["length"] += spike * np.exp(-np.degrees(np.abs(np.angle(np.exp(4j * turn)) / 4)) / 2.0)
    table["length"] += drift * time * np.cos(turn - rng.uniform(0, 2 * np.pi))
    return Ballbar(table, noise, bool(rng.integers(2)))


def circle_trial(rng: np.random.Generator, folder: Path) -> tuple[str, dict[str, str]]:
    """As `trial`, of circles."""
    machine = read_machine("vertical_three_axis")
    made = ballbar(machine, rng)
    centre = middle(machine)
    for plane, part in made.table.groupby("plane"):
        (folder / f"{plane}.csv").write_text(trace(part, str(plane)))
    out = {}
    for what in CIRCLE_WRONG:
        part = made.plane(what, rng)
        if part is None:
            continue
        text = trace(part, "XY")
        if made.named or what in OF_COLUMN:
            sense = np.where(np.arange(len(part)) < len(made.table) // 6, "CCW", "CW")
            head, _, rows = text.partition("Deviation [um]\n")
            lines = [f"{row},{word}" for row, word in zip(rows.splitlines(), sense, strict=True)]
            text = f"{head}Deviation [um],Direction\n" + "\n".join(lines) + "\n"
        (folder / "XY.csv").write_text(text)
        try:
            found = import_survey([folder / f"{p}.csv" for p in PLANES], machine, centre=centre)
            told = found.summary()
            out[what] = f"{SAID}{told}" if what in CIRCLE_SAID and CIRCLE_SAID[what] in told else ""
        except InputError as error:
            out[what] = f"{error.found}. {error.cure}"
    return f"{len(made.table) // 6} readings a turn, noise {1e3 * made.noise:g} um", out


def main() -> None:
    words = sys.argv[1:]
    of_circles = words[:1] == ["circles"]
    numbers = [int(w) for w in words[of_circles:]]
    trials, seed = (numbers[k] if len(numbers) > k else own for k, own in ((0, 100), (1, 7)))
    survived, said, tried = Counter[str](), Counter[str](), Counter[str]()
    for number in range(trials):
        rng = np.random.default_rng([seed, number])
        with tempfile.TemporaryDirectory() as folder:
            shown, out = (circle_trial if of_circles else trial)(rng, Path(folder))
        for what, message in out.items():
            tried[what] += 1
            survived[what] += not message
            said[what] += message.startswith(SAID)
            if (what == "right") == bool(message):
                print(f"{number}: {shown}: {what}: {message or 'survived'}", flush=True)
    for what in CIRCLE_WRONG if of_circles else WRONG:
        words = f", {said[what]} said and not refused" if said[what] else ""
        print(f"{what}: {survived[what]} of {tried[what]} went through{words}")


if __name__ == "__main__":
    main()
