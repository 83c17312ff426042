"""Whether measured orientations agree with the angles that the points show, or do so read in another way.

Where the commanded orientation hardly changes, as on machines of linear axes, orientations show the angular errors
alone. The points show the same angles by their levers. Position and orientation are fitted together, linearly, with the
orientations read in each way and a noise level of each kind estimated; the likelihoods of the file's numbers are
compared. What no declared error makes sets points and right orientations at variance, too, and one of 52 ways to read
them may suit it by chance. So a way counts only if the joint fit is then as good as one with parameters for each kind
alone, and decides only if that leaves nothing but noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.exceptions import InputError
from errormodel.survey import Survey
from errormodel.surveys.columns import ORIENTATION
from identification.estimation.least_squares import identifiable
from identification.observation.assembly import Problem
from identification.observation.frames import mean_rotation
from identification.observation.models import OrientationView, PositionView
from identification.observation.normal_equations import design_rows, sampled, view_vector

FEWEST = 20  # rows with an orientation that show which way they are to be read; by judgement
MOST = 600  # rows of a view: more say the same
# log likelihood that a way has to gain, at least and for each measured value
SAID = (12.0, 1 / 60)
DECISIVE = (50.0, 1 / 15)
AT_ONE = 3.0  # standard deviations by which a joint fit may be less likely than two, beyond their parameters
STRUCTURE = 3.9  # standard deviations of a serial correlation: one of 24 exceeds it in 1 of 400 surveys of noise
AS_GOOD = 6.0  # log likelihood by which a simpler way may be behind the best
QUIETER = 0.9  # times the noise of the numbers: a unit that leaves more only lets them say less
LEAST_MM, LEAST_RAD = 1e-6, 1e-9  # noise below which numbers are those of a computer
WILD = 20.0  # times the median of how far rows lie: no error motion is so uneven; by judgement
LESS = 0.995  # times what is left of the points, from which on it is said
SAME = 1e-4  # relative change of a noise level at which its iteration stops
ROUNDS = 40
UNITS = {"deg": float(np.pi / 180), "mrad": 1e-3, "urad": 1e-6}  # that are read as rad
FAR = 0.05  # rad: so far no machine's members are turned from where they should be; by judgement
LEAVE_OUT = "leave them out (of raw files with --columns mrx=-,mry=-,mrz=-, of a table by taking the columns away)"


@dataclass(frozen=True)
class Way:
    """Another way to read the three columns.

    Attributes
    ----------
    words : the way, in words; `cure`: what to write, or to see to.
    order, signs : of the three components; `factor` on them; `rows` by which they come later.
    """

    words: str
    cure: str
    order: tuple[int, ...] = (0, 1, 2)
    signs: tuple[float, ...] = (1.0, 1.0, 1.0)
    factor: float = 1.0
    rows: int = 0

    def read(self, vectors: Array) -> Array:
        """Rotation vectors (n, 3) of one measuring frame, in this way."""
        return np.roll(vectors[:, list(self.order)] * self.factor * np.array(self.signs), self.rows, axis=0)


@dataclass(frozen=True)
class Likelihood:
    """Log likelihood of the numbers of a file, and the noise that is left.

    Attributes
    ----------
    points : noise of a coordinate in units of its whitener.
    rad : of a component of orientation; `number`: of the numbers that it was read from.
    apart : log likelihood that parameters of points and orientations of their own add.
    structure : largest serial correlation of what these leave, by rows or along a joint, in standard deviations.
    """

    log: float
    points: float
    rad: float
    number: float
    apart: float
    structure: float


def ways() -> Iterator[Way]:
    """All ways that are tried, the simplest of each kind first."""
    for unit, factor in UNITS.items():
        said = ", ".join(f"{name}: {unit}" for name in ORIENTATION)
        cure = f"Say units: {{{said}}} in a survey.yaml, or --units {said.replace(': ', '=').replace(' ', '')} with "
        yield Way(f"read in {unit}", f"{cure}errormodel import", factor=factor)
    for rows, side in ((1, "before"), (-1, "after")):
        cure = f"See that each row holds its own: those of row 10 stand in row {10 - rows}"
        yield Way(f"taken from the row {side}", cure, rows=rows)
    signed = product(permutations(range(3)), product((1.0, -1.0), repeat=3))
    for order, signs in sorted(signed, key=_strangeness):
        if order == (0, 1, 2) and min(signs) > 0:
            continue
        names = (f"{'-' if s < 0 else ''}{ORIENTATION[k]}" for k, s in zip(order, signs, strict=True))
        text = ",".join(f"{ours}={theirs}" for ours, theirs in zip(ORIENTATION, names, strict=True))
        yield Way(f"read as {text}", f"Say it with --columns {text} of errormodel import", order, signs)


def _strangeness(way: tuple[tuple[int, ...], tuple[float, ...]]) -> tuple[int, int]:
    """Rotations of the inverse sense and two columns exchanged come first."""
    order, signs = way
    moved = sum(k != place for place, k in enumerate(order))
    return (moved if moved != 0 or max(signs) < 0 else 4), sum(s < 0 for s in signs)


def reading_notes(survey: Survey, problem: Problem) -> tuple[str, ...]:
    """A note where orientations agree better with the points if they are read in another way.

    Parameters
    ----------
    survey : whose rows `problem` is of.

    Raises
    ------
    InputError
        They agree so much better that this is how they were written.
    """
    found = _best(survey, problem)
    if found is None:
        return ()
    way, own, other, equations = found
    file = survey.table["file"].iloc[next(v for v in problem.views if isinstance(v, OrientationView)).index[0]]
    what = (
        f"{way.words} they agree better with the angles that the points show: the noise of one component of "
        f"orientation is then {1e6 * other.rad:.3g} urad (now {1e6 * own.rad:.3g})"
    )
    if other.points < LESS * own.points:
        what += f", and {other.points / own.points:.3g} times as much is left of the points"
    where = f"{file}, columns {' '.join(ORIENTATION)}"
    if other.log - own.log > _margin(DECISIVE, equations) and other.structure < STRUCTURE:
        contradicted = f"measured orientations that the points contradict; {what}"
        raise InputError(where, contradicted, f"{way.cure}, or {LEAVE_OUT}")
    doubt = "Others may do so as well: see how the file writes them"
    return (f"{where}: measured orientations that may be read in a wrong way; {what}. {doubt}. {way.cure}",)


def _margin(of: tuple[float, float], equations: int) -> float:
    least, each = of
    return max(least, each * equations)


def _best(survey: Survey, problem: Problem) -> tuple[Way, Likelihood, Likelihood, int] | None:
    """The simplest of the ways that fit best, what is likely as it stands and so, and the number of equations."""
    seen = [v for v in problem.views if isinstance(v, OrientationView) and not len(v.pose.undetermined)]
    points = [v for v in problem.views if isinstance(v, PositionView)]
    if not points or sum(map(len, seen)) < FEWEST:
        return None
    joint = _Joint(survey, problem, points, seen)
    if joint.equations <= joint.unknowns or (own := joint.likelihood(AS_WRITTEN)) is None:
        return None
    found = [(way, other) for way in ways() if (other := joint.likelihood(way)) is not None]
    found = [(w, o) for w, o in found if w.factor == 1.0 or o.number < QUIETER * own.number]
    found = [(w, o) for w, o in found if o.apart < joint.by_chance]
    best = max((o.log for _, o in found), default=-np.inf)
    if best == -np.inf:
        return None
    way, other = next((w, o) for w, o in found if o.log > best - AS_GOOD)
    least = SAID if other.structure < STRUCTURE else DECISIVE
    return (way, own, other, joint.equations) if best - own.log > _margin(least, joint.equations) else None


def _usual(view: OrientationView) -> Index:
    """At most `MOST` rows of a view, evenly spread, without those that lie far out, or stand beside one that does."""
    gap = np.hstack([g for _, g in view.gaps(view.at_zero)])
    apart = np.abs(gap - np.median(gap, axis=1, keepdims=True)).max(axis=0)
    wild = apart > WILD * max(float(np.median(apart)), LEAST_RAD)
    rows = np.flatnonzero(~(wild | np.roll(wild, 1) | np.roll(wild, -1)))
    return np.asarray(rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), MOST)).astype(int))])


AS_WRITTEN = Way("", "")


class _Joint:
    """The linear fit of positions and orientations together, by triangular factors of each."""

    def __init__(
        self, survey: Survey, problem: Problem, points: Sequence[PositionView], seen: Sequence[OrientationView]
    ) -> None:
        chain, place = problem.chain, problem.place()
        zero, none = np.zeros(len(chain.ids)), np.zeros(len(problem.unknowns))
        points = [sampled(v, MOST) for v in points]
        table = survey.table[list(ORIENTATION)].to_numpy(dtype=float)
        self.vectors = [table[v.index] for v in seen]
        self.rows = [_usual(v) for v in seen]
        self.seen = [v.part(rows) for v, rows in zip(seen, self.rows, strict=True)]
        views = (*points, *self.seen)
        base = identifiable(chain, views, problem.unknowns).base
        designs = [np.vstack([design_rows(v, place, most=len(v))[:, base] for v in own]) for own in (points, self.seen)]
        norms = np.sqrt(
            sum(np.square(size * d).sum(axis=0) for size, d in zip((1.0, chain.size), designs, strict=True))
        )
        (q, self.of_points), (self.q, self.of_seen) = (np.linalg.qr(d / norms) for d in designs)
        self.shared = int(np.linalg.matrix_rank(self.of_seen, 1e-8))
        joints = survey.table[[j.name for j in chain.machine.joints]].to_numpy(dtype=float)
        self.orders = [_orders(joints[v.index]) for v in self.seen]
        gap = np.concatenate(
            [np.hstack([v.whiten(p, g) for p, g in v.gaps(view_vector(v, place, none, zero))]).ravel() for v in points]
        )
        self.gap, self.beside = q.T @ gap, float(gap @ gap - np.square(q.T @ gap).sum())
        alone = np.linalg.lstsq(self.of_points, self.gap)[0]
        left = gap - q @ (self.of_points @ alone)
        self.square_alone = float(left @ left)
        self.structure = _structure(left, points, [_orders(joints[v.index]) for v in points])
        self.count, self.angles = sum(v.count for v in points), 3 * sum(map(len, self.seen))
        self.unknowns = len(base)
        self.commanded = [v.commanded for v in self.seen]

    @property
    def by_chance(self) -> float:
        """Log likelihood that as many parameters more add to what is at one."""
        return self.shared / 2 + AT_ONE * float(np.sqrt(self.shared / 2))

    @property
    def equations(self) -> int:
        return self.count + self.angles

    def likelihood(self, way: Way) -> Likelihood | None:
        """Of the orientations read in a way; None where they are no small angles from the commands."""
        from scipy.spatial.transform import Rotation

        read = [way.read(v)[rows] for v, rows in zip(self.vectors, self.rows, strict=True)]
        turned = [v.pose.rotation.T @ Rotation.from_rotvec(r).as_matrix() for v, r in zip(self.seen, read, strict=True)]
        pairs = list(zip(turned, self.commanded, strict=True))
        mount = mean_rotation(np.concatenate([c.transpose(0, 2, 1) @ t for t, c in pairs]))
        small = [Rotation.from_matrix(t @ mount.T @ c.transpose(0, 2, 1)).as_rotvec().T for t, c in pairs]
        gap = np.concatenate([s.ravel() for s in small])
        if np.median(np.abs(gap)) > FAR:
            return None
        # a number changes the rotation by the factor along its axis, and by sin(a/2)/(a/2) of it across
        halves = np.concatenate([np.linalg.norm(r, axis=1) for r in read]) / 2
        across = np.maximum(np.abs(np.sinc(halves / np.pi)), 1e-9)
        scale = float(self.angles * np.log(way.factor) + 2 * np.log(across).sum())
        along = self.q.T @ gap
        beside = max(float(gap @ gap - along @ along), 0.0)
        least = LEAST_RAD * way.factor
        rad = max(float(np.sqrt(gap @ gap / self.angles)), least)
        mm = max(float(np.sqrt((self.beside + self.gap @ self.gap) / self.count)), LEAST_MM)
        for _ in range(ROUNDS):
            rows = np.vstack([self.of_points / mm, self.of_seen / rad])
            step = np.linalg.lstsq(rows, np.concatenate([self.gap / mm, along / rad]))[0]
            before = mm, rad
            left = self.beside + float(np.square(self.gap - self.of_points @ step).sum())
            mm = max(float(np.sqrt(left / self.count)), LEAST_MM)
            left = beside + float(np.square(along - self.of_seen @ step).sum())
            rad = max(float(np.sqrt(left / self.angles)), least)
            if abs(mm / before[0] - 1) + abs(rad / before[1] - 1) < SAME:
                break
        log = scale - self.count * float(np.log(mm)) - self.angles * float(np.log(rad))
        own = gap - self.q @ (self.of_seen @ np.linalg.lstsq(self.of_seen, along)[0])
        apart = self.count * np.log(mm / max(np.sqrt(self.square_alone / self.count), LEAST_MM))
        apart += self.angles * np.log(rad / max(np.sqrt(own @ own / self.angles), least))
        structure = max(self.structure, _structure(own, self.seen, self.orders))
        return Likelihood(log, mm, rad, rad * float(np.exp(-scale / self.angles)), float(apart), structure)


def _orders(joints: Array) -> list[Index]:
    """The rows as they follow one another, and along each joint of which the positions (n, joints) are given."""
    return [np.arange(len(joints)), *(np.argsort(q, kind="stable") for q in joints.T)]


def _structure(left: Array, views: Sequence[PositionView | OrientationView], orders: Sequence[list[Index]]) -> float:
    """Largest serial correlation at lag 1 of residuals (all views', component by component), in standard deviations."""
    found, start = 0.0, 0
    for view, own in zip(views, orders, strict=True):
        block = left[start : start + 3 * len(view)].reshape(3, -1)
        start += block.size
        square = np.maximum(np.square(block).sum(axis=1), 1e-300)
        for order in own:
            turn = block[:, order]
            found = max(found, float(((turn[:, 1:] * turn[:, :-1]).sum(axis=1) / square).max() * np.sqrt(len(view))))
    return found
