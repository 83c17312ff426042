"""Diagnosis as a section of the report: verdict in words, findings with figures and tables."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from math import log10

import numpy as np

from errormodel.conventions import unit_of
from identification.diagnosis.linear.row_residuals import noise_mm, vectors
from identification.diagnosis.results.diagnosed import Diagnosed, numbered
from identification.diagnosis.results.driver_words import time_unit
from identification.diagnosis.results.effect_size import Amount
from identification.diagnosis.results.findings import Alternative, Finding, Untestable
from identification.diagnosis.results.headline import headline
from identification.diagnosis.search.scoring import Step
from identification.plots.effect_curve import DRAWN_PERIODS, draw_effect_curve
from identification.plots.residuals_along_driver import MOST_DRIVER_DOTS, draw_residuals_along_driver
from identification.plots.where_map import draw_where_map
from identification.report.pictures import Picture, picture
from identification.report.tables import number
from identification.report.wording import short, three
from identification.results.parameter_table import chance, decimals, printed
from identification.results.residual_projection import Evidence, evidence_of

MOST_PARAMETERS = 8  # parameters in the table of a finding
LARGEST_ODDS = "over 1000 times"  # text of larger ratios of probabilities
# probability of a name, from which the report calls it certain, or likely; by judgement
SURE_PROBABILITY, LIKELY_PROBABILITY = 0.9, 0.7


def _signs(text: str) -> str:
    text = text.replace(" +- ", " ± ")
    return re.sub(r"(?<![\w.-])-(?=\d)", "−", re.sub(r"\bu(?=m\b|rad\b)", "µ", text))


@dataclass(frozen=True)
class FindingPart:
    """A finding as displayed: cells of its tables, in words and with units."""

    number: int
    finding: Finding
    facts: list[tuple[str, str]]
    parameters: list[list[str]]
    alternatives: list[list[str]]
    moved: list[list[str]]
    pictures: list[Picture]

    @property
    def title(self) -> str:
        word = "An effect without a name" if self.finding.nameless else self.finding.effect.capitalize()
        return f"{self.number}. {word} at {self.finding.where}"

    @property
    def statement(self) -> str:
        """Sentence of the finding with typographic signs that a terminal may lack."""
        return _signs(self.finding.statement)

    @property
    def summary(self) -> list[str]:
        """Cells of the table of findings."""
        held = self.finding.heldout_rms_um
        drivers = ", ".join(_channel(d) for d in self.finding.driver)
        return [drivers or "–", _probability(self.finding), three(held.before), three(held.after)]


@dataclass(frozen=True)
class DiagnosisPart:
    """Content of the section."""

    headline: str
    heldout: str
    notes: tuple[str, ...]
    findings: list[FindingPart]
    where: list[Picture]
    untestable: Sequence[Untestable]


def diagnosis_part(diagnosed: Diagnosed) -> DiagnosisPart:
    """Words, tables and figures of a diagnosis; without findings there are no figures."""
    diagnosis = diagnosed.diagnosis
    parts = diagnosed.parts or (diagnosed,)
    groups = numbered(diagnosed)
    findings = []
    for n, f in enumerate(diagnosis.findings, start=1):
        part = next((p for p in parts if any(f is own for own in p.diagnosis.findings)), parts[0])
        findings.append(_part(part, n, f, groups.get(n)))
    doubtful = [str(n) for n in groups if diagnosis.findings[n - 1].probability < LIKELY_PROBABILITY]
    named = (f"the name of finding {' and '.join(doubtful)} is not sure, see its other explanations",)
    left = (f"left over: {diagnosis.unexplained}",) if diagnosis.unexplained else ()
    return DiagnosisPart(
        _signs(headline(diagnosis)),
        _heldout(diagnosed),
        (*(n for n in diagnosis.notes if n not in diagnosed.final.notes), *(named if doubtful else ()), *left),
        findings,
        [_where(p, own) for p in parts if (own := {n: g for n, g in groups.items() if g[0] in p.model.steps})],
        diagnosis.untestable,
    )


def _count(count: int) -> str:
    words = ("no", "one", "two", "three", "four", "five", "six")
    return words[count] if count < len(words) else str(count)


def _heldout(diagnosed: Diagnosed) -> str:
    diagnosis = diagnosed.diagnosis
    seen = np.isfinite(np.vstack([vectors(p.final) for p in diagnosed.parts or (diagnosed,)]))
    rows = max(int(seen.any(axis=1).sum()), 1)
    noise = diagnosis.noise_um * float(np.sqrt(seen.sum() / rows))
    before, after = (s["heldout_rms_um"] for s in (diagnosis.baseline, diagnosis.final))
    text = f"{short(_value(after))} µm rms; where they were fitted {short(noise)} µm are left"
    if diagnosis.findings and before != after:  # a corrected table was used by the first fit already
        text = f"{short(_value(before))} µm rms without the findings, {text.replace(' µm rms', ' µm rms with them', 1)}"
    return f"Rows that were left out of the fit are predicted to {text}."


def _value(value: float | None) -> float:
    return float("nan") if value is None else value


def _part(diagnosed: Diagnosed, count: int, finding: Finding, group: Sequence[Step] | None) -> FindingPart:
    evidence = evidence_of(diagnosed.model, group) if group else None
    facts = [("Name", sure(finding))] if group else []
    if finding.motion:
        facts.append(("Motion", ", ".join(finding.motion)))
    turning = {j.name for j in diagnosed.final.chain.machine.joints if j.type == "rotary"}
    for driver, period in zip(finding.driver, finding.periods, strict=False):
        unit = "°" if driver.removeprefix("dir_") in turning else " s" if driver == "time" else " mm"
        along = f" of {driver}" if len(finding.periods) > 1 else ""
        facts.append(("Period", f"{period:.4g}{unit}{along}"))
    facts += [("Time constant", _time(amount)) for amount in finding.time_constants]
    if finding.size_um:
        facts.append(("Size at the tip", f"{three(finding.size_um)} µm rms over the survey's rows"))
    if group:
        facts.append(("Hidden by the geometry", f"{100 * finding.absorbed:.0f} % of it"))
    if more := sum(s.effect.empirical or s.effect.effect != group[0].effect.effect for s in group[1:]) if group else 0:
        facts.append(("Form", f"refined by {_count(more)} further term{'s' * (more > 1)}"))
    if finding.positive:
        facts.append(("A positive parameter means", finding.positive))
    facts.append(("Next measurement", finding.next_measurement))
    return FindingPart(
        count,
        finding,
        facts,
        _amounts(finding) if group else [],
        [[_other(a), *odds(a)] for a in finding.alternatives],
        [_amount(n, v, None, _unit(diagnosed, n)) for n, v in finding.moved.items()],
        _pictures(diagnosed, count, evidence) if evidence else [],
    )


def _other(other: Alternative) -> str:
    """Another explanation by name and place; of an empirical term, the motion and the channel it varies with."""
    text = f"{other.effect} at {other.where}"
    return f"{text}: {', '.join(other.motion)} by {', '.join(map(_channel, other.driver))}" if other.motion else text


def _channel(name: str) -> str:
    return f"side from which {name[4:]} arrives" if name.startswith("dir_") else name


def _probability(finding: Finding) -> str:
    return f"{finding.probability:.2f}" if finding.probability < 0.995 else "over 0.99"


def sure(finding: Finding) -> str:
    """How far to trust the name."""
    if finding.nameless:
        return "none: no effect of the library fits; it is modelled by its form alone"
    p = finding.probability
    word = (
        "sure"
        if p >= SURE_PROBABILITY
        else "likely"
        if p >= LIKELY_PROBABILITY
        else "one of several that fit about as well, see below"
    )
    return f"{finding.effect}: {word} (probability {_probability(finding)})"


def odds(other: Alternative) -> list[str]:
    """Alternative explanation: probability, evidence of these data alone, and whether it is distinguishable."""
    power = other.log10_bayes_factor
    times = 10 ** min(abs(power), 3.0)
    if abs(power) < log10(1.5):
        text = "fits about as well"
    elif abs(power) >= 3:
        text = f"by far less likely ({LARGEST_ODDS})" if power < 0 else f"by far likelier ({LARGEST_ODDS})"
    else:
        text = f"{times:.2g} times {'less likely' if power < 0 else 'likelier'}"
    own = other.probability
    share = "same effect" if own is None else chance(own)
    why = f"; not chosen: {other.reason}" if other.reason else ""
    return [share, text + why, "distinguishable" if other.separable else "not distinguishable by this data"]


def _time(amount: Amount) -> str:
    """A time constant with its standard uncertainty, in the unit that one says it in."""
    size, unit = time_unit(amount.value)
    places = decimals(amount.std / size)
    return f"{number(amount.value / size, places)} ± {number(amount.std / size, places)} {unit}"


def _amounts(finding: Finding) -> list[list[str]]:
    sense = f" (positive: {finding.positive})" if finding.positive else ""
    rows = [_amount(a.name + sense, a.value, a.std, a.unit) for a in finding.parameters[:MOST_PARAMETERS]]
    more = len(finding.parameters) - len(rows)
    return [*rows, [f"and {more} more in parameters.csv", "", ""]] if more else rows


def _amount(name: str, value: float, std: float | None, unit: str) -> list[str]:
    factor, word = printed(unit)
    places = decimals(factor * std) if std else max(0, 2 - int(np.floor(log10(abs(factor * value) or 1.0))))
    spread = f" ± {number(factor * std, places)}" if std else ""
    return [name, number(factor * value, min(places, 6)) + spread, word]


def _unit(diagnosed: Diagnosed, name: str) -> str:
    units = {p.id: p.unit for p in diagnosed.model.start.chain.parameters}
    units |= {name: unit for view in diagnosed.final.problem.readings for name, unit in view.units.items()}
    motion = name.rsplit(".", 1)[-1]
    return units.get(name) or (unit_of(motion) if motion in ("dx", "dy", "dz", "ea", "eb", "ec") else "1")


def _where(diagnosed: Diagnosed, groups: dict[int, Sequence[Step]]) -> Picture:
    return picture(
        partial(draw_where_map, diagnosed.model, diagnosed.ranking, list(groups.items())),
        "Where: each cell is a motion of an element (row) that goes with a channel (column; side: from which side the "
        "joint arrived). Figures and colour are the share, in per cent, of the error beyond noise that the best single "
        "effect there would explain before anything is accepted; empty cells explain nothing, rows and columns below "
        "10 % are left out. Look-alikes are dark at the same time; framed is what was accepted.",
        "Heat map of how much of the error beyond noise each motion of each element explains with each channel; "
        "the findings are framed",
    )


def _pictures(diagnosed: Diagnosed, count: int, evidence: Evidence) -> list[Picture]:
    final, driver = diagnosed.final, evidence.abscissa.label.split(" / ")[0]
    name = f"finding {count}, {evidence.effect.effect} at {evidence.effect.where}"
    split = f", by {_by(evidence)}" if evidence.split else ""
    periods = " The motion counts from its mean." if evidence.from_mean else ""
    if sense := evidence.effect.positive(final.chain.machine):
        periods += f" A positive parameter means: {sense}."
    if evidence.abscissa.period:
        span = np.ptp(evidence.channel(evidence.abscissa.name)) / evidence.abscissa.period
        periods += f" {_count(DRAWN_PERIODS).capitalize()} of the {span:.0f} periods in the recorded range are drawn."
    rest = (
        " Temperatures are as recorded, and the motion counts from the first row."
        if evidence.abscissa.name == "time"
        else ""
    )
    return [
        picture(
            partial(draw_residuals_along_driver, evidence, noise_mm(final)),
            f"Residuals in the direction in which {evidence.symbol} moves the tip, against {driver}{split}: on the "
            "left of a fit of everything but this finding (the geometry has taken what it can of it), on the right "
            f"with it. Dots are rows, at most {MOST_DRIVER_DOTS}; marks are means of bins with their "
            "standard error; grey is ± 2 standard deviations of the noise.",
            f"Residuals against {driver} without and with {name}",
        ),
        picture(
            partial(draw_effect_curve, evidence, diagnosed.model, final),
            f"What the finding adds to the machine's motions over the recorded range of {driver.split(' within')[0]}"
            f"{split}, with bands of ± 2 standard uncertainties. All else stands at its median.{rest}{periods}",
            f"Curves of the motions of {name}, against {driver}, with their uncertainty",
        ),
    ]


def _by(evidence: Evidence) -> str:
    assert evidence.split is not None
    name = evidence.split.name
    return f"the side from which {name[4:]} arrived" if name.startswith("dir_") else f"levels of {name}"
