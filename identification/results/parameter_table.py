"""Parameter table of a fit: groups with numbers, names, values and standard uncertainties in um and urad."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import floor, log10
from typing import Any, Literal

from errormodel.machine import Joint
from errormodel.surveys.observations import is_unknown
from identification.estimation.result import Fit
from identification.results.groups import PART_OF

DISPLAY_UNITS: dict[str, tuple[float, str]] = {
    "mm": (1e3, "µm"),
    "rad": (1e6, "µrad"),
    "1": (1e6, "µm/m"),
    "rad/mm": (1e9, "µrad/m"),
    "1/K": (1e6, "µm/m/K"),
    "1/(mm K)": (1e9, "µrad/m/K"),
    "s": (1e3, "ms"),
    "rad s/mm": (1e6, "µrad s/mm"),
}
ARCSEC_PER_URAD = 0.20626480624709636  # arcseconds per microradian


def printed(unit: str) -> tuple[float, str]:
    """Factor and name of the display unit of an internal unit, including units of effects such as mm/K."""
    head, slash, rest = unit.partition("/")
    if unit in DISPLAY_UNITS or not slash:
        return DISPLAY_UNITS.get(unit, (1.0, unit))
    factor, name = DISPLAY_UNITS[head] if head in ("mm", "rad") else (1e6, "1e-6") if head == "1" else (1.0, head)
    return factor, f"{name}/{rest}"


def chance(probability: float) -> str:
    """A probability to two decimals."""
    return "below 0.01" if probability < 0.005 else f"{probability:.2f}"


def decimals(std: float) -> int:
    """Decimals that show two digits of a standard uncertainty, at most four."""
    return min(max(0, 1 - floor(log10(std))), 4) if 0 < std < float("inf") else 3


Kind = Literal["member", "joint", "effect", "frame", "zero", "observation"]


@dataclass(frozen=True)
class Estimate:
    """One identifiable group.

    Attributes
    ----------
    number : from 1, in the order of the fit.
    id : base parameter of the group; `name` has an ellipsis if the group has further members.
    formula : the whole group; `symbol` : the ISO 230-1 name, if there is one; `meaning` : a location error in words.
    value, std : in `unit` (um, urad, um/m, urad/m); std is the standard uncertainty (k = 1).
    kind : structural member, joint, effect, measuring frame (or a target's mount), zero of an instrument, or unknown of
        a set-up.
    """

    number: int
    id: str
    name: str
    formula: str
    symbol: str
    meaning: str
    value: float
    std: float
    unit: str
    kind: Kind

    @property
    def significance(self) -> float:
        """Absolute value over standard uncertainty."""
        return abs(self.value) / self.std if self.std else float("inf")


def estimates(fit: Fit, groups: Sequence[Mapping[str, Any]]) -> list[Estimate]:
    """All groups of a fit (see `groups_of`), as they are printed."""
    joints = {e.name for e in fit.chain.machine.elements if isinstance(e, Joint)}
    members = {e.name for e in fit.chain.machine.elements} - joints
    of_effects = fit.chain.of_effects
    out = []
    for number, p in enumerate(groups, start=1):
        factor, unit = printed(p["unit"])
        kind: Kind = "zero" if p["id"].startswith("zero[") else "observation" if is_unknown(p["id"]) else "frame"
        if p["id"] in fit.chain.index:
            known = fit.chain.parameters[fit.chain.index[p["id"]]]
            kind = "joint" if known.element in joints else "member" if known.element in members else "frame"
            kind = "effect" if p["id"] in of_effects else kind
        more = " …" if len(p["members"]) > 1 else ""
        whole = p["meaning"] and not p["meaning"].startswith(PART_OF)
        symbol = p["symbol"] + more if p["symbol"] and not whole else p["symbol"]
        values = (factor * p["value"], factor * p["std"])
        out.append(Estimate(number, p["id"], p["id"] + more, p["group"], symbol, p["meaning"], *values, unit, kind))
    return out
