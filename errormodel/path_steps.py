"""Places that a path of commanded positions comes to one after the other, and the steps between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Index, Mask

RUNS_ON = 0.7  # cosine of the turn up to which a path runs on through a row; by judgement: corners turn by more
STANDS = 1e-9  # mm or rad


@dataclass(frozen=True, eq=False)
class PathSteps:
    """Places at which a path stays, for one row or several, and the steps between them.

    Attributes
    ----------
    first : (k,) number of the first row at each place.
    place : (n,) number of the place of each row.
    steps : (k + 1, joints), mm and rad: step j leads to place j, step j + 1 from it. Before the first place of a
        series, and after the last, it is zero.
    directions : (k + 1, joints) of these steps, as `directions` has them.
    joined : (k - 1,) whether a place and the next one are of one series.
    """

    first: Index
    place: Index
    steps: Array
    directions: Array
    joined: Mask

    @classmethod
    def of(cls, position: Array, series: Index) -> PathSteps:
        """The steps of positions (n, joints), mm and rad, in the order in which they were reached.

        Parameters
        ----------
        series : number of the series of rows (n,) that each belongs to; from one to another there is no step.
        """
        stays = (series[1:] == series[:-1]) & (np.abs(np.diff(position, axis=0)) <= STANDS).all(axis=1)
        fresh = np.append(True, ~stays)
        first = np.flatnonzero(fresh)
        joined = series[first[1:]] == series[first[:-1]]
        steps = np.zeros((len(first) + 1, position.shape[1]))
        steps[1:-1][joined] = np.diff(position[first], axis=0)[joined]
        return cls(first, np.cumsum(fresh) - 1, steps, directions(steps, position), joined)

    @property
    def after(self) -> Index:
        """Number of the row after the last one at each place (k,)."""
        return np.append(self.first[1:], len(self.place))

    @property
    def cosine(self) -> Array:
        """Cosine of the turn at each place (k,); 0 where no step leads to it or from it."""
        return np.asarray(np.einsum("nj,nj->n", self.directions[:-1], self.directions[1:]))


def directions(steps: Array, position: Array) -> Array:
    """Direction of each step (n, joints), every joint in units of its range; 0 where there is none."""
    span = np.ptp(position, axis=0)
    scaled = steps / np.where(span > 0, span, 1.0)
    size = np.linalg.norm(scaled, axis=1)
    return np.asarray(scaled / np.where(size > 0, size, 1.0)[:, None])
