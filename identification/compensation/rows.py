"""Survey behind a fit: measured commands, and residuals of rows that the fit did not use.

Commands in mm and rad, residuals in mm in the axes of the reference frame.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from errormodel.approach import direction
from errormodel.arrays import Array, Mask
from errormodel.chain import TOOL_CHANNELS, Chain
from errormodel.channels import channel, columns, lacking, plays_among, root
from errormodel.conventions import MOTIONS
from errormodel.exceptions import InputError
from errormodel.files import as_numbers, read_csv, without_apostrophes
from errormodel.inputs import noted
from errormodel.instruments.plain import Plain
from errormodel.machine import Machine
from errormodel.survey import Survey
from identification.observation.assembly import frame_labels
from identification.observation.pose import IDENTITY, Pose
from identification.results.stored_fit import CURE, StoredFit

if TYPE_CHECKING:
    import pandas as pd

RESIDUAL = re.compile(r"(nominal|residual|heldout)_\w+_(um|urad)$|dir_")  # columns of numbers beside commands
LARGEST = 1e10  # mm, um or deg: of a length of 10 km; more is no length of a machine, by judgement
CONDITIONS = ("time", "w_", "feed", "load", "T_")  # prefixes of channels that no table or description has as an input
FEWEST_HELD_OUT = 12  # held-out poses: an RMS of fewer is too uncertain to report; by judgement


def read_rows(folder: Path, machine: Machine) -> pd.DataFrame:
    """Rows of a fit's ``residuals.csv`` whose commands are all known, positions in mm and rad.

    Raises
    ------
    InputError
        There is no such file, or it is of another machine.
    """
    path = noted(folder / "residuals.csv")
    try:
        table = read_csv(path, dtype={"run": str, "file": str})
    except (OSError, ValueError) as error:
        raise InputError(str(path), f"it cannot be read ({error})", CURE) from error
    for name in {"run", "file"} & {*table}:
        table[name] = without_apostrophes(table[name])
    missing = [j.name for j in machine.joints if j.name not in table]
    if missing or not len(table):
        found = f"no column '{missing[0]}'" if missing else "no rows"
        raise InputError(str(path), found, "Run the fit again")
    _check_numbers(table, machine, path)
    for joint in machine.joints:
        if joint.type == "rotary":
            table[joint.name] = np.radians(table[joint.name])
    if (about := joints_read(table)) is not None:
        return placed(table, machine, set(about))
    known = table[[j.name for j in machine.joints]].notna().all(axis=1)
    return table[known].reset_index(drop=True)


def _check_numbers(table: pd.DataFrame, machine: Machine, path: Path) -> None:
    """Raise InputError at a command or residual that is no number, or one that no machine has."""
    commands = {*(j.name for j in machine.joints), *TOOL_CHANNELS}
    for name in [n for n in map(str, table) if n in commands or RESIDUAL.match(n)]:
        numbers = as_numbers(table[name])
        wrong = (numbers.isna() & table[name].notna()) | (numbers.abs() > LARGEST)
        if wrong.any():
            row = int(np.argmax(wrong))
            raise InputError(f"{path}, row {row + 1}, column {name}", f"{str(table[name][row])[:40]!r}", CURE)
        table[name] = numbers


def joints_read(table: pd.DataFrame) -> dict[str, list[str]] | None:
    """Of a survey of error motions only, which motions of which joints were read; None of any other survey."""
    if "joint" not in table or table["joint"].isna().any():
        return None
    out: dict[str, list[str]] = {}
    for name, rows in table[table["role"] == "fit"].groupby("joint", sort=False):
        out[str(name)] = [m for m in MOTIONS if rows.filter(like=f"residual_{m}_").notna().to_numpy().any()]
    return out


def placed(table: pd.DataFrame, machine: Machine, read: Collection[str]) -> pd.DataFrame:
    """Rows about one joint each with positions of all: the others in the middle of what was read of them.

    Joints of which nothing was read stand still, where most rows have them or in the middle of their travel.
    """
    table = table.copy()
    for joint in machine.joints:
        given = table[joint.name].to_numpy(dtype=np.float64)
        own = given[(table["joint"] == joint.name).to_numpy()] if joint.name in read else given[np.isfinite(given)]
        if joint.name in read:
            table[joint.name] = np.where(np.isnan(given), (own.min() + own.max()) / 2, given)
        else:
            table[joint.name] = float(np.median(own)) if len(own) else sum(joint.travel) / 2
    return table


@dataclass(frozen=True)
class Rows:
    """Commands of a survey in mm and rad.

    Attributes
    ----------
    q : (n, joints)
    direction : (n, joints), with a column more for each play (`Field.rows`) where the path before is known.
    tool : (n, 3) mm
    left : (n, 3) measured minus predicted by a fit that did not see the row, mm, in the reference's axes.
    frames : (n,) label of the frame that a row was measured in.
    what : which rows these are, in words.
    about : (n,) joint whose error motions a row reads, "" where it is a position; None: all are positions.
    seen : (n, 3) as `left`, by the model that the tables are computed from: with it comes what was measured, which is
        the error without tables. None: `left` is that.
    own : values (n,) of channels that tables hold at one value (`conditions_in`); those of the rows are not theirs.
    """

    q: Array
    direction: Array
    tool: Array
    left: Array
    frames: Array
    what: str
    about: Array | None = None
    seen: Array | None = None
    own: Mapping[str, Array] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.q)

    def part(self, keep: Mask, of: str) -> Rows:
        """Subset of the rows, with the words `of` that describe it."""
        q, came, tool, left, frames = (a[keep] for a in (self.q, self.direction, self.tool, self.left, self.frames))
        about, seen = (None if a is None else a[keep] for a in (self.about, self.seen))
        own = {name: values[keep] for name, values in self.own.items()}
        return Rows(q, came, tool, left, frames, f"{len(q)} {self.what.partition(' ')[2]}, {of}", about, seen, own)

    def nearest(self, state: Mapping[str, float], states: Sequence[Mapping[str, float]]) -> Rows | None:
        """Rows that were measured nearer to a state than to others of a machine; None: too few."""
        names = [n for n in state if n in self.own]
        if len(states) < 2 or not names:
            return self
        away = np.zeros((len(states), len(self)))
        for name in names:
            levels = np.array([s[name] for s in states])
            away += ((self.own[name] - levels[:, None]) / (np.ptp(levels) or 1.0)) ** 2
        keep = away.argmin(axis=0) == states.index(state)
        return self.part(keep, "nearest to this state") if keep.sum() >= FEWEST_HELD_OUT else None

    @property
    def in_state(self) -> Rows:
        """The same rows as if they had been measured in the state of the tables."""
        return replace(self, own={})

    @property
    def measured(self) -> Rows:
        """The same rows with `left` such that errors without corrections are those that were measured."""
        return self if self.seen is None else replace(self, left=self.seen)


def commands(table: pd.DataFrame, machine: Machine) -> tuple[Array, Array, Array]:
    """Positions, directions of approach (n, joints) and tool tips (n, 3) of a table."""
    q = table[[j.name for j in machine.joints]].to_numpy(dtype=np.float64)
    came = np.column_stack([direction(table, j.name) for j in machine.joints]) if len(table) else np.ones_like(q)
    tools = np.tile(np.asarray(machine.tool, dtype=np.float64), (len(table), 1))
    for k, name in enumerate(TOOL_CHANNELS):
        if name in table:
            tools[:, k] = table[name].fillna(machine.tool[k])
    return q, came, tools


def taken_up(chain: Chain, table: pd.DataFrame) -> Array:
    """Shares (n, plays), -1 to 1, of the plays of a chain that the path of a table's rows has taken up."""
    out = [np.zeros((len(table), 0))]
    for name, joint, width in plays_among(chain.channels):
        left = table[joint].to_numpy(dtype=np.float64) - channel(table, name)
        out.append(left[:, None] / (width / 2))
    return np.hstack(out)


def conditions_in(chain: Chain, table: pd.DataFrame) -> dict[str, Array]:
    """Values (n,) that a table's rows had of each channel of a chain that tables hold at one value."""
    there = {*map(str, table.select_dtypes("number"))}
    names = [
        name
        for name in chain.channels
        if (name == "row" or root(name).startswith(CONDITIONS)) and not lacking(there, [name])
    ]
    return dict(zip(names, columns(table, names), strict=True))


def held_out(fit: StoredFit, table: pd.DataFrame) -> Rows | None:
    """Positions that the fit did not use: test files, or blocks of cross-validation; None if there are too few."""
    for role, column, what in (
        ("test", "residual", "rows of test files"),
        ("fit", "heldout", "rows left out of the fit in blocks"),
    ):
        names = [f"{column}_{axis}_um" for axis in "xyz"]
        if not {*names} <= {*table.columns}:
            continue
        keep = (table["role"] == role) & table[names].notna().all(axis=1)
        part = table[keep]
        if len(part) < FEWEST_HELD_OUT:
            continue
        q, came, tools = commands(table, fit.chain.machine)
        came = np.hstack([came, taken_up(fit.chain, table)])
        mask = keep.to_numpy(dtype=bool)
        labels = frame_labels(Survey(part, "shared", (), Plain(), Path()), fit.frame_mode)
        turns = np.empty((len(part), 3, 3))
        for label in dict.fromkeys(labels):
            rows = labels == label
            turns[rows] = _pose(fit, part["file"].iloc[int(np.argmax(rows))], label, role).rotation
        left, seen = (
            np.einsum("ni,nij->nj", 1e-3 * part[columns].to_numpy(dtype=np.float64), turns)
            for columns in (names, [f"residual_{axis}_um" for axis in "xyz"])
        )
        own = {name: values[mask] for name, values in conditions_in(fit.chain, table).items()}
        return Rows(q[mask], came[mask], tools[mask], left, labels, f"{len(part)} {what}", seen=seen, own=own)
    return None


def _pose(fit: StoredFit, file: str, label: str, role: str) -> Pose:
    if role == "test":
        return fit.test_frames.get(file, {}).get(label) or fit.frames.get(label, IDENTITY)
    return fit.frames.get(label, IDENTITY)
