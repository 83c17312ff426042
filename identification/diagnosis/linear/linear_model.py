"""The linear model in which candidates are scored: whitened residuals, a basis of the geometry, and levers.

All scalar observations are stacked (component by component, view by view), in units of one standard uncertainty. The
columns of M (with frames and tool) are projected out of every candidate (Frisch-Waugh-Lovell theorem).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.conventions import MOTIONS, Motion
from errormodel.effects.base import Effect, EffectTerm
from errormodel.effects.search_space.survey_summary import Scene
from identification.diagnosis.linear.first_poses import FirstPoses
from identification.diagnosis.linear.known_models import Lineage
from identification.diagnosis.linear.random_effects import EXACT, RandomEffects, principal
from identification.diagnosis.linear.survey_rows import SurveyRows
from identification.estimation.orthonormal_basis import LEFT, orthonormal_basis

T = TypeVar("T")
UNSEEN = 1e-9  # of a column's length squared: less than this of it the basis has not spanned by rounding only
AT_ONCE = 32  # effects whose columns are projected together: one by one each would read the whole basis
ONCE_IS_ENOUGH = 0.1  # of a column's length: where as much is left, rounding errors of a projection are not larger


class Further(NamedTuple):
    """What further columns add to a linear model.

    Attributes
    ----------
    basis : (N + ties, k) orthonormal, and to the model's basis; the last ties are those of the columns' parameters.
    residual : (N + ties,) what it leaves.
    hold : (ties,) weights of the equations that tie the columns' parameters to zero; free ones: (0,).
    """

    basis: Array
    residual: Array
    hold: Array

    @property
    def square(self) -> float:
        """Residual sum of squares."""
        return max(float(self.residual @ self.residual), EXACT)


@dataclass(frozen=True, eq=False)
class LinearModel:
    """Observations of a fit, ready for candidates.

    Attributes
    ----------
    residual : (N + ties,) whitened residual, free of what `basis` spans; behind the observations one equation for
        each parameter that is tied to zero.
    basis : (N + ties, r) orthonormal: the fitted geometry, and what has been accepted so far.
    levers : element -> (6, N) whitened effect of each motion of the element.
    table : channel -> (N,) its value at each observation.
    index : (N,) the survey's row of each observation.
    round_off : a residual sum of squares that rounding errors make.
    first : the first poses of observations that have two; `levers` and `table` are those of the second.
    lineage : by which effects it was made; None where by other columns too.
    rows : the rows of the survey that the observations are of; None where these have two poses.
    plain : observations and ties, and columns of the basis, before the effects of the lineage; None: it has none.
    holds : of each of these effects, the weights (k,) of the equations that tie its parameters to zero; none: (0,).
    """

    chain: Chain
    residual: Array
    basis: Array
    levers: Mapping[str, Array]
    table: dict[str, Array]
    index: Index
    scene: Scene
    round_off: float = 0.0
    first: FirstPoses | None = None
    lineage: Lineage | None = None
    rows: SurveyRows | None = None
    plain: tuple[int, ...] | None = None
    holds: tuple[Array, ...] = ()

    @property
    def size(self) -> int:
        """Observations and ties."""
        return len(self.residual)

    @property
    def freedom(self) -> int:
        return int(self.size - self.basis.shape[1])

    @property
    def square(self) -> float:
        """Residual sum of squares."""
        return max(float(self.residual @ self.residual), EXACT)

    @property
    def exact(self) -> bool:
        """Whether nothing but rounding errors is left: what follows these would be found without end."""
        return self.square <= self.round_off

    def answer(self, make: Callable[[], T], about: tuple[Effect, ...], *question: Hashable) -> T:
        """What is asked of this model about some effects: made once, as a search returns to the same models."""
        if self.lineage is None:
            return make()
        key, answers = (self.lineage.effects, about, question), self.lineage.known.answers
        if key not in answers:
            answers[key] = make()
        known: T = answers[key]
        return known

    def channel(self, name: str) -> Array:
        """A channel at each observation, (N,)."""
        return self.table[name]

    def columns(self, effect: Effect) -> tuple[Array, Array]:
        """Whitened columns (k, N + ties) of an effect's parameters as they act on the data, and their sizes (k,).

        Of random effects they are the principal components, which are as many parameters or fewer.
        """
        if self.lineage is None:
            return self._own_columns(effect)
        columns, sizes = self._known_columns(effect) or self._own_columns(effect)
        self.lineage.known.columns.keep(effect, (columns, sizes), columns.nbytes)
        return columns[:, : self.size], sizes

    def _known_columns(self, effect: Effect) -> tuple[Array, Array] | None:
        """The same as they are kept, of at least as many rows: those behind the observations are zero."""
        known: tuple[Array, Array] | None = None if self.lineage is None else self.lineage.known.columns.find(effect)
        if known is None or known[0].shape[1] >= self.size:
            return known
        columns = np.zeros((len(known[0]), self.size))
        columns[:, : known[0].shape[1]] = known[0]
        columns.flags.writeable = False
        return columns, known[1]

    def _own_columns(self, effect: Effect) -> tuple[Array, Array]:
        (columns,), sizes = self.swept([effect])
        if effect.random:
            columns = principal(columns)
            sizes = sizes[: len(columns)]
        columns.flags.writeable = sizes.flags.writeable = False  # others have them too
        return columns, sizes

    def swept(self, effects: Sequence[Effect]) -> tuple[Array, Array]:
        """Columns (n, k, N + ties) and sizes (k,) of effects that are alike but for the field `Effect.shape`."""
        terms = self.terms(effects)
        out = np.empty((len(effects), len(terms), self.size))
        self.fill(terms, out)
        return out, np.array([t.size for t in terms])

    def terms(self, effects: Sequence[Effect]) -> list[EffectTerm]:
        """The terms (k) of effects that are alike but for the field `Effect.shape`, of all of them at once.

        Their values are those of the `rows`; without these of the observations, and of the first poses behind them.
        """
        one = effects[0]
        if len(effects) > 1:
            one = one.model_copy(update={one.shape: np.array([[getattr(e, one.shape)] for e in effects])})
        channel = self._at_all_poses if self.rows is None else self.rows.table.__getitem__
        return one.terms(channel, self.chain.machine)

    def _at_all_poses(self, name: str) -> Array:
        """A channel at each observation, and behind them at the first poses."""
        if self.first is None:
            return self.table[name]
        return np.concatenate([self.table[name], self.first.table[name]])

    def fill(self, terms: Sequence[EffectTerm], out: NDArray[np.floating[Any]], scaled: bool = False) -> None:
        """Write the whitened columns of some terms (k) into `out` (n, k, N + ties), in units of their size if `scaled`.

        All is computed in the precision of `out`: mixed ones take several times as long.
        """
        seen, kind = len(self.index), out.dtype
        out[:, :, seen:] = 0.0
        first = self.first
        for k, term in enumerate(terms):
            levers, own = self.levers[term.element], out[:, k, :seen]
            if first is not None:  # both poses side by side, and then that of the first added
                levers = np.hstack([levers, first.levers[term.element]])
                own = np.zeros((len(out), levers.shape[1]), kind)
            if not term.motion:
                own[:] = 0.0
            for n, (motion, value) in enumerate(term.motion.items()):
                lever = levers[MOTIONS.index(motion)] * (term.size if scaled else 1.0)
                values = np.asarray(value, kind)
                if self.rows is not None and values.ndim:
                    values = values[..., self.rows.number]
                parts = lever.astype(kind, copy=False), values
                if n:
                    own += np.multiply(*parts)
                else:
                    np.multiply(*parts, out=own)
            if first is not None:
                own[:, first.at] += own[:, seen:]
                out[:, k, :seen] = own[:, :seen]

    def project(self, columns: Array) -> Array:
        """Columns (k, N + ties) without what the basis spans."""
        return columns - (columns @ self.basis) @ self.basis.T

    def left_of(self, effects: Sequence[Effect]) -> Iterator[Array]:
        """Of the columns (k, N + ties) of each effect what the basis does not span."""
        for first in range(0, len(effects), AT_ONCE):
            columns = [self.columns(effect)[0] for effect in effects[first : first + AT_ONCE]]
            yield from np.split(self.project(np.vstack(columns)), np.cumsum([len(own) for own in columns[:-1]]))

    def with_columns(self, columns: Array, hold: Array | None = None) -> LinearModel:
        """The linear model after further columns (k, N + ties) have been fitted; `hold` (k,) ties their parameters."""
        further = self.beyond(columns, hold)
        if not further.basis.shape[1]:
            return self
        return replace(self, basis=self._beside(further.basis), residual=further.residual, lineage=None)

    def beyond(self, columns: Array, hold: Array | None = None, inner: Array | None = None) -> Further:
        """What columns (k, N + ties) add, tied by `hold` (k,); `inner` (k, r): their products with the basis."""
        hold, inner = np.zeros(0) if hold is None else hold, columns @ self.basis if inner is None else inner
        left, whole = columns - inner @ self.basis.T, np.linalg.norm(columns, axis=1)
        if (little := np.linalg.norm(left, axis=1) < ONCE_IS_ENOUGH * whole).any():
            left[little] = self.project(left[little])
        if len(hold):
            left, whole = np.hstack([left, np.diag(hold)]), np.hypot(whole, hold)
        norms = np.linalg.norm(left, axis=1)
        keep = norms > LEFT * whole
        residual = np.append(self.residual, np.zeros(len(hold)))
        if not keep.any():
            return Further(np.zeros((len(residual), 0)), residual, hold)
        q = orthonormal_basis((left[keep] / norms[keep, None]).T)
        residual -= q @ (q.T @ residual)
        return Further(q, residual, hold)

    def _beside(self, columns: Array) -> Array:
        """The basis and further columns (N + ties, k), of which the last ties may be new."""
        size, rank = self.basis.shape
        basis = np.empty((len(columns), rank + columns.shape[1]))
        basis[:size, :rank], basis[size:, :rank], basis[:, rank:] = self.basis, 0.0, columns
        return basis

    def further(self, effect: Effect) -> Further:
        """What an effect adds to the model; made once, as a search returns to the same models."""
        effects = () if self.lineage is None else (*self.lineage.effects, effect)
        found: Further | None = None if self.lineage is None else self.lineage.known.further.find(effects)
        if found is None:
            columns, size = self.columns(effect)
            inner = columns @ self.basis
            hold = self._hold(effect, columns, size, inner) if effect.random else None
            found = self.beyond(columns, hold, inner)
            if self.lineage is not None:
                self.lineage.known.further.keep(effects, found, sum(a.nbytes for a in found))
        return found

    def with_effect(self, effect: Effect) -> LinearModel:
        """The linear model after an effect has been fitted."""
        return self._widened([self.further(effect)], self.lineage and self.lineage.further(effect))

    def with_effects(self, effects: Sequence[Effect]) -> LinearModel:
        """The linear model after some effects have been fitted, one after the other."""
        known, lineage = list[Further](), self.lineage
        for effect in effects if lineage is not None else ():
            assert lineage is not None
            further = lineage.further(effect)
            if (found := further.known.further.find(further.effects)) is None:
                break
            known.append(found)
            lineage = further
        linear = self._widened(known, lineage) if known else self
        for effect in effects[len(known) :]:
            linear = linear.with_effect(effect)
        return linear

    def _widened(self, known: Sequence[Further], lineage: Lineage | None) -> LinearModel:
        """The model with what some effects add, one after the other; ties of each may be new."""
        plain, holds = self.plain or self.basis.shape, (*self.holds, *(own.hold for own in known))
        columns = np.zeros((len(known[-1].basis), sum(own.basis.shape[1] for own in known)))
        at = 0
        for own, _, _ in known:
            columns[: len(own), at : at + own.shape[1]] = own
            at += own.shape[1]
        basis = self._beside(columns)
        return replace(self, basis=basis, residual=known[-1].residual, lineage=lineage, plain=plain, holds=holds)

    def branch(self) -> LinearModel:
        """The same for an independent search."""
        lineage = self.lineage and replace(self.lineage, known=self.lineage.known.copy())
        return replace(self, lineage=lineage)

    def ended(self) -> None:
        """The search is over: of what it has made only the answers are still wanted."""
        if self.lineage is not None:
            self.lineage.known.only_answers()

    def learn(self, branch: LinearModel) -> None:
        """Take over the answers that a branch has found."""
        if self.lineage is not None and branch.lineage is not None:
            answers = self.lineage.known.answers
            answers.update((key, own) for key, own in branch.lineage.known.answers.items() if key not in answers)

    def of_residual(self, residual: Array) -> LinearModel:
        """The same for another residual."""
        of_columns = self.lineage and replace(self.lineage, known=self.lineage.known.of_columns())
        return replace(self, residual=residual, lineage=of_columns)

    def square_with(self, effect: Effect) -> float:
        """Residual sum of squares after an effect has been fitted: that of `with_effect`, without making it."""
        return self.squares_with([effect])[0]

    def squares_with(self, effects: Sequence[Effect]) -> list[float]:
        """The same of several effects with as many parameters each, which differ in their shapes."""
        if effects[0].random:
            return [self.further(effect).square for effect in effects]
        if self.rows is None or self._known_columns(effects[0]) is not None:
            every = [(self._known_columns(effect) or self._own_columns(effect))[0] for effect in effects]
            columns = np.vstack([own[:, : self.size] for own in every])
            inner = columns @ self.basis
        else:  # not kept: they may be tried out once
            terms = [term for effect in effects for term in self.terms([effect])]
            columns, inner = np.empty((len(terms), self.size)), self._along(terms)
            self.fill(terms, columns[None])
        slopes, count = columns @ self.residual, len(columns) // len(effects)
        out = []
        for first in range(0, len(columns), count):
            own = slice(first, first + count)
            norms = np.linalg.norm(columns[own], axis=1)
            scaled, taken, slope = (v[own][norms > 0] for v in (columns, inner, slopes))
            norms = norms[norms > 0]
            gram = (scaled @ scaled.T - taken @ taken.T) / (norms[:, None] * norms)
            values, vectors = np.linalg.eigh(gram)
            kept = values > UNSEEN
            along = vectors[:, kept].T @ (slope / norms)
            out.append(self.square - float(np.sum(along**2 / values[kept])))
        return out

    def _along(self, terms: Sequence[EffectTerm]) -> Array:
        """Products (k, r) of the columns of some terms with the basis, by its sums over what is seen in each row."""
        rows, kept, out = self.rows, self._summed, np.zeros((len(terms), self.basis.shape[1]))
        assert rows is not None
        values = dict[tuple[str, Motion], list[tuple[int, Array]]]()
        for k, term in enumerate(terms):
            for motion, value in term.motion.items():
                values.setdefault((term.element, motion), []).append((k, np.asarray(value)))
        for place, own in values.items():
            element, motion = place
            if place not in kept:
                lever = self.levers[element][MOTIONS.index(motion)]
                kept[place] = np.asarray(rows.summed(lever, rows.gathered(self.basis[: len(lever)])), float)
            some = np.array([np.broadcast_to(value, len(kept[place])) for _, value in own])
            out[[k for k, _ in own]] += some @ kept[place]
        return out

    @cached_property
    def _summed(self) -> dict[tuple[str, str], Array]:
        """Sums (rows, r) of the basis over the observations of each row, times the lever of an element's motion."""
        return {}

    def random(self, columns: Array) -> RandomEffects:
        """Columns (k, N) or (k, N + ties) as those of random effects."""
        inner = columns @ self.basis[: columns.shape[1]]
        return RandomEffects.of(columns, inner, self.residual, self.freedom)

    def random_beside(self, effect: Effect, columns: Array) -> RandomEffects:
        """Columns (k, N) as those of random effects, given the model with an effect."""
        further, seen = self.further(effect), columns.shape[1]
        inner = np.hstack([columns @ self.basis[:seen], columns @ further.basis[:seen]])
        freedom = self.freedom + len(further.hold) - further.basis.shape[1]
        return RandomEffects.of(columns, inner, further.residual, freedom)

    def delta_chi2(self, after: LinearModel) -> float:
        """Decrease of the residual sum of squares in a larger model, in this model's noise variances."""
        return (self.square - after.square) * self.freedom / self.square

    def _hold(self, effect: Effect, columns: Array, size: Array, inner: Array | None = None) -> Array:
        """Weight of each parameter's equation ``0 = parameter``, (k,), in units of the noise that the effect leaves.

        `inner` are products (k, r) of the columns and the basis, where they are made already.
        """
        if not effect.random:
            return np.zeros(len(size))
        inner = columns @ self.basis if inner is None else inner
        random = RandomEffects.of(columns, inner, self.residual, self.freedom)
        return np.asarray(np.sqrt(random.noise(float(size[0]))) / size)

    def estimates(self, effects: Sequence[Effect]) -> tuple[Array, Array]:
        """Columns (k, N + ties) of some effects together, and their parameters (k,) as the data have them."""
        parts = [(e, *self.columns(e)) for e in effects]
        columns = np.vstack([c for _, c, _ in parts])
        hold = np.concatenate([self._hold(*part) for part in parts])
        left = np.hstack([self.project(columns), np.diag(hold)[:, hold > 0]])
        aim = np.append(self.residual, np.zeros(left.shape[1] - self.size))
        return columns, np.asarray(np.linalg.lstsq(left.T, aim, rcond=None)[0])

    def blocks(self, count: int) -> Index:
        """For each observation the number, from 0, of its block of consecutive rows."""
        edges = np.linspace(self.index.min(), self.index.max() + 1, count + 1)
        return np.digitize(self.index, edges) - 1
