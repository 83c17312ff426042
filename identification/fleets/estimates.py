"""What one survey tells of a machine, in numbers that can be laid beside those of other surveys.

Quantities are those that `monitor` watches: groups of parameters that do not depend on where the instrument stood.
Surveys of other poses have other groups: a quantity is looked for in what a survey determines, as a linear function.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.arrays import Array, Mask
from identification.monitoring.quantities import SAME_GROUP_SHARE, Watched

if TYPE_CHECKING:
    from identification.estimation.result import Fit
    from identification.results.evaluation_result import EvaluationResult
    from identification.results.stored_fit import StoredFit

MOST_ROWS = 500  # of a survey, at which it is looked how far a quantity moves the tool
UNKNOWN_STD = 0.0  # of a figure whose uncertainty is not known: only its scatter over surveys and machines counts


@dataclass(frozen=True)
class Estimates:
    """Quantities of one survey: what they are, values (k,) and covariance (k, k), in mm, rad and their ratios.

    Attributes
    ----------
    moves : (k,) root mean square over the survey's rows of what a quantity moves the tool by, mm per unit, beyond what
        a shift and turn of the measuring frame does; NaN where that is not known.
    """

    what: tuple[Watched, ...]
    values: Array
    covariance: Array
    moves: Array

    def as_json(self) -> dict[str, Any]:
        return {
            "quantities": [
                {"id": w.id, "group": w.group, "symbol": w.symbol, "unit": w.unit, "members": dict(w.members)}
                for w in self.what
            ],
            "values": self.values.tolist(),
            "covariance": self.covariance[np.tril_indices(len(self.what))].tolist(),
            "moves": self.moves.tolist(),
        }

    @classmethod
    def of_json(cls, data: Mapping[str, Any]) -> Estimates:
        what = tuple(
            Watched(**{k: q[k] for k in ("id", "group", "symbol", "unit", "members")}) for q in data["quantities"]
        )
        covariance = np.zeros((len(what), len(what)))
        covariance[np.tril_indices(len(what))] = np.array(data["covariance"], dtype=float)
        covariance += np.tril(covariance, -1).T
        numbers = (np.array(data[name], dtype=float) for name in ("values", "moves"))
        values, moves = numbers
        return cls(what, values, covariance, moves)

    def of(self, wanted: Sequence[Watched]) -> tuple[Array, Array, Array]:
        """Values, variances and moves of other quantities, NaN of those that this survey does not determine."""
        out = np.full((3, len(wanted)), np.nan)
        place = {w.id: k for k, w in enumerate(self.what)}
        table: tuple[list[str], Array] | None = None
        for j, w in enumerate(wanted):
            k = place.get(w.id)
            if k is not None and _same(w.members, self.what[k].members):
                out[:, j] = self.values[k], self.covariance[k, k], self.moves[k]
                continue
            if not w.members:
                continue
            if table is None:
                table = self._table()
            shares = _shares(w.members, *table)
            if shares is not None:
                out[:2, j] = shares @ self.values[self._whole], shares @ self._known @ shares
        return out[0], out[1], out[2]

    @property
    def _whole(self) -> Mask:
        return np.array([bool(w.members) for w in self.what])

    @property
    def _known(self) -> Array:
        return np.asarray(self.covariance[np.ix_(self._whole, self._whole)])

    def _table(self) -> tuple[list[str], Array]:
        """Names of all members, and the coefficients of each quantity that has members."""
        groups = [w.members for w in self.what if w.members]
        names = list(dict.fromkeys(n for members in groups for n in members))
        return names, np.array([[members.get(n, 0.0) for n in names] for members in groups]).reshape(-1, len(names))


def _same(one: Mapping[str, float], other: Mapping[str, float]) -> bool:
    if one.keys() != other.keys():
        return False
    return all(abs(one[n] - other[n]) <= SAME_GROUP_SHARE * max(abs(one[n]), abs(other[n])) for n in one)


def _shares(members: Mapping[str, float], names: Sequence[str], table: Array) -> Array | None:
    """Coefficients of the rows of `table` whose sum is the function; None where there are none."""
    if not members.keys() <= set(names):
        return None
    wanted = np.array([members.get(n, 0.0) for n in names])
    shares = np.linalg.lstsq(table.T, wanted, rcond=1e-10)[0]
    size = np.maximum(np.abs(wanted), np.abs(shares) @ np.abs(table))
    return np.asarray(shares) if (np.abs(wanted - shares @ table) <= SAME_GROUP_SHARE * size).all() else None


def reference(many: Sequence[Estimates]) -> tuple[Watched, ...]:
    """The quantities of a type: of each id the group that most surveys have, in the order in which they come."""
    count: dict[str, dict[tuple[tuple[str, str], ...], int]] = {}
    first: dict[tuple[str, tuple[tuple[str, str], ...]], Watched] = {}
    for one in many:
        for w in one.what:
            key = tuple(sorted((n, f"{c:.3g}") for n, c in w.members.items()))
            own = count.setdefault(w.id, {})
            own[key] = own.get(key, 0) + 1
            first.setdefault((w.id, key), w)
    return tuple(first[i, max(own, key=own.__getitem__)] for i, own in count.items())


def of_fit(fit: Fit, stored: StoredFit) -> Estimates:
    """Quantities of a fit; `stored` is it as its folder has it."""
    from identification.monitoring.quantities import measured, watched

    what = watched(stored)
    cycle = measured(what, fit)
    return Estimates(what, cycle.values, cycle.covariance, _moves(fit, what))


def of_evaluation(result: EvaluationResult) -> Estimates:
    """Figures of standards, each with its standard uncertainty."""
    quantities = [q for e in result.evaluations for q in e.quantities if np.isfinite(q.value)]
    names = [f"{e.number} {q.name}" for e in result.evaluations for q in e.quantities if np.isfinite(q.value)]
    what = tuple(Watched(n, q.words, q.symbol, q.unit, {}) for n, q in zip(names, quantities, strict=True))
    std = [UNKNOWN_STD if q.expanded is None else q.expanded / 2 for q in quantities]
    moves = [1.0 if q.unit == "mm" else np.nan for q in quantities]
    values = np.array([q.value for q in quantities])
    return Estimates(what, values, np.diag(np.square(std)), np.array(moves))


def _moves(fit: Fit, what: Sequence[Watched]) -> Array:
    """What each quantity moves the tool by, mm rms per unit, less what the measuring frame could do."""
    chain, survey = fit.chain, fit.survey
    out = np.full(len(what), np.nan)
    columns = chain.columns(survey.table)
    rows = np.unique(np.linspace(0, len(survey.table) - 1, min(len(survey.table), MOST_ROWS)).astype(int))
    own = [(k, w.id) for k, w in enumerate(what) if w.id in chain.index and w.id not in chain.frame_ids]
    if not own:
        return out
    from errormodel.arrays import as_rows

    ids = tuple(dict.fromkeys((*(i for _, i in own), *chain.frame_ids)))
    design = chain.kernel("design", ids, None, (0, 1, 2))(as_rows(*(c[rows] for c in columns)))
    design = design.reshape(len(ids), -1).T  # (3 n, ids)
    if not np.isfinite(design).all():
        return out
    rigid = design[:, [ids.index(i) for i in chain.frame_ids]]
    left = design - rigid @ np.linalg.lstsq(rigid, design, rcond=1e-12)[0]
    size = np.sqrt(np.square(left).sum(axis=0) / len(rows))
    for k, i in own:
        out[k] = size[ids.index(i)]
    return out


def without_moves(what: Sequence[Watched]) -> Array:
    """Moves of quantities of which it is not known how far they move the tool."""
    return np.full(len(what), np.nan)
