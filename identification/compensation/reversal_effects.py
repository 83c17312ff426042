"""Reversal errors of a model (backlash, lost motion, hysteresis, of any motion), and what corrections hold of them.

Figures are those of the tip over the measured volume: half the difference of both directions of approach after long
strokes, um. A direction of travel tells backlash. Hysteresis depends on how far the axis has moved since it turned:
where most strokes of the survey were too short for it, tables hold the mean of both directions.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import Array
from errormodel.channels import POINT_CHANNELS, plays_among, root
from errormodel.controllers.base import Controller, Target
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Tables
from errormodel.conventions import MOTIONS, ROTATIONS, Motion, iso_symbol
from errormodel.effects import make
from errormodel.effects.base import Effect, axis_motion
from errormodel.machine import Joint
from identification.compensation.assessment import Correct, fresh_rows
from identification.compensation.field import Field
from identification.compensation.findings import Found, Outside
from identification.compensation.reversal import left_to_parameters
from identification.compensation.volume import Volume

LEAST_UM = 0.05  # um rms at the tip: smaller reversal errors are not said, as they would print as zero
WHOLE_SHARE, NO_SHARE = 0.9, 0.1  # of a reversal error that is taken away: all of it, none of it; by judgement


@dataclass(frozen=True)
class ReversalError:
    """A reversal error of the model, and what the corrections leave of it.

    Attributes
    ----------
    effect, where : as in ``machine.yaml``; `joint` : whose reversal it is.
    probability : of the finding; None: the machine's file declares it.
    peak_to_peak : largest difference of both directions, by motion, mm or rad.
    width : travel after which a reversal is complete, mm or deg; None: it is at once.
    size_um, left_um : rms at the tip without and with the corrections, after long strokes; `worst_um` : the largest
        without.
    held : ``all``, ``part`` or ``none``.
    words : what it is; `why` : what becomes of it.
    """

    effect: str
    where: str
    joint: str
    probability: float | None
    peak_to_peak: Mapping[Motion, float]
    width: float | None
    size_um: float
    left_um: float
    worst_um: float
    held: str
    words: str
    why: str

    def line(self) -> str:
        return f"{self.words}, {self.size_um:.1f} um rms at the tip: {self.why}"

    @property
    def outside(self) -> Outside:
        """It as one of those that the tables do not hold."""
        return Outside(self.effect, self.where, self.probability, self.size_um, self.why)


@dataclass(frozen=True)
class _Turn:
    """An effect at the reversal of one joint; `width` of its play, mm or deg.

    `difference` : (n, 3) of both directions at the tip, mm; `motions` : of the element, the largest, mm or rad.
    """

    effect: Effect
    ids: tuple[str, ...]
    joint: Joint
    width: float | None
    difference: Array
    motions: Mapping[Motion, float]

    @property
    def width_words(self) -> str:
        """Width with its unit; empty where the reversal is at once."""
        return "" if self.width is None else f"{self.width:.3g} {'deg' if self.joint.type == 'rotary' else 'mm'}"


def reversal_errors(
    volume: Volume,
    correct: Correct,
    seed: int,
    target: Target,
    setup: Setup,
    tables: Tables,
    found: Collection[Found],
    loose: Collection[str],
    follows: bool = False,
) -> tuple[ReversalError, ...]:
    """Reversal errors of the model, in its order, with what corrected commands leave of them.

    Parameters
    ----------
    correct : the commands; `tables` : those that they come from, none of commands that are corrected themselves.
    follows : whether each command is corrected by the path before it.
    found : findings of the diagnosis; `loose` : channels that no table follows: what they drive is said elsewhere.
    """
    field, rows = volume.field, fresh_rows(volume, seed)
    out: list[ReversalError] = []
    for joint in (j for j in field.joints if j.name in field.reversing):
        sides = _sides(field, joint, rows.direction)
        turns = _turns(field, joint, rows.q, sides, loose)
        if not turns:
            continue
        up, down = (field.actual(correct(rows.q, side, rows.tool), side, rows.tool) for side in sides)
        whole = np.sum([t.difference for t in turns], axis=0)
        lefts = _left(turns, up - down, up - down - whole)
        for turn, left_um in zip(turns, lefts, strict=True):
            size = 1e3 * np.linalg.norm(turn.difference, axis=1) / 2
            if (size_um := float(np.sqrt(np.mean(size**2)))) < LEAST_UM:
                continue
            removed = 1 - left_um / size_um
            held = "all" if removed >= WHOLE_SHARE else "none" if removed <= NO_SHARE else "part"
            own = [f.probability for f in found if f.effect == turn.effect.effect and {*f.ids} & {*turn.ids}]
            error = ReversalError(
                turn.effect.effect, turn.effect.where, joint.name, own[0] if own else None, turn.motions, turn.width,
                size_um, left_um, float(size.max()), held, _words(turn, joint), "",
            )  # fmt: skip
            out.append(replace(error, why=_why(error, target, setup, tables, turn, field, follows)))
    return tuple(out)


def _k(field: Field, joint: Joint) -> int:
    return field.joints.index(joint)


def _sides(field: Field, joint: Joint, direction: Array) -> tuple[Array, Array]:
    """Directions of approach of rows, with those of one joint all plus and all minus."""
    up, down = direction.copy(), direction.copy()
    up[:, _k(field, joint)], down[:, _k(field, joint)] = 1.0, -1.0
    return up, down


def _turns(field: Field, joint: Joint, q: Array, sides: tuple[Array, Array], loose: Collection[str]) -> list[_Turn]:
    """Effects that change where a joint turns round."""
    chain, out = field.chain, list[_Turn]()
    whole = np.subtract(*(field.actual(q, side) for side in sides))
    for spec, ids in zip(chain.machine.effects, chain.effect_ids, strict=True):
        effect = make(spec)
        channels = effect.channels(chain.machine)
        plays = [width for _, of, width in plays_among(channels) if of == joint.name]
        if not (plays or f"dir_{joint.name}" in channels) or {*map(root, channels)} & {*loose}:
            continue
        others = field.values.copy()
        others[[chain.index[i] for i in ids]] = 0.0
        without = np.subtract(*(replace(field, values=others).actual(q, side) for side in sides))
        unit = 180 / np.pi if joint.type == "rotary" else 1.0
        width = max((unit * own for own in plays), default=None)
        motions = _motions(field, effect, ids, q, sides)
        out.append(_Turn(effect, tuple(ids), joint, width, whole - without, motions))
    return out


def _motions(
    field: Field, effect: Effect, ids: tuple[str, ...], q: Array, sides: tuple[Array, Array]
) -> dict[Motion, float]:
    """Largest difference of both directions of each motion of an effect's element, mm or rad."""
    chain, points = field.chain, dict(zip(POINT_CHANNELS, field.nominal(q).T, strict=True))
    moved = []
    for side in sides:
        columns = {**points, **dict(zip(chain.channels, field.rows(q, side), strict=True))}
        sums = {m: np.zeros(len(q)) for m in MOTIONS}
        for term, i in zip(effect.terms(columns.__getitem__, chain.machine), ids, strict=True):
            for motion, value in term.motion.items():
                sums[motion] = sums[motion] + np.asarray(value) * field.values[chain.index[i]]
        moved.append(sums)
    largest = {m: float(np.abs(moved[0][m] - moved[1][m]).max()) for m in MOTIONS}
    return {m: v for m, v in largest.items() if v > 0}


def _left(turns: Sequence[_Turn], left: Array, moved: Array) -> list[float]:
    """What is left (um rms) of each effect at one joint, of `left` (n, 3) of all; `moved` is what corrections changed.

    What they move is shared among the effects by least squares, and the rest among those held in part.
    """
    flat = np.array([t.difference.ravel() for t in turns])
    shares = np.linalg.lstsq(-flat.T, moved.ravel(), rcond=1e-9)[0]
    squares = np.square(flat).sum(axis=1)
    rest = float(np.square(moved.ravel() + shares @ flat).sum())
    parts = np.clip(shares * (1 - shares), 0, None) * squares
    parts = parts if parts.sum() > 0 else squares
    sums = (1 - shares) ** 2 * squares + rest * parts / max(float(parts.sum()), np.finfo(float).tiny)
    return [float(v) for v in 1e3 / 2 * np.sqrt(sums / len(left))]


def _words(turn: _Turn, joint: Joint) -> str:
    """A reversal error in words: motion, size, kind."""
    own = axis_motion(joint)
    parts = []
    for motion, size in turn.motions.items():
        unit, value = ("urad", 1e6 * size) if motion in ROTATIONS else ("um", 1e3 * size)
        axis = "xyz"[MOTIONS.index(motion) % 3]
        symbol = iso_symbol(turn.effect.where, motion)
        if motion == own and turn.effect.where == joint.name:
            what = f"position of {joint.name}"
        elif motion in ROTATIONS:
            tilts = joint.type == "rotary" and turn.effect.where == joint.name
            what = f"{'tilt' if tilts else 'turn'} of {turn.effect.where} about {axis} ({symbol})"
        else:
            what = f"shift of {turn.effect.where} along {axis} ({symbol})"
        parts.append(f"{what}, {value:.3g} {unit} peak to peak")
    of = joint.name if turn.effect.where != joint.name else ""
    within = f" within {turn.width_words}" if turn.width_words else ""
    return f"{'; '.join(parts)}, on reversal{f' of {of}' if of else ''} ({turn.effect.effect}{within})"


def _why(
    error: ReversalError, target: Target, setup: Setup, tables: Tables, turn: _Turn, field: Field, follows: bool
) -> str:
    """What becomes of a reversal error."""
    if error.width is not None:
        return _of_paths(error, target, turn.width_words, error.joint not in field.short, follows)
    if not isinstance(target, Controller):
        return f"in these commands{_rest(error)}"
    if error.held == "all":
        return "in these tables, by direction of travel"
    if error.held == "part":
        return f"in these tables in part only, by direction of travel{_rest(error)}"
    letter = next(a.name for a in setup.axes if a.joint == error.joint)
    ends = turn.effect.reversal([float(field.values[field.chain.index[i]]) for i in turn.ids])
    beside = ends is not None and letter in left_to_parameters(target, setup, tables)
    parameter = "; the control's backlash parameter can take it: see the steps below" if beside else ""
    return f"not in these tables, which are the same in both directions of {error.joint}{parameter}"


def _rest(error: ReversalError) -> str:
    return f": {error.left_um:.1f} um rms are left" if error.left_um >= LEAST_UM else ""


def _of_paths(error: ReversalError, target: Target, width: str, by_direction: bool, follows: bool) -> str:
    """What becomes of a hysteresis, which depends on how far its axis has moved since it turned."""
    most, twice = f"{error.worst_um:.1f}", f"{2 * error.worst_um:.1f}"
    after = f"after strokes shorter than {width} up to {twice} um are left, where {most} are without it"
    if follows:
        return (
            "in these commands, which follow how far each row is from the reversal before; the first rows count as "
            "reached by a long stroke"
        )
    what = "tables" if isinstance(target, Controller) else "commands"
    if by_direction and error.held != "none":
        part = "" if error.held == "all" else " in part only,"
        return f"in these {what}{part} by the direction of travel, as most strokes of the survey were longer; {after}"
    if by_direction:
        return f"not in these {what}: up to {most} um are left"
    return (
        f"not in these {what}, which hold the mean of both directions: up to {most} um are left. Most strokes of the "
        f"survey were too short for the direction of travel: by it, after strokes shorter than {width} up to {twice} "
        "um would be left"
    )
