"""Fleets whose truth is known: surveys of simulated machines, and estimates from a known sampling distribution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from errormodel import simulate
from errormodel.arrays import Array, Mask
from identification.fleets.comparison import Compared, Type, compared, quantity
from identification.fleets.partial_pooling import Surveys
from identification.monitoring.quantities import Watched
from tests.helpers.commands import Done, run, write

MILL = "vertical_three_axis"
NOISE_MM = 0.002


def mill_fleet(folder: Path, machines: int, surveys: int = 1, odd: Sequence[int] = (), rows: int = 60) -> Path:
    """A list of mills whose scales and squareness differ from machine to machine; `odd` ones have a scale far off."""
    rng = np.random.default_rng(5)
    lines = ["machine,survey,id,type,date,hall"]
    for i in range(machines):
        truth = {
            "X.dx.1": 0.03 + 0.005 * rng.standard_normal(), "Y.dy.1": 0.005 * rng.standard_normal(),
            "X.ec.1": 2e-5 * rng.standard_normal(),
        }  # fmt: skip
        truth["X.dx.1"] += 0.1 * (i in odd)
        for j in range(surveys):
            table = simulate(MILL, rows, truth, noise=NOISE_MM, seed=100 * i + j)
            write(folder / f"data/m{i}_{j}.csv", table.to_csv(index=False))
            lines.append(f"{MILL},data/m{i}_{j}.csv,M{i:02d},mill,{2022 + j}-0{1 + i % 9}-01,{'AB'[i % 2]}")
    return write(folder / "list.csv", "\n".join(lines) + "\n")


def fleet_of(folder: Path, lines: str, *words: object) -> Done:
    """Run `fleet` on a list of these lines, with its results beside it."""
    write(folder / "list.csv", lines)
    return run("fleet", folder / "list.csv", "--out", folder / "out", "--workers", 1, *words)


@dataclass(frozen=True)
class Kind:
    """What is true of one type whose estimates are drawn.

    Attributes
    ----------
    covariance : (k, k) of one survey's estimates.
    mean, spread, within : (k,) of the machines, between them, and between surveys of one.
    moves : mm that the tool moves by per unit.
    """

    name: str
    covariance: Array
    mean: Array
    spread: Array
    within: Array
    moves: float = 1.0


@dataclass
class Drawn:
    """A fleet of estimates, what is true of it, and what was found."""

    result: Compared
    ailing: set[str] = field(default_factory=set)
    truth: dict[str, Array] = field(default_factory=dict)  # (machines, k) by type
    healthy: dict[str, Mask] = field(default_factory=dict)

    @property
    def found(self) -> set[str]:
        return set(self.result.found())

    def ratio(self) -> tuple[float, float, float]:
        """Mean squared error of pooled over single estimates of healthy machines: seen, by theory, and its std.

        By theory it is spread^2 / (spread^2 + v) with v the variance of a machine's own estimate; all quantities in
        units of their own v. The std is that of a mean of squared normal errors: correlation of the two lowers it.
        """
        seen, theory, count = [], [], 0
        for t in self.result.types:
            keep = self.healthy[t.name]
            for j, q in enumerate(t.quantities):
                v = float(q.each.variances[0])
                pooled = (q.level.pooled - self.truth[t.name][:, j])[keep] ** 2 / v
                single = (q.each.values - self.truth[t.name][:, j])[keep] ** 2 / v
                seen.append((pooled.sum(), single.sum()))
                theory.append(self.expected[t.name][j])
                count += int(keep.sum())
        pooled_sum, single_sum = np.array(seen).sum(axis=0)
        return float(pooled_sum / single_sum), float(np.mean(theory)), float(np.sqrt(2 / count))

    expected: dict[str, Array] = field(default_factory=dict)  # (k,) theoretical ratio by type


def kinds(count: int, quantities: int, seed: int = 1, spread: float = 2.0) -> list[Kind]:
    """Types with covariances of random correlation; machines differ by `spread` standard uncertainties of a survey."""
    rng = np.random.default_rng(seed)
    out = []
    for c in range(count):
        root = rng.standard_normal((quantities, 2 * quantities))
        std = 10.0 ** rng.uniform(-6, -2, quantities)
        shape = root @ root.T / (2 * quantities)
        shape = shape / np.sqrt(np.outer(np.diag(shape), np.diag(shape))) * np.outer(std, std)
        out.append(Kind(f"type {c + 1}", shape, np.zeros(quantities), spread * std, 0.5 * std, 1e-3 / std[0]))
    return out


def drawn_fleet(
    types: Sequence[Kind], machines: int, surveys: int = 4, *, ailing: float = 0.1, size: tuple[float, float] = (6, 14),
    seed: int = 0, rate: float = 0.01,
) -> Drawn:  # fmt: skip
    """Estimates of a fleet.

    Parameters
    ----------
    machines, surveys : of each type, and of each machine, a quarter of a year apart.
    ailing : share of machines with something of their own: one quantity that is off, or one that changes.
    size : range of it, in standard deviations of what the type's machines and surveys let expect.
    """
    rng = np.random.default_rng(seed)
    out = Drawn(compared([], rate))
    parts = []
    for kind in types:
        k = len(kind.mean)
        what = tuple(Watched(f"q{j}", f"q{j}", "", "mm", {f"q{j}": 1.0}) for j in range(k))
        names = tuple(f"{kind.name} {i:04d}" for i in range(machines))
        truth = kind.mean + kind.spread * rng.standard_normal((machines, k))
        dates = 0.25 * np.arange(surveys) - 0.125 * (surveys - 1)
        variance = np.diag(kind.covariance) + kind.within**2
        slopes = np.zeros((machines, k))
        ill = rng.random(machines) < ailing
        for i in np.flatnonzero(ill):
            j, away = int(rng.integers(k)), rng.uniform(*size) * rng.choice([-1, 1])
            if rng.random() < 0.5 or surveys < 3:
                truth[i, j] += away * np.sqrt(kind.spread[j] ** 2 + variance[j] / surveys)
            else:
                slopes[i, j] = away * np.sqrt(variance[j] / np.sum(dates**2))
        noise = rng.multivariate_normal(np.zeros(k), kind.covariance, (machines, surveys), method="cholesky")
        noise += kind.within * rng.standard_normal((machines, surveys, k))
        values = truth[:, None] + slopes[:, None] * dates[None, :, None] + noise
        number, date = np.repeat(np.arange(machines), surveys), np.tile(dates, machines)
        each = tuple(
            quantity(
                w, np.arange(machines),
                Surveys(values[:, :, j].ravel(), np.full(number.shape, kind.covariance[j, j]), number, date),
                kind.moves,
            )
            for j, w in enumerate(what)
        )  # fmt: skip
        parts.append(Type(kind.name, names, each, ()))
        out.ailing |= {names[i] for i in np.flatnonzero(ill)}
        out.truth[kind.name], out.healthy[kind.name] = truth, ~ill
        out.expected[kind.name] = kind.spread**2 / (kind.spread**2 + variance / surveys)
    out.result = compared(parts, rate)
    return out


def with_fault(kind: Kind, quantity_number: int, spreads: float) -> Kind:
    """A type all of whose machines have an error of a mean of so many spreads."""
    mean = kind.mean.copy()
    mean[quantity_number] = spreads * kind.spread[quantity_number]
    return replace(kind, mean=mean)
