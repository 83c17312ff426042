"""Commands that were not measured, in a list of single readings that is shorter than the list of commands.

A stretch of readings without a gap places the set-up; from there all commands have a nominal reading. The readings go
along them in order, passing over as many commands as there are too many. Of a list that is much shorter, as one that
was broken off, the readings are those of the first commands or of the last, without a gap.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.observations.base import Observation
from identification.importing.reading_proof import LARGE, Candidate, lying, misfit
from identification.importing.sources import SourceFile

FEW = 0.1  # of the commands may be missing
STRETCH = 12  # readings at least that place a set-up, and
EACH = 4  # readings an unknown


def with_gaps(chain: Chain, commands: SourceFile, observation: Observation, readings: Array) -> Candidate | None:
    """The commands of readings of which a few are missing; None where no few commands explain it.

    Parameters
    ----------
    readings : (n,) mm or rad, fewer than the commands.
    """
    n, missing = len(readings), commands.rows - len(readings)
    size = max(STRETCH, EACH * len(observation.free))
    if observation.poses > 1 or missing <= 0 or n < size:
        return None
    if missing > FEW * commands.rows:
        return _cut_off(chain, commands, observation, readings)
    for first, skipped in _stretches(n, size, missing):
        part = Candidate(np.arange(first, first + size) + skipped, "")
        own = readings[first : first + size]
        found = misfit(chain, commands, observation, part, own)
        if found.why or found.size > LARGE * found.reach:
            continue
        placed = lying(chain, commands, observation, part, own)[0]
        nominal = placed.nominal_at(chain, commands)
        way = Candidate(_along(readings, nominal, missing), f"order, passing over {missing}")
        whole = misfit(chain, commands, observation, way, readings)
        if not whole.why and whole.size < LARGE * whole.reach:
            return way
    return None


def _cut_off(chain: Chain, commands: SourceFile, observation: Observation, readings: Array) -> Candidate | None:
    """The first commands, or the last, of readings that were broken off or begun late; None where not one fits."""
    n, fits = len(readings), []
    for first, words in ((0, "the first"), (commands.rows - n, "the last")):
        way = Candidate(np.arange(first, first + n), f"order, {words} {n} commands")
        found = misfit(chain, commands, observation, way, readings)
        if not found.why and found.size < LARGE * found.reach:
            fits.append(way)
    return fits[0] if len(fits) == 1 else None


def _stretches(n: int, size: int, missing: int) -> Iterator[tuple[int, int]]:
    """First reading of a stretch, and how many commands were passed over before it."""
    yield 0, 0
    yield n - size, missing
    for first in ((n - size) // 2, (n - size) // 4, 3 * (n - size) // 4):
        for skipped in range(missing + 1):
            yield first, skipped


def _along(readings: Array, nominal: Array, missing: int) -> Index:
    """Rows of the commands (n,), increasing, whose nominal readings lie nearest in sum of distances."""
    n = len(readings)
    # best[s]: smallest sum so far with s commands passed over; back[i, s]: passed over before reading i
    best, back = np.zeros(missing + 1), np.zeros((n, missing + 1), dtype=np.intp)
    for i in range(n):
        before = np.minimum.accumulate(best)
        back[i] = [int(np.argmin(best[: s + 1])) for s in range(missing + 1)]
        best = before + np.abs(readings[i] - nominal[i : i + missing + 1])
    out = np.zeros(n, dtype=np.intp)
    s = int(np.argmin(best))
    for i in range(n - 1, -1, -1):
        out[i] = i + s
        s = int(back[i, s])
    return out
