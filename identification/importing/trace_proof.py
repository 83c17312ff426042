"""Proof that readings of a bar along a circle stand in their own rows: neighbours, the two senses, and several circles.

A machine's errors change slowly along a circle, except where an axis reverses; a ball off the centre makes one wave a
turn. A turn of half a circle changes no effect of the sense of travel (play, servo mismatch: even waves), so that the
two senses must have the same single wave: the ball stands where it stood. Source of these waves: ISO 230-4:2022,
annex A; W. Knapp, Annals of the CIRP 32 (1983) 465.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import MAD_STD, Array, Index, Mask
from errormodel.exceptions import InputError

WINDOW = 3  # rows on each side whose median a reading is compared with
SINGLE = 8.0  # standard deviations: a reading so far off its neighbours is none of them
FITS = 4.0  # standard deviations: so near, it belongs there
LEAST = 1e-4  # mm: a scatter below is the resolution of a file
QUADRANT = 5.0  # degrees, or `WINDOW` rows, beside the places where an axis reverses
# of what a reading is off in the other place: so far may one beside a reversal be off in its own; if both are there
CLEAR, CLEAR_BOTH = 0.8, 0.35
USUAL_PEAK = 0.02  # mm: smaller peaks are usual there
ORDER = 4  # waves a turn that a machine's errors have, at most
MOST_ROWS = 400  # by which readings are shifted, to either side
FEWEST = 40  # readings of each sense
WHOLE = 300.0  # degrees that each sense must reach over
BETTER = 3.0  # times: so much less must another place of the rows leave
MOVED = 0.01  # mm: a ball moves less between the two senses, by judgement
ALIKE = 1.1  # times what is left: two explanations fit alike
SAME_BALL = 0.005  # mm: so far apart the errors of a machine show one ball in two planes, by judgement
AGREES = 0.2  # of its distance from the centre, likewise


@dataclass(frozen=True)
class Circle:
    """Readings along a circle in the order of the file.

    Attributes
    ----------
    angle : (n,) rad, as commanded, from the first axis of the plane to its second.
    sense : (n,) 1 where it grows, else -1.
    length : (n,) mm.
    lines : (n,) of the file.
    """

    angle: Array
    sense: Array
    length: Array
    lines: tuple[int, ...]

    def reach(self, sense: float) -> float:
        """Degrees that one sense reaches over, gaps of more than ten usual steps left out; 0 without readings."""
        own = np.sort(np.mod(self.angle[self.sense == sense], 2 * np.pi))
        if len(own) < 2:
            return 0.0
        steps = np.degrees(np.diff(np.append(own, own[0] + 2 * np.pi)))
        usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
        return 360.0 - float(steps[steps > 10 * usual].sum())

    def gaps(self, sense: float) -> Iterator[tuple[float, float]]:
        """Gaps within one sense of 1.5 to ten usual steps: degrees, and where they begin."""
        own = np.sort(np.mod(self.angle[self.sense == sense], 2 * np.pi))
        steps = np.degrees(np.diff(np.append(own, own[0] + 2 * np.pi))) if len(own) > 1 else np.zeros(0)
        usual = float(np.median(steps)) if len(steps) else 0.0
        for k in np.flatnonzero((steps > 1.5 * usual) & (steps <= 10 * usual)):
            yield float(steps[k]), float(np.degrees(own[k]))


def refuse_exchanged(circle: Circle, where: str) -> int:
    """Number of single readings off their neighbours, those beside a reversal of an axis left out that are usual there.

    Raises
    ------
    InputError
        Two of them fit in each other's row.
    """
    n = len(circle.length)
    if n < FEWEST:
        return 0
    padded = np.pad(circle.length, WINDOW, mode="reflect")
    around = np.delete(np.lib.stride_tricks.sliding_window_view(padded, 2 * WINDOW + 1), WINDOW, axis=1)
    middle = np.median(around, axis=1)
    off = circle.length - middle
    scatter = max(MAD_STD * float(np.median(np.abs(off - np.median(off)))), LEAST)
    single = np.flatnonzero(np.abs(off) > SINGLE * scatter)
    steps = np.abs(np.diff(circle.angle))
    beside = max(np.radians(QUADRANT), WINDOW * float(np.median(steps)) + 1e-9)
    reverses = np.abs(np.angle(np.exp(4j * circle.angle)) / 4) < beside
    for at, i in enumerate(single):
        for j in (k for k in single[at + 1 :] if k - i > 2 * WINDOW):  # nearer, each is a neighbour of the other
            size = min(abs(off[i]), abs(off[j]))
            apart = np.abs([circle.length[j] - middle[i], circle.length[i] - middle[j]])
            peaks = reverses[[i, j]]  # single readings off their neighbours are usual there
            clear = CLEAR_BOTH if peaks.all() else CLEAR
            near = np.where(peaks, max(FITS * scatter, clear * size), FITS * scatter)
            if (apart < near).all() and off[i] * off[j] < 0 and not (peaks.all() and size < USUAL_PEAK):
                rows = f"lines {circle.lines[i]} and {circle.lines[j]}" if circle.lines else f"rows {i + 1} and {j + 1}"
                found = (
                    f"the readings of {rows} are exchanged: they lie {1e3 * abs(off[i]):.3g} and "
                    f"{1e3 * abs(off[j]):.3g} um off their neighbours, and fit in the place of the other"
                )
                raise InputError(where, found, "Give the trace as the instrument wrote it")
    return sum(not reverses[i] or _unusual(circle, off, reverses, i) for i in single.tolist())


def _unusual(circle: Circle, off: Array, reverses: Mask, i: int) -> bool:
    """Whether a reading beside a reversal lies far more off its neighbours than any beside the other reversals."""
    passage = np.round(circle.angle / (np.pi / 2)) * 2 + (circle.sense > 0)
    others = np.abs(off[reverses & (passage != passage[i])])
    return bool(abs(off[i]) > max(USUAL_PEAK, BETTER * float(others.max(initial=0.0))))


def refuse_shifted(circle: Circle, where: str) -> str:
    """What is said of the ball in both senses; empty where they show it at one place, or a sense is missing.

    Raises
    ------
    InputError
        The readings fit far better some rows later or earlier, or the ball stands elsewhere in one of the senses.
    """
    if min((circle.sense == s).sum() for s in (1, -1)) < FEWEST or min(map(circle.reach, (1, -1))) < WHOLE:
        return ""
    model, moved = _waves(circle), _moved(circle)
    size = min(MOST_ROWS, len(circle.length) // 4)
    shifts = np.arange(-size, size + 1)
    rolled = np.column_stack([np.roll(circle.length, k) for k in shifts])
    left = _left(model, rolled)
    here = float(left[size])
    alike = np.flatnonzero(left < ALIKE * left.min())  # half a turn on in both senses the readings fit as well
    best = int(alike[np.argmin(np.abs(shifts[alike]))])
    both = np.column_stack([model, moved])
    free = float(_left(both, circle.length[:, None])[0])
    coefficients = np.linalg.lstsq(both, circle.length, rcond=None)[0]
    apart = 2 * float(np.hypot(*coefficients[-2:]))
    if here < 1.5 * max(min(free, float(left[best])), LEAST):
        return ""
    says = f"the ball lies {1e3 * apart:.3g} um apart in the two senses"
    if best != size and here > BETTER * left[best] and left[best] < ALIKE * free:
        k = int(shifts[best])
        rows = f"{abs(k)} row{'s' * (abs(k) > 1)} {'early' if k > 0 else 'late'}"
        found = (
            f"readings that stand {rows} beside their angles: {says}; put right, {1e3 * left[best]:.3g} um rms are left"
            f" of {1e3 * here:.3g}"
        )
        raise InputError(where, found, "Give the trace as the instrument wrote it, each reading with its own angle")
    if here > BETTER * free and apart > MOVED:
        found = f"{says}: it was set anew between them, or the angles of one count otherwise"
        raise InputError(where, found, "Give each direction as a file of its own, or the angles as they were run")
    return f"{says}: it moved, or angles and readings are some rows apart"


def _left(model: Array, readings: Array) -> Array:
    """Root mean square of what a linear model (n, k) leaves of readings (n, m), each (m,)."""
    basis = np.linalg.qr(model)[0]
    over = readings - basis @ (basis.T @ readings)
    return np.asarray(np.sqrt(np.mean(over**2, axis=0)))


def _waves(circle: Circle) -> Array:
    """Waves that both senses have in common, and even ones of each: play, lost motion across, servo mismatch."""
    a, s = circle.angle, circle.sense
    sine, cosine = np.sin(a), np.cos(a)
    common = [f(k * a) for k in range(1, ORDER + 1) for f in (np.cos, np.sin)]
    play = [np.sign(sine) * cosine, np.sign(cosine) * sine, np.abs(sine), np.abs(cosine), np.cos(2 * a), np.sin(2 * a)]
    return np.column_stack([np.ones_like(a), s, *common, *(s * p for p in play)])


def _moved(circle: Circle) -> Array:
    """A single wave that has the other sign in the other sense: half of the distance of the two balls."""
    return np.column_stack([circle.sense * np.cos(circle.angle), circle.sense * np.sin(circle.angle)])


TURNED: dict[
    str, Callable[[float, float], tuple[float, float]]
] = {  # place of a ball (first axis, second axis) where the angle counts otherwise, by what to say
    "--start 90": lambda u, v: (-v, u),
    "--start 180": lambda u, v: (-u, -v),
    "--start 270": lambda u, v: (v, -u),
    "axes exchanged": lambda u, v: (v, u),
    "--start 90, axes exchanged": lambda u, v: (u, -v),
    "--start 180, axes exchanged": lambda u, v: (-v, -u),
    "--start 270, axes exchanged": lambda u, v: (-u, v),
}


def common_ball(balls: Mapping[str, Mapping[str, float]]) -> tuple[str, str]:
    """What circles about one place say of each other: a sentence, and a warning.

    Parameters
    ----------
    balls : of each circle by its name, place of the ball along the two axes of its plane, mm from the centre.

    Returns
    -------
    Both are empty where circles have no axis in common. The warning is that one of at least three circles shows the
    ball where the others do, if its angle is counted otherwise.
    """
    apart = _apart(balls)
    size = max((max(map(abs, b.values())) for b in balls.values()), default=0.0)
    if len(balls) < 2 or not np.isfinite(apart):
        return "", ""
    near = max(SAME_BALL, AGREES * size)
    if apart <= near:
        return f"the circles show one ball, within {1e3 * apart:.2g} um", ""
    says = (
        f"the circles show balls {1e3 * apart:.3g} um apart: set anew for each, or an angle counts otherwise, or the "
    )
    says += "deviations of one have the other sign"
    if len(balls) < 3:
        return says, ""
    cures = []
    for name, ball in balls.items():
        first, second = ball
        for what, turn in TURNED.items():
            u, v = turn(ball[first], ball[second])
            if _apart({**balls, name: {first: u, second: v}}) <= near / 2:
                option = what.replace("axes exchanged", f"--plane {second}{first}")
                cures.append(f"that of {name} as with {option}")
    if not cures:
        return says, ""
    return says, f"{says}; with the angle counted otherwise they show one: {' or '.join(cures)}"


def _apart(balls: Mapping[str, Mapping[str, float]]) -> float:
    """Largest distance (mm) along an axis that two circles have in common; NaN without any."""
    axes = {a for b in balls.values() for a in b}
    along = [[b[a] for b in balls.values() if a in b] for a in axes]
    return max((max(own) - min(own) for own in along if len(own) > 1), default=float("nan"))


def row_places(rows: Index, lines: tuple[int, ...]) -> tuple[int, ...]:
    """Lines of the file of some of its rows; empty where they are not known."""
    return tuple(lines[k] for k in rows) if lines else ()
