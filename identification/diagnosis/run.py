"""The diagnosis from gate 0 to the extended machine, refitted in exact kinematics."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import Array, Mask
from errormodel.chain import Chain
from errormodel.effects.base import Effect
from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec, Machine
from errormodel.survey import Survey
from identification.diagnosis.candidates import Candidates
from identification.diagnosis.findings import (
    Amount,
    Diagnosis,
    Finding,
    HeldOut,
    alternatives_of,
    motions_of,
    moved_by,
    p_value_of,
    probability_of,
    statement_of,
)
from identification.diagnosis.outliers import gross_rows
from identification.diagnosis.sanity import Blunder, find_blunder, without
from identification.diagnosis.selection import Growth, Step, grow, heldout_rms
from identification.diagnosis.unseen import unseen
from identification.diagnosis.workbench import set_up
from identification.fit.result import Fit
from identification.fit.run import fit_machine
from identification.store import parameters
from identification.sums import design_rows
from identification.views import PositionView


@dataclass(frozen=True)
class Diagnosed:
    """The diagnosis, the fit before it and the fit of the extended machine."""

    diagnosis: Diagnosis
    baseline: Fit
    final: Fit
    growth: Growth


def diagnose(machine: Machine, survey: Survey) -> Diagnosed:
    """Find what physics a survey shows beyond the machine's model, and put it into the model.

    Raises
    ------
    InputError
        The survey has nothing to fit, or no row with a measured position.
    """
    if not np.isfinite(survey.fit.measured).any():
        found = "no row to fit has a measured position, which the diagnosis works on"
        raise InputError(str(survey.source), found, "Add rows with mx my mz, or use `errormodel fit` for error motions")
    chain = Chain(machine)
    blunders: list[Blunder] = []
    while len(blunders) < 3 and (blunder := find_blunder(chain, survey)) is not None:
        blunders.append(blunder)
        survey = blunder.survey
    baseline = fit = fit_machine(machine, survey)
    bad = np.zeros(len(fit.survey), dtype=bool)
    for _ in range(3):  # gross rows hide smaller ones
        more = gross_rows(fit) & ~bad
        if not more.any():
            break
        bad |= more
        survey = _without_fit_rows(survey, bad)
        fit = fit_machine(machine, survey)
    bench = set_up(fit)
    candidates = Candidates.of(bench)
    growth = grow(bench, candidates)
    effects = [*(b.effect for b in blunders), *(s.effect for s in growth.steps)]
    final = fit_machine(_extended(machine, effects), survey) if effects else fit
    findings = [_blunder_finding(b) for b in blunders]
    findings += [_finding(group, growth, final, fit) for group in growth.findings]
    if bad.any():
        findings.append(_outlier_finding(bad, baseline, fit))
    absorbed = candidates.scores(bench).absorbed
    diagnosis = Diagnosis(
        "explained" if findings else "adequate",
        1e3 * final.sigma_mm,
        _summary(baseline),
        _summary(final),
        tuple(findings),
        tuple(unseen(bench.scene, candidates.effects, absorbed)),
        None,
        final.notes,
    )
    return Diagnosed(diagnosis, baseline, final, growth)


def _without_fit_rows(survey: Survey, bad: Mask) -> Survey:
    mask = np.zeros(len(survey), dtype=bool)
    mask[np.flatnonzero((survey.table["role"] == "fit").to_numpy())[bad]] = True
    return without(survey, mask)


def _extended(machine: Machine, effects: list[Effect]) -> Machine:
    specs = tuple(EffectSpec(e.effect, e.model_dump(exclude_defaults=True)) for e in effects)
    return replace(machine, effects=(*machine.effects, *specs))


def _summary(fit: Fit) -> dict[str, float | None]:
    s = fit.solution
    return {
        "rms_um": fit.fitted.rms_um,
        "heldout_rms_um": fit.heldout.rms_um,
        "reduced_chi2": s.chi2 / s.dof if s.dof > 0 else None,
    }


def _finding(group: list[Step], growth: Growth, final: Fit, before: Fit) -> Finding:
    """A finding from its steps: the effect, and the refinements of its form."""
    main = group[0]
    bench = growth.without(group)  # geometry and the other findings fitted, this one not
    columns, values = bench.estimates([s.effect for s in group])
    columns = columns[:, : len(bench.index)]
    noise = 1e3 * before.sigma_mm
    size = noise * float(np.sqrt(3 * np.mean((columns.T @ values) ** 2)))
    amounts = _amounts(main.effect, final)
    probability = probability_of(main)
    at = getattr(main.effect, "at", None) if "time" in main.effect.drivers else None
    return Finding(
        effect=main.effect.effect,
        where=main.effect.where,
        motion=motions_of(main.effect, bench),
        driver=list(main.effect.drivers),
        runs=[d[4:-1] for d in main.effect.drivers if d.startswith("run(")] or None,
        time=[float(at)] if at is not None else None,
        period=getattr(main.effect, "period", None),
        statement=statement_of(main.effect, amounts, size, main.absorbed, probability),
        parameters=amounts,
        probability=probability,
        p_value=p_value_of(main, max(len(amounts), 1)),
        heldout_rms_um=HeldOut(*(float(np.sqrt(3)) * noise * heldout_rms(b) for b in (bench, growth.bench))),
        absorbed=main.absorbed,
        moved=_moved(before, columns, values),
        alternatives=alternatives_of(main),
        next_measurement=main.effect.separate,
    )


def _moved(before: Fit, columns: Array, values: Array) -> dict[str, float]:
    """How far the missing effect had pushed the geometry's parameters; empty where rows were thinned out."""
    base = before.solution.groups.base
    views = [v for v in before.problem.views if isinstance(v, PositionView)]
    design = np.vstack([design_rows(v, before.problem.place(), most=len(v))[:, base] for v in views])
    if len(design) != columns.shape[1]:
        return {}
    level = 1.0 if "position" in before.solution.declared else before.sigma_mm
    return moved_by(design / level, [before.solution.unknowns[j] for j in base], columns, values)


def _amounts(effect: Effect, final: Fit) -> list[Amount]:
    """The effect's parameters as the final fit has them."""
    own = (p for p in parameters(final) if p["id"].startswith(f"{effect.where}.") and f".{effect.effect}" in p["id"])
    return [Amount(p["id"], p["value"], p["std"], p["unit"]) for p in own]


def _blunder_finding(blunder: Blunder) -> Finding:
    text = (
        f"{blunder.effect.text}: the nominal machine misses by {blunder.before_um:.0f} um, "
        f"with it put right by {blunder.after_um:.0f} um."
    )
    return Finding(
        effect="axis-blunder",
        where=blunder.effect.where,
        driver=[blunder.effect.column],
        statement=text[0].upper() + text[1:],
        probability=0.999,
        p_value=0.0,
        heldout_rms_um=HeldOut(blunder.before_um, blunder.after_um),
        next_measurement=blunder.effect.separate,
    )


def _outlier_finding(bad: Mask, baseline: Fit, fit: Fit) -> Finding:
    rows = [int(r) for r in baseline.survey.table["row"].to_numpy()[bad]]
    largest = 1e3 * float(np.nanmax(np.linalg.norm(baseline.residuals[bad], axis=1)))
    listed = ", ".join(map(str, rows[:12])) + (" ..." if len(rows) > 12 else "")
    return Finding(
        effect="outliers",
        where="instrument",
        statement=(
            f"{len(rows)} rows of {len(bad)} lie far outside anything the others show (up to {largest:.0f} um) and "
            f"were left out: rows {listed}."
        ),
        parameters=[Amount("rows", float(len(rows)), 0.0, "1")],
        probability=0.99,
        p_value=0.0,
        heldout_rms_um=HeldOut(baseline.heldout.rms_um, fit.heldout.rms_um),
        next_measurement="measure these rows again",
        rows=rows,
    )
