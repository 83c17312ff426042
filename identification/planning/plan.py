"""Plan of a survey: optimal poses in order, predicted uncertainty, and power analysis of the effects.

Poses are exchanged by the largest predicted variance or D-optimality, then for distinguishable effects, then ordered.
Poses are in mm and rad; predicted standard uncertainties in um, k = 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.arrays import Index
from errormodel.chain import TOOL_CHANNELS, Chain
from errormodel.channels import POINT_CHANNELS
from errormodel.exceptions import InputError
from errormodel.instruments.base import Instrument
from errormodel.machine import Machine
from errormodel.simulation import measured_at, outward
from errormodel.surveys.columns import MEASURED
from errormodel.truth import Truth
from identification.diagnosis.linear.of_fit import MOST_ROWS, set_up
from identification.diagnosis.search.criteria import canonical_correlation
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit
from identification.observation.identifiability import Groups
from identification.planning.candidates import Stage, prepare
from identification.planning.design import Design, Space, exchange, rounded
from identification.planning.discrimination import Pair, told_apart
from identification.planning.poses import as_survey
from identification.planning.power import INDISTINGUISHABLE_CORRELATION, Verdict, classes, verdicts
from identification.planning.readings import with_noise
from identification.planning.run_order import arranged, revisits
from identification.planning.setup import Setup
from identification.planning.weights import optimal_weights
from identification.runtime.blas import one_blas_thread
from identification.runtime.progress import Progress, silent

if TYPE_CHECKING:
    import pandas as pd

RANDOM_DESIGNS = 20  # random designs with which the plan is compared
# Variance from which a direction counts as unobserved, in units in which all candidates together have information 1
UNOBSERVED_VARIANCE = 1e7
SECOND_TOOL_LENGTHENING = 0.4  # additional length of the suggested second tool over that of the first, by judgement
MOST_EFFECT_PAIRS = 12  # pairs of effects for which poses are exchanged: limits the time


@dataclass(frozen=True)
class Uncertainty:
    """Predicted standard uncertainty of the position in the volume, um, k = 1 (root sum of squares of components)."""

    worst_um: float
    median_um: float


@dataclass(frozen=True)
class Change:
    """A verdict on an effect that another way of measuring changes; `by` is that way."""

    by: str
    effect: str
    where: str
    before: str
    after: str


@dataclass(frozen=True)
class Plan:
    """Poses in order, their predicted uncertainty and detectable effects.

    Attributes
    ----------
    table : rows to measure, mm and rad.
    groups : identifiable groups, measuring frame included.
    uncertainty : with these rows; `random`: median of designs with as many random rows; `twice`: with twice as many.
    d_efficiency : D-efficiency relative to optimal weights; `d_random`: relative to random rows (above 1: better).
    found : verdicts on the library's effects; `changes`: verdicts changed by the plan's order, and by a second tool.
    blind : share of the volume where parameters act that no allowed pose identifies.
    repeated : number of rows at the end that repeat the first.
    """

    chain: Chain
    table: pd.DataFrame
    groups: Groups
    uncertainty: Uncertainty
    random: Uncertainty
    twice: Uncertainty
    d_efficiency: float
    d_random: float
    found: list[Verdict]
    changes: list[Change]
    blind: float
    repeated: int

    def as_json(self) -> dict[str, Any]:
        """The content of ``plan.json``: mm, rad, um."""
        return {
            "schema": "errormodel.plan/1",
            "machine": self.chain.machine.name,
            "n_points": len(self.table),
            "n_parameters": len(self.chain.machine_ids),
            "rank": self.groups.rank,
            "condition": self.groups.condition,
            "groups": self.groups.listed(),
            "no_effect": list(self.groups.no_effect),
            "uncertainty": _numbers(self.uncertainty),
            "random": {"same": _numbers(self.random), "twice": _numbers(self.twice)},
            "d_efficiency": self.d_efficiency,
            "d_efficiency_vs_random": self.d_random,
            "blind": self.blind,
            "repeated_rows": self.repeated,
            "effects": [_verdict(v) for v in self.found],
            "classes": classes(self.found),
            "changes": [vars(c) for c in self.changes],
        }


def _numbers(u: Uncertainty) -> dict[str, float]:
    """An uncertainty for JSON."""
    return {"worst_um": u.worst_um, "median_um": u.median_um}


def _verdict(v: Verdict) -> dict[str, Any]:
    """A verdict for JSON."""
    return {
        "effect": v.effect,
        "where": v.where,
        "motion": v.motion,
        "driver": list(v.drivers),
        "verdict": v.verdict,
        "smallest": v.smallest,
        "apart": v.apart,
        "possible": v.possible,
        "unit": v.unit,
        "absorbed": v.absorbed,
        "with": list(v.alike),
        "reason": v.reason,
        "needs": v.needs,
    }


def plan(
    machine: Machine,
    setup: Setup,
    count: int,
    noise: Instrument | float,
    seed: int = 0,
    *,
    worst: bool = True,
    progress: Progress = silent,
) -> Plan:
    """Plan `count` rows.

    Parameters
    ----------
    setup : reachable and visible poses, tools, instrument and time.
    noise : an instrument, or one standard uncertainty of all coordinates, mm.
    seed : of all random choices.
    worst : minimise the largest predicted uncertainty in the volume; else the determinant (D-optimal).
    progress : context manager entered around each stage, with its name.

    Raises
    ------
    InputError
        Too few rows for the machine's identifiable groups, or no pose is allowed.
    """
    with one_blas_thread():  # blocks are small: one thread is fastest
        return _plan(machine, setup, count, noise, seed, worst, progress)


def _plan(
    machine: Machine,
    setup: Setup,
    count: int,
    noise: Instrument | float,
    seed: int,
    worst: bool,
    progress: Progress,
) -> Plan:
    with progress("Choosing poses"):
        stage = prepare(machine, setup, noise, seed)
        space = stage.space
        chosen, ceiling = optimal(space, count, worst)
    with progress("Asking what they would show of physics"):
        walked = chosen[np.lexsort(stage.positions[chosen].T[::-1])]  # joint by joint, as in a usual program
        plain, _ = _verdicts(stage, stage.table.iloc[walked], seed)
    with progress("Telling effects apart"):
        repeat = revisits(count, space.rank, space.components)
        pairs = _pairs(stage, plain, seed)
        chosen = told_apart(space, without(space, chosen, repeat), pairs, INDISTINGUISHABLE_CORRELATION)
        rows = chosen[_arranged(stage, chosen, repeat, seed)]
        table = stage.table.iloc[rows].reset_index(drop=True)
        found, groups = _verdicts(stage, table, seed)
        changes = _changes("the order, repeats and poses of this plan", plain, found)
    if len(setup.points(machine)) == 1 and repeat:  # a second tool adds parameters: only where rows are plentiful
        with progress("Asking what a second tool would show"):
            more, how = _second_tool(table, machine)
            changes += _changes(how, found, _verdicts(stage, more, seed)[0])
    rng = np.random.default_rng([seed, 3])
    pool = stage.scattered or len(stage.table)
    chance = [rng.choice(pool, 2 * count, replace=2 * count > pool) for _ in range(RANDOM_DESIGNS)]
    information = -Design(space, rows).value
    by_chance = float(np.median([-Design(space, r[:count]).value for r in chance]))
    return Plan(
        stage.chain,
        table,
        groups,
        uncertainty_of(space, rows),
        _middle([uncertainty_of(space, r[:count]) for r in chance]),
        _middle([uncertainty_of(space, r) for r in chance]),
        float(np.exp((information - ceiling) / space.rank)) / count,
        float(np.exp((information - by_chance) / space.rank)),
        found,
        changes,
        stage.blind,
        repeat,
    )


def optimal(space: Space, count: int, worst: bool) -> tuple[Index, float]:
    """An optimal design of `count` poses, and an upper bound of ``log det`` of the information of weights with sum 1.

    Raises
    ------
    InputError
        No design of so few poses identifies all groups.
    """
    weights, ceiling = optimal_weights(space, worst)
    chosen = exchange(space, rounded(weights, count), worst=False)
    if not shows_all(space, chosen):
        more = range(max(count, space.rank // space.components) + 1, count + space.rank + 1)
        least = next((n for n in more if shows_all(space, exchange(space, rounded(weights, n), worst=False))), more[-1])
        found = f"no {count} poses show all {space.rank} identifiable groups, measuring frame included"
        raise InputError("--points", found, f"Plan at least {least}, better {2 * least}")
    return exchange(space, chosen, worst=True) if worst else chosen, ceiling


def shows_all(space: Space, chosen: Index) -> bool:
    """Whether a design has a degree of freedom left and identifies every combination of the groups."""
    left = space.components * len(chosen) > space.rank
    return left and bool(np.linalg.eigvalsh(space.covariance(chosen))[-1] < UNOBSERVED_VARIANCE)


def without(space: Space, chosen: Index, number: int) -> Index:
    """The design without the `number` poses whose removal loses least information."""
    for _ in range(number):
        chosen = np.delete(chosen, Design(space, chosen).least()[0])
    return chosen


def uncertainty_of(space: Space, chosen: Index) -> Uncertainty:
    """Predicted standard uncertainty in the volume with a design, um, k = 1."""
    u = 1e3 * np.sqrt(space.variances(space.covariance(chosen)))
    return Uncertainty(float(u.max()), float(np.median(u)))


def as_file(plan: Plan, setup: Setup) -> pd.DataFrame:
    """The rows of a points file: joints in mm and degrees, and the tool if the setup lists tools."""
    machine = plan.chain.machine
    table = outward(plan.table, machine).round(6)
    return table if setup.tools else table.drop(columns=list(TOOL_CHANNELS))


def _middle(several: list[Uncertainty]) -> Uncertainty:
    """Medians of several uncertainties."""
    return Uncertainty(*(float(np.median([getattr(u, n) for u in several])) for n in ("worst_um", "median_um")))


def _verdicts(stage: Stage, table: pd.DataFrame, seed: int) -> tuple[list[Verdict], Groups]:
    """Verdicts and groups of rows in this order, from a simulated survey with noise only."""
    fit = _noise_only(stage, table, seed)
    return verdicts(set_up(fit)), fit.solution.groups


def _noise_only(stage: Stage, table: pd.DataFrame, seed: int) -> Fit:
    """Fit of a simulated survey of the nominal machine with noise only."""
    machine = stage.chain.machine
    survey = as_survey(stage.chain, stage.setup, table.reset_index(drop=True), stage.noise)
    if survey.observations:
        return fit_machine(machine, with_noise(stage.chain, stage.setup, survey, stage.noise, seed))
    seen = measured_at(machine, survey.table, Truth({}), stage.noise, seed)
    names = list(MEASURED)
    return fit_machine(machine, replace(survey, table=survey.table.assign(**{n: seen[n] for n in names})))


def _arranged(stage: Stage, chosen: Index, repeat: int, seed: int) -> Index:
    """Run order of the chosen poses with the repeated ones."""
    chain, views = stage.chain, [v.part(chosen) for v in stage.views]
    parts = [v.whiten(slice(None), v.levers()) for v in views]
    arms = np.concatenate(parts, axis=1).transpose(0, 2, 1)  # (6 elements, n, c)
    places = {name: 6 * k for k, name in enumerate(chain.element_names)}
    levers = []
    for joint in chain.machine.joints:
        start = places[joint.name] + (3 if joint.type == "rotary" else 0)
        levers.append(np.tensordot(np.array(joint.axis), arms[start : start + 3], axes=1))
    return arranged(stage.space.X[chosen], stage.positions[chosen], np.array(levers), arms[:3], repeat, seed)


def _pairs(stage: Stage, found: list[Verdict], seed: int) -> list[Pair]:
    """Pairs of effects of different names that depend on position only and are not distinguishable; the worst first."""
    known = {j.name for j in stage.chain.machine.joints} | set(POINT_CHANNELS)
    open_ = []
    for shown in (v.typical for v in found if v.typical is not None and {*v.drivers} <= known):
        others = (e for v in found if v.typical is shown for e in v.rivals)
        rival = next((e for e in others if e.effect != shown.effect and {*e.drivers} <= known), None)
        if rival is not None:
            open_.append((shown, rival))
    if not open_:
        return []
    n, c = len(stage.table), stage.space.components
    linear = set_up(_noise_only(stage, stage.table, seed), MOST_ROWS * max(len(stage.views), 1))
    if linear.size != c * n:  # some component is not measured anywhere
        return []
    columns = [tuple(linear.columns(e)[0] for e in pair) for pair in open_]
    best = [canonical_correlation(linear, *pair) for pair in columns]  # with all candidate poses
    order = [k for k in np.argsort(best, kind="stable") if best[k] < INDISTINGUISHABLE_CORRELATION]
    return [Pair(*(own.reshape(-1, c, n).transpose(2, 1, 0) for own in columns[k])) for k in order[:MOST_EFFECT_PAIRS]]


def _second_tool(table: pd.DataFrame, machine: Machine) -> tuple[pd.DataFrame, str]:
    """The table with a longer tool in every other row, and a description for the user."""
    tool = np.array(machine.tool)
    length = float(np.linalg.norm(tool)) * SECOND_TOOL_LENGTHENING
    longer = tool * (1 + SECOND_TOOL_LENGTHENING) if length else np.array([0.0, 0.0, -100.0])
    table = table.copy()
    table.loc[table.index[::2], list(TOOL_CHANNELS)] = longer
    return table, f"a second tool, {length or 100.0:.0f} mm longer, in every other row"


def _changes(by: str, before: list[Verdict], after: list[Verdict]) -> list[Change]:
    """Verdicts that differ between two plans."""
    old = {v.key: v.verdict for v in before}
    return [
        Change(by, v.effect, v.where, old.get(v.key, "invisible"), v.verdict)
        for v in after
        if v.verdict != old.get(v.key, "invisible")
    ]
