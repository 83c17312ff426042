"""Power analysis of a plan: smallest detectable size of every effect of the library, and indistinguishable effects.

An effect is detectable from the size at which `diagnose` would accept it with a probability of 95 %. Two effects are
distinguishable if, with the geometry eliminated, their correlation is below `INDISTINGUISHABLE_CORRELATION`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.effects import registry
from errormodel.effects.base import Effect
from identification.diagnosis.decisions.constants import ABSORBED
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search.candidates import Candidates, changing_shares
from identification.diagnosis.search.scoring import DETECT

POWER_QUANTILE = 1.645  # normal quantile of the power: 95 %, by convention
INDISTINGUISHABLE_CORRELATION = 0.95  # correlation above which two effects are indistinguishable, by judgement
LARGEST_EFFECT_SIGMA = 2.0  # largest plausible size of an effect, in standard deviations of its physical size
SHAPES_PER_FAMILY = 5  # shapes that represent one effect at one place in one motion: limits the time


@dataclass(frozen=True)
class Verdict:
    """Detectability of one effect at one place.

    Attributes
    ----------
    effect, where : name and place; `drivers`, `motion`: its channels and error motion.
    verdict : detectable, confusable (detectable, but indistinguishable from those in `alike`) or invisible.
    smallest : size of the first parameter from which the effect is detected, in `unit`; None: at no size.
    apart : size from which it is also distinguished from the most similar effect; None: beyond the plausible size.
    possible : largest plausible size, in `unit`.
    absorbed : share of the effect collinear with geometry and measuring frame, 0 to 1 (R squared).
    alike : names of indistinguishable effects.
    reason, needs : reason of the verdict and the measurement needed; empty for detectable effects.
    typical : the shape of median detectability; `rivals`: effects indistinguishable from it, most similar first.
    """

    effect: str
    where: str
    verdict: str
    smallest: float | None
    apart: float | None
    possible: float | None
    unit: str
    absorbed: float
    drivers: tuple[str, ...] = ()
    motion: str | None = None
    alike: tuple[str, ...] = ()
    reason: str = ""
    needs: str = ""
    typical: Effect | None = None
    rivals: tuple[Effect, ...] = ()

    @property
    def key(self) -> tuple[object, ...]:
        """Key common to the verdicts on one effect at one place in different plans."""
        return (self.effect, self.where, self.drivers, self.motion)


def verdicts(linear: LinearModel) -> list[Verdict]:
    """Verdicts on every effect of the library at every possible place, most detectable first."""
    effects, shapes, trials = _library(linear)
    candidates = Candidates.of(linear, effects)
    absorbed = candidates.scores(linear).absorbed
    strength, possible, columns, owner = _seen(linear, candidates, shapes, trials)
    share = _explained(columns, owner, len(candidates.effects))
    groups: dict[tuple[object, ...], list[int]] = {}
    for n, effect in enumerate(candidates.effects):
        groups.setdefault(family_of(effect), []).append(n)
    number = {key: k for k, key in enumerate(dict.fromkeys(candidates.keys))}
    place = np.array([number[key] for key in candidates.keys])
    found = []
    for members in groups.values():
        live = sorted((n for n in members if np.isfinite(strength[n])), key=lambda n: float(strength[n]))
        typical = live[len(live) // 2] if live else members[0]
        others = {n: np.flatnonzero((share[n] > INDISTINGUISHABLE_CORRELATION**2) & (place != place[n])) for n in live}
        mistaken = [n for n in live if len(others[n])]
        rivals: list[int] = []
        if 2 * len(mistaken) > len(live):  # most of its shapes are indistinguishable from another effect
            typical = typical if typical in mistaken else mistaken[len(mistaken) // 2]
            rivals = sorted(others[typical].tolist(), key=lambda n: -float(share[typical, n]))
        least = min(float(absorbed[n]) for n in members)
        nearest = float(np.max(share[typical], where=place != place[typical], initial=0.0))
        size = float(strength[typical])
        sizes = (size, size / np.sqrt(max(1 - nearest, 1e-12)), float(possible[typical]))
        found.append(_verdict(linear, candidates, typical, rivals, least, sizes))
    return [*sorted(found, key=_rank), *_absent({v.effect for v in found})]


def family_of(effect: Effect) -> tuple[object, ...]:
    """Key common to all shapes of one effect in one motion at one place."""
    return (*effect.key, getattr(effect, "motion", None))


def _verdict(
    linear: LinearModel,
    candidates: Candidates,
    typical: int,
    rivals: Sequence[int],
    least: float,
    sizes: tuple[float, float, float],
) -> Verdict:
    """Verdict on the family represented by `typical`; `least`: smallest share of its shapes absorbed by the geometry.

    `sizes`: detectable and distinguishable size, in physical standard deviations, and the largest plausible size.
    """
    effect = candidates.effects[typical]
    term = effect.terms(linear.channel, linear.chain.machine)[0]
    seen, apart, possible = sizes
    named = tuple(dict.fromkeys(_named(candidates.effects[n]) for n in rivals))
    word, reason = _judged(seen, least, named, effect)
    return Verdict(
        effect=effect.effect,
        where=effect.where,
        motion=getattr(effect, "motion", None),
        drivers=effect.drivers,
        verdict=word,
        smallest=seen * possible / LARGEST_EFFECT_SIGMA if np.isfinite(seen) else None,
        apart=apart * possible / LARGEST_EFFECT_SIGMA if apart <= LARGEST_EFFECT_SIGMA else None,
        possible=possible,
        unit=term.unit,
        absorbed=least,
        alike=named if word == "confusable" else (),
        reason=reason,
        needs=effect.recommended(linear.scene.columns) if word != "detectable" else "",
        typical=effect,
        rivals=tuple(candidates.effects[n] for n in rivals),
    )


def _rank(verdict: Verdict) -> tuple[int, float]:
    """Sort key: verdict, then detectable size over plausible size."""
    place = ("detectable", "confusable", "invisible").index(verdict.verdict)
    return place, (verdict.smallest or np.inf) / (verdict.possible or 1.0)


def _named(effect: Effect) -> str:
    """Name and place of an effect."""
    return f"{effect.effect} at {effect.where}"


def _judged(strength: float, absorbed: float, alike: Sequence[str], effect: Effect) -> tuple[str, str]:
    """Verdict and its reason, from the detectable size in physical standard deviations."""
    if not np.isfinite(strength):
        return "invisible", f"geometry and measuring frame absorb {100 * absorbed:.1f} % of it"
    if strength > LARGEST_EFFECT_SIGMA:
        return (
            "invisible",
            f"it would have to be {strength / LARGEST_EFFECT_SIGMA:.1f} times what is physically possible",
        )
    if not alike:
        return "detectable", ""
    if all(other.startswith(f"{effect.effect} at ") for other in alike):
        return "confusable", "its name is found, its place is not distinguishable"
    return "confusable", "the other acts alike on these rows, once geometry and frame are taken out"


def _absent(present: set[str]) -> list[Verdict]:
    """Verdicts on effects that do not occur in the planned rows."""
    reason = "nothing of this machine or in the planned rows would show it"
    return [
        Verdict(name, "", "invisible", None, None, None, "", 1.0, reason=reason, needs=kind.separate)
        for name, kind in registry().items()
        if name not in present and not kind.empirical and kind.traits().physical
    ]


def _library(linear: LinearModel) -> tuple[list[Effect], dict[tuple[object, ...], int], int]:
    """Proposals thinned to a few shapes each, number of shapes of each key, and number of keys (trials factor)."""
    kept: list[Effect] = []
    shapes: dict[tuple[object, ...], int] = {}
    for kind in registry().values():
        alike: dict[tuple[object, ...], list[Effect]] = {}
        for effect in kind.proposals(linear.scene):
            shapes[effect.key] = shapes.get(effect.key, 0) + 1
            if not kind.empirical:
                alike.setdefault(family_of(effect), []).append(effect)
        for family in alike.values():
            pick = np.unique(np.linspace(0, len(family) - 1, SHAPES_PER_FAMILY).round().astype(int))
            kept += [family[k] for k in pick]
    return kept, shapes, len(shapes)


def _seen(
    linear: LinearModel, candidates: Candidates, shapes: dict[tuple[object, ...], int], trials: int
) -> tuple[Array, Array, Array, Index]:
    """Detectable size of each proposal, in physical standard deviations (inf: none), and its largest plausible size.

    Also the columns of all proposals, geometry eliminated and scaled to physical sizes, and their owners.
    """
    count, free = len(candidates.effects), linear.freedom
    strength, possible = np.full(count, np.inf), np.zeros(count)
    parts, owners, changing = [], [], changing_shares(candidates.effects, linear.scene)
    for block in candidates.blocks:
        numbers, columns = block.numbers, block.observed(linear.size)
        m, k, n = columns.shape
        left = linear.project(columns.reshape(m * k, n)).reshape(m, k, n)
        possible[numbers] = LARGEST_EFFECT_SIGMA * block.sizes[:, 0]
        gram = left @ left.transpose(0, 2, 1)
        norm = np.sqrt(block.square * changing[numbers, None])
        seen = np.linalg.eigvalsh(gram / norm[:, :, None] / norm[:, None, :]).max(axis=1) > 1 - ABSORBED
        gain = np.maximum(np.linalg.eigvalsh(gram), 0.0)
        odds = [candidates.effects[i].cost(linear.scene) for i in numbers]
        cost = np.array(odds) + np.log([shapes[candidates.keys[i]] for i in numbers])
        log_factor = DETECT + np.log(trials) + 0.5 * np.log1p(gain).sum(axis=1) + cost
        excess = free * np.expm1(np.minimum(2 * log_factor / max(free, 1), 500.0))
        needed = (np.sqrt(excess) + POWER_QUANTILE) ** 2  # noncentrality, in noise variances
        signal = gain.sum(axis=1) / k
        strength[numbers] = np.where(seen, np.sqrt(needed / np.maximum(signal, 1e-300)), np.inf)
        parts.append(np.where(seen[:, None, None], left, 0.0).reshape(m * k, n))
        owners.append(np.repeat(numbers, k))
    return strength, possible, np.vstack(parts), np.concatenate(owners)


def _explained(columns: Array, owner: Index, count: int) -> Array:
    """Squared correlation (count, count): share of each proposal's columns (row) explained by each other (column)."""
    order = np.argsort(owner, kind="stable")
    columns, owner = columns[order], owner[order]
    starts = np.searchsorted(owner, np.arange(count))
    bases = np.zeros_like(columns)
    for own in (slice(a, b) for a, b in zip(starts, [*starts[1:], len(owner)], strict=True)):
        norms = np.linalg.norm(columns[own], axis=1)
        some = norms > 0
        if some.any():
            q, r = np.linalg.qr((columns[own][some] / norms[some, None]).T)
            q = q[:, np.abs(np.diag(r)) > 1e-6]
            bases[own.start : own.start + q.shape[1]] = q.T
    whole = np.add.reduceat(np.square(columns).sum(axis=1), starts)
    inner = np.add.reduceat(np.add.reduceat(np.square(columns @ bases.T), starts, axis=0), starts, axis=1)
    return np.asarray(inner / np.maximum(whole, 1e-300)[:, None])


def classes(found: Sequence[Verdict]) -> list[list[str]]:
    """Sets of indistinguishable effects, by name and place: connected components through `alike`."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    names = list(dict.fromkeys(n for v in found if v.alike for n in (f"{v.effect} at {v.where}", *v.alike)))
    place = {n: k for k, n in enumerate(names)}
    edges = [(place[f"{v.effect} at {v.where}"], place[n]) for v in found for n in v.alike]
    if not edges:
        return []
    one, two = np.array(edges).T
    graph = coo_array((np.ones(len(one)), (one, two)), shape=(len(names), len(names)))
    _, labels = connected_components(graph, directed=False)
    sets: dict[int, list[str]] = {}
    for name, label in zip(names, labels, strict=True):
        sets.setdefault(int(label), []).append(name)
    return sorted(sets.values(), key=len)
