"""What is printed of a description, a fit and a diagnosis: plain lines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from identification.estimation.result import noise_bounds
from identification.results.groups import PART_OF, location_name
from identification.results.parameter_table import chance, printed
from identification.results.set_ups import SetUpValue, set_ups
from identification.results.terminal import table_lines

if TYPE_CHECKING:
    from identification.diagnosis.linear.row_residuals import ReadingSizes
    from identification.diagnosis.results.findings import Alternative, Diagnosis, Finding
    from identification.estimation.motions import Motions
    from identification.estimation.readings import Readings
    from identification.estimation.result import Fit, Spread
    from identification.results.analysis import Analysis
    from identification.results.description import Description

SHOWN = 12  # outliers
SHOWN_SET_UPS = 24  # unknowns of set-ups
LEAST_PRINTED = 0.01  # probability of an alternative that is printed in any case


def description_lines(description: Description) -> Iterator[str]:
    """Chain, counts, groups, and what has no effect."""
    chain, groups = description.chain, description.groups
    machine = chain.machine
    yield machine.name
    yield "chain: " + " > ".join(e.name for e in machine.elements)
    yield (
        f"{len(chain.machine_ids)} parameters, {len(groups.no_effect)} without effect, rank {groups.rank}, "
        f"condition {groups.condition:.3g}"
    )
    yield "\nidentifiable groups"
    symbols = {p.id: p.symbol for p in chain.parameters}
    units = {p.id: p.unit for p in chain.parameters}
    for k in range(groups.rank):
        base = groups.ids[groups.base[k]]
        location, meaning = location_name(chain, description.locations, groups.members(k))
        symbol = location or symbols.get(base, "")
        yield f"  {symbol:9} {units.get(base, ''):7} {groups.name(k)}{'   ' if meaning else ''}{meaning}"
    if groups.no_effect:
        yield "\nno effect"
        for identity, reason in description.reasons.items():
            yield f"  {identity}: {reason}"
    if description.split:
        yield "\nsplit by this survey (one group with one tool and random poses)"
        for name in description.split:
            yield f"  {name}"
    if description.with_frame is not None:
        set_up = ("frame", "observation[")
        own = sum(not description.with_frame.ids[j].startswith(set_up) for j in description.with_frame.base)
        unknown = any(i.startswith(set_up[1]) for i in description.with_frame.ids)
        what = "what is unknown of the set-ups" if unknown else "the measuring frame unknown"
        each = [description.with_frame.members(k) for k in range(description.with_frame.rank)]
        mixed = [k for k, m in enumerate(each) if len(m) > 1 and any(name.startswith(set_up) for name in m)]
        yield (
            f"\nwith {what}: rank {description.with_frame.rank}, of which {own} groups hold "
            f"parameters of the machine{'; those that it shares:' if mixed else ''}"
        )
        yield from (f"  {description.with_frame.name(k)}" for k in mixed)


def fit_lines(analysis: Analysis) -> Iterator[str]:
    """Residuals before and after, noise, and the groups that stand out."""
    fit = analysis.fit
    yield f"{fit.chain.machine.name}: {fit.rows} rows, {fit.solution.groups.rank} identifiable groups"
    if fit.fitted.n:
        yield from _spread_lines(fit)
    if fit.motions:
        yield from _motion_lines(fit, fit.motions)
    if fit.readings:
        yield from _reading_lines(fit, fit.readings)
    if not fit.fitted.n:
        yield from _level_lines(fit)
    places = [v for v in set_ups(fit) if v.type == "target"]
    of = ", of a machine whose last members have no constant errors" if any(v.relative_to for v in places) else ""
    yield from _set_up_lines(places, f"places of targets in the last frame{of}")
    if fit.inflation > 1 and fit.declared:
        yield f"residuals exceed the declared uncertainty: standard uncertainties are multiplied by {fit.inflation:.2f}"
    yield from _outlier_lines(fit)
    shared = ("frame.", "frame[", "zero[", "observation[")
    effects = fit.chain.of_effects  # that of an instrument moves the frame, but is none of it
    framed = [any(m.startswith(shared) and m not in effects for m in p["members"]) for p in analysis.groups]
    whole = [bool(p["meaning"]) and not p["meaning"].startswith(PART_OF) for p in analysis.groups]
    listed = [p for p, *no in zip(analysis.groups, framed, whole, strict=True) if not any(no)]
    listed.sort(key=lambda p: -abs(p["value"]) / p["std"] if p["std"] else -np.inf)
    yield "\nlargest in units of their uncertainty (all in parameters.csv)"
    rows = []
    for p in listed[:12]:
        factor, unit = printed(p["unit"])
        value, std = f"{factor * p['value']:.3f}", f"+- {factor * p['std']:8.3f}"
        rows.append([p["symbol"], value, std, unit.replace("µ", "u"), p["group"], p["meaning"]])
    yield from table_lines(rows, "<>><<<", indent=2)
    if analysis.location_errors:
        spots = {e.at for e in analysis.location_errors}
        common = f", between {min(spots)}" if len(spots) == 1 else ""
        yield f"\nlocation errors of the axes (squareness, parallelism){common}"
        cells = [
            [e.symbol, f"{1e6 * e.value:.3f}", f"+- {1e6 * e.std:8.3f}", "urad", e.words if common else e.spoken]
            for e in analysis.location_errors
        ]
        yield from table_lines(cells, "<>><<", indent=2)
    if any(framed):
        what = "the measuring frame" if fit.problem.frames else "the instrument's zeros"
        what = "the set-ups of the observations" if fit.readings else what
        yield f"  and {sum(framed)} groups of, or shared with, {what}"


def _spread_lines(fit: Fit) -> Iterator[str]:
    """Sizes of the error of position, and the noise of a coordinate."""
    yield ""
    rows: list[tuple[str, Spread]] = [
        ("nominal" if fit.survey.frame == "fixed" else "nominal, best frame", fit.nominal),
        ("fitted", fit.fitted),
        (f"held out ({fit.folds} blocks)", fit.heldout),
    ]
    for test in fit.tests:
        rows += [(f"{test.path}: nominal", test.nominal), (f"{test.path}: predicted", test.fitted)]
    cells = [
        [
            name,
            *(f"{v:.2f}" if np.isfinite(v) else "-" for v in (spread.rms_um, spread.mean_um, spread.max_um)),
            str(spread.n),
        ]
        for name, spread in rows
    ]
    yield from table_lines([["um", "rms", "mean", "max", "n"], *cells], "<>>>>", least=7)
    known = "position" in fit.declared
    how = "seen; standard uncertainties follow the declared one" if known else "from residuals"
    if fit.solution.dof > 0:
        low, high = (1e3 * fit.sigma_mm * x for x in noise_bounds(fit.solution.dof))
        how = f"{low:.2f} to {high:.2f}, 95 %, {how}"
    tested = known and fit.solution.dof > 0
    chi = f", reduced chi-square {fit.solution.chi2 / fit.solution.dof:.3f}" if tested else ""
    yield f"\nnoise of one coordinate {1e3 * fit.sigma_mm:.2f} um ({how}), {fit.solution.dof} degrees of freedom{chi}"
    if fit.sigma_rad is not None:
        yield f"{_turning(1e6 * fit.sigma_rad)} (from residuals)"


def _turning(urad: float) -> str:
    return f"noise of one component of orientation {urad:.3g} urad"


def _motion_lines(fit: Fit, motions: Motions) -> Iterator[str]:
    """Sizes of the readings of error motions, each motion of each joint by itself."""
    yield f"\n{'error motions, rms':28}{'nominal':>9}{'fitted':>9}{'held out':>9}{'n':>8}"
    for e in motions.errors(fit.survey):
        yield f"  {f'{e.symbol}, {e.unit}':26}{e.nominal:9.2f}{e.fitted:9.2f}{e.heldout:9.2f}{e.n:8d}"
    yield ""


def _reading_lines(fit: Fit, readings: Readings) -> Iterator[str]:
    """Sizes of single readings, each observation by itself, and the unknowns of the set-ups."""
    rows = [["readings, rms", "", "nominal", "fitted", "held out", "n"]]
    rows += [
        [e.observation, f"{e.type}, {e.unit}", *(f"{v:.2f}" for v in (e.nominal, e.fitted, e.heldout)), str(e.n)]
        for e in readings.errors(fit.survey)
    ]
    yield ""
    yield from table_lines(rows, "<<>>>>", least=7)
    yield from _set_up_lines(
        [v for v in set_ups(fit) if v.type != "target"],
        "set-ups (coordinates in the machine's reference, with its constants: zeros of the axes, and the tool)",
    )
    yield ""


def _set_up_lines(found: Sequence[SetUpValue], heading: str) -> Iterator[str]:
    if not found:
        return
    yield f"\n{heading}"
    cells = [
        [v.id, f"{v.value:.6g}" if v.unit == "rad" else f"{v.value:.4f}", _plus_minus(v.std), v.unit]
        for v in found[:SHOWN_SET_UPS]
    ]
    yield from table_lines(cells, "<>><", indent=2)
    if len(found) > SHOWN_SET_UPS:
        yield f"  and {len(found) - SHOWN_SET_UPS} more in fit.json"


def _plus_minus(std: float | None) -> str:
    """A standard uncertainty as printed, or that there is none."""
    return "not determined" if std is None else f"+- {std:.2g}"


def _level_lines(fit: Fit) -> Iterator[str]:
    """Noise by kind of reading, where no position was measured."""
    for kind, sigma in fit.solution.sigma.items():
        factor, unit = (1e6, "urad") if kind in fit.problem.angular else (1e3, "um")
        how = "as declared" if kind in fit.declared else f"{factor * sigma:.3g} {unit} (from residuals)"
        yield f"noise of a reading, {kind}: {how}"
    yield f"{fit.solution.dof} degrees of freedom"


def _outlier_lines(fit: Fit) -> Iterator[str]:
    """The rows that a robust fit leaves out."""
    if fit.sorting is None:
        return
    if not fit.outliers:
        yield "robust: no row is an outlier"
        return
    rows = len({o.index for o in fit.outliers})
    yield f"\nrobust: {rows} of {len(fit.survey)} rows take no part, in whole or with what is named"
    for o in sorted(fit.outliers, key=lambda o: -o.distance_sigma)[:SHOWN]:
        size = f", {o.residual_um:.6g} um" if np.isfinite(o.residual_um) else ""
        yield f"  {o.file}, row {o.row}: {o.what}, {o.distance_sigma:.3g} sigma{size}"
    if len(fit.outliers) > SHOWN:
        yield f"  and {len(fit.outliers) - SHOWN} more in fit.json"


def diagnosis_lines(diagnosis: Diagnosis) -> Iterator[str]:
    """The verdict, the findings as sentences, and what the data could not show."""
    from identification.diagnosis.results.headline import headline

    before, after = (_held_out(s) for s in (diagnosis.baseline, diagnosis.final))
    yield headline(diagnosis)
    what = "coordinate" if diagnosis.points else "reading"
    low, high = diagnosis.noise_interval_um
    known = f" ({low:.2f} to {high:.2f}, 95 %)" if diagnosis.dof > 0 else ""
    yield f"verdict: {diagnosis.verdict}; noise of one {what} {diagnosis.noise_um:.2f} um{known}"
    weighed = ", rows weighed by their noise" if before != after and not diagnosis.findings else ""
    if diagnosis.orientation_noise_urad is not None:
        yield _turning(diagnosis.orientation_noise_urad)
    yield f"held out: {before} um rms before, {after} um after{weighed}"
    yield from _observation_lines(diagnosis.readings)
    if diagnosis.unexplained:
        yield f"left over: {diagnosis.unexplained}"
    for number, finding in enumerate(diagnosis.findings, start=1):
        yield f"\n{number}. {finding.statement}"
        for other in _worth_printing(finding.alternatives):
            causes = " and ".join(other.driver)
            by = f"{' '.join(other.motion)} by {causes}" if other.motion else f"column {causes}"
            what = f"{other.effect} at {other.where} ({by})"
            yield f"   instead: {what}, {'; '.join(comparison(other))}"
        yield f"   next: {finding.next_measurement}"
    if said := forms_said(diagnosis.findings):
        yield f"\n{said}"
    if diagnosis.untestable:
        yield "\ncannot be seen in this survey"
        for item in diagnosis.untestable:
            yield f"  {item.effect}: {item.reason}"


def forms_said(findings: Sequence[Finding]) -> str:
    """What `+-` of findings holds beside the noise; empty where none has a form of which that is known."""
    from errormodel.effects import registry

    kinds = {f.effect: registry()[f.effect] for f in findings if f.effect in registry()}
    shares = {name: 0.0 if kind.empirical else kind.traits().form_uncertainty for name, kind in kinds.items()}
    forms = ", ".join(f"{name} {100 * share:.0f} % of its size" for name, share in shares.items() if share)
    if not forms:
        return ""
    return (
        f"+- of findings: beside the noise how far such effects depart from their textbook form ({forms}); `fit` with "
        "the same effects states the noise alone"
    )


def _worth_printing(alternatives: Sequence[Alternative]) -> list[Alternative]:
    """Named physics that the data leave open, and whatever may well be it; not what is known not to be it."""
    from errormodel.effects import registry

    def named_(a: Alternative) -> bool:
        return (kind := registry().get(a.effect)) is None or not kind.empirical

    return [a for a in alternatives if (a.probability or 0.0) >= LEAST_PRINTED or (not a.separable and named_(a))]


def _observation_lines(readings: Sequence[ReadingSizes]) -> Iterator[str]:
    """What is left of single readings without the findings and with them, each observation by itself."""
    if not readings:
        return
    head = ["readings, rms left out of the fit", "", "before", "after", "noise", "n"]
    sizes = [
        [
            r.observation,
            f"{r.type}, {r.unit}",
            *(f"{v:.2f}" for v in (r.heldout_before, r.heldout_after, r.noise)),
            str(r.n),
        ]
        for r in readings
    ]
    yield from table_lines([head, *sizes], "<<>>>>", least=7)


def comparison(other: Alternative) -> Iterator[str]:
    """How probable another explanation is, whether the data distinguish it, and why it was not chosen."""
    own = other.probability
    yield "the same effect" if own is None else f"probability {chance(own)}"
    if other.reason:
        yield f"fits this data better, but {other.reason}"
    else:
        yield "distinguishable" if other.separable else "not distinguishable by this data alone"


def _held_out(summary: Mapping[str, float | None]) -> str:
    value = summary["heldout_rms_um"]
    return "-" if value is None else f"{value:.2f}"
