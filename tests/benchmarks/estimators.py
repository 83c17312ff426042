"""Bias, spread and coverage of each estimator of `fit`, in clean and in bad conditions: ``python -m ... --seeds 500``.

A three-axis machine with errors in every group is measured again and again with fresh noise. Errors of the groups count
in the standard uncertainty that least squares has on the clean data of the same seed: a spread of 1 is the best there
is. Where rows are wrong, the limit is what the others hold: a line of its own. Coverage is how often the truth lies
within two of the fit's own standard uncertainties: 95.4 % of normal errors. Beside the estimators of `fit` stand the
convex ones that they are chosen from: L1, the smallest sum of distances, and Huber's.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi, norm

from errormodel.chain import Chain
from errormodel.instruments.laser_tracker import LaserTracker
from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from identification.estimation import fit as estimation
from identification.estimation.least_squares import identifiable
from identification.estimation.noise import Noise
from identification.estimation.robust import first_judgement
from identification.observation.assembly import Problem, build
from identification.observation.identifiability import Groups
from identification.observation.normal_equations import design_rows, view_vector
from tests.helpers.chains import Array, errors
from tests.helpers.surveys import FAR, TURNED, measured, positions, survey

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


def group_errors(problem: Problem, groups: Groups, values: Array) -> Array:
    """Estimates (base,) minus truth: the measuring frame's small parameters count from where it was put."""
    pose = problem.frames[""]
    turn = pose.rotation.T @ Rotation.from_euler("XYZ", TURNED).as_matrix()
    shift = pose.rotation.T @ (np.array(FAR) - pose.translation)
    frame = dict(zip(CHAIN.frame_ids, [*shift, *Rotation.from_matrix(turn).as_euler("XYZ")], strict=True))
    truth = np.array([frame[u] if u in frame else P[CHAIN.index[u]] for u in problem.unknowns])
    return np.asarray(values - groups.coefficients @ truth)


Estimated = tuple[list[int], Array, Array]  # the groups' base, their errors and standard uncertainties


def fitted(data: Survey, robust: bool = False) -> Estimated:
    fit = estimation.fit_machine(MACHINE, data, robust)
    groups = fit.solution.groups
    own = np.sqrt(np.diag(fit.solution.covariance)) * fit.inflation
    return groups.base.tolist(), group_errors(fit.problem, groups, fit.solution.values[groups.base]), np.asarray(own)


def convex(data: Survey, share: float) -> Estimated:
    """Huber's estimate, of which that share of normal rows counts in full; 0: the smallest sum of distances (L1).

    Huber's noise level is estimated with the values, one convex problem: each residual is split into noise, whose
    square counts, and what the row is out by, whose length counts. No standard uncertainties.
    """
    import cvxpy as cp

    problem = build(CHAIN, data.fit)
    judged = first_judgement(CHAIN, problem.views, problem.unknowns)
    problem, _ = estimation.anchored(
        problem, len(data.fit), judged=judged
    )  # only where the frame's parameters count from
    (view,) = problem.views
    groups = identifiable(CHAIN, problem.views, problem.unknowns)
    model = design_rows(view, problem.place(), len(view))[:, groups.base]
    gaps = view.gaps(view_vector(view, {}, np.zeros(0), np.zeros(len(CHAIN.ids))))
    aim = np.hstack([view.whiten(part, gap) for part, gap in gaps]) / SIGMA  # (3, n)
    distance = np.linalg.norm(aim, axis=0)
    aim *= np.minimum(1, 100 * np.median(distance) / distance)  # from there a row pulls as hard
    Q, R = np.linalg.qr(model)
    x, out = cp.Variable(Q.shape[1]), cp.Variable(aim.shape)
    rest = aim - cp.reshape(Q @ x, aim.shape, order="C")
    lengths = cp.sum(cp.norm(out, 2, axis=0))
    if share:
        bound, level = chi.ppf(share, 3), cp.Variable()
        full = 3 * chi.cdf(bound, 5) + bound**2 * (1 - share)  # mean of a normal row's square, which ends at the bound
        free = (aim.size - Q.shape[1]) / 3
        goal = cp.quad_over_lin(rest - out, level) / 2 + bound * lengths + free * full / 2 * level
        cp.Problem(cp.Minimize(goal)).solve(solver=cp.CLARABEL)
    else:
        cp.Problem(cp.Minimize(lengths), [rest == out]).solve(solver=cp.CLARABEL)
    values = np.linalg.solve(R, x.value) * SIGMA
    return groups.base.tolist(), group_errors(problem, groups, values), np.full(len(values), np.nan)


HUBER = float(norm.cdf(1.345) - norm.cdf(-1.345))  # as of 1.345 sigma of one component: 95 % efficient
ESTIMATORS: dict[str, Callable[[Survey], Estimated]] = {
    "least squares": fitted,
    "L1": lambda data: convex(data, 0.0),
    "Huber": lambda data: convex(data, HUBER),
    "robust": lambda data: fitted(data, robust=True),
}
DECLARED = ("tracker, declared",)  # the convex ones are for rows of one noise level


@cache
def clean(seed: int) -> Estimated:
    """Least squares on white noise alone."""
    return fitted(white(np.random.default_rng(seed)))


def campaign(
    draw: Callable[[np.random.Generator], Survey], estimate: Callable[[Survey], Estimated], seeds: int
) -> tuple[Array, ...]:
    """(seeds, groups): errors over the clean standard uncertainty, over their own, and the clean fit's errors."""
    out: list[tuple[Array, Array, Array]] = []
    for seed in range(seeds):
        base, error_of_clean, unit = clean(seed)
        own_base, error, own = estimate(draw(np.random.default_rng(seed)))
        if own_base == base:
            out.append((error / unit, error / own, error_of_clean / unit))
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
    covered = f"{inside.mean():10.1f} ±{error:4.1f}" if np.isfinite(own).all() else f"{'-':>10}      "
    said = np.sqrt(np.mean((scaled / own) ** 2, axis=0)).max()
    cells = [f"{v:10.3g}" if np.isfinite(v) else f"{'-':>10}" for v in (bias, spread, worst, said, shift)]
    return f"{name:42}{estimator:15}{''.join(cells)}{covered}{len(scaled):7d}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, default=500)
    parser.add_argument("--only", default="", help="conditions whose name starts so")
    given = parser.parse_args()
    estimation.Chain = lambda machine: CHAIN  # type: ignore[misc, assignment]  # traced once for all surveys
    estimation.held_out = lambda problem, solution, rows, fixed: (
        np.full((rows, 3), np.nan),
        0,
    )  # nothing here looks at it
    heads = "".join(f"{h:>10}" for h in ("bias", "spread", "worst", "own", "shift", "cover %"))
    heads += "      "
    print(f"{'condition':42}{'estimator':15}{heads}{'fits':>7}")
    start = time.perf_counter()
    for name, draw in CONDITIONS.items():
        if name.startswith(given.only):
            names = ["least squares"] if name.endswith(ORACLE) else list(ESTIMATORS)
            names = [e for e in names if e in ("least squares", "robust")] if name in DECLARED else names
            for estimator in names:
                print(line(name, estimator, campaign(draw, ESTIMATORS[estimator], given.seeds)), flush=True)
    print(f"{time.perf_counter() - start:.0f} s; all but coverage in clean standard uncertainties, rms over groups;")
    print("worst: the group that fares worst, with the chance of so few seeds; own: the same of the fit's own standard")
    print("uncertainties, which have next to none; shift: against the clean fit of the same seed")


if __name__ == "__main__":
    main()
