"""What readings of lengths can identify of a machine, by rank: for the page of reference that is written from it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.instruments.plain import Plain
from errormodel.machine import Machine
from errormodel.machine_file import read_machine
from errormodel.observations import registry
from errormodel.observations.base import Observation
from errormodel.simulation import random_points
from errormodel.simulation_readings import readings_at
from errormodel.survey import Survey
from errormodel.surveys.observations import is_unknown
from errormodel.truth import Truth
from identification.observation.assembly import build
from identification.observation.identifiability import find_groups
from identification.observation.models import PositionView
from identification.observation.normal_equations import design_rows, full_norms

MACHINES = ("bridge_cmm", "vertical_three_axis", "trunnion_five_axis")
POSES = 150
STEPS = 13  # positions on a line
SEEN = (
    1e-7  # singular value of columns scaled to full travel from which a direction is seen; exact ones are below 1e-12
)
MOST_NAMES = 8


@dataclass(frozen=True)
class Rank:
    """What a set-up sees of a machine: number of groups, and names of those that positions show and it does not."""

    groups: int
    unseen: list[str]


def motions(names: list[str]) -> str:
    """Error motions of some groups, each once, at most `MOST_NAMES`."""
    each = list(dict.fromkeys(n.partition(" ")[0] for n in names))
    more = f" and {len(each) - MOST_NAMES} more" if len(each) > MOST_NAMES else ""
    return f"{', '.join(each[:MOST_NAMES])}{more}"


def table() -> Iterator[tuple[str, list[Rank]]]:
    """Rows of the table: a set-up in words, and what it sees of each of `MACHINES`."""
    chains = [Chain(read_machine(name)) for name in MACHINES]
    whole = [_positions(c) for c in chains]
    yield "all three coordinates (tracker), frame unknown", [Rank(len(w), []) for w in whole]
    for words, made in CASES.items():
        yield words, [_rank(c, made(c), w) for c, w in zip(chains, whole, strict=True)]


def _entry(kind: str, **keys: Any) -> Observation:
    return registry()[kind](type=kind, **keys)


def _places(chain: Chain) -> Array:
    """Four places around the machine, well apart, (4, 3) mm."""
    points = chain.kernel("nominal", outputs=(0, 1, 2))(chain.columns(_poses(chain.machine, 0))).T
    middle, half = (points.max(axis=0) + points.min(axis=0)) / 2, np.ptp(points, axis=0).max()
    return np.asarray(
        middle + half * np.array([[1.5, -1.1, -0.6], [-1.4, -1.0, -0.4], [0.2, 1.6, -0.5], [0.3, 0.4, 1.8]])
    )


def _poses(machine: Machine, seed: int, longer: bool = False) -> pd.DataFrame:
    poses = random_points(machine, POSES, seed)
    if longer:  # every other row with a target that lies elsewhere
        poses.loc[::2, ["tool_x", "tool_y", "tool_z"]] = np.array(machine.tool) + np.array([70.0, 40.0, -80.0])
    return poses


def _stations(count: int, known: bool = False, longer: bool = False) -> Callable[[Chain], Survey]:
    def made(chain: Chain) -> Survey:
        machine = chain.machine
        entries, parts, values = {}, [], {}
        for k, place in enumerate(_places(chain)[:count]):
            label = "ABCD"[k]
            keys: dict[str, Any] = (
                {"station": place.tolist()} if known else {"near": place.tolist(), "dead_path": "unknown"}
            )
            entries[label] = _entry("station-distance", **keys)
            values[label] = {} if known else dict(zip("xyz", place.tolist(), strict=True))
            parts.append(_poses(machine, 0, longer).assign(observation=label))
        return _survey(chain, pd.concat(parts, ignore_index=True), entries, "fixed" if known else "shared", values)

    return made


def _pairs(known: bool = True) -> Callable[[Chain], Survey]:
    def made(chain: Chain) -> Survey:
        machine = chain.machine
        start = _poses(machine, 1)[[j.name for j in machine.joints]].add_prefix("from_")
        rows = _poses(machine, 0).join(start).assign(observation="bar")
        return _survey(chain, rows, {"bar": _entry("pose-distance", offset=0.0 if known else "unknown")}, "shared", {})

    return made


def _circles(known: bool) -> Callable[[Chain], Survey]:
    def made(chain: Chain) -> Survey:
        machine = chain.machine
        axes = [j for j in machine.joints if j.type == "prismatic"]
        middle = _poses(machine, 0).iloc[:1].copy()
        for j in machine.joints:
            middle[j.name] = sum(j.travel) / 2 if j.type == "prismatic" else 0.0
        angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
        radius = 0.4 * min(j.travel[1] - j.travel[0] for j in axes)
        parts, entries = [], {}
        for one, other in ((0, 1), (1, 2), (2, 0)):
            label = axes[one].name + axes[other].name
            rows = pd.concat([middle] * len(angle), ignore_index=True).assign(observation=label)
            rows[axes[one].name] += radius * np.cos(angle)
            rows[axes[other].name] += radius * np.sin(angle)
            parts.append(rows)
            entries[label] = _entry("ballbar-circle", calibrated=radius if known else "unknown")
        return _survey(chain, pd.concat(parts, ignore_index=True), entries, "shared", {})

    return made


def _lines(directions: Callable[[int], list[Array]]) -> Callable[[Chain], Survey]:
    """Calibrated lengths from the first pose of lines, along directions in shares of the linear axes' travels."""

    def made(chain: Chain) -> Survey:
        machine = chain.machine
        axes = [j for j in machine.joints if j.type == "prismatic"]
        low, high = np.array([j.travel for j in axes]).T
        middle = _poses(machine, 0).iloc[:1].copy()
        for j in machine.joints:
            middle[j.name] = 0.0
        parts = []
        for direction in directions(len(axes)):
            at = np.linspace(-0.45, 0.45, STEPS)[:, None] * direction * (high - low) + (high + low) / 2
            rows = pd.concat([middle] * (STEPS - 1), ignore_index=True)
            rows[[j.name for j in axes]] = at[1:]
            start = rows[[j.name for j in machine.joints]].add_prefix("from_")
            start[[f"from_{j.name}" for j in axes]] = at[0]
            parts.append(rows.join(start).assign(observation="gauge"))
        entries = {"gauge": _entry("pose-distance", offset=0.0)}
        return _survey(chain, pd.concat(parts, ignore_index=True), entries, "shared", {})

    return made


def _axes(count: int) -> list[Array]:
    """One direction an axis."""
    return list(np.eye(count))


def _diagonals(count: int) -> list[Array]:
    """The body diagonals of the working volume, each once."""
    return [np.array((1.0, *signs)) for signs in product((1.0, -1.0), repeat=count - 1)]


def _with_faces(count: int) -> list[Array]:
    """Body diagonals, and those of the faces through the middle."""
    faces = [one + sign * other for one, other in combinations(np.eye(count), 2) for sign in (1, -1)]
    return [*_diagonals(count), *faces]


CASES: dict[str, Callable[[Chain], Survey]] = {
    "one station, unknown, dead path unknown": _stations(1),
    "two such stations": _stations(2),
    "three such stations": _stations(3),
    "four such stations": _stations(4),
    "four such stations, two targets on the spindle": _stations(4, longer=True),
    "one station, known in the machine's own frame": _stations(1, known=True),
    "three stations, known in the machine's own frame": _stations(3, known=True),
    "step gauge along each linear axis": _lines(_axes),
    "four body diagonals (ISO 230-6)": _lines(_diagonals),
    "body and face diagonals": _lines(_with_faces),
    "calibrated distances between any two poses": _pairs(),
    "the same, offset unknown": _pairs(known=False),
    "ballbar circles in three planes, length calibrated": _circles(known=True),
    "the same, length unknown": _circles(known=False),
}


def _survey(chain: Chain, rows: pd.DataFrame, entries: dict[str, Observation], frame: Any, values: Any) -> Survey:
    """A survey with the readings of the machine without errors."""
    rows = rows.assign(
        mx=np.nan, my=np.nan, mz=np.nan, run="1", file="plan", role="fit", row=np.arange(1, len(rows) + 1)
    )
    read = readings_at(chain, rows, entries, Truth({}, set_ups=values), fixed=True)
    return Survey(rows.assign(**read), frame, (), Plain(), Path("plan"), observations=entries)


def _positions(chain: Chain) -> dict[str, Array]:
    """Directions of the scaled parameters that positions in an unknown frame show, by names in words."""
    poses = _poses(chain.machine, 0)
    seen = chain.kernel("nominal", outputs=(0, 1, 2))(chain.columns(poses))
    rows = poses.assign(mx=seen[0], my=seen[1], mz=seen[2], run="1", file="plan", role="fit", row=1)
    directions = _seen(chain, Survey(rows, "shared", (), Plain(), Path("plan")))
    # frames are taken out: groups of what is left, each named after its base parameter
    groups = find_groups(directions, chain.machine_ids, np.ones(directions.shape[1]), range(directions.shape[1]))
    out = {}
    for k in range(groups.rank):
        parameter = chain.parameters[chain.index[chain.machine_ids[groups.base[k]]]]
        name = f"{parameter.symbol} ({parameter.id})" if parameter.symbol else parameter.id
        row = groups.coefficients[k] * 1.0
        out[name] = row / np.linalg.norm(row)
    return out


def _rank(chain: Chain, survey: Survey, whole: dict[str, Array]) -> Rank:
    directions = _seen(chain, survey)
    unseen = [name for name, row in whole.items() if np.linalg.norm(row - directions.T @ (directions @ row)) > 1e-4]
    return Rank(len(directions), unseen)


def _seen(chain: Chain, survey: Survey) -> Array:
    """Orthonormal directions (rank, parameters) of the machine's scaled parameters that a survey shows.

    Parameters are scaled to what each does to positions over the full travels. What frames and set-ups imitate is taken
    out first.
    """
    problem = build(chain, survey)
    names, place = problem.unknowns, problem.place()
    own = [place[i] for i in chain.machine_ids]
    other = [k for k, n in enumerate(names) if is_unknown(n) or n in chain.frame_ids]
    rows = np.vstack([design_rows(v, place, len(v)) for v in problem.views])
    at = {i: k for k, i in enumerate(chain.machine_ids)}
    whole = PositionView(
        kind="position", chain=chain, ids=chain.machine_ids, columns=chain.machine_ids,
        rows=chain.columns(_poses(chain.machine, 0).assign(run="1")), whitener=np.ones(POSES), index=np.arange(POSES),
        measured=np.zeros((POSES, 3)),
    )  # fmt: skip
    left = rows[:, own] / full_norms(whole, at)
    if other:
        norms = np.linalg.norm(rows[:, other], axis=0)
        q, s, _ = np.linalg.svd(rows[:, other][:, norms > 0] / norms[norms > 0], full_matrices=False)
        q = q[:, s > SEEN * s.max()]
        left = left - q @ (q.T @ left)
    _, s, v = np.linalg.svd(left, full_matrices=False)
    return np.asarray(v[s > SEEN * s.max()])
