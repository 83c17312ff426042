"""Rows in which commands and measured points do not belong together: another order, frame or meaning of a column.

Most rows say where the frame stands; hypotheses are tried for rows far from their nominal points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Index, Mask
from errormodel.chain import Chain
from errormodel.conventions import FRAME, INSTRUMENT
from errormodel.exceptions import InputError
from errormodel.survey import Survey
from errormodel.surveys.columns import MEASURED, ORIENTATION, TOOL_COLUMNS
from identification.diagnosis.data_checks.blunder import Blunder, Points, Sheet, groups, length, sheet
from identification.diagnosis.data_checks.columns import ALIKE as ALIKE_FITS
from identification.diagnosis.data_checks.columns import Changes, mended, single_changes
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog
from identification.observation.frames import MACHINE_ERROR_SHARE
from identification.observation.pose import Pose

if TYPE_CHECKING:
    import pandas as pd

FEWEST = 16  # rows of a file, to say anything
MOST_TARGETS = 8  # of which each two are tried in each other's place
FEWEST_OF_TARGET = 4  # rows, to say where their target or their frame is
ORIGIN_AND_AXES = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
FAR = 8.0  # times the others' distance
LATEST = 12  # rows by which measured points may be late or early
WINDOWS = 8  # lengths of the stretches that say where the frame stands: so many to a file
NEAR = 5e-3  # of the points' spread: what a shop calls the same place
MOST = 0.4  # of the rows must agree on a frame
CLEARLY = 0.05  # of the rows: by so much more must agree where they are taken to be late or early
BETTER = 10.0  # times nearer: rows that one change brings to where they belong
REST = 0.8  # of the rows concerned must follow
MOVED = 20.0  # times what is small: a frame that moved less is an effect of its own, not a mistake
THINNED = 600  # rows, to find an order
UNITS = {25.4: ("inch", "mm"), 1000.0: ("m", "mm"), 1000 / 25.4: ("m", "inch")}  # usual mistakes, by how many times
ALIKE = 0.2  # relative difference of spreads of poses that were drawn alike; by judgement
OWN_RUN = (
    "Give them a run of their own (column run) and say frame: per-run in a survey.yaml (--frame per-run of "
    "`errormodel import`)"
)
OWN_FILE = "Give them a file of their own and say frame: per-file in a survey.yaml"  # where rows are streamed


def wrong_rows(chain: Chain, survey: Survey, log: DecisionLog = UNRECORDED) -> Blunder | None:
    """The first file with rows that belong elsewhere, and the survey with them put right; or None.

    Raises
    ------
    InputError
        Rows were measured in another frame, which the survey must say.
    """
    points = Points.of(chain, sheet(chain, survey.table), survey.frame == "fixed")
    # error motions of one joint are read wherever the others are
    placed = np.asarray(np.isfinite(points.nominal).all(axis=1))
    every = (rows[placed[rows]] for rows in groups(survey, gaps=True))
    parts = [_Part(chain, survey, points.part(rows), rows) for rows in every]
    for part in parts:
        if part.seen.sum() < FEWEST:
            continue
        others = {str(survey.table["run"].iloc[o.rows[0]]): o for o in parts if o is not part}
        if (found := part.wrong(others if survey.frame == "per-run" else {})) is not None:
            log.add("rows-elsewhere", "found", "rows", len(found.rows or ()), beside=found.text)
            return found
    log.add("rows-elsewhere", "passed", "rows", 0)
    return None


def refuse_other_targets(chain: Chain, survey: Survey) -> None:
    """InputError where the rows far from the others are those of targets that lie elsewhere than is written."""
    for rows in groups(survey, gaps=True):
        columns = sheet(chain, survey.table.iloc[rows])
        part = _Part(chain, survey, Points.of(chain, columns, survey.frame == "fixed"), rows)
        if part.seen.sum() >= FEWEST and np.isfinite(part.points.nominal).all():
            part.refuse_exchanged_targets(columns)
            part.refuse_other_targets(columns)


@dataclass(frozen=True)
class _Part:
    """The rows of one file in one frame: `rows` of the survey's table, (n,)."""

    chain: Chain
    survey: Survey
    points: Points
    rows: Index

    @property
    def small(self) -> float:
        return MACHINE_ERROR_SHARE * self.chain.size

    @property
    def plausible(self) -> float:
        """Distance (mm) from the nominal points that rows of this machine keep; no less where these do not spread."""
        return max(NEAR * self.points.spread, self.small)

    @cached_property
    def seen(self) -> Mask:
        """Rows with all components."""
        return np.asarray(np.isfinite(self.points.measured).all(axis=1))

    def wrong(self, others: dict[str, _Part]) -> Blunder | None:
        distance = self.points.shifted(0).distances()
        usual = float(np.median(distance))
        if distance.max() < max(self.small, FAR * usual) and usual < self.plausible:
            return None
        late, pose = self._agreed()
        if pose is None:
            return None
        distance = self.points.distances(pose)
        fit = self.points.shifted(late).distances(pose)
        near = max(self.small, FAR * float(np.median(fit[fit < self.plausible])))
        off = np.flatnonzero(self.seen & (distance > near))
        if len(off) < 2:
            return None
        found = self._other_column(pose, off, near) or self._other_run(pose, off, near, others)
        found = found or self._other_order(pose, off, near)
        if found is None:
            self._refuse_other_frame(pose, off, near)
        return found

    def refuse_exchanged_targets(self, columns: Sheet) -> None:
        """InputError where two targets that stand for each other in all rows explain what no single column does."""
        if not {*TOOL_COLUMNS} <= {*columns}:
            return
        places, target = np.unique(np.column_stack([columns[n] for n in TOOL_COLUMNS]), axis=0, return_inverse=True)
        before = self.points.shifted(0).misfit() if 1 < len(places) <= MOST_TARGETS else 0.0
        if before < self.plausible:
            return
        tries = list[tuple[float, int, int]]()
        for one, other in combinations(range(len(places)), 2):
            exchanged = np.arange(len(places))
            exchanged[[one, other]] = other, one
            tries.append(
                (self._misfit(columns, dict(zip(TOOL_COLUMNS, places[exchanged][target].T, strict=True))), one, other)
            )
        after, one, other = min(tries)
        if after > min(before / BETTER, self.plausible):
            return
        single = (mended(columns, changes) for changes in single_changes(self.chain.machine))
        if min(self._misfit(columns, changed) for changed in single) < ALIKE_FITS * after:
            return  # which can be put right
        where = f"{self.survey.table['file'].iloc[self.rows[0]]}, columns {' '.join(TOOL_COLUMNS)}"
        sizes = length(1e3 * before), length(1e3 * after)
        found = (
            f"the targets at {_spot(places[one])} and {_spot(places[other])} are exchanged: the nominal machine misses "
        )
        found += "by {}, with each in the other's place by {} (four of five rows stay within)".format(*sizes)
        raise InputError(where, found, "Write the place of each under the name of the other (targets:), or in its rows")

    def _misfit(self, columns: Sheet, changed: Sheet) -> float:
        return Points.of(self.chain, columns | changed, self.points.fixed).measured_whole.misfit()

    def refuse_other_targets(self, columns: Sheet) -> None:
        written = np.column_stack([columns[name] for name in TOOL_COLUMNS if name in columns])
        if (written == written[:1]).all():
            return
        places, target = np.unique(written, axis=0, return_inverse=True)
        most = max((int(np.sum(self.seen & (target == k))) for k in range(len(places))), default=0)
        if (
            written.shape[1] < 3
            or len(places) < 2
            or most < FEWEST_OF_TARGET
            or self.points.distances()[self.seen].max() < self.plausible
        ):
            return
        each = [np.flatnonzero(self.seen & (target == k)) for k in range(len(places))]
        poses = [self.points.part(own).pose() for own in each if len(own) >= FEWEST_OF_TARGET]
        pose = min(poses, key=lambda p: float(np.mean(self.points.distances(p)[self.seen] > self.plausible)))
        distance = self.points.distances(pose)
        if not (distance[self.seen] < self.plausible).any():
            return
        near = max(self.small, FAR * float(np.median(distance[distance < self.plausible])))
        off = np.flatnonzero(self.seen & (distance > near))
        wrong = [(places[k], own) for k in np.unique(target[off]) if len(own := off[target[off] == k])]
        if len(wrong) == len(places) or not wrong or min(len(own) for _, own in wrong) < FEWEST_OF_TARGET:
            return
        if self._other_column(pose, off, near) is not None:  # which can be put right
            return
        said, exchanged = [], True
        for place, own in wrong:
            shown = self._shown_place(columns, pose, own)
            here = columns | {name: np.full(len(self.rows), x) for name, x in zip(TOOL_COLUMNS, shown, strict=True)}
            left = Points.of(self.chain, here, fixed=True).part(own).distances(pose)
            if np.mean(left < near) < REST or np.median(left) > np.median(distance[own]) / BETTER:
                return
            text = f"{self._spoken(own)}, written with the target at {_spot(place)}, show it at {_spot(shown)}"
            others = places[(np.linalg.norm(places - shown, axis=1) < near) & (places != place).any(axis=1)]
            exchanged &= len(others) > 0
            said.append(text + (f", where {_spot(others[0])} is written in other rows" if len(others) else ""))
        if (
            2 * len(off) >= self.seen.sum() and not exchanged
        ):  # few tell nothing of the rest, but by places written there
            return
        where = f"{self.survey.table['file'].iloc[self.rows[0]]}, columns {' '.join(TOOL_COLUMNS)}"
        rest = f"while the other {int(self.seen.sum()) - len(off)} rows fit theirs"
        cure = "Write in each row the place of the target that was measured there: look for a wrong name, unit or digit"
        raise InputError(where, f"{'; '.join(said)} (mm), {rest}", cure)

    def _shown_place(self, columns: Sheet, pose: Pose, own: Index) -> Array:
        """Place (3,) mm in the last frame at which the measured points of some rows lie, in a frame of known pose."""
        n = len(self.rows)
        tools = [columns | {t: np.full(n, x) for t, x in zip(TOOL_COLUMNS, p, strict=True)} for p in ORIGIN_AND_AXES]
        origin, *ends = (Points.of(self.chain, tool, fixed=True).nominal[own] for tool in tools)
        turns = np.stack([end - origin for end in ends], axis=-1)
        seen = pose.invert(self.points.measured[own]) - origin
        return np.asarray(np.median(np.einsum("nji,nj->ni", turns, seen), axis=0))

    def _agreed(self) -> tuple[int, Pose | None]:
        """By how many rows what was measured is late, for most rows, and the frame that these agree on.

        Stretches of consecutive rows are aligned and the others asked whether they agree; as commanded, unless
        clearly more agree otherwise.
        """
        every, near = -(-len(self.points) // THINNED), self.plausible
        agreed, best, found = MOST, 0, None
        for late in sorted(range(-LATEST, LATEST + 1), key=abs):
            pairs = self.points.shifted(late)
            if len(pairs) < FEWEST:
                continue
            count = max(len(pairs) // WINDOWS, 8)
            for first in range(0, len(pairs) - count + 1, max(count // 2, 1)):
                pose = pairs.part(np.arange(first, first + count, max(every // 2, 1))).pose(rounds=0)
                distance = pairs.part(np.arange(0, len(pairs), every)).distances(pose)
                agree = float(np.mean(distance < near)) - CLEARLY * (late != 0)
                if agree > agreed + 1e-9:
                    agreed, best, found = agree, late, pose
        if found is not None:
            pairs = self.points.shifted(best)
            found = pairs.part(pairs.distances(found) < near).pose()
        return best, found

    def _other_column(self, pose: Pose, off: Index, near: float) -> Blunder | None:
        """A column that has another sign, unit or place in some rows only."""
        columns = sheet(self.chain, self.survey.table.iloc[self.rows[off]])
        before = float(np.median(self.points.part(off).distances(pose)))
        tries: list[tuple[float, int, Changes]] = []
        for k, changes in enumerate(single_changes(self.chain.machine)):
            distance = Points.of(self.chain, mended(columns, changes), fixed=True).distances(pose)
            if np.median(distance) < before / BETTER and np.mean(distance < near) > REST:
                tries.append((float(np.median(distance)), k, changes))
        if not tries:
            return None
        after, _, changes = min(tries)
        stretch = np.arange(off[0], off[-1] + 1)  # where the column is small the mistake is small as well
        whole = mended(sheet(self.chain, self.survey.table.iloc[self.rows[stretch]]), changes)
        if np.mean(Points.of(self.chain, whole, fixed=True).distances(pose) < near) > 0.95:
            off = stretch
        here = self.survey.table.index[self.rows[off]]
        new = self.survey.table.copy()
        right = mended(new.loc[here], changes)
        new.loc[here, right.columns] = right
        what = changes[0].text(self.chain.machine)
        return self._blunder(f"{what} in {self._spoken(off)}", new, off, before, after, changes[0].where)

    def _other_run(self, pose: Pose, off: Index, near: float, others: dict[str, _Part]) -> Blunder | None:
        """Rows that carry the label of another run than the one in whose frame they lie."""
        before = float(np.median(self.points.part(off).distances(pose)))
        for label, other in others.items():
            distance = self.points.part(off).distances(other.points.pose())
            here = off[distance < max(near, self.small)]
            if len(here) < max(REST * len(off), 2) or np.median(distance) > before / BETTER:
                continue
            new = self.survey.table.copy()
            own = str(new["run"].iloc[self.rows[0]])
            new.loc[new.index[self.rows[here]], "run"] = label
            what = f"{self._spoken(here)} of run {own} lie in the frame of run {label}: they are labelled wrongly"
            return self._blunder(what, new, here, before, float(np.median(distance)), FRAME)
        return None

    def _other_order(self, pose: Pose, off: Index, near: float) -> Blunder | None:
        """Measured points that belong to other rows: a stretch that is late or early, or any order."""
        source = self._sources(pose, off, near)
        moved = np.flatnonzero((source >= 0) & (source != np.arange(len(source))))
        if len(moved) < max(2, REST * len(off) - LATEST):
            return None
        reached = pose.apply(self.points.nominal)
        before, after = (
            float(np.nanmedian(np.linalg.norm(self.points.measured[which] - reached[moved], axis=1)))
            for which in (moved, source[moved])
        )
        if after > before / BETTER:
            return None
        steps, counts = np.unique(source[moved] - moved, return_counts=True)
        k, wrong = int(steps[np.argmax(counts)]), np.sort(source[moved])
        what = f"what was measured is in another order than the commands in {self._spoken(wrong)}"
        if counts.max() > REST * len(moved):
            many = f"{abs(k)} row{'s' * (abs(k) > 1)}"
            what = f"what was measured stands {many} too {'late' if k > 0 else 'early'} in {self._spoken(wrong)}"
        names = [n for n in (*MEASURED, *ORIENTATION) if n in self.survey.table]
        new = self.survey.table.copy()
        values = new[names].to_numpy()[self.rows]
        new.loc[new.index[self.rows], names] = np.where((source >= 0)[:, None], values[source], np.nan)
        return self._blunder(what, new, wrong, before, after, INSTRUMENT)

    def _sources(self, pose: Pose, off: Index, near: float) -> Index:
        """For each row the one whose measured point it should have, -1 for none, (n,)."""
        from scipy.spatial import KDTree

        n, reached, seen = len(self.points), pose.apply(self.points.nominal), self.points.measured
        every = np.arange(n)
        source = np.where(self.seen, every, -1)
        source[off] = -1
        stretches = []
        for k in (k for k in range(-min(LATEST, n - 1), min(LATEST, n - 1) + 1) if k):
            here = every[max(-k, 0) : n - max(k, 0)]
            there = np.linalg.norm(seen[here + k] - reached[here], axis=1)
            fit = here[there < near]
            own = fit[source[fit] < 0]
            if len(own) > 2:
                stretches.append((len(own), k, fit[(fit >= own[0]) & (fit <= own[-1])]))
        for _, k, fit in sorted(stretches, key=lambda s: (s[0], -abs(s[1]))):  # the one that most follow has the say
            source[fit] = fit + k
        left = np.flatnonzero(source < 0)
        free = np.setdiff1d(every[self.seen], source)
        if len(left) and len(free):
            distance, nearest = map(np.asarray, KDTree(seen[free]).query(reached[left]))
            back = np.asarray(KDTree(reached[left]).query(seen[free])[1])
            same = (back[nearest] == np.arange(len(left))) & (distance < near)
            source[left[same]] = free[nearest[same]]
        # a point that two rows ask for is the nearer one's
        away = np.where(source >= 0, np.linalg.norm(seen[source] - reached, axis=1), np.inf)
        for row in np.argsort(-away):
            if source[row] >= 0 and np.sum(source == source[row]) > 1:
                source[row] = -1
        own = off[~np.isin(off, source) & (source[off] < 0)]  # wild, and nobody else's
        source[own] = own
        return source

    def _refuse_other_frame(self, pose: Pose, off: Index, near: float) -> None:
        """InputError where the rows lie as they should in a frame of their own, far from the others'."""
        own, whole = self.points.part(off), len(off) > REST * (off[-1] + 1 - off[0])  # one stretch: a station was moved
        if self.survey.frame == "fixed" or len(off) < FEWEST // 2 or not whole:
            return
        before, after = own.misfit(pose), own.misfit()
        if before > MOVED * near and after < near and after < before / BETTER:
            where = f"{self.survey.table['file'].iloc[self.rows[0]]}, columns {' '.join(MEASURED)}"
            rest = np.setdiff1d(np.flatnonzero(self.seen), off)
            spread = self.points.part(rest).spread / max(own.spread, 1e-300)
            for size, (unit, other) in UNITS.items():
                if abs(spread / size - 1) < ALIKE:
                    found = f"{self._spoken(off)} spread {spread:.3g} times less than the rest"
                    raise InputError(where, f"{found}, as if in {unit} where these are in {other}", "Write one unit")
            found = f"{self._spoken(off)} lie in another measuring frame than the rest, {before:.0f} mm away"
            raise InputError(where, found, OWN_RUN)

    def _spoken(self, which: Index) -> str:
        """Rows of the file, as a person finds them."""
        rows = self._numbers(which)
        if len(rows) == len(self.points):
            return "all rows"
        if rows[-1] - rows[0] < 1.05 * len(rows):
            return f"rows {rows[0]} to {rows[-1]}"
        return f"{len(rows)} rows ({', '.join(map(str, rows[:6]))}{' ...' if len(rows) > 6 else ''})"

    def _numbers(self, which: Index) -> tuple[int, ...]:
        return tuple(int(r) for r in self.survey.table["row"].to_numpy()[self.rows[which]])

    def _blunder(
        self, what: str, table: pd.DataFrame, which: Index, before: float, after: float, where: str
    ) -> Blunder:
        survey = replace(self.survey, table=table)
        return Blunder(
            what, survey, where=where, before_um=1e3 * before, after_um=1e3 * after, rows=self._numbers(which)
        )


def _spot(place: Array) -> str:
    """A place as a person writes it."""
    return f"({', '.join(f'{x + 0.0:.5g}' for x in np.round(place, 2))})"
