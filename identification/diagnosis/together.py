"""A survey of error motions only, diagnosed joint by joint and fitted as a whole."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from errormodel.chain import Chain
from errormodel.effects import registry
from errormodel.effects.base import axis_motion
from errormodel.machine import Machine
from errormodel.survey import Survey
from identification.diagnosis.decisions.constants import EVEN
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.linear.motions_as_points import Carried
from identification.diagnosis.results.diagnosed import Diagnosed
from identification.diagnosis.results.findings import Alternative, Diagnosis, Finding, Untestable
from identification.diagnosis.results.model_discrepancy import with_form
from identification.diagnosis.search.candidates import WIDEST
from identification.estimation.fit import fit_machine


def together(machine: Machine, survey: Survey, parts: Sequence[tuple[Carried, Diagnosed]]) -> Diagnosed:
    """What was found in each joint's displacements and rotations, and the whole survey fitted with it."""
    steps = [d.model.steps for _, d in parts]
    specs = [s.effect.spec for own in steps for s in own]
    before = fit_machine(machine, survey)
    final, first = before, len(machine.effects)
    if specs:
        final = fit_machine(replace(machine, effects=(*machine.effects, *specs)), survey, effect_sizes=WIDEST)
    for own, (_, d) in zip(steps, parts, strict=True):
        if own:
            final = with_form(final, d.model, first)
        first += len(own)
    known = [
        e for own, (_, d) in zip(steps, parts, strict=True) if own for e in d.final.chain.machine.effects[-len(own) :]
    ]
    if known != specs:  # where parts of them were recorded
        final = replace(final, chain=Chain(replace(machine, effects=(*machine.effects, *known))))
    parts = [(c, replace(d, diagnosis=replace(d.diagnosis, findings=_findings(c, d)))) for c, d in parts]
    findings = sorted((f for _, d in parts for f in d.diagnosis.findings), key=lambda f: -f.heldout_rms_um.before)
    left = [f"{c}: {d.diagnosis.unexplained}" for c, d in parts if d.diagnosis.unexplained]
    word = ("partly-explained" if findings else "unexplained") if left else "explained" if findings else "adequate"
    notes = [f"{c}: {n}" for c, d in parts for n in d.diagnosis.notes if n not in d.final.notes]
    diagnosis = Diagnosis(
        word,
        _mean([(d.diagnosis.noise_um, d.final.fitted.n) for _, d in _lengths(parts)]),
        _summary([(d.diagnosis.baseline, d.final.fitted.n) for _, d in _lengths(parts)]),
        _summary([(d.diagnosis.final, d.final.fitted.n) for _, d in _lengths(parts)]),
        tuple(findings),
        tuple(_untestable(parts)),
        "; ".join(left) or None,
        next((d.diagnosis.dependence for _, d in parts if d.diagnosis.dependence), None),
        (*final.notes, *dict.fromkeys(notes)),
        dof=sum(d.final.solution.dof for _, d in _lengths(parts)),
    )
    main = max((d for _, d in parts), key=lambda d: len(d.model.steps))
    log = DecisionLog()
    for c, d in parts:
        log.join(d.log, str(c))
    return Diagnosed(diagnosis, before, final, main.model, main.ranking, tuple(d for _, d in parts), log)


def _findings(part: Carried, diagnosed: Diagnosed) -> tuple[Finding, ...]:
    """The findings of a part; rotations act at a metre's distance there, for want of a tool."""
    place = "rms at a metre from the joint" if part.turning else "rms"
    found = (replace(f, statement=f.statement.replace("rms at the tip", place)) for f in diagnosed.diagnosis.findings)
    return tuple(_sampled(f, part, diagnosed) for f in found)


def _sampled(finding: Finding, part: Carried, diagnosed: Diagnosed) -> Finding:
    """A finding along the travel of a joint that was read at few targets: what repeats between them looks the same."""
    joint = part.machine.joints[0]
    along = joint.type == "prismatic" and axis_motion(joint) in finding.motion and finding.driver == [joint.name]
    for kind in registry().values() if along else ():
        why = kind.unresolved(diagnosed.model.start.scene, joint)
        if not why or finding.effect == kind.effect:
            continue
        probability = min(finding.probability, EVEN)
        diagnosed.log.compared(
            "unresolved-name",
            kind.effect,
            joint.name,
            joint.name,
            finding.probability,
            EVEN,
            f"{finding.effect}@{finding.where}",
        )
        other = Alternative(kind.effect, joint.name, 0.0, False, finding.motion, finding.driver)
        text = re.sub(r"Probability [\d.]+\d", f"Probability {probability:.2f}", finding.statement)
        finding = replace(
            finding,
            statement=f"{text} {why}",
            probability=probability,
            alternatives=[other, *(a for a in finding.alternatives if a.effect != kind.effect)],
            next_measurement=kind.separate,
        )
    return finding


def _lengths(parts: Sequence[tuple[Carried, Diagnosed]]) -> list[tuple[Carried, Diagnosed]]:
    """The parts that are displacements; rotations (um at a metre) where there are no others."""
    return [p for p in parts if not p[0].turning] or list(parts)


def _mean(values: Sequence[tuple[float, int]]) -> float:
    """Root mean square of values, each of so many rows."""
    return float(np.sqrt(sum(n * v**2 for v, n in values) / max(sum(n for _, n in values), 1)))


def _summary(parts: Sequence[tuple[dict[str, float | None], int]]) -> dict[str, float | None]:
    """Root mean squares over all rows of some parts."""
    out: dict[str, float | None] = {}
    for key in ("rms_um", "heldout_rms_um"):
        known = [(v, n) for summary, n in parts if (v := summary[key]) is not None and np.isfinite(v)]
        out[key] = _mean(known) if known else None
    known = [(v, n) for summary, n in parts if (v := summary["reduced_chi2"]) is not None]
    out["reduced_chi2"] = sum(v * n for v, n in known) / sum(n for _, n in known) if known else None
    return out


def _untestable(parts: Sequence[tuple[Carried, Diagnosed]]) -> list[Untestable]:
    """What no part could show; of several parts each says its own."""
    said: dict[Untestable, list[str]] = {}
    for c, d in parts:
        for u in d.diagnosis.untestable:
            said.setdefault(u, []).append(str(c))
    every = len(parts)
    return [u if len(at) == every else replace(u, reason=f"{', '.join(at)}: {u.reason}") for u, at in said.items()]
