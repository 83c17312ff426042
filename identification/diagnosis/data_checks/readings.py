"""Mistakes among lengths: readings far from where the others put their set-up, exchanged ones, few that are left.

Before a fit, a length is compared with that of a machine without errors, from where the estimation of its set-up
starts: a robust place, so that wrong readings stand out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.survey import Survey
from errormodel.surveys.columns import OBSERVATION
from identification.diagnosis.data_checks.blunder import listed
from identification.diagnosis.data_checks.shared_starts import WrongStart, start_lines, wrong_starts
from identification.estimation.checks import WILD, WILD_FROM
from identification.estimation.result import Fit
from identification.observation.assembly import build
from identification.observation.frames import MACHINE_ERROR_SHARE
from identification.observation.models import View
from identification.observation.readings import ReadingView

MINORITY = 0.5  # of the readings of an observation left out: what is left is the smaller part, and may be the wrong one
MOST_WILD = 200  # readings, among which exchanged ones are looked for


ONE_WAY = 10  # lengths, to say that nearly all are too long or too short


@dataclass(frozen=True)
class Lengths:
    """Lengths of an observation beside those of a machine without errors.

    Attributes
    ----------
    label : of the observation.
    index : (n,) survey rows.
    gap : (n,) measured minus nominal, mm.
    wild : (k,) places of the readings that lie far off.
    exchanged : pairs of places of readings that fit in each other's place.
    starts : set-ups that are off by the same amount in all their readings.
    long : whether they are lengths of something, and no displacements across a line (straightness).
    """

    label: str
    index: Index
    gap: Array
    wild: Index
    exchanged: tuple[tuple[int, int], ...]
    starts: tuple[WrongStart, ...] = ()
    long: bool = True

    @property
    def far_mm(self) -> float:
        """Distance that half of them lie beside the nominal machine, mm."""
        return float(np.median(np.abs(self.gap))) if len(self.gap) else 0.0


def lengths_of(chain: Chain, views: Sequence[View]) -> list[Lengths]:
    """The lengths in a survey, an entry an observation (or a run, where its set-up is one a run)."""
    out = []
    for view in views:
        if not isinstance(view, ReadingView) or view.turns:
            continue
        gap = view.beside_nominal()
        usual = float(np.quantile(np.abs(gap), 0.8))
        wild = np.flatnonzero(np.abs(gap) > max(WILD * usual, WILD_FROM * chain.size))
        nominal = view.measured - gap
        exchanged = _exchanged(view.measured, nominal, wild, usual, chain)
        starts, long = wrong_starts(view, gap), not view.observation.along_line
        out.append(Lengths(view.label, view.index, gap, wild, exchanged, starts, long))
    return out


def _exchanged(measured: Array, nominal: Array, wild: Index, usual: float, chain: Chain) -> tuple[tuple[int, int], ...]:
    near = max(2 * usual, MACHINE_ERROR_SHARE * chain.size)
    pairs = [(int(i), int(j)) for n, i in enumerate(wild[:MOST_WILD]) for j in wild[n + 1 : MOST_WILD]]
    fit = [(i, j) for i, j in pairs if max(abs(measured[i] - nominal[j]), abs(measured[j] - nominal[i])) < near]
    return tuple(fit) if 2 * len(fit) == len({k for pair in fit for k in pair}) else ()


def refuse_exchanged(survey: Survey, lengths: Sequence[Lengths]) -> None:
    """InputError about lengths that stand in each other's row."""
    for own in lengths:
        if not own.exchanged:
            continue
        rows = _rows(survey, own.index)
        text = ", ".join(f"{rows[i]} and {rows[j]}" for i, j in own.exchanged[:5])
        found = (
            f"the lengths of rows {text} are exchanged: each lies {abs(own.gap[own.exchanged[0][0]]):.3g} mm off, and "
        )
        found += "fits in the place of the other"
        raise InputError(_place(survey, own), found, "Give each length with the command at which it was read")


def refuse_exchanged_names(chain: Chain, survey: Survey, lengths: Sequence[Lengths]) -> None:
    """InputError about two observations of a type whose readings lie far off, and where they should by the other name.

    Parameters
    ----------
    survey : what `lengths` are of.
    """
    off = _typical(lengths)
    far = [label for label, size in off.items() if size > WILD_FROM * chain.size]
    for one, other in combinations(far, 2):
        if survey.observations[one].type != survey.observations[other].type:
            continue
        table, pair = survey.table.copy(), {one: other, other: one}
        table[OBSERVATION] = table[OBSERVATION].replace(pair)
        try:
            views = build(chain, replace(survey, table=table)).views
        except InputError:  # by these names there is no place for an instrument
            continue
        so = _typical(lengths_of(chain, [v for v in views if isinstance(v, ReadingView) and v.label in pair]))
        if all(so[label] < min(off[label] / WILD, WILD_FROM * chain.size) for label in pair):
            file = survey.table["file"].iloc[next(own.index[0] for own in lengths if own.label == one)]
            found = (
                f"the readings of '{one}' and '{other}' are exchanged: half of them lie more than "
                f"{min(off[one], off[other]):.3g} mm beside the nominal machine, and within "
                f"{max(so.values()):.2g} mm of it by the name of the other"
            )
            cure = "Exchange the two names in the column observation, or under observations: in survey.yaml"
            raise InputError(f"{file}, observations {one}, {other}", found, cure)


def _typical(lengths: Sequence[Lengths]) -> dict[str, float]:
    """Distance that half of the readings of each observation lie beside the nominal machine, mm, over all its runs."""
    gaps: dict[str, list[Array]] = {}
    for own in lengths:
        gaps.setdefault(own.label, []).append(np.abs(own.gap))
    return {label: float(np.median(np.concatenate(parts))) for label, parts in gaps.items()}


def refuse_wild(survey: Survey, lengths: Sequence[Lengths]) -> None:
    """InputError about lengths that lie where no error motion takes them."""
    refuse_exchanged(survey, lengths)
    for own in lengths:
        if len(own.wild):
            numbers = _rows(survey, own.index)[own.wild].tolist()
            some = (
                f"the lengths of rows {listed(numbers)} are"
                if len(numbers) > 1
                else f"the length of row {numbers[0]} is"
            )
            largest = float(np.abs(own.gap[own.wild]).max())
            found = f"{some} up to {largest:.3g} mm from where the other {len(own.gap) - len(own.wild)} put the set-up"
            cure = "Leave length empty in these rows, or fit with --robust, which weighs rows by how far they lie"
            raise InputError(_place(survey, own), found, cure)


def refuse_minority(survey: Survey, fit: Fit) -> None:
    """InputError where a robust fit leaves out most readings of an observation: the few that are left may be wrong."""
    gone = {o.index for o in fit.outliers}
    for view in fit.problem.views:
        if isinstance(view, ReadingView):
            out = sum(int(k) in gone for k in view.index)
            if out > MINORITY * len(view):
                found = f"{out} of {len(view)} readings lie far from what the other observations and the machine allow"
                cure = "Look for a beam that was lost, another unit or another order of its rows, or leave it out"
                file = survey.table["file"].iloc[view.index[0]]
                raise InputError(f"{file}, observation {view.label}", found, cure)


def length_lines(survey: Survey, lengths: Sequence[Lengths]) -> Iterator[str]:
    """How the lengths lie beside those of a machine without errors."""
    views = Counter(own.label for own in lengths)
    for own in lengths:
        um = 1e3 * np.abs(own.gap)
        run = survey.table["run"].iloc[own.index[0]]
        which = f"{own.label}, run {run}" if views[own.label] > 1 else own.label  # a set-up of its own in each run
        what = f"{len(um)} {'lengths' if own.long else 'readings'}"
        text = f"{which}: {what}, {np.sqrt(np.mean(um**2)):.3g} um rms (median {np.median(um):.3g} um, "
        text += f"largest {um.max():.3g} um) from a machine without errors"
        if own.long and len(um) >= ONE_WAY and abs(np.sign(own.gap).sum()) >= 0.9 * len(um):
            way = "long" if np.median(own.gap) > 0 else "short"
            text += f"; nearly all of them too {way}: a scale, or the known length is wrong"
        if len(own.wild):
            text += f"; far off: rows {listed(_rows(survey, own.index)[own.wild].tolist())} (fit with --robust)"
        yield text
        yield from start_lines(survey, own.label, own.index, own.starts)


def start_notes(survey: Survey, lengths: Sequence[Lengths]) -> Iterator[str]:
    """Sentences on set-ups of distances that are off in common."""
    for own in lengths:
        yield from start_lines(survey, own.label, own.index, own.starts)


def _rows(survey: Survey, index: Index) -> Index:
    return np.asarray(survey.table["row"].to_numpy()[index])


def _place(survey: Survey, own: Lengths) -> str:
    return f"{survey.table['file'].iloc[own.index[0]]}, observation {own.label}"
