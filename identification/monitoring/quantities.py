"""What is watched of a machine: the groups that a fit has identified, and how a new cycle shows each of them.

A cycle has poses of its own, so its groups need not be those of the fit. Each watched group is a linear function of the
parameters; the cycle shows it where that function lies in the row space of the cycle's own groups, and only there.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array
from errormodel.conventions import MOTIONS, iso_symbol
from errormodel.exceptions import InputError
from identification.estimation.result import Fit
from identification.results.parameter_table import printed
from identification.results.stored_fit import StoredFit

NOISE = "noise"  # the watched scatter of what a cycle's fit leaves, as the logarithm of its standard deviation
SAME = 1e-4  # of a coefficient: two groups are the same one up to this
ZERO = re.compile(r"zero\[(?P<joint>.*), run (?P<run>[^\]]*)\]\.(?P<motion>\w+)")


@dataclass(frozen=True)
class Watched:
    """One quantity that is watched from cycle to cycle.

    Attributes
    ----------
    id : of the parameter that stands for the group, or `NOISE`; `group`: the whole group as a formula.
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
        if self.id == NOISE:
            return "the scatter about the model"
        return f"{self.symbol} ({self.id})" if self.symbol else self.id


@dataclass(frozen=True)
class Cycle:
    """The watched quantities as one cycle shows them: values (k,) and covariance (k, k), NaN where it does not."""

    values: Array
    covariance: Array

    @property
    def std(self) -> Array:
        return np.sqrt(np.diag(self.covariance))


def watched(stored: StoredFit) -> tuple[Watched, ...]:
    """The groups of a fit that are the machine's and its own sensors', and the scatter.

    What is, or shares, a measuring frame is left out: an instrument stands elsewhere in every cycle.

    Raises
    ------
    InputError
        Nothing is left.
    """
    entries = stored.data["parameters"]
    out = [
        Watched(p["id"], p["group"], p["symbol"] or _of_zero(p["id"]), p["unit"], dict(p["members"]))
        for p in entries
        if not any(str(member).startswith(("frame.", "frame[")) for member in p["members"])
    ]
    if not out:
        found = "every group that it identifies depends on where the instrument stood"
        raise InputError("fit.json", found, "Fit a survey in which the machine shows more than its frame")
    return (*out, Watched(NOISE, NOISE, "", _unit_of_noise(stored), {}))


def _unit_of_noise(stored: StoredFit) -> str:
    """``log mm`` or ``log rad`` where all levels are estimated in that unit; ``log`` of a ratio to what is declared."""
    levels = stored.data["noise"]
    units = {"rad" if kind in ("orientation", "angle") else "mm" for kind in levels}
    estimated = not any(level["declared"] for level in levels.values())
    return f"log {units.pop()}" if estimated and len(units) == 1 else "log"


def _of_zero(identity: str) -> str:
    """ISO name of what an instrument's zero is the constant of; "" of anything else."""
    zero = ZERO.fullmatch(identity)
    motion = next((m for m in MOTIONS if zero and m == zero["motion"]), None)
    return iso_symbol(zero["joint"], motion) if zero and motion else ""


def measured(what: tuple[Watched, ...], fit: Fit) -> Cycle:
    """The watched quantities in the fit of one cycle."""
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
        if (left <= SAME * size).all():
            transform[k] = shares
    values = np.append(transform @ s.values[s.groups.base], np.nan)
    covariance = np.full((len(what), len(what)), np.nan)
    covariance[:-1, :-1] = transform @ (s.covariance * fit.inflation**2) @ transform.T
    if s.dof > 0:  # of all kinds together, each in units of its own level: with one level, its logarithm
        levels = [math.log(value) for kind, value in s.sigma.items() if kind not in s.declared]
        excess = 0.5 * math.log(max(s.chi2 / s.dof, 1e-30)) if s.declared else 0.0
        values[-1] = excess + (sum(levels) / len(levels) if levels else 0.0)
        covariance[-1] = covariance[:, -1] = np.where(np.isfinite(values), 0.0, np.nan)
        covariance[-1, -1] = 0.5 / s.dof
    return Cycle(values, covariance)


def _by_run(names: Iterable[str]) -> dict[str, str]:
    """Names in which an instrument's zero goes by the order of the runs, whose labels differ from cycle to cycle."""
    runs: dict[str, dict[str, int]] = {}
    out = {}
    for name in names:
        found = ZERO.fullmatch(name)
        if found is None:
            out[name] = name
        else:
            order = runs.setdefault(found["joint"], {})
            number = order.setdefault(found["run"], len(order) + 1)
            out[name] = f"zero[{found['joint']}, run {number}].{found['motion']}"
    return out
