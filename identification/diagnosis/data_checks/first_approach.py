"""The side from which a joint came where nothing states it: first positions, starts of lines, pilgrim steps.

`direction` assumes the sign of the first move, and elsewhere that of the move from the row before. Where a joint has
play, half of the first are wrong, of lines whose ends are overrun the first positions, and in a pilgrim step half of
the readings; what is left of them looks like another effect. Of both signs the likelier one is taken: the residuals are
fitted with motions of the joint that follow its direction of approach, with one sign and with the other.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from errormodel.approach import assumed_sides, direction, from_other_side, starts_of_lines, unstated
from errormodel.arrays import Array, Mask
from errormodel.effects.base import Effect
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.survey import Survey
from identification.diagnosis.data_checks.blunder import listed
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog, Outcome
from identification.diagnosis.linear.linear_model import UNSEEN, LinearModel
from identification.diagnosis.linear.random_effects import EXACT

if TYPE_CHECKING:
    import pandas as pd

CLEAR = 4.6  # log evidence ratio, beyond the logarithm of how many were tried: odds of 100 to 1

FIRST = (
    "{rows}: before its first move there, {joint} is taken to have come with {channel} = {sign}, which nothing states, "
    "but the readings show. Write {channel} if it is known"
)
START = (
    "{rows}: where a line begins, {joint} is taken to come along it ({channel} = {sign}, after an overrun of the line "
    "before as in ISO 230-2), which nothing states, but the readings show. Write {channel} if it is known"
)
AGAIN = (
    "{rows}: of the readings that follow one another at a place, these are taken to be from the other side "
    "({channel} = {sign}, as in a pilgrim step of ISO 230-2), which nothing states, but the readings show. Write "
    "{channel} if it is known"
)
ONE_SIDE = (
    "{rows}: column {channel} has one value in all rows, but the readings follow the side from which {joint} came in "
    "the order of the rows: {channel} = {sign} is taken. Correct the column"
)


@dataclass(frozen=True)
class Assumption:
    """A joint, rows (n,) in which its direction of approach is the other one, and what is said if so."""

    joint: str
    turned: Mask
    text: str


def likelier_sides(
    survey: Survey, linear: LinearModel, effects: Sequence[Effect] = (), log: DecisionLog = UNRECORDED
) -> Survey | None:
    """The survey with the likelier directions of approach as columns; None where those assumed are as likely.

    Parameters
    ----------
    linear : of the survey's rows to fit, without the `effects`.
    effects : what was found; what follows a joint's direction is fitted anew with each sign. Each other one is tried
        without, too: what sides that were assumed leave looks like a step or a curve.
    """
    table = survey.table
    fitted = np.flatnonzero((table["role"] == "fit").to_numpy())
    sides = {j.name: direction(table, j.name) for j in linear.scene.moving}
    tried = [t for t in _assumptions(table, linear.scene) if t.turned[fitted][linear.index].any()]
    every = _without_each([e for e in effects if not {f"dir_{name}" for name in sides} & set(e.drivers)])
    texts = dict[str, list[str]]()
    many = float(np.log(max(len(tried), 1)))
    while tried:
        turned = [{**sides, t.joint: np.where(t.turned, -sides[t.joint], sides[t.joint])} for t in tried]
        own = {name: side[fitted] for name, side in sides.items()}
        others = [{**own, t.joint: side[t.joint][fitted]} for t, side in zip(tried, turned, strict=True)]
        gains = _gains(linear, every, own, others) - many
        best, instead = (int(k) for k in np.unravel_index(np.argmax(gains), gains.shape))
        found = gains[best, instead] > CLEAR
        for k in [best] if found else range(len(tried)):
            where = f"rows {listed(table['row'].to_numpy()[tried[k].turned].tolist())}"
            channel = f"dir_{tried[k].joint}"
            word: Outcome = "found" if found else "passed"
            log.add("first-approach", word, f"column {channel}", gains[k].max(), CLEAR, beside=where)
        if not found:
            break
        every = [every[instead]] if instead else every
        sides, taken = turned[best], tried.pop(best)
        signs = sorted({f"{value:+.0f}" for value in sides[taken.joint][taken.turned]}, reverse=True)
        said = taken.text.format(rows=where, joint=taken.joint, channel=channel, sign=" or ".join(signs))
        texts.setdefault(taken.joint, []).append(said)
    if not texts:
        return None
    known = table.assign(**{f"dir_{name}": sides[name] for name in texts})
    return replace(survey, table=known, notes=(*survey.notes, *(t for said in texts.values() for t in said)))


def _assumptions(table: pd.DataFrame, scene: Scene) -> Iterator[Assumption]:
    """Directions of approach that the columns and the order of the rows do not show."""
    joints = [j.name for j in scene.machine.joints]
    recorded = [c for c in scene.columns if c in table and c not in joints and not c.startswith("dir_")]
    for joint in scene.moving:
        name = joint.name
        if (given := _as_moved(table, name)) is not None:
            yield Assumption(name, given, ONE_SIDE)
        if scene.both_ways(joint):
            first = assumed_sides(table, name)
            yield from (Assumption(name, first == k, FIRST) for k in np.unique(first) if k)
            yield Assumption(name, starts_of_lines(table, name, joints), START)
        yield from (Assumption(name, rows, AGAIN) for rows in from_other_side(table, name, joints, recorded))


def _as_moved(table: pd.DataFrame, joint: str) -> Mask | None:
    """Rows (n,) to which a joint came from the other side than a column of one value says; None of other columns."""
    name = f"dir_{joint}"
    if name not in table or unstated(table, joint).any() or table[name].nunique() > 1:
        return None
    moved = direction(table.drop(columns=name), joint)
    return np.asarray(moved * table[name].to_numpy(dtype=np.float64) < 0)


def _without_each(effects: Sequence[Effect]) -> list[list[Effect]]:
    """All effects, and those without one of them."""
    return [[e for e in effects if e is not out] for out in (None, *effects)]


def _gains(
    linear: LinearModel,
    every: Sequence[Sequence[Effect]],
    sides: Mapping[str, Array],
    turned: Sequence[Mapping[str, Array]],
) -> Array:
    """Log evidence (k, n) of k other sides beside each of n models, over that of the `sides`.

    By Schwarz's criterion, over the `sides` beside the first model and beside the same one: a model without a finding
    may be the likelier one by itself. It is so by as much as a finding is unlikely beforehand: a side that nothing
    states is not.

    Parameters
    ----------
    linear : without effects; `every`: the effects of each model. Of an arm a model takes tens of megabytes: one at a
        time is made.
    """
    evidence = np.empty((1 + len(turned), len(every)))
    for n, effects in enumerate(every):
        beside = linear.with_effects(effects)
        left = list(_left_beside(beside, sides, turned))
        if not n:
            (square, rank), columns_of_first, freedom = left[0], beside.basis.shape[1], beside.freedom
        spared = columns_of_first - beside.basis.shape[1]
        for k, (own, columns) in enumerate(left):
            # no reward for a sign with which motions follow the geometry instead
            further = max(columns + spared - rank, 0) - spared
            per_column = float(np.log(len(linear.index))) / 2
            evidence[k, n] = freedom / 2 * np.log(square / own) - further * per_column + CLEAR * (n > 0)
    return np.asarray(evidence[1:] - np.maximum(evidence[0, 0], evidence[0]))


def _left_beside(
    beside: LinearModel, sides: Mapping[str, Array], turned: Sequence[Mapping[str, Array]]
) -> Iterator[tuple[float, int]]:
    """What is left, squared, with motions that follow the `sides` of the joints (of the rows to fit); and columns.

    Then the same with each of the other sides. All columns are projected at once; those of a joint whose sides are
    the same are there once.
    """
    every = {(joint, id(side)): side for own in (sides, *turned) for joint, side in own.items()}
    follows = np.zeros((6 * len(every), beside.size))
    for k, ((joint, _), side) in enumerate(every.items()):
        follows[6 * k : 6 * k + 6, : len(beside.index)] = beside.levers[joint] * side[beside.index]
    norms = np.linalg.norm(follows, axis=1)
    follows /= np.where(norms > 0, norms, 1.0)[:, None]
    left = beside.project(beside.project(follows))
    gram, slope, number = left @ left.T, left @ beside.residual, {key: k for k, key in enumerate(every)}
    for own in (sides, *turned):
        some = np.concatenate([6 * number[joint, id(side)] + np.arange(6) for joint, side in own.items()])
        values, vectors = np.linalg.eigh(gram[np.ix_(some, some)])
        kept = values > UNSEEN
        along = vectors[:, kept].T @ slope[some]
        square = max(beside.square - float(np.sum(along**2 / values[kept])), EXACT)
        yield square, beside.basis.shape[1] + int(kept.sum())
