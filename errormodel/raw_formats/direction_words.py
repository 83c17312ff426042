"""Words for the direction in which a joint arrives at a position, as files have them."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from errormodel.arrays import Array
from errormodel.exceptions import InputError

MOSTLY = 0.5  # of the steps under a word, less those the other way: so many go its way
_PLUS = frozenset((
    "+", "+1", "1", "1.0", "forward", "forwards", "fwd", "positive", "pos", "up", "f", "\u2191", "\u2192", "plus",
    "vor", "vorw\u00e4rts", "vorwaerts", "vw", "v", "hin", "aller", "andata", "auf", "aufw\u00e4rts", "aufwaerts",
    "steigend", "positiv", "upward", "upwards", "ascending", "increasing", "avanti", "avant",
))  # fmt: skip
_MINUS = frozenset((
    "-", "-1", "-1.0", "\u2013", "\u2212", "backward", "backwards", "reverse", "rev", "bwd", "back", "negative", "neg",
    "down", "b", "r", "\u2193", "\u2190", "minus", "zur\u00fcck", "zurueck", "zur", "z", "r\u00fcck", "rueck",
    "r\u00fcckw\u00e4rts", "rueckwaerts", "rw", "her", "retour", "ritorno", "ab", "abw\u00e4rts", "abwaerts", "fallend",
    "negativ", "downward", "downwards", "descending", "decreasing", "indietro", "arri\u00e8re", "arriere",
))  # fmt: skip
_TURNS = {
    **dict.fromkeys(
        ("ccw", "counterclockwise", "anticlockwise", "acw", "g3", "g03", "guzs", "gegenuhrzeigersinn"), 1.0
    ),
    **dict.fromkeys(("cw", "clockwise", "g2", "g02", "uzs", "uhrzeigersinn"), -1.0),
}
HEADINGS = r"dir(ection)?|approach(direction)?|sense|richtung"


def turning(cells: Iterable[object]) -> Array | None:
    """1 for counter-clockwise, -1 for clockwise, (n,); None where a cell says neither."""
    words = ["".join(c for c in str(cell).lower() if c.isalnum()) for cell in cells]
    out = np.array([_TURNS.get(w, np.nan) for w in words])
    return None if not len(out) or np.isnan(out).any() else out


def side_of(word: str) -> float | None:
    """1 or -1 as in `sides`; None for a word that says neither."""
    word = word.strip().lower()
    return 1.0 if word in _PLUS else -1.0 if word in _MINUS else None


def by_way(cells: Iterable[object], position: Array) -> Array | None:
    """1 or -1 as in `sides` of two words of any kind (``CW``, ``CCW``): which way the positions go under each.

    None where there are not two words, or a word goes both ways.
    """
    words = np.array([str(c).strip().lower() for c in cells])
    steps, alike = np.sign(np.diff(position)), words[1:] == words[:-1]
    found: dict[str, float] = {}
    for word in dict.fromkeys(words.tolist()):
        own = steps[alike & (words[1:] == word) & (steps != 0)]
        # between two runs of one word the way back is a single step
        if len(own) == 0 or abs(own.sum()) < MOSTLY * len(own):
            return None
        found[word] = float(np.sign(own.sum()))
    return np.array([found[w] for w in words]) if sorted(found.values()) == [-1.0, 1.0] else None


def sides(cells: Iterable[object], where: Callable[[int], str]) -> Array:
    """1 for a joint that arrives from smaller positions, -1 from larger ones, (n,).

    Parameters
    ----------
    cells : what stands in the rows; `where`: place of a row in the file, for messages.

    Raises
    ------
    InputError
        A cell is neither.
    """
    words = [str(c).strip().lower() for c in cells]
    out = np.array([np.nan if (side := side_of(w)) is None else side for w in words])
    if np.isnan(out).any():
        row = int(np.argmax(np.isnan(out)))
        found = f"'{words[row]}' as a direction"
        raise InputError(where(row), found, "Directions are + and -, 1 and -1, forward and reverse")
    return out
