"""What a machine's model holds and what a set of poses could tell of it, before anything is measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.chain import TOOL_CHANNELS, Chain
from errormodel.machine import Machine
from identification.fit.least_squares import identifiable
from identification.groups import Groups
from identification.problem import build
from identification.views import PositionView, View

if TYPE_CHECKING:
    from errormodel.survey import Survey

POSES = 2000  # random poses: enough that chance does not hide a direction, few enough to answer at once


@dataclass(frozen=True)
class Description:
    """The identifiable groups of a machine.

    Attributes
    ----------
    groups : of the machine's own parameters, seen from a known measuring frame.
    reasons : why each parameter without effect has none.
    with_frame : the same when the measuring frame is unknown too, as the survey has it; None without a survey.
    split : groups of the machine with its one tool that the survey's poses and tools take apart.
    """

    chain: Chain
    groups: Groups
    reasons: dict[str, str]
    with_frame: Groups | None = None
    split: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """The JSON form of the contract, section 3."""
        out: dict[str, Any] = {
            "machine": self.chain.machine.name,
            "n_parameters": len(self.chain.machine_ids),
            "n_no_effect": len(self.groups.no_effect),
            "rank": self.groups.rank,
            "groups": [{"name": self.groups.name(k), "members": self.groups.members(k)} for k in range(self.groups.rank)],
            "no_effect": list(self.groups.no_effect),
            "no_effect_reasons": self.reasons,
            "condition": self.groups.condition,
        }
        if self.with_frame is not None:
            groups = self.with_frame
            out["split"] = list(self.split)
            out["with_frame"] = {
                "rank": groups.rank,
                "groups": [{"name": groups.name(k), "members": groups.members(k)} for k in range(groups.rank)],
                "no_effect": list(groups.no_effect),
                "condition": groups.condition,
            }
        return out


def random_rows(machine: Machine, count: int, seed: int = 0) -> list[np.ndarray[Any, np.dtype[np.float64]]]:
    """Channels of random poses, uniform over the travels, with the machine's one tool."""
    rng = np.random.default_rng(seed)
    joints = [rng.uniform(*j.travel, count) for j in machine.joints]
    return [*joints, *(np.full(count, value) for value in machine.tool)]


def describe(machine: Machine, survey: Survey | None = None) -> Description:
    """Parameters, rank and groups; without a survey for random poses over the travels and one tool."""
    chain = Chain(machine)
    ids = chain.machine_ids
    alone = identifiable(chain, [_random_view(chain)], ids)
    if survey is None:
        return Description(chain, alone, _reasons(chain, alone, None))
    problem = build(chain, survey)
    groups = identifiable(chain, problem.views, ids)
    names = {groups.name(k) for k in range(groups.rank)}
    split = tuple(alone.name(k) for k in range(alone.rank) if alone.name(k) not in names)
    return Description(
        chain, groups, _reasons(chain, groups, survey), identifiable(chain, problem.views, problem.unknowns), split
    )


def _random_view(chain: Chain) -> View:
    rows = random_rows(chain.machine, POSES)
    return PositionView(
        kind="position", chain=chain, ids=chain.machine_ids, columns=chain.machine_ids, rows=rows,
        whitener=np.ones(POSES), index=np.arange(POSES), measured=np.zeros((POSES, 3)),
    )  # fmt: skip


def _reasons(chain: Chain, groups: Groups, survey: Survey | None) -> dict[str, str]:
    out = {}
    for identity in groups.no_effect:
        parameter = chain.parameters[chain.index[identity]]
        still = survey is not None and parameter.element in survey.table and survey.table[parameter.element].nunique() < 2
        if still:
            out[identity] = f"{parameter.element} stands still in this survey"
        elif parameter.motion in ("ea", "eb", "ec"):
            out[identity] = "the functional point stays on the axis of this rotation: it has no lever"
        else:
            out[identity] = "nothing is measured in its direction"
    return out


def tools_of(survey: Survey) -> int:
    """How many different functional points a survey uses."""
    return len(survey.table[list(TOOL_CHANNELS)].drop_duplicates())
