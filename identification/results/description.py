"""Identifiability of a machine's model before measurement: rank and parameter groups, for random or given poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.chain import Chain
from errormodel.channels import root
from errormodel.machine import Machine
from errormodel.simulation import random_points
from errormodel.simulation_readings import with_nominal
from errormodel.surveys.columns import MEASURED
from identification.estimation.least_squares import identifiable
from identification.observation.assembly import build
from identification.observation.identifiability import Groups
from identification.observation.models import PositionView, View, fixed_tool
from identification.results.axis_lines import LocationAt, locations_of
from identification.uncertainty.measured_range import covered

if TYPE_CHECKING:
    import pandas as pd

    from errormodel.survey import Survey

# random poses: enough that no direction stays unobserved by chance, few enough to answer at once
RANDOM_POSES = 2000


@dataclass(frozen=True)
class Description:
    """Identifiable parameter groups of a machine.

    Attributes
    ----------
    groups : groups of the machine's own parameters, with a known measuring frame.
    reasons : reason for each parameter without effect.
    with_frame : groups when the measuring frame is unknown as well, as in the survey; None without a survey.
    split : groups of the machine with a single tool that the survey's poses and tools separate.
    locations : location errors of the axes, of lines through the middle of the travels, or of what the survey covers.
    """

    chain: Chain
    groups: Groups
    reasons: dict[str, str]
    with_frame: Groups | None = None
    split: tuple[str, ...] = ()
    locations: Sequence[LocationAt] = ()

    def summary(self) -> str:
        """What the command line prints of it."""
        from identification.results.text import description_lines

        return "\n".join(description_lines(self))

    def draw(self, path: str | Path) -> None:
        """Draw the chain from workpiece to tool into a file (.svg, .png or .pdf)."""
        from identification.plots import style
        from identification.plots.chain_drawing import draw_chain

        style.save(draw_chain(self.chain.machine), Path(path))

    def as_json(self) -> dict[str, Any]:
        """The JSON form (``docs/file_formats.md``, section 3)."""
        out: dict[str, Any] = {
            "machine": self.chain.machine.name,
            "n_parameters": len(self.chain.machine_ids),
            "n_no_effect": len(self.groups.no_effect),
            "rank": self.groups.rank,
            "groups": self.groups.listed(),
            "no_effect": list(self.groups.no_effect),
            "no_effect_reasons": self.reasons,
            "condition": self.groups.condition,
        }
        if self.with_frame is not None:
            groups = self.with_frame
            out["split"] = list(self.split)
            out["with_frame"] = {
                "rank": groups.rank,
                "groups": groups.listed(),
                "no_effect": list(groups.no_effect),
                "condition": groups.condition,
            }
        return out


def describe(machine: Machine, survey: Survey | None = None) -> Description:
    """Parameters, rank and groups; without a survey for random poses over the travels with one tool."""
    chain = Chain(machine)
    ids = chain.machine_ids
    alone = identifiable(chain, [_random_view(chain)], ids)
    if survey is None:
        locations = locations_of(chain, _random_table(chain), {})
        return Description(chain, alone, no_effect_reasons(chain, alone, None), locations=locations)
    survey = _as_if_measured(chain, survey)
    problem = build(chain, survey)
    groups = identifiable(chain, problem.views, ids)
    names = {groups.name(k) for k in range(groups.rank)}
    split = tuple(alone.name(k) for k in range(alone.rank) if alone.name(k) not in names)
    return Description(
        chain,
        groups,
        no_effect_reasons(chain, groups, survey),
        identifiable(chain, problem.views, problem.unknowns),
        split,
        locations_of(chain, survey.table, covered(chain, survey.table)),
    )


def _random_view(chain: Chain) -> View:
    rows = chain.columns(_random_table(chain))
    return PositionView(
        kind="position", chain=chain, ids=chain.machine_ids, columns=chain.machine_ids, rows=rows,
        whitener=np.ones(RANDOM_POSES), index=np.arange(RANDOM_POSES),
        fixed=fixed_tool(chain, rows), measured=np.zeros((RANDOM_POSES, 3)),
    )  # fmt: skip


def _random_table(chain: Chain) -> pd.DataFrame:
    """Random poses with one tool; other columns that effects depend on vary over usual ranges."""
    table = random_points(chain.machine, RANDOM_POSES)
    rng = np.random.default_rng(1)
    ranges = {"T_": (18.0, 24.0), "w_": (0.0, 1.0), "feed": (500.0, 5000.0), "load": (0.0, 500.0)}
    for word in dict.fromkeys(map(root, chain.channels)):
        for prefix, (low, high) in ranges.items():
            if word.startswith(prefix):
                table[word] = rng.uniform(low, high, RANDOM_POSES)
    return table.assign(time=60.0 * np.arange(RANDOM_POSES))  # s


def _as_if_measured(chain: Chain, survey: Survey) -> Survey:
    """Calibration rows of a survey; rows with commands only count as poses with all three coordinates measured."""
    rows = survey.fit if len(survey.fit) else survey
    if rows.observations:
        return replace(rows, table=with_nominal(chain, rows.table, rows.observations))
    if "joint" in rows.table or np.isfinite(rows.measured).any():
        return rows
    nominal = chain.kernel("nominal", outputs=(0, 1, 2))(chain.columns(rows.table))
    return replace(rows, table=rows.table.assign(**dict(zip(MEASURED, nominal, strict=True))))


def no_effect_reasons(chain: Chain, groups: Groups, survey: Survey | None) -> dict[str, str]:
    """Reason for each parameter without effect, in words."""
    out = {}
    for identity in groups.no_effect:
        parameter = chain.parameters[chain.index[identity]]
        still = (
            survey is not None and parameter.element in survey.table and survey.table[parameter.element].nunique() < 2
        )
        if still:
            out[identity] = f"{parameter.element} stands still in this survey"
        elif parameter.motion in ("ea", "eb", "ec"):
            out[identity] = "the functional point stays on the axis of this rotation: it has no lever"
        else:
            out[identity] = "nothing is measured in its direction"
    return out
