"""Monitored quantities: the identified parameter groups of a fit, and their values in the fit of a new cycle.

A cycle has poses of its own, so its groups may differ from those of the fit. Each monitored group is a linear function
of the parameters; a cycle determines it if that function lies in the row space of the cycle's groups. Units mm, rad.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from errormodel.arrays import Array
from errormodel.conventions import MOTIONS, iso_symbol
from errormodel.exceptions import InputError
from identification.estimation.result import Fit
from identification.results.parameter_table import printed
from identification.results.stored_fit import StoredFit

NOISE_ID = "noise"  # id of the residual scatter of a cycle's fit, as the natural logarithm of its standard deviation
SAME_GROUP_SHARE = 1e-4  # relative difference of coefficients up to which two groups are the same; far above rounding
# parameter id of an instrument's zero
ZERO_ID = re.compile(r"zero\[(?P<joint>.*), run (?P<run>[^\]]*)\]\.(?P<motion>\w+)")


@dataclass(frozen=True)
class Watched:
    """One monitored quantity.

    Attributes
    ----------
    id : of the parameter that stands for the group, or `NOISE_ID`; `group`: the whole group as a formula.
    symbol : ISO 230-1 name, or "".
    unit : internal (mm, rad, 1, rad/mm ...); of the noise "log", followed by its unit if all of it has one.
    members : coefficients of the group's parameters.
    """

    id: str
    group: str
    symbol: str
    unit: str
    members: Mapping[str, float]

    def shown(self, value: float) -> float:
        """A value as people read it, in `shown_unit`."""
        if self.is_log:
            return printed(self._plain)[0] * math.exp(value) if value < 700 else math.inf
        return printed(self.unit)[0] * value

    @property
    def is_log(self) -> bool:
        """Whether values are logarithms."""
        return self.unit.startswith("log")

    @property
    def _plain(self) -> str:
        return self.unit.removeprefix("log").strip()

    @property
    def shown_unit(self) -> str:
        return printed(self._plain)[1] if self.is_log else printed(self.unit)[1]

    @property
    def name(self) -> str:
        """For sentences: the ISO name with the id, or the id."""
        if self.id == NOISE_ID:
            return "the scatter about the model"
        return f"{self.symbol} ({self.id})" if self.symbol else self.id


@dataclass(frozen=True)
class Cycle:
    """Monitored quantities of one cycle: values (k,) and covariance (k, k), NaN where they are not identifiable."""

    values: Array
    covariance: Array

    @property
    def std(self) -> Array:
        return np.sqrt(np.diag(self.covariance))


def watched(stored: StoredFit) -> tuple[Watched, ...]:
    """Groups of a fit that belong to the machine and its own sensors, location errors, and the residual scatter.

    Groups that contain a measuring frame are left out, since an instrument is set up anew in every cycle. Of these, the
    location errors are left that do not depend on it, such as a squareness that is a difference of two groups.

    Raises
    ------
    InputError
        No group remains.
    """
    entries = stored.data["parameters"]
    out = [
        Watched(p["id"], p["group"], p["symbol"] or _of_zero(p["id"]), p["unit"], dict(p["members"]))
        for p in entries
        if not any(str(member).startswith(("frame.", "frame[")) for member in p["members"])
    ]
    out += _beside(out, stored.data.get("location_errors", []))
    if not out:
        found = "every group that it identifies depends on where the instrument stood"
        raise InputError("fit.json", found, "Fit a survey in which the machine shows more than its frame")
    return (*out, Watched(NOISE_ID, NOISE_ID, "", _unit_of_noise(stored), {}))


def _beside(groups: Sequence[Watched], errors: Sequence[Mapping[str, Any]]) -> Iterator[Watched]:
    """The location errors that are no combination of the monitored groups, nor of those before them."""
    every = [*(w.members for w in groups), *(e["members"] for e in errors)]
    names = list(dict.fromkeys(name for members in every for name in members))

    def row(members: Mapping[str, float]) -> Array:
        values = np.array([members.get(name, 0.0) for name in names])
        return np.asarray(values / np.linalg.norm(values))

    known = [row(w.members) for w in groups]
    for e in errors:
        own = row(e["members"])
        span = np.array(known).reshape(-1, len(names)).T
        left = own - span @ np.linalg.lstsq(span, own, rcond=None)[0]
        if np.linalg.norm(left) > SAME_GROUP_SHARE:
            known.append(own)
            formula = " + ".join(f"{c:.6g} {name}" for name, c in e["members"].items()).replace("+ -", "- ")
            words = e["words"] if e.get("at") else f"{e['words']}, by the constants of shapes"  # of older versions
            yield Watched(e["symbol"], formula, words, e["unit"], dict(e["members"]))


def _unit_of_noise(stored: StoredFit) -> str:
    """``log mm`` or ``log rad`` where all noise levels are estimated in that unit, else ``log`` of a ratio."""
    levels = stored.data["noise"]
    units = {"rad" if kind in ("orientation", "angle") else "mm" for kind in levels}
    estimated = not any(level["declared"] for level in levels.values())
    return f"log {units.pop()}" if estimated and len(units) == 1 else "log"


def _of_zero(identity: str) -> str:
    """ISO name of the error motion whose constant is an instrument's zero; "" of anything else."""
    zero = ZERO_ID.fullmatch(identity)
    motion = next((m for m in MOTIONS if zero and m == zero["motion"]), None)
    return iso_symbol(zero["joint"], motion) if zero and motion else ""


def measured(what: tuple[Watched, ...], fit: Fit) -> Cycle:
    """Values and covariance of the monitored quantities in the fit of one cycle."""
    s = fit.solution
    own = _by_run(s.groups.ids)
    place = {own[name]: k for k, name in enumerate(s.groups.ids)}
    names = _by_run(member for w in what for member in w.members)
    transform = np.full((len(what) - 1, s.groups.rank), np.nan)
    for k, w in enumerate(what[:-1]):
        wanted = np.zeros(len(s.groups.ids))
        members = {names[member]: c for member, c in w.members.items()}
        if not members.keys() <= place.keys():
            continue
        for member, coefficient in members.items():
            wanted[place[member]] = coefficient
        shares = wanted[s.groups.base]
        left = np.abs(wanted - shares @ s.groups.coefficients)
        size = np.maximum(np.abs(wanted), np.abs(shares) @ np.abs(s.groups.coefficients))
        if (left <= SAME_GROUP_SHARE * size).all():
            transform[k] = shares
    values = np.append(transform @ s.values[s.groups.base], np.nan)
    covariance = np.full((len(what), len(what)), np.nan)
    covariance[:-1, :-1] = transform @ (s.covariance * fit.inflation**2) @ transform.T
    if s.dof > 0:  # all kinds of rows together, each in units of its noise level; with one level, its logarithm
        levels = [math.log(value) for kind, value in s.sigma.items() if kind not in s.declared]
        excess = 0.5 * math.log(max(s.chi2 / s.dof, 1e-30)) if s.declared else 0.0
        values[-1] = excess + (sum(levels) / len(levels) if levels else 0.0)
        covariance[-1] = covariance[:, -1] = np.where(np.isfinite(values), 0.0, np.nan)
        covariance[-1, -1] = 0.5 / s.dof
    return Cycle(values, covariance)


def _by_run(names: Iterable[str]) -> dict[str, str]:
    """Names with runs numbered in order, since labels of runs differ from cycle to cycle."""
    runs: dict[str, dict[str, int]] = {}
    out = {}
    for name in names:
        found = ZERO_ID.fullmatch(name)
        if found is None:
            out[name] = name
        else:
            order = runs.setdefault(found["joint"], {})
            number = order.setdefault(found["run"], len(order) + 1)
            out[name] = f"zero[{found['joint']}, run {number}].{found['motion']}"
    return out
