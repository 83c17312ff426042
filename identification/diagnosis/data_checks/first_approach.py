"""The side from which a joint came where neither a column nor a move states it: first positions, and starts of lines.

`direction` assumes the sign of the first move, and elsewhere that of the move from the row before. Where a joint has
play, half of the first are wrong, and of lines whose ends are overrun the first positions; what is left of them looks
like another effect. Of both signs the likelier one is taken: the residuals are fitted with motions of the
joint that follow its direction of approach, with one sign and with the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from errormodel.approach import assumed_sides, direction, starts_of_lines
from errormodel.arrays import Array
from errormodel.effects.base import Effect
from errormodel.survey import Survey
from identification.diagnosis.data_checks.blunder import listed
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog
from identification.diagnosis.linear.linear_model import LinearModel

CLEAR = 4.6  # log likelihood ratio, beyond the logarithm of how many were tried: odds of 100 to 1

FIRST = (
    "{rows}: before its first move there, {joint} is taken to have come with {channel} = {sign}, which nothing states, "
    "but the readings show. Write {channel} if it is known"
)
START = (
    "{rows}: where a line begins, {joint} is taken to come along it ({channel} = {sign}, after an overrun of the line "
    "before as in ISO 230-2), which nothing states, but the readings show. Write {channel} if it is known"
)


def likelier_sides(
    survey: Survey, linear: LinearModel, effects: Sequence[Effect] = (), log: DecisionLog = UNRECORDED
) -> Survey | None:
    """The survey with the likelier directions of approach as columns; None where those assumed are as likely.

    Parameters
    ----------
    linear : of the survey's rows to fit, without the `effects`.
    effects : what was found; what follows a joint's direction is fitted anew with each sign.
    """
    table = survey.table
    fitted = np.flatnonzero((table["role"] == "fit").to_numpy())
    names = [j.name for j in linear.scene.moving if linear.scene.both_ways(j)]
    series = [(name, assumed_sides(table, name)) for name in names]
    tried = [(name, own == k, FIRST) for name, own in series for k in np.unique(own[fitted]) if k]
    joints = [j.name for j in linear.scene.machine.joints]
    tried += [(name, starts_of_lines(table, name, joints), START) for name in names]
    columns, texts = dict[str, Array](), list[str]()
    for name, rows, text in tried:
        channel, turned = f"dir_{name}", rows[fitted][linear.index]
        if not turned.any():
            continue
        beside = linear
        for effect in effects:
            beside = beside if channel in effect.drivers else beside.with_effect(effect)
        follows = np.zeros((6, beside.size))
        follows[:, : len(linear.index)] = linear.levers[name] * linear.channel(channel)
        other = follows.copy()
        other[:, : len(linear.index)] *= np.where(turned, -1.0, 1.0)
        left = [beside.with_columns(c).square for c in (follows, other)]
        gain = beside.freedom / 2 * float(np.log(left[0] / left[1])) - float(np.log(len(tried)))
        found = gain > CLEAR
        where = f"rows {listed(table['row'].to_numpy()[rows].tolist())}"
        log.add("first-approach", "found" if found else "passed", f"column {channel}", gain, CLEAR, beside=where)
        if found:
            side = columns.get(channel, direction(table, name))
            columns[channel] = np.where(rows, -side, side)
            signs = sorted({f"{value:+.0f}" for value in columns[channel][rows]}, reverse=True)
            texts.append(text.format(rows=where, joint=name, channel=channel, sign=" or ".join(signs)))
    if not columns:
        return None
    return replace(survey, table=table.assign(**columns), notes=(*survey.notes, *texts))
