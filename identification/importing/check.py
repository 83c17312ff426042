"""All that can be said of a survey before it is fitted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from errormodel.approach import direction
from errormodel.chain import Chain
from errormodel.conventions import MOTIONS
from errormodel.machine import Joint, Machine
from errormodel.survey import Survey
from errormodel.surveys.columns import ORIENTATION, SIGMA_COLUMNS
from errormodel.surveys.observations import groups
from identification.diagnosis.data_checks.readings import (
    Lengths,
    length_lines,
    lengths_of,
    refuse_exchanged,
    refuse_exchanged_names,
)
from identification.diagnosis.data_checks.temperature_sensors import copies, faults, incomplete
from identification.estimation.checks import refuse_far_readings
from identification.estimation.fit import anchored, nominal_readings
from identification.importing.proof import Proof, prove
from identification.importing.text import proof_lines
from identification.observation.assembly import build
from identification.results.description import Description, describe

COVERED = 0.8  # of a travel: less is said; by judgement
LEVELS = 3  # positions of a joint that show a curvature
FEW_ROWS = 2.0  # rows a group: fewer leave little to judge a fit by; by judgement


@dataclass(frozen=True)
class Checked:
    """A survey that was looked at.

    Attributes
    ----------
    machine, survey : what was looked at.
    proof : how its points lie beside the commanded ones.
    description : which parameters its poses determine.
    lengths : how single lengths lie beside those of a machine without errors.
    """

    machine: Machine
    survey: Survey
    proof: Proof
    description: Description
    lengths: tuple[Lengths, ...] = ()


def check_survey(machine: Machine, survey: Survey) -> Checked:
    """Look at a survey as `fit` and `diagnose` would, without fitting.

    Raises
    ------
    InputError
        It holds a mistake: what is wrong, and what to write instead.
    """
    points = bool(np.isfinite(survey.fit.measured).any())
    proof = prove(machine, survey, False, points)
    chain = Chain(machine)
    lengths = lengths_of(chain, build(chain, survey).views) if "length" in survey.table else []
    refuse_exchanged_names(chain, survey, lengths)
    refuse_exchanged(survey, lengths)
    _refuse_far(chain, survey.fit)
    return Checked(machine, survey, proof, describe(machine, survey), tuple(lengths))


def _refuse_far(chain: Chain, survey: Survey) -> None:
    """InputError about readings that no machine gives, however it is set up, as after a fit."""
    if not any(groups(survey.table, survey.observations)):
        return
    problem, _ = anchored(build(chain, survey), len(survey))
    refuse_far_readings(chain, survey, nominal_readings(problem, len(survey), None))


def check_lines(checked: Checked) -> Iterator[str]:
    """What was found, in words."""
    survey, table = checked.survey, checked.survey.table
    files = dict.fromkeys(table["file"].astype(str))
    for file in files:
        part = table[table["file"] == file]
        held_out = ", held out as a test" if (part["role"] == "test").all() else ""
        yield f"{file}: {len(part)} rows{held_out}"
    yield from _measured(survey)
    if len(checked.proof.rows):
        yield f"measuring frame: {_frame(survey)}"
    yield ""
    for joint in checked.machine.joints:
        yield _joint(survey, joint, checked.machine)
    yield ""
    yield from _channels(survey)
    if len(checked.proof.rows):
        yield from proof_lines(checked.proof, survey)
    yield from length_lines(survey, checked.lengths)
    yield ""
    yield from _parameters(checked)


def _measured(survey: Survey) -> Iterator[str]:
    table = survey.table
    seen = np.isfinite(survey.measured)
    full, some = int(seen.all(axis=1).sum()), int((seen.any(axis=1) & ~seen.all(axis=1)).sum())
    if full:
        yield f"{full} rows with x, y and z"
    for axis, column in zip("xyz", seen.T, strict=True):
        if some and column.any():
            yield f"{int((column & ~seen.all(axis=1)).sum())} rows with {axis} but not all of x, y, z"
    if ORIENTATION[0] in table and table[ORIENTATION[0]].notna().any():
        yield f"{int(table[ORIENTATION[0]].notna().sum())} rows with an orientation"
    if "joint" in table:
        for joint, part in table[table["joint"] != ""].groupby("joint", sort=False):
            motions = [m for m in MOTIONS if m in part and part[m].notna().any()]
            yield f"{len(part)} rows of error motions of {joint} ({', '.join(motions)})"
    sigma = [c for c in SIGMA_COLUMNS if c in table and table[c].notna().any()]
    if sigma:
        yield f"standard uncertainties in the file: {1e3 * float(np.nanmedian(table[sigma])):.3g} um (median)"
    elif survey.instrument.stated:
        yield f"standard uncertainties from the instrument ({survey.instrument.type})"
    elif declared := [label for label, o in survey.observations.items() if o.sigma is not None]:
        yield f"standard uncertainties of {', '.join(declared)} as declared (sigma)"
    else:
        yield "no standard uncertainties: the noise will be estimated from the residuals"


def _frame(survey: Survey) -> str:
    words = {
        "shared": "one for all files, of unknown place", "per-run": "one a run", "per-file": "one a file",
        "fixed": "that of the machine",
    }  # fmt: skip
    return words[survey.frame]


def _joint(survey: Survey, joint: Joint, machine: Machine) -> str:
    q = survey.table[joint.name].to_numpy(dtype=np.float64)
    q = q[np.isfinite(q)]
    if not len(q):
        return f"{joint.name}: not commanded"
    scale, unit = (180 / np.pi, "deg") if joint.type == "rotary" else (1.0, "mm")
    low, high = float(q.min()), float(q.max())
    levels = len(np.unique(np.round(q, 6)))
    share = (high - low) / (joint.travel[1] - joint.travel[0])
    text = f"{joint.name}: {scale * low:g} to {scale * high:g} {unit} ({100 * share:.0f} % of its travel)"
    text += f", {levels} position{'s' * (levels > 1)}"
    remarks = []
    if levels == 1:
        return text + ": it stood still, so that nothing of its motions shows"
    if share < COVERED:
        remarks.append("the rest of the travel will be extrapolated")
    if levels < LEVELS:
        remarks.append("a curvature does not show")
    sides = direction(survey.table, joint.name)
    stated = f"dir_{joint.name}" in survey.table
    ways = len(np.unique(sides[np.isfinite(sides)]))
    remarks.append(
        f"arrived from {'both sides' if ways > 1 else 'one side only: backlash does not show'}"
        + ("" if stated else ", by the order of the rows")
    )
    return f"{text}; {'; '.join(remarks)}"


def _channels(survey: Survey) -> Iterator[str]:
    table = survey.table
    if "time" in table and table["time"].notna().any():
        hours = float(np.ptp(table["time"].dropna())) / 3600
        yield f"time: {hours:.3g} h" + ("" if hours > 0 else ", all at once: drift does not show")
    else:
        yield "no time: drift does not show"
    sensors = [str(c) for c in table if str(c).startswith("T_")]
    wrong = copies(table) | faults(table)
    for name in sensors:
        values = table[name].to_numpy(dtype=np.float64)
        seen = values[np.isfinite(values)]
        if len(seen):
            text = f"{name}: {seen.min():.2f} to {seen.max():.2f} degC"
            still = "" if np.ptp(seen) > 0 else ", constant: an expansion with it does not show"
            yield text + (f": {wrong[name]}; `diagnose` lets it drive nothing" if name in wrong else still)
    if not sensors:
        yield "no temperatures: what grows with them is seen as drift at best"
    others = [str(c) for c in table if str(c).startswith("w_") or c in ("feed", "load")]
    if others:
        yield f"other channels: {', '.join(others)}"
    for name, reason in incomplete(table).items():
        yield f"{name}: {reason}; `diagnose` lets it drive nothing"
    runs = table["run"].nunique()
    if runs > 1:
        yield f"{runs} runs"


def _parameters(checked: Checked) -> Iterator[str]:
    groups = checked.description.groups
    rows = 3 * len(checked.survey.fit)
    many = len(checked.description.chain.machine_ids)
    yield f"{many} parameters, of which these poses determine {groups.rank} groups"
    if rows < FEW_ROWS * groups.rank:
        yield f"{rows} readings for {groups.rank} groups: too few to judge a fit by"
    yield "`errormodel describe MACHINE SURVEY` lists the groups"
