"""Tables of a report, as text in cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from identification.estimation.fit import moved
from identification.estimation.result import Fit, Spread
from identification.report.wording import file_name, three
from identification.results.analysis import Analysis
from identification.results.correlations import correlation, strongest
from identification.results.description import no_effect_reasons
from identification.results.location_estimates import LocationEstimate
from identification.results.parameter_table import ARCSEC_PER_URAD, Estimate, Kind, decimals, printed
from identification.results.set_ups import set_ups

GROUP_HEADINGS: dict[Kind, str] = {
    "member": "Structural members (constants)",
    "joint": "Joints (error motions)",
    "effect": "Effects",
    "frame": "Measuring frame and target",
    "zero": "Zeros of the instruments",
    "observation": "Set-ups of the readings (relative to where the estimation starts)",
}
BARRED: tuple[Kind, ...] = ("member", "joint", "effect")  # kinds of groups whose values are drawn as bars
MOST_PAIRS, CORRELATED = 12, 0.7  # pairs of groups that are listed: how many, and from which coefficient on
MOST_FRAME_ROWS = 30  # rows about measuring frames or zeros; a long survey has hundreds


class Result(NamedTuple):
    """Row of the table of residuals, um."""

    name: str
    note: str
    spread: Spread

    @property
    def cells(self) -> list[str]:
        s = self.spread
        return [number(v, 1) for v in (s.mean_um, s.rms_um, s.max_um)] + [str(s.n)]


class GroupRow(NamedTuple):
    """Row of the table of parameter groups."""

    number: int
    formula: str
    symbol: str
    meaning: str
    value: str
    unit: str
    arcsec: str
    significance: str
    clear: bool
    bar: tuple[float, float, float] | None = None  # ends and middle of the bar, 0 to 120, zero at 60


def number(value: float, places: int) -> str:
    """Number with a true minus sign; a dash for an unknown value."""
    if not np.isfinite(value):
        return "–"
    text = f"{value:.{places}f}"
    return text.replace("-", "−") if float(text) else text.removeprefix("-")


def results(fit: Fit) -> list[Result]:
    """Rows for nominal, fitted, held-out and each test file before and after; none if no position was measured."""
    if not fit.fitted.n:
        return []
    frame = "" if fit.survey.frame == "fixed" else "best frame, "
    rows = [
        Result("Nominal", f"{frame}no error parameter", fit.nominal),
        Result("Fitted", f"groups identified: {fit.solution.groups.rank}", fit.fitted),
        Result("Held out", f"each of {fit.folds} blocks of rows predicted without it", fit.heldout),
    ]
    for test in fit.tests:
        own = ["its frame"] * any(".d" in n or ".e" in n for n in test.refit if not n.startswith("tool"))
        own += ["its tool"] * any(n.startswith("tool") for n in test.refit)
        note = f"predicted; estimated from its own rows: {' and '.join(own)}" if own else "predicted, nothing estimated"
        name = f"Test {test.path}"
        rows += [Result(name, "nominal", test.nominal), Result(name, note, test.fitted)]
    return rows


def motions(fit: Fit) -> list[list[str]]:
    """Cells of each measured error motion: name and unit, nominal, fitted, held out, readings."""
    if fit.motions is None:
        return []
    return [
        [
            f"{e.symbol} / {e.unit.replace('u', 'µ', 1)}",
            *(number(v, 2) for v in (e.nominal, e.fitted, e.heldout)),
            str(e.n),
        ]
        for e in fit.motions.errors(fit.survey)
    ]


def readings(fit: Fit) -> list[list[str]]:
    """Cells of each observation of single readings: name, type and unit, nominal, fitted, held out, readings."""
    if fit.readings is None:
        return []
    return [
        [
            f"{e.observation}: {e.type} / {e.unit.replace('u', 'µ', 1)}",
            *(number(v, 2) for v in (e.nominal, e.fitted, e.heldout)),
            str(e.n),
        ]
        for e in fit.readings.errors(fit.survey)
    ]


def of_set_ups(fit: Fit) -> list[list[str]]:
    """Cells of each unknown of a set-up: name, value, standard uncertainty, unit; at most `MOST_FRAME_ROWS`."""
    found = [v for v in set_ups(fit) if v.type != "target"]  # these are among the effects
    out = [
        [
            v.id,
            f"{v.value:.6g}" if v.unit == "rad" else number(v.value, 4),
            three(v.std) if v.std else "not determined",
            v.unit,
        ]
        for v in found[:MOST_FRAME_ROWS]
    ]
    more = len(found) - len(out)
    return [*out, [f"and {more} more in fit.json", "", "", ""]] if more else out


def counts(fit: Fit) -> dict[str, int]:
    """Numbers of parameters by status: identified, dependent, without effect."""
    ids, groups = fit.chain.machine_ids, fit.solution.groups
    named = {groups.ids[j] for j in groups.base}
    return {
        "parameters": len(ids),
        "identified": sum(i in named for i in ids),
        "without": sum(i in groups.no_effect for i in ids),
        "rank": groups.rank,
    }


def group_sections(groups: Sequence[Estimate]) -> list[tuple[str, list[GroupRow]]]:
    """Groups by kind, in the order of the fit; at most `MOST_FRAME_ROWS` measuring frames."""
    out, scales = [], _scales(groups)
    for kind, heading in GROUP_HEADINGS.items():
        own = [e for e in groups if e.kind == kind]
        most = MOST_FRAME_ROWS if kind in ("frame", "zero") else len(own)
        more = f": {most} of {len(own)}, all in parameters.csv" if len(own) > most else ""
        if own:
            out.append((heading + more, [_group_row(e, scales.get(e.unit, 0.0)) for e in own[:most]]))
    return out


def location_rows(errors: Sequence[LocationEstimate]) -> list[GroupRow]:
    """Rows of the location errors; the words, with the place of the lines, stand in place of a formula."""
    factor, unit = printed("rad")
    return [
        _group_row(
            Estimate(
                number, e.symbol, e.symbol, e.spoken, e.symbol, "", factor * e.value, factor * e.std, unit, "joint"
            )
        )
        for number, e in enumerate(errors, start=1)
    ]


def _scales(groups: Sequence[Estimate]) -> dict[str, float]:
    """The farthest end of a bar of two standard uncertainties, by unit; frames and zeros have no bars."""
    out: dict[str, float] = {}
    for e in groups:
        if e.kind in BARRED:
            out[e.unit] = max(out.get(e.unit, 0.0), abs(e.value) + 2 * e.std)
    return out


def _group_row(e: Estimate, scale: float = 0.0) -> GroupRow:
    places = decimals(e.std)
    arcsec = ""
    if e.unit.startswith("µrad"):
        places_arcsec = decimals(ARCSEC_PER_URAD * e.std)
        size = f"{number(ARCSEC_PER_URAD * e.value, places_arcsec)} ± {number(ARCSEC_PER_URAD * e.std, places_arcsec)}"
        arcsec = f"{size} arcsec{e.unit.removeprefix('µrad')}"
    value = f"{number(e.value, places)} ± {number(e.std, places)}"
    significance = number(e.significance, 1) if e.significance < 1e4 else "over 10000"
    bar = None
    if e.kind in BARRED and np.isfinite(scale) and scale > 0:
        low, middle, high = (round(60 + 58 * x / scale, 1) for x in (e.value - 2 * e.std, e.value, e.value + 2 * e.std))
        bar = low, middle, high
    clear = e.significance >= 2
    return GroupRow(e.number, e.formula, e.symbol, e.meaning, value, e.unit, arcsec, significance, clear, bar)


def correlated_pairs(analysis: Analysis) -> list[tuple[str, str, str]]:
    """The most correlated pairs of groups of the machine, by name, with their coefficients."""
    groups, matrix = correlation(analysis)
    pairs = strongest(matrix, CORRELATED, MOST_PAIRS)
    return [(groups[i].name, groups[j].name, number(coefficient, 2)) for i, j, coefficient in pairs]


def dependent(fit: Fit) -> list[tuple[str, str]]:
    """Dependent parameters: ids, and the combination of groups they act as; equal ones share a row."""
    groups = fit.solution.groups
    base = set(groups.base.tolist())
    alike: dict[tuple[tuple[str, float], ...], list[str]] = {}
    for j, name in enumerate(groups.ids):
        rows = np.flatnonzero(groups.coefficients[:, j])
        if j not in base and len(rows):
            key = tuple((groups.ids[groups.base[k]], float(groups.coefficients[k, j])) for k in rows)
            alike.setdefault(key, []).append(name)
    return [(_list(names), _list([_share(*pair) for pair in key])) for key, names in alike.items()]


def _list(words: list[str], most: int = 12) -> str:
    more = f" and {len(words) - most} more" if len(words) > most else ""
    return ", ".join(words[:most]) + more


def _share(name: str, factor: float) -> str:
    if abs(factor - 1) < 1e-9:
        return name
    return f"{'−' if factor < 0 else ''}{'' if abs(factor + 1) < 1e-9 else f'{abs(factor):.6g} × '}{name}"


def no_effect(fit: Fit) -> list[tuple[str, str]]:
    """Parameters without effect on the measurements: ids and reasons; equal ones share a row."""
    groups = fit.solution.groups
    known = replace(groups, no_effect=tuple(i for i in groups.no_effect if i in fit.chain.index))
    reasons = dict.fromkeys(groups.no_effect, "nothing that was measured depends on it")
    reasons |= no_effect_reasons(fit.chain, known, fit.survey)
    alike: dict[str, list[str]] = {}
    for name, reason in reasons.items():
        alike.setdefault(reason, []).append(name)
    return [(_list(names), reason) for reason, names in alike.items()]


def frames(fit: Fit) -> list[list[str]]:
    """Label, x y z (mm) and rotations about x, y, z (deg) of each measuring frame, at most `MOST_FRAME_ROWS`."""
    from scipy.spatial.transform import Rotation

    named = fit.solution.named()
    out = []
    for label, pose in list(fit.problem.frames.items())[:MOST_FRAME_ROWS]:
        whole = moved(fit.chain, pose, named, label)
        turns = Rotation.from_matrix(whole.rotation).as_euler("XYZ", degrees=True)
        cells = [*(number(v, 4) for v in whole.translation), *(number(v, 6) for v in turns)]
        out.append([label or "one frame for all rows", *cells])
    more = len(fit.problem.frames) - len(out)
    return [*out, [f"and {more} more in fit.json", *[""] * 6]] if more else out


def noise(fit: Fit) -> list[list[str]]:
    """Kinds of observation: number, standard deviation, and its origin."""
    out = []
    for kind, sums in fit.solution.sums.items():
        declared = kind in fit.declared
        factor, unit = (1e6, "µrad") if kind in fit.problem.angular else (1e3, "µm")
        sigma = fit.sigma_mm if kind == "position" else fit.solution.sigma[kind]
        how = "declared (the deviation is that of the residuals)" if declared else "estimated from the residuals"
        out.append([f"{kind}, one coordinate", str(sums.count), f"{three(factor * sigma)} {unit}", how])
    return out


def inputs(fit: Fit) -> list[tuple[str, str]]:
    """Names of the input files."""
    machine = fit.chain.machine
    rows = [("Machine", file_name(machine.source) if machine.source else machine.name)]
    rows.append(("Survey", fit.survey.name))
    counts = fit.survey.table["file"].value_counts(sort=False) if fit.streamed is None else fit.streamed.files
    rows += [("Fitted file", f"{file}, {n} rows") for file, n in counts.items()]
    rows += [("Test file", f"{test.path}, {len(test.survey)} rows") for test in fit.tests]
    instrument = fit.survey.instrument.type
    return [*rows, ("Instrument", instrument if fit.survey.sized else f"{instrument}, as its residuals show it")]
