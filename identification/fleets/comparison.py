"""Machines of one type beside one another: what is normal, which machine is out, what they have in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Index
from identification.fleets.collecting import Collected, Entry
from identification.fleets.common import Shown, common_effects, common_parameters, own_findings
from identification.fleets.estimates import reference
from identification.fleets.false_alarms import Selected, selected
from identification.fleets.partial_pooling import LEFT_OUT, Normal, PerMachine, Surveys, apart, normal, per_machine
from identification.monitoring.quantities import Watched

if TYPE_CHECKING:
    import pandas as pd

LEAST_SHARE = 0.5  # of a type's machines that show a quantity, for it to be compared
LEAST_SEEN = 2  # machines that show it
LEVEL, TREND, EFFECT = "level", "trend", "effect"  # kinds of tests


@dataclass(frozen=True)
class Quantity:
    """One quantity of one type, of n machines that show it.

    Attributes
    ----------
    what : the quantity; `kind`: the type of machine.
    machines : their numbers among the machines of the type.
    each : level and trend of each; `level`: what is normal of them.
    trend : the same of the changes a year; None where too few machines have two dates. `dated` : (n,) those that have.
    moves : mm (rms over a survey) that the tool moves by per unit; NaN where that is not known.
    surveys : how many there are of it.
    entries : (N,) numbers of these among the surveys of the type.
    far : (N,) p-value of so much distance from the machine's other surveys and from the type; 1 where it is unknown.
    """

    what: Watched
    machines: Index
    each: PerMachine
    level: Normal
    trend: Normal | None
    dated: Index
    moves: float
    surveys: int
    entries: Index
    far: Array


@dataclass(frozen=True)
class Type:
    """One type of machine: its machines by name, its quantities, and effects that its machines show."""

    name: str
    machines: tuple[str, ...]
    quantities: tuple[Quantity, ...]
    shown: tuple[Shown, ...]


@dataclass(frozen=True)
class Test:
    """One test of one machine.

    Attributes
    ----------
    machine : number of the machine among all of the fleet that have results.
    kind : level, trend or effect.
    size_um : what it does at the tool, um (rms over a survey); of a trend in a year.
    """

    __test__ = False  # keeps pytest from collecting the class

    machine: int
    kind: str
    p: float
    size_um: float
    quantity: Quantity | None = None
    number: int = -1  # of the machine in the quantity
    shown: Shown | None = None


@dataclass(frozen=True)
class Compared:
    """What the fleet tells.

    Attributes
    ----------
    machines : names of those with results; `types` : their types.
    tests, verdict : all tests, and which of them are found with the rate of false alarms that was asked for.
    common : DataFrame of what types have in common.
    """

    rate: float
    machines: tuple[str, ...]
    types: tuple[Type, ...]
    tests: tuple[Test, ...]
    verdict: Selected
    common: pd.DataFrame
    type_of: dict[str, str] = field(default_factory=dict)

    def found(self) -> dict[str, list[Test]]:
        """Of each machine that is out the tests that say so, those that do most at the tool first."""
        out: dict[str, list[Test]] = {
            m: [] for m, is_out in zip(self.machines, self.verdict.found, strict=True) if is_out
        }
        for test, counts in zip(self.tests, self.verdict.tests, strict=True):
            if counts:
                out[self.machines[test.machine]].append(test)
        for tests in out.values():
            tests.sort(key=lambda t: (-np.nan_to_num(t.size_um), t.p))
        return out


def compare(fleet: Collected, rate: float) -> Compared:
    """Compare the machines of each type.

    Parameters
    ----------
    rate : largest share of false ones among the machines that are out, at 95 % confidence; among what types have in
        common, largest expected one.
    """
    types = []
    for name, machines in fleet.types().items():
        entries = list(machines.values())
        types.append(Type(name, tuple(machines), quantities_of(entries), tuple(own_findings(entries))))
    return compared(types, rate, fleet.command != "iso")


def compared(types: Sequence[Type], rate: float, signed: bool = True) -> Compared:
    """The same of types whose machines have been estimated.

    Parameters
    ----------
    signed : whether quantities are about zero, so that a common value is an error that all machines have.
    """
    import pandas as pd

    effects = common_effects([(t.name, len(t.machines), t.shown) for t in types], rate)
    means = common_parameters([(t.name, [(q.what, q.level, q.moves) for q in t.quantities]) for t in types], rate)
    tables = [t for t in (effects, means if signed else means.iloc[:0]) if len(t)]
    common = pd.concat(tables, ignore_index=True) if tables else effects
    own = effects[effects["common"].astype(bool)]
    usual = {(str(t), str(e), str(w)) for t, e, w in zip(own["type"], own["name"], own["where"], strict=True)}
    machines: list[str] = []
    tests: list[Test] = []
    for t in types:
        start = len(machines)
        machines += t.machines
        tests += list(_tests(t, start, usual))
    p = np.array([t.p for t in tests], dtype=float)
    group = np.array([t.machine for t in tests], dtype=np.intp)
    verdict = selected(p, group, len(machines), rate)
    type_of = {m: t.name for t in types for m in t.machines}
    return Compared(rate, tuple(machines), tuple(types), tuple(tests), verdict, common, type_of)


def _tests(t: Type, start: int, usual: set[tuple[str, str, str]]) -> list[Test]:
    out = []
    for q in t.quantities:
        levels = _sizes(q, q.each.values - q.level.mean, q.each.values)
        out += [
            Test(start + int(m), LEVEL, float(q.level.p[k]), float(levels[k]), q, k) for k, m in enumerate(q.machines)
        ]
        if q.trend is not None:
            sizes = _sizes(q, q.each.trends[q.dated] - q.trend.mean, None)
            out += [
                Test(start + int(q.machines[n]), TREND, float(q.trend.p[k]), float(sizes[k]), q, int(n))
                for k, n in enumerate(q.dated)
            ]
    diagnosed = {s.machine for s in t.shown}
    for s in t.shown:
        if s.effect and s.shown and (t.name, s.effect, s.where) not in usual:
            out.append(Test(start + s.machine, EFFECT, s.p, s.size_um, shown=s))
    having = {test.machine for test in out if test.kind == EFFECT}
    # a machine in which a diagnosis found nothing of its own was tested all the same
    out += [Test(start + m, EFFECT, 1.0, 0.0) for m in sorted(diagnosed) if start + m not in having]
    return out


def _sizes(q: Quantity, away: Array, values: Array | None) -> Array:
    """What deviations do at the tool, um."""
    if q.what.is_log:
        if values is None or q.what.shown_unit != "µm":
            return np.full(len(away), np.nan)
        return np.array([abs(q.what.shown(v) - q.what.shown(q.level.mean)) for v in values])
    return 1e3 * np.abs(away) * q.moves


def quantities_of(machines: Sequence[Sequence[Entry]]) -> tuple[Quantity, ...]:
    """Quantities that most machines of a type show, with what is normal of each.

    Parameters
    ----------
    machines : surveys of each machine, all with results.
    """
    entries = [(k, e) for k, own in enumerate(machines) for e in own]
    each = [e.estimates for _, e in entries]
    what = reference(each)
    rows = [one.of(what) for one in each]
    values, variances, moves = (np.array([row[k] for row in rows]) for k in range(3))
    number = np.array([k for k, _ in entries], dtype=np.intp)
    date = np.array([e.row.date for _, e in entries])
    out = []
    for j, w in enumerate(what):
        seen = np.isfinite(values[:, j]) & np.isfinite(variances[:, j])
        shown = np.unique(number[seen])
        if len(shown) < max(LEAST_SEEN, LEAST_SHARE * len(machines)):
            continue
        own = np.searchsorted(shown, number[seen])
        known = moves[seen, j]
        lever = float(np.nanmedian(known)) if np.isfinite(known).any() else float("nan")
        surveys = Surveys(values[seen, j], variances[seen, j], own, date[seen])
        out.append(replace(quantity(w, shown, surveys, lever), entries=np.flatnonzero(seen)))
    return tuple(out)


def quantity(what: Watched, machines: Index, surveys: Surveys, moves: float) -> Quantity:
    """What is normal of one quantity of one type.

    Parameters
    ----------
    machines : (n,) numbers of the machines that `surveys` numbers from 0.
    """
    floor = 1e-12 * max(float(np.var(surveys.values)), 1e-300)  # a value without uncertainty has the weight of another
    surveys = Surveys(surveys.values, np.maximum(surveys.variances, floor), surveys.machine, surveys.date)
    first = per_machine(surveys)
    level, (trend, dated) = normal(first.values, first.variances), _trend(first)
    # scatter within machines is learned from those that neither changed nor scatter more than the others
    odd = first.p_scatter < LEFT_OUT / len(machines)
    if trend is not None:
        odd[dated[~trend.kept]] = True
    each = per_machine(surveys, odd)
    level, (trend, dated) = normal(each.values, each.variances), _trend(each)
    count = len(surveys.values)
    far = apart(surveys, each, level)
    return Quantity(what, machines, each, level, trend, dated, moves, count, np.arange(count), far)


def _trend(each: PerMachine) -> tuple[Normal | None, Index]:
    dated = np.flatnonzero(np.isfinite(each.trends))
    if len(dated) < LEAST_SEEN:
        return None, dated
    return normal(each.trends[dated], each.trend_variances[dated]), dated
