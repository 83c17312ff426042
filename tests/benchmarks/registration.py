"""Registration of a profiler's clouds: how accurate, how near to what the noise allows, how honest.

    python -m tests.benchmarks.registration [cases] [profile step in mm]

Free-form artefacts of 40 mm x 40 mm, 3200 points a profile at 12.5 um, 0.5 um of noise, outliers and stray light; the
sensor starts up to 1 mm and 0.3 degrees away. For each case the displacement of the sensor and, through the lever of
2.2 m, the six error motions of the joint; beside them small_gicp's own fine registration on the same cleaned points.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from identification.registration.cleaning import clean
from identification.registration.displacement import _coarse, displacement
from identification.registration.motions import with_uncertainty
from identification.registration.surface import fit_surface
from tests.helpers import crossbeam as sim

RELIEF = 6.0  # mm; slopes of up to about 45 degrees
MICRO = np.array([1e3] * 3 + [1e6] * 3)
PAPER = 0.021  # mm, the paper's average RMSE
NAMES = ("x", "y", "z", "about x", "about y", "about z")


def start(rng):
    """A displacement of the sensor of up to 1 mm and 0.3 degrees."""
    shift, turn = rng.standard_normal((2, 3))
    shift *= rng.uniform(0.2, 1) / np.linalg.norm(shift)
    turn *= np.radians(0.3) * rng.uniform(0.2, 1) / np.linalg.norm(turn)
    return sim.pose(np.r_[shift, turn])


def gap(found, true):
    """What is left of the displacement, shift and turn in um and urad."""
    left = found @ np.linalg.inv(true)
    return np.r_[left[:3, 3], sim.rotation_vector(left)] * MICRO


def rival(cold, warm, matrix):
    """small_gicp's point-to-plane registration, from where the coarse one ended."""
    import small_gicp

    target, tree = small_gicp.preprocess_points(cold, downsampling_resolution=0.1, num_neighbors=20)
    source, _ = small_gicp.preprocess_points(warm, downsampling_resolution=0.1, num_neighbors=20)
    result = small_gicp.align(
        target, source, tree, matrix, registration_type="PLANE_ICP", max_correspondence_distance=0.3,
        max_iterations=200, rotation_epsilon=1e-9, translation_epsilon=1e-8,
    )  # fmt: skip
    return np.asarray(result.T_target_source)


def one(seed, step, rivals):
    """One case: errors (um, urad) and uncertainties of the displacement and of the motions, bound, RMSE, seconds."""
    rng = np.random.default_rng([31, seed])
    artefact, y = sim.Artefact.random(1000 + seed, RELIEF), np.arange(-20, 20, step)
    true = start(rng)
    cold = sim.disturbed(sim.scan(artefact, np.eye(4), y, rng=rng), rng)
    warm = sim.disturbed(sim.scan(artefact, true, y, rng=rng), rng)
    before = time.perf_counter()
    cold, warm = clean(cold, "cold"), clean(warm, "warm")
    found = displacement(cold, fit_surface(cold), warm)
    seconds = time.perf_counter() - before
    lever, mount = np.array(sim.LEVER), np.array(sim.MOUNT)
    arm = sim.lever_and_mount()
    motions, covariance = with_uncertainty(found.matrix, found.covariance, mount, np.zeros((6, 6)), lever)
    others = None
    if rivals:
        coarse = _coarse(cold, warm)
        others = gap(coarse, true), gap(rival(cold, warm, coarse), true)
    truth = arm @ true @ np.linalg.inv(arm)
    wrong = np.r_[motions[:3] - truth[:3, 3], sim.rotation_vector(sim.pose(motions) @ np.linalg.inv(truth))] * MICRO
    bound = np.sqrt(np.diag(sim.bound(artefact, sim.scan(artefact, np.eye(4), y)))) * MICRO
    return {
        "gap": gap(found.matrix, true),
        "u": np.sqrt(np.diag(found.covariance)) * MICRO,
        "motions": wrong,
        "u_motions": np.sqrt(np.diag(covariance)) * MICRO,
        "bound": bound,
        "rmse": found.rmse,
        "seconds": seconds,
        "others": others,
        "points": len(warm),
    }


def line(label, values):
    print(f"{label:44}" + "".join(f"{v:10.3f}" for v in values), flush=True)


def rms(rows):
    return np.sqrt(np.mean(np.square(rows), axis=0))


def main():
    cases = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    step = float(sys.argv[2]) if len(sys.argv) > 2 else 0.4
    done = [one(seed, step, alternatives=seed < 5) for seed in range(cases)]
    stack = {k: np.array([d[k] for d in done]) for k in ("gap", "u", "motions", "u_motions", "bound")}
    print(f"{cases} cases, {int(np.mean([d['points'] for d in done]))} points a cloud")
    print(f"{'rms, um and urad':44}" + "".join(f"{n:>10}" for n in NAMES))
    line("displacement of the sensor", rms(stack["gap"]))
    line("  its stated uncertainty", rms(stack["u"]))
    line("  what the noise alone allows", rms(stack["bound"]))
    line("  error over that", rms(stack["gap"] / stack["bound"]))
    line("  worst case", np.abs(stack["gap"]).max(axis=0))
    line("motions of the joint, lever 2.2 m", rms(stack["motions"]))
    line("  their stated uncertainty", rms(stack["u_motions"]))
    line("  worst case", np.abs(stack["motions"]).max(axis=0))
    held = np.abs(stack["motions"]) <= 1.96 * stack["u_motions"]
    line("  within 1.96 u, %", 100 * held.mean(axis=0))
    others = [d["others"] for d in done if d["others"] is not None]
    line("small_gicp VGICP (the coarse step)", rms([o[0] for o in others]))
    line("small_gicp PLANE_ICP after it", rms([o[1] for o in others]))
    shifts = np.linalg.norm(stack["gap"][:, :3], axis=1)
    turns = np.linalg.norm(stack["gap"][:, 3:], axis=1)
    good = np.count_nonzero((shifts < 1) & (turns < 2))
    print(f"arrived (within 1 um and 2 urad): {good} of {cases}")
    rmse = np.mean([d["rmse"] for d in done])
    print(f"RMSE {1e3 * rmse:.3f} um; the paper's average is {1e3 * PAPER:.0f} um, {PAPER / rmse:.0f} times as much")
    print(f"{np.median([d['seconds'] for d in done]):.1f} s a pair of clouds")


if __name__ == "__main__":
    main()
