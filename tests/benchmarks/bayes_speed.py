"""What a log-probability costs inside emcee, by statistics and by rows: ``python -m tests.benchmarks.bayes_speed``.

The same ensemble, moves and posterior (five-axis machine, all groups, unknown noise level), three ways: statistics;
every row with M kept in memory, all walkers of a call in one matrix product (as fast as rows can be in NumPy); every
row by the exact kinematics, walker by walker. Seconds a log-probability are those of the whole of emcee.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import emcee
import numpy as np
from threadpoolctl import threadpool_limits

from errormodel.chain import Chain
from errormodel.machine_file import read_machine
from identification.bayes.full_posterior import Whole
from identification.bayes.inference import model_of
from identification.bayes.sampling import Reference, inside, walkers_for
from identification.estimation.fit import fit_machine
from identification.observation.normal_equations import design_rows, view_vector
from tests.helpers.chains import Array, errors
from tests.helpers.surveys import measured, positions, survey


def seconds(log_prob: Callable[[Array], Array], reference: Reference, start: Array, steps: int) -> float:
    """Of one log-probability in an ensemble of walkers, moves and bookkeeping included."""
    calls = 0

    def counted(points: Array) -> Array:
        nonlocal calls
        calls += len(points)
        return log_prob(points)

    moves = [(emcee.moves.MHMove(reference.propose), 0.5), (emcee.moves.DEMove(), 0.5)]
    sampler = emcee.EnsembleSampler(*start.shape, counted, vectorize=True, moves=moves)
    began = time.perf_counter()
    sampler.run_mcmc(start, steps)
    return (time.perf_counter() - began) / calls


def main() -> None:
    machine = read_machine("five_axis_table_quill")
    p = errors(Chain(machine))
    sizes = [int(n) for n in sys.argv[1:]] or [1_000, 10_000, 100_000]
    print(f"{'rows':>8}{'statistics':>14}{'rows, in memory':>18}{'rows, exact':>14}{'':>4}times as fast")
    for rows in sizes:
        fit = fit_machine(machine, survey(positions(measured(machine, p, rows, noise=3e-3))))
        linear, _, _ = model_of(fit, {}, None, False)
        whole = Whole.of(linear)
        (view,) = fit.problem.views
        place, base, zero = fit.problem.place(), fit.solution.groups.base, np.zeros(len(fit.chain.ids))
        design = np.asfortranarray(design_rows(view, place, most=rows)[:, base])
        vector = view_vector(view, place, fit.solution.values, zero)
        gap = np.hstack([view.whiten(k, g) for k, g in view.gaps(vector)]).ravel()
        gap = gap + design @ fit.solution.values[base]

        def known(points: Array, whole: Whole = whole) -> tuple[Array, Array]:
            """Parameters, and all of the log-probability that needs no rows."""
            values, own = whole.split(points)
            away = values - whole.linear.prior.mean
            rest = -0.5 * np.einsum("ni,ni->n", away @ whole.linear.prior.precision, away)
            return values, rest + whole.linear.log_prior(own) - own[:, 0] * whole.linear.statistics.count[0]

        def in_memory(points: Array, known=known, design: Array = design, gap: Array = gap) -> Array:
            values, rest = known(points)
            left = gap[:, None] - design @ values.T
            return rest - 0.5 * np.exp(-2 * points[:, -1]) * np.einsum("mn,mn->n", left, left)

        def exact(points: Array, known=known, fit=fit, view=view, place=place, zero: Array = zero) -> Array:
            values, rest = known(points)
            square, full = np.empty(len(points)), np.zeros(len(fit.solution.unknowns))
            for k, own in enumerate(values):
                full[fit.solution.groups.base] = own
                gaps = view.gaps(view_vector(view, place, full, zero))
                square[k] = sum(float(np.square(view.whiten(part, g)).sum()) for part, g in gaps)
            return rest - 0.5 * np.exp(-2 * points[:, -1]) * square

        coordinates = whole.coordinates
        reference = Reference(
            np.array([*np.zeros(len(base)), *(c.start for c in coordinates)]),
            np.array([*np.ones(len(base)), *(c.scale for c in coordinates)]),
        )
        start = inside(whole, reference, walkers_for(len(base) + 1), np.random.default_rng(0))
        with threadpool_limits(1):
            apart = np.ptp(whole.log_prob(start[:6]) - in_memory(start[:6]))
            assert apart < 0.05, apart  # nats: M at zero errors and at the fit
            few = max(2, 200_000 // rows // 10)
            own = [seconds(f, reference, start, n) for f, n in ((whole.log_prob, 400), (in_memory, few), (exact, 1))]
        print(
            f"{rows:8d}{1e6 * own[0]:11.2f} us{1e6 * own[1]:15.1f} us{1e6 * own[2]:11.0f} us    "
            f"{own[1] / own[0]:.0f} and {own[2] / own[0]:.0f}"
        )


if __name__ == "__main__":
    main()
