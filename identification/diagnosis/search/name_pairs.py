"""The likeliest two names that the same channels drive, by exhaustive search of pairs.

Two effects of one joint hide in each other: the best single one is a compromise between them, and what it leaves over
is neither. Each pair is a small linear system.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np

from errormodel.arrays import Array, Index
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search.blocks import NOTHING
from identification.diagnosis.search.candidates import Candidates
from identification.diagnosis.search.model import replayed
from identification.diagnosis.search.scoring import Step
from identification.diagnosis.search.sensor_pairs import decreases
from identification.diagnosis.search.shape_fit import optimise_shapes

MOST = 400  # proposals, those with most evidence by themselves, of which all pairs are compared
TRIED = 3  # pairs of names of which the shapes are optimised
SWEEPS = 3  # over the shapes of the two
AT_ONCE = 20_000  # pairs
LEAST_POSITIONS = 15  # of a joint: through fewer, two forms with four shapes and sizes each nearly pass; by judgement


def likeliest_two(
    start: LinearModel,
    drivers: frozenset[str],
    others: Sequence[Step],
    candidates: Candidates,
    *,
    at_places: bool = False,
) -> list[Step]:
    """The others and the likeliest two names with a form of their own that some channels drive; none: nothing.

    Of a joint with few positions nothing: they do not show two forms.

    Parameters
    ----------
    others : the findings beside which they are.
    at_places : the two may have one name, at two places.
    """
    moving = (j.name for j in start.scene.moving if j.name in drivers)
    if any(len(np.unique(start.channel(name))) < LEAST_POSITIONS for name in moving):
        return []
    linear = replayed(start, others).linear
    evidence = candidates.scores(linear).evidence
    able = [
        n
        for n, e in enumerate(candidates.effects)
        if evidence[n] > 0 and e.drivers and {*e.drivers} <= drivers and not (e.empirical or e.random)
    ]
    able = sorted(able, key=lambda n: -evidence[n])[:MOST]
    pairs = _best_of_names(linear, candidates, able, at_places)
    tried = [[*others, *_of_best_shapes(start, linear, pair, candidates)] for pair in pairs]
    return max(tried, key=lambda steps: replayed(start, steps).log_posterior, default=[])


def _best_of_names(
    linear: LinearModel, candidates: Candidates, able: Sequence[int], at_places: bool
) -> list[tuple[int, int]]:
    """The pair with most evidence (Schwarz) of each two names, or names at places, those of the best names first."""
    columns, kept = list[Array](), list[int]()
    for n, left in zip(able, linear.left_of([candidates.effects[n] for n in able]), strict=True):
        norms = np.linalg.norm(left, axis=1, keepdims=True)
        if (norms > NOTHING).all():
            columns.append(left / norms)
            kept.append(n)
    if not columns:
        return []
    flat, counts = np.vstack(columns), np.array([len(own) for own in columns])
    gram, slope, first = flat @ flat.T + 1e-9 * np.eye(len(flat)), flat @ linear.residual, np.cumsum(counts) - counts
    effects = [candidates.effects[n] for n in kept]
    labels = [f"{e.effect} {e.where}" if at_places else e.effect for e in effects]
    _, name = np.unique(labels, return_inverse=True)
    best: dict[tuple[int, ...], tuple[float, tuple[int, int]]] = {}
    for two in combinations_with_replacement(np.unique(counts), 2):
        one, other = (i.ravel() for i in np.meshgrid(*(np.flatnonzero(counts == k) for k in two), indexing="ij"))
        own = name[one] != name[other]
        one, other = one[own], other[own]
        parts = [first[i][:, None] + np.arange(k) for i, k in zip((one, other), two, strict=True)]
        left = np.maximum(linear.square - _of_all(gram, slope, np.hstack(parts)), 1e-12 * linear.square)
        evidence = -linear.freedom / 2 * np.log(left) - sum(two) / 2 * np.log(linear.freedom)
        ranked = np.argsort(evidence)[::-1]
        names, at = np.unique(np.sort(np.column_stack([name[one], name[other]]))[ranked], axis=0, return_index=True)
        for both, k in zip(map(tuple, names.tolist()), ranked[at], strict=True):
            if both not in best or evidence[k] > best[both][0]:
                best[both] = float(evidence[k]), (kept[one[k]], kept[other[k]])
    return [pair for _, pair in sorted(best.values(), reverse=True)[:TRIED]]


def _of_all(gram: Array, slope: Array, choices: Index) -> Array:
    parts = [decreases(gram, slope, choices[k : k + AT_ONCE]) for k in range(0, len(choices), AT_ONCE)]
    return np.concatenate(parts) if parts else np.empty(0)


def _of_best_shapes(
    start: LinearModel, linear: LinearModel, pair: tuple[int, int], candidates: Candidates
) -> list[Step]:
    """A pair with its shapes optimised in turn beside all else, each with its prior among all candidates."""
    alike = ([candidates.effects[k] for k in candidates.of_key[candidates.keys[n]]] for n in pair)
    families = [Candidates.of(start, [e for e in own if not e.random]) for own in alike]
    effects = [candidates.effects[n] for n in pair]
    steps = list[Step]()
    for _ in range(SWEEPS):
        steps = []
        for k, family in enumerate(families):
            found = optimise_shapes(linear.with_effect(effects[1 - k]), family, 1)
            if not found:
                return []
            effects[k] = found[0].effect
            places = candidates.places[effects[k].effect]
            trials, names = len(candidates.of_key), len(candidates.places)
            steps.append(replace(found[0], trials=trials, names=names, places=places))
    return steps
