"""Sampling by emcee with checkpoint files: an interrupted run continues after its last file with identical results.

A chain is converged when it is fifty autocorrelation times long and the rank-normalised split R-hat of its walkers
(A. Vehtari et al., Bayesian Analysis 16 (2021) 667) is small. Until then no result is returned.
"""

from __future__ import annotations

import hashlib
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol
from zipfile import BadZipFile

import numpy as np

from errormodel.arrays import Array
from errormodel.exceptions import ErrorModelError
from errormodel.files import replacing
from identification.runtime.progress import Steps, uncounted

LEAST_CHAIN_LENGTH_TAU = 50.0  # autocorrelation times a chain must last after burn-in: recommendation of emcee
# Largest split R-hat of a coordinate. Above the usual 1.01: each half of a walker is only 25 autocorrelation times long
LARGEST_SPLIT_RHAT = 1.03
BURN_IN_SHARE = 0.25  # share of a chain that is discarded
PIECE_STEPS = 200  # stored steps per file
MOST_PIECES = 60  # files per chain, after which sampling fails


class Target(Protocol):
    """A density that can be sampled."""

    def log_prob(self, points: Array) -> Array:
        """Log density (n,), up to a constant, of points (n, dimension)."""
        ...


class NotConvergedError(ErrorModelError):
    """The chain has not converged, and no posterior is returned."""


@dataclass(frozen=True)
class Chains:
    """Converged chains.

    Attributes
    ----------
    points : (walkers, draws, dimension), after the burn-in, every `thin`-th step.
    log_prob : (walkers, draws) log density of the points.
    steps : of each walker, burn-in included.
    tau : largest integrated autocorrelation time of a coordinate, steps.
    rhat : largest split R-hat of a coordinate.
    effective : smallest effective number of independent draws.
    accepted : share of accepted proposals.
    """

    points: Array
    log_prob: Array
    steps: int
    thin: int
    tau: float
    rhat: float
    effective: float
    accepted: float


@dataclass(frozen=True)
class Reference:
    """A normal approximation of the target: `center` and `scale` (dimension,).

    Proposals reversible with respect to it (preconditioned Crank-Nicolson) have an acceptance rate that depends on the
    quality of the approximation, not on the dimension. Where it is poor, the moves of the ensemble take over.
    """

    center: Array
    scale: Array

    def draw(self, rng: np.random.Generator, count: int) -> Array:
        """Random points (count, dimension)."""
        return np.asarray(self.center + self.scale * rng.standard_normal((count, len(self.scale))))

    def propose(self, points: Array, rng: np.random.RandomState) -> tuple[Array, Array]:
        """Proposed points, and the log ratio of the proposal densities; step lengths are random."""
        unit = (points - self.center) / self.scale
        step = rng.uniform(0.05, 1.0, (len(points), 1))
        new = np.sqrt(1 - step**2) * unit + step * rng.standard_normal(unit.shape)
        factor = 0.5 * (np.square(new).sum(axis=1) - np.square(unit).sum(axis=1))
        return self.center + self.scale * new, factor


def sample(
    target: Target,
    reference: Reference,
    start: Array,
    seed: int,
    folder: Path | None = None,
    count: Steps = uncounted,
    most: int = MOST_PIECES,
) -> Chains:
    """Sample until converged.

    Parameters
    ----------
    target : log density.
    reference : normal approximation of the target.
    start : (walkers, dimension) starting points of finite density.
    seed : of the chain.
    folder : where pieces of the chain are stored, and found by a later run with the same target, start and seed.
    count : progress callback.
    most : largest number of pieces.

    Raises
    ------
    NotConvergedError
        The chain has not converged within `most` pieces.
    """
    import emcee

    walkers, dimension = start.shape
    thin = max(1, dimension // 8)
    moves = [(emcee.moves.MHMove(reference.propose), 0.5), (emcee.moves.DEMove(), 0.5)]
    sampler = emcee.EnsembleSampler(walkers, dimension, target.log_prob, vectorize=True, moves=moves)
    # the densities at the start identify model, survey and prior
    name = hashlib.sha256(start.tobytes() + target.log_prob(start).tobytes() + str(seed).encode()).hexdigest()[:12]
    store = _Pieces(folder, name)
    pieces = store.read()
    state = emcee.State(start, random_state=np.random.RandomState(seed).get_state())
    if pieces:
        state = emcee.State(pieces[-1].end, log_prob=pieces[-1].end_log_prob, random_state=pieces[-1].random)
    with count("Sampling the posterior") as report:
        while True:
            tau, rhat, done = _judge(pieces, thin)
            length = sum(len(p.points) for p in pieces) * thin
            wanted = (
                LEAST_CHAIN_LENGTH_TAU * tau / (1 - BURN_IN_SHARE) if np.isfinite(tau) else PIECE_STEPS * thin * most
            )
            report(min(1.0, length / wanted), _remark(length, tau))
            if done:
                break
            if len(pieces) >= most:
                raise NotConvergedError(_why(length, tau, rhat, folder))
            sampler.reset()
            state = sampler.run_mcmc(state, PIECE_STEPS, thin_by=thin, skip_initial_state_check=bool(pieces))
            piece = _Piece(
                sampler.get_chain().copy(), sampler.get_log_prob().copy(), state.coords, state.log_prob,
                state.random_state, float(np.mean(sampler.acceptance_fraction)),
            )  # fmt: skip
            store.write(len(pieces), piece)
            pieces.append(piece)
    chains = _chains(pieces, thin, tau, rhat)
    store.clear()
    return chains


@dataclass(frozen=True)
class _Piece:
    points: Array  # (steps, walkers, dimension)
    log_prob: Array
    end: Array
    end_log_prob: Array
    random: tuple[str, Array, int, int, float]
    accepted: float


class _Pieces:
    """Storage of the pieces of one chain: files in a folder, or none."""

    def __init__(self, folder: Path | None, name: str) -> None:
        self.folder, self.name = folder, name

    def read(self) -> list[_Piece]:
        """All stored pieces, in order, up to one that cannot be read: it and those behind it are made anew."""
        out: list[_Piece] = []
        while self.folder is not None and (path := self._path(len(out))).is_file():
            try:
                out.append(self._piece(path))
            except (OSError, EOFError, ValueError, KeyError, TypeError, BadZipFile, zlib.error):
                break
        return out

    @staticmethod
    def _piece(path: Path) -> _Piece:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as f:
            position, gauss, cached = f["numbers"].tolist()
            random = ("MT19937", f["keys"], int(position), int(gauss), float(cached))
            return _Piece(f["points"], f["log_prob"], f["end"], f["end_log_prob"], random, float(f["accepted"]))

    def write(self, number: int, piece: _Piece) -> None:
        """Store a piece."""
        if self.folder is None:
            return
        _, keys, *numbers = piece.random
        with replacing(self._path(number)) as part:
            np.savez(
                part, points=piece.points, log_prob=piece.log_prob, end=piece.end, end_log_prob=piece.end_log_prob,
                keys=keys, numbers=np.array(numbers, dtype=float), accepted=piece.accepted,
            )  # fmt: skip

    def clear(self) -> None:
        """Delete the files of a completed chain."""
        if self.folder is not None and self.folder.is_dir():
            for path in self.folder.glob("piece_*.npz"):
                path.unlink()
            if not any(self.folder.iterdir()):
                self.folder.rmdir()

    def _path(self, number: int) -> Path:
        assert self.folder is not None
        return self.folder / f"piece_{self.name}_{number:04d}.npz"


def _kept(pieces: list[_Piece]) -> tuple[Array, Array]:
    """Points and log densities of all pieces without the burn-in."""
    points, log_prob = (np.concatenate([getattr(p, n) for p in pieces]) for n in ("points", "log_prob"))
    first = int(BURN_IN_SHARE * len(points))
    return points[first:], log_prob[first:]


def _judge(pieces: list[_Piece], thin: int) -> tuple[float, float, bool]:
    """Autocorrelation time in steps, split R-hat (NaN for a chain that is too short), and whether it converged."""
    if len(pieces) < 2:
        return float("nan"), float("nan"), False
    points, _ = _kept(pieces)
    tau = autocorrelation(points)
    if not len(points) >= LEAST_CHAIN_LENGTH_TAU * tau:
        return thin * tau, float("nan"), False
    rhat = split_rhat(points)
    return thin * tau, rhat, rhat < LARGEST_SPLIT_RHAT


def autocorrelation(points: Array) -> float:
    """Largest integrated autocorrelation time of chains (steps, walkers, dimension), in stored steps."""
    import emcee

    return float(np.max(emcee.autocorr.integrated_time(points, tol=0)))


def split_rhat(points: Array) -> float:
    """Largest rank-normalised split R-hat over coordinates; each walker is a chain that is split in halves."""
    from arviz_stats.base.array import array_stats

    stats: Any = array_stats  # incompletely typed library
    return max(float(stats.rhat(points[:, :, k].T, chain_axis=0, draw_axis=1)) for k in range(points.shape[2]))


def _chains(pieces: list[_Piece], thin: int, tau: float, rhat: float) -> Chains:
    """The converged chains, thinned to half an autocorrelation time."""
    points, log_prob = _kept(pieces)
    stored = tau / thin
    every = max(1, int(stored / 2))
    return Chains(
        points[::every].transpose(1, 0, 2),
        log_prob[::every].T,
        sum(len(p.points) for p in pieces) * thin,
        thin * every,
        tau,
        rhat,
        points.shape[0] * points.shape[1] / stored,
        float(np.mean([p.accepted for p in pieces])),
    )


def _remark(length: int, tau: float) -> str:
    """Text for the progress display."""
    return "" if not length else f"{length} steps" + (f", autocorrelation time {tau:.0f}" if np.isfinite(tau) else "")


def _why(length: int, tau: float, rhat: float, folder: Path | None) -> str:
    """Message of the error that the chain has not converged."""
    reason = (
        f"it is {(1 - BURN_IN_SHARE) * length / tau:.0f} autocorrelation times long where "
        f"{LEAST_CHAIN_LENGTH_TAU:.0f} are needed"
        if not np.isfinite(rhat)
        else f"its walkers disagree (split R-hat {rhat:.3f}, at most {LARGEST_SPLIT_RHAT} is allowed)"
    )
    kept = f" The chain is kept in {folder}: the same command goes on from there." if folder is not None else ""
    return f"the chain has not converged after {length} steps: {reason}. No posterior is reported.{kept}"


def walkers_for(dimension: int) -> int:
    """Number of walkers: differential evolution moves need more walkers than dimensions."""
    return max(24, 2 * dimension + 2 + dimension % 2)


def inside(target: Target, reference: Reference, walkers: int, rng: np.random.Generator) -> Array:
    """Starting points (walkers, dimension) of finite density; fewer if most of the reference is outside the bounds."""
    out = np.zeros((0, 0))
    for _ in range(50):
        points = reference.draw(rng, 4 * walkers)
        points = points[np.isfinite(target.log_prob(points))]
        out = points if not len(out) else np.vstack([out, points])
        if len(out) >= walkers:
            break
    return out[:walkers]
