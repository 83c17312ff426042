"""Findings of a diagnosis that its tables do not hold, and columns of the survey that were taken with a change.

An instrument's errors move nothing of the machine, and no table follows time, temperature, feed or load. A column that
was mended changes the machine itself: a mirrored measuring frame reads as an axis that was commanded with the wrong
sign, and tables of the wrong one of the two double errors in place of removing them.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from errormodel.channels import root
from errormodel.effects.axis_blunder import AxisBlunder, mended_words
from errormodel.exceptions import InputError
from errormodel.inputs import noted
from identification.compensation.conditions import held_at
from identification.compensation.field import Field
from identification.results.stored_fit import CURE
from identification.results.versions import read_json, reason_of


@dataclass(frozen=True)
class Outside:
    """What no table holds: its probability (None: declared), rms size at the tip (um), and why not."""

    effect: str
    where: str
    probability: float | None
    size_um: float
    why: str

    def line(self) -> str:
        chance = "" if self.probability is None else f", {_likely(self.probability)}"
        return f"{self.effect} of {self.where}{chance}, {self.size_um:.1f} um rms at the tip: {self.why}"


def _likely(probability: float) -> str:
    return f"{probability:.2f} likely" if probability < 0.995 else "more than 0.99 likely"


@dataclass(frozen=True)
class Found:
    """A finding as ``diagnosis.json`` has it; `ids`: its parameters."""

    effect: str
    where: str
    probability: float
    size_um: float
    driver: tuple[str, ...]
    ids: tuple[str, ...]


def findings_of(folder: Path) -> list[Found]:
    """Findings of the diagnosis in a folder; none where it is that of another command."""
    from identification.diagnosis.results.findings import SCHEMA
    from identification.results.explanation import DIAGNOSIS

    path = folder / DIAGNOSIS
    if not path.is_file():
        return []
    try:
        return [
            Found(
                str(f["effect"]),
                str(f["where"]),
                float(f["probability"]),
                float(f["size_um"]),
                tuple(map(str, f["driver"])),
                tuple(str(p["name"]) for p in f["parameters"]),
            )
            for f in read_json(noted(path), SCHEMA, CURE)["findings"]
        ]
    except (OSError, ValueError, KeyError, TypeError) as error:
        found = f"its findings cannot be read ({reason_of(error)})"
        raise InputError(str(path), found, CURE) from error


def outside(findings: Collection[Found], field: Field, loose: Collection[str]) -> list[Outside]:
    """Findings that no table holds, in their order; `loose`: channels that no table follows."""
    chain = field.chain
    beside = {*chain.frame_ids, *chain.tool_ids, *chain.instrument_ids}
    out = []
    for f in findings:
        driven = [c for c in map(root, f.driver) if c in loose]
        if f.ids and beside.issuperset(f.ids):
            why = "it acts in the instrument or its target; if it is the machine's, this is left"
        elif f.ids and driven:
            names = list(dict.fromkeys(driven))
            at = " and ".join(held_at(field, name) for name in names if name in field.state)
            alone = f"; they are for {at} alone" if at else ""
            why = f"it changes with {' and '.join(names)}, which no table follows{alone}"
        else:
            continue
        out.append(Outside(f.effect, f.where, f.probability, f.size_um, why))
    return out


def changed_columns(findings: Collection[Found], field: Field) -> tuple[list[str], bool]:
    """Columns of the survey that were taken with a change, in words, and whether the diagnosis alone says so."""
    words = mended_words(field.chain.machine)
    return words, bool(words) and any(f.effect == AxisBlunder.effect for f in findings)


def column_line(words: Collection[str]) -> str:
    """What to confirm before tables of a survey with changed columns are right."""
    return (
        f"the survey was taken with a change: {'; '.join(words)}. The tables are right only if that is so: a mirrored "
        "measuring frame reads as a commanded axis with the wrong sign, and then they double the squareness. Move "
        "the axis by hand and compare; then mend the table and fit again"
    )
