"""Bias, spread and coverage of each estimator of `fit`, in clean and in bad conditions: ``python -m ... --seeds 500``.

A three-axis machine with errors in every group is measured again and again with fresh noise. Errors of the groups count
in the standard uncertainty that least squares has on the clean data of the same seed: a spread of 1 is the best there
is. Where rows are wrong, the limit is what the others hold: a line of its own. Coverage is how often the truth lies
within two of the fit's own standard uncertainties: 95.4 % of normal errors.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from errormodel.chain import Chain
from errormodel.instruments.laser_tracker import LaserTracker
from errormodel.schema import read_machine
from errormodel.survey import Survey
from identification.fit import run
from identification.fit.noise import Noise
from identification.fit.result import Fit
from tests.chains import Array, errors
from tests.surveys import FAR, TURNED, measured, positions, survey

MACHINE = read_machine("horizontal_three_axis")
CHAIN = Chain(MACHINE)
P = errors(CHAIN, 1)
ROWS = 100
POINTS = positions(measured(MACHINE, P, ROWS, 0))
SIGMA = 5e-3  # mm
XYZ = ["mx", "my", "mz"]
TRACKER = LaserTracker(type="laser-tracker", station=[2500, -1500, 600], range=[1e-3, 1e-6], angle=5e-6)
WAY = np.array([0.6, 0.0, -0.8])


def white(rng: np.random.Generator) -> Survey:
    return with_noise(rng.normal(0, SIGMA, (ROWS, 3)))


def with_noise(noise: Array, **more: object) -> Survey:
    table = POINTS.copy()
    table[XYZ] += noise
    return survey(table, **more)  # type: ignore[arg-type]


def tracked(rng: np.random.Generator) -> Survey:
    """Uncertainty by range and angle, declared."""
    return with_noise(TRACKER.draw_noise(POINTS[XYZ].to_numpy(), rng), instrument=TRACKER)


def correlated(length: float) -> Callable[[np.random.Generator], Survey]:
    """Three fifths of the variance hang together over `length` rows."""
    noise = Noise(length, 1.5)

    def draw(rng: np.random.Generator) -> Survey:
        slow = np.empty((ROWS, 3))
        slow[0] = rng.normal(size=3)
        for k in range(1, ROWS):
            slow[k] = noise.kept * slow[k - 1] + np.sqrt(1 - noise.kept**2) * rng.normal(size=3)
        whole = rng.normal(size=(ROWS, 3)) + np.sqrt(noise.part) * slow
        return with_noise(SIGMA * whole / np.sqrt(1 + noise.part))

    return draw


def drifting(rng: np.random.Generator) -> Survey:
    """The instrument creeps by six sigma during the survey, along one direction: no model has it."""
    return with_noise(rng.normal(0, SIGMA, (ROWS, 3)) + 6 * SIGMA * np.linspace(-0.5, 0.5, ROWS)[:, None] * WAY)


def outliers(size: float | None, where: str, share: float = 0.1) -> Callable[[np.random.Generator], Survey]:
    """White noise, and a share of the rows out by `size` sigma: scattered in all directions, or together one way.

    None: just these are missing, as if an oracle had named them. No estimator can do better than what is left.
    """

    def draw(rng: np.random.Generator) -> Survey:
        clean = white(rng)  # the same numbers as without outliers
        table, count = clean.table, round(share * ROWS)
        away = np.tile(WAY, (count, 1))
        if where == "scattered":
            rows = rng.permutation(ROWS)[:count]
            away = rng.normal(size=(count, 3))
            away /= np.linalg.norm(away, axis=1)[:, None]
        elif where == "one way":
            rows = rng.permutation(ROWS)[:count]
        elif where == "in a block":
            rows = int(rng.integers(ROWS - count)) + np.arange(count)
        elif where == "of one component":
            rows, away = rng.permutation(ROWS)[:count], np.tile([0.0, 0.0, 1.0], (count, 1))
        else:  # the far end of the first joint's travel
            rows = np.argsort(table[MACHINE.joints[0].name].to_numpy())[-count:]
        away = np.where(away == 0, 0.0, np.nan) if size is None else size * SIGMA * away
        table.loc[rows, XYZ] += away
        return clean

    return draw


ORACLE = "known and left out"
CONDITIONS: dict[str, Callable[[np.random.Generator], Survey]] = {
    "clean": white,
    "tracker, declared": tracked,
    "correlated over 6 rows": correlated(6.0),
    "correlated over a fifth of the survey": correlated(20.0),
    "drift, not modelled": drifting,
    **{
        f"{where}, {f'10 % out by {size:g} sigma' if size else ORACLE}": outliers(size, where)
        for where, sizes in {
            "scattered": (3, 6, 100, 2e8, None),
            "one way": (1, 3, 6, 20, 2e8),
            "in a block": (6, 2e8, None),
            "in one region": (3, 6, 20, 2e8, None),
        }.items()
        for size in sizes
    },
    "of one component, a third out by 20 sigma": outliers(20, "of one component", 1 / 3),
    f"of one component, {ORACLE}": outliers(None, "of one component", 1 / 3),
}


def group_errors(fit: Fit) -> Array:
    """Estimates minus truth: the measuring frame's small parameters count from where it was put."""
    pose = fit.problem.frames[""]
    turn = pose.rotation.T @ Rotation.from_euler("XYZ", TURNED).as_matrix()
    shift = pose.rotation.T @ (np.array(FAR) - pose.translation)
    frame = dict(zip(fit.chain.frame_ids, [*shift, *Rotation.from_matrix(turn).as_euler("XYZ")], strict=True))
    truth = np.array([frame[u] if u in frame else P[fit.chain.index[u]] for u in fit.solution.unknowns])
    return np.asarray(fit.solution.values[fit.solution.groups.base] - fit.solution.groups.coefficients @ truth)


def deviations(fit: Fit) -> Array:
    return np.asarray(np.sqrt(np.diag(fit.solution.covariance)) * fit.inflation)


@cache
def clean(seed: int) -> tuple[list[int], Array, Array]:
    """Least squares on white noise alone: the groups' base, their errors and standard uncertainties."""
    fit = run.fit_machine(MACHINE, white(np.random.default_rng(seed)))
    return fit.solution.groups.base.tolist(), group_errors(fit), deviations(fit)


def campaign(draw: Callable[[np.random.Generator], Survey], robust: bool, seeds: int) -> tuple[Array, ...]:
    """(seeds, groups): errors over the clean standard uncertainty, over their own, and the clean fit's errors."""
    out: list[tuple[Array, Array, Array]] = []
    for seed in range(seeds):
        base, error_of_clean, unit = clean(seed)
        fit = run.fit_machine(MACHINE, draw(np.random.default_rng(seed)), robust)
        if fit.solution.groups.base.tolist() == base:
            error = group_errors(fit)
            out.append((error / unit, error / deviations(fit), error_of_clean / unit))
    return tuple(np.array(a) for a in zip(*out, strict=True))


def line(name: str, estimator: str, found: tuple[Array, ...]) -> str:
    if not len(found):
        return f"{name:42}{estimator:15}  no fit with the groups of clean data"
    scaled, own, clean = found
    bias = np.sqrt(np.mean(scaled.mean(axis=0) ** 2))
    spread = np.sqrt(np.mean(scaled**2))
    worst = np.sqrt(np.mean(scaled**2, axis=0)).max()
    shift = np.sqrt(np.mean((scaled - clean) ** 2))
    inside = 100 * np.mean(np.abs(own) < 2, axis=1)
    error = inside.std() / np.sqrt(len(inside))
    cells = [f"{v:10.3g}" for v in (bias, spread, worst, shift)]
    return f"{name:42}{estimator:15}{''.join(cells)}{inside.mean():10.1f} ±{error:4.1f}{len(scaled):7d}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, default=500)
    parser.add_argument("--only", default="", help="conditions whose name starts so")
    given = parser.parse_args()
    run.Chain = lambda machine: CHAIN  # type: ignore[misc, assignment]  # traced once for all surveys
    run.held_out = lambda problem, solution, rows, fixed: (np.full((rows, 3), np.nan), 0)  # nothing here looks at it
    heads = "".join(f"{h:>10}" for h in ("bias", "spread", "worst", "shift", "cover %"))
    heads += "      "
    print(f"{'condition':42}{'estimator':15}{heads}{'fits':>7}")
    start = time.perf_counter()
    for name, draw in CONDITIONS.items():
        if name.startswith(given.only):
            for robust in (False,) if name.endswith(ORACLE) else (False, True):
                words = "robust" if robust else "least squares"
                print(line(name, words, campaign(draw, robust, given.seeds)), flush=True)
    print(f"{time.perf_counter() - start:.0f} s; all but coverage in clean standard uncertainties, rms over groups;")
    print("worst: the group that fares worst; shift: against the clean fit of the same seed")


if __name__ == "__main__":
    main()
