"""ISO 230-2: accuracy and repeatability of positioning of linear and rotary axes.

Definitions of ISO 230-2:2014, clause 3, for deviations ``x_ij`` (actual minus target) at targets i in runs j, from both
sides: means, standard deviations ``s_i`` (n - 1), and of the axis A, E, M, R, B. In particular R is the largest of
``2 s_i(up) + 2 s_i(down) + |B_i|`` and of both ``4 s_i``, not the larger unidirectional R; and E is the range of the
means of both directions together, not of one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from errormodel.arrays import Array
from errormodel.conventions import REFERENCE_TEMPERATURE
from errormodel.surveys.record import UncertaintyRecord
from identification.iso_standards.base import Evaluation, Quantity, Sheet, Standard, spread, text
from identification.iso_standards.fitted import FittedMachine
from identification.iso_standards.measured_lengths import BEAM_NOTE, ZERO_NOTE, lengths_of
from identification.iso_standards.series import series_of, zeros_apart
from identification.iso_standards.targets import OF_BOTH, WORDS, Axis, as_json, axis_of, chart, of_readings, sheet
from identification.results.terminal import counted

if TYPE_CHECKING:
    from errormodel.machine import Machine
    from errormodel.survey import Survey

USUAL_RUNS = 5  # from each side (ISO 230-2:2014, 5.3.2)
FEWEST_TARGETS = 5  # in a metre, and of any axis (the same)
LONGEST_TRAVEL = 2000.0  # mm, up to which that holds
LONGEST_INTERVAL = 250.0  # mm, mean interval of the targets of longer axes (5.3.3)
ROTARY_TARGETS = {3: 90.0, 5: 180.0, 8: np.inf}  # fewest of a rotary axis, by its travel in degrees (5.3.4)
FEWEST_READINGS = 3  # of a test
MODEL_TARGETS = 21  # of a test of a fitted model: enough for curves that polynomials describe
# expanded uncertainty (k = 2) of a rectangular distribution over its range: 2 / (2 sqrt 3), which annex A rounds up
OF_RANGE = 0.6

APART = "each run goes one way only and has a zero of its own: nothing ties readings from below to those from above"
WITHOUT_PLAY = "systematic positioning error, without reversal"  # E of a model that has no play

Part: TypeAlias = "tuple[str, str, Axis, list[Quantity], tuple[str, ...]]"  # label, unit, values, figures, remarks


def annex_a(
    travel: float, runs: int, targets: int, given: UncertaintyRecord, noise: float | None, temperature: float | None
) -> dict[str, float]:
    """Expanded uncertainties (k = 2) of the figures, mm, by the contributions of annex A.

    Contributions are the device, misalignment (``0.3 R^2 / L``), temperature and coefficient of expansion of the
    machine (``0.6`` times the range), and the variation of the environment ``0.6 E_VE``. The last acts on each reading
    independently and is propagated to means and standard deviations of `runs` readings; the others act on lengths, and
    cancel in what is a difference at one target.

    Parameters
    ----------
    travel : length of the test in mm.
    runs, targets : readings of a target from one side, and targets.
    given : what the survey states.
    noise : standard uncertainty of one reading of the instrument in mm; None where none is declared.
    temperature : of the machine during the test in degC; None: 20.
    """
    reading = np.hypot(OF_RANGE * given.environment, 2 * (noise or 0.0))
    out = of_readings(float(reading), runs, targets) if reading > 0 else {}
    parts = contributions(travel, given, noise, temperature)
    if parts:
        common = sum(u**2 for _, _, u in parts)
        shares = dict.fromkeys(("E", "E↑", "E↓"), 2 / runs) | {"M": 1 / runs}
        shares |= dict.fromkeys(("A", "A↑", "A↓"), 4 + 2 / runs)
        out |= {name: float(np.sqrt(common + share * reading**2)) for name, share in shares.items()}
    return out


def contributions(
    travel: float, given: UncertaintyRecord, noise: float | None, temperature: float | None
) -> list[tuple[str, str, float]]:
    """Contributions to the uncertainty of a length that all readings share: what, from which input, U in mm (k = 2).

    None where nothing is known of the device.
    """
    device = given.device if given.device is not None else None if noise is None else 2 * noise
    if device is None:
        return []
    warm = REFERENCE_TEMPERATURE if temperature is None else temperature
    off = abs(warm - REFERENCE_TEMPERATURE)
    stated = "as stated" if given.device is not None else "twice the instrument's standard uncertainty"
    return [
        ("device", stated, device),
        (
            "misalignment",
            f"{given.misalignment:g} mm over {travel:.4g} mm",
            OF_RANGE / 2 * given.misalignment**2 / travel,
        ),
        (
            "temperature of the machine",
            f"± {given.temperature:g} K, {1e6 * given.coefficient:g} µm/m/K",
            OF_RANGE * given.coefficient * travel * 2 * given.temperature,
        ),
        (
            "coefficient of expansion",
            f"± {1e6 * given.coefficient_bound:g} µm/m/K at {warm:g} °C",
            OF_RANGE * off * travel * 2 * given.coefficient_bound,
        ),
    ]


def _budget(
    label: str, travel: float, given: UncertaintyRecord, noise: float | None, warm: float | None
) -> list[Sheet]:
    """The contributions as a table; none where nothing is known of the device."""
    parts = contributions(travel, given, noise, warm)
    if not parts:
        return []
    rows = [[what, source, text(u, "mm")] for what, source, u in parts]
    if given.environment:
        source = f"range {text(given.environment, 'mm')} µm of a drift test, of a single reading"
        rows.append(["variation of the environment", source, text(OF_RANGE * given.environment, "mm")])
    if noise:
        rows.append(["noise of the instrument", "of a single reading", text(2 * noise, "mm")])
    caption = f"{label}: contributions to the uncertainty (annex A), U with k = 2 in µm; what is 0 was not stated"
    return [Sheet(f"uncertainty-{label}", caption, ["contribution", "from", "U"], rows)]


class Positions(NamedTuple):
    """Readings of the position of one joint: what `Series` and `Lengths` hold of it.

    Attributes
    ----------
    q : (n,) commands; `along` (n,) deviations, `sigma` (n,) their declared standard uncertainties: mm or rad.
    direction : (n,) +-1, side of arrival.
    beam : whether lengths were read; from_pose : each of them from a pose of its own.
    apart : why the sides do not compare; empty: they do.
    """

    label: str
    unit: str
    q: Array
    along: Array
    sigma: Array | None
    direction: Array
    beam: bool = False
    from_pose: bool = False
    apart: str = ""


def _tests(survey: Survey, machine: Machine) -> Iterator[Positions]:
    """The positioning tests of a survey."""
    for s in series_of(survey, machine):
        if np.isfinite(s.along).sum() >= FEWEST_READINGS:
            why = APART if zeros_apart(survey, s) else ""
            yield Positions(s.label, s.unit, s.q, s.along, s.along_sigma, s.direction, apart=why)
    found = [lengths for lengths in lengths_of(survey, machine) if len(lengths.moving) == 1]
    names = [machine.joints[lengths.moving[0]].name for lengths in found]
    for lengths, name in zip(found, names, strict=True):
        label = name if names.count(name) == 1 else f"{name} ({lengths.label})"
        q = lengths.q[:, lengths.moving[0]]
        own = (q, lengths.deviation, lengths.sigma, lengths.direction)
        yield Positions(label, "mm", *own, beam=True, from_pose=lengths.from_pose)


class Positioning(Standard):
    """Positioning of each axis."""

    number = "230-2"
    title = "ISO 230-2:2014, accuracy and repeatability of positioning"
    needs = (
        "readings of one joint at targets, while the others stand still: rows about its error motions (column joint), "
        "measured points, or lengths along its line"
    )

    def of_survey(self, survey: Survey, machine: Machine) -> Evaluation:
        found = list(_tests(survey, machine))
        if not found:
            raise self.lacking(survey, "no joint was read at three targets with the others standing still")
        record = survey.record
        given = UncertaintyRecord() if record is None else record.uncertainty
        warm = None if record is None else record.ambient.machine_temperature
        parts: list[Part] = []
        budgets: list[Sheet] = []
        for series in found:
            axis = axis_of(series.q, series.along, series.direction, series.apart)
            sigma = series.sigma
            noise = None if sigma is None or not np.isfinite(sigma).any() else float(np.nanmax(sigma))
            travel = float(np.ptp(axis.targets))
            own = given if series.unit == "mm" else UncertaintyRecord()  # its lengths say nothing about an angle
            known = annex_a(travel, max(axis.runs, 1), len(axis.targets), own, noise, warm)
            quantities = [
                Quantity(
                    name,
                    series.label,
                    WORDS[name],
                    float(v),
                    series.unit,
                    known.get(name) if np.isfinite(v) else None,
                    _basis(name, known, series.unit) if np.isfinite(v) else series.apart,
                )
                for name, v in axis.figures().items()
            ]
            parts.append((series.label, series.unit, axis, quantities, tuple(remarks(series, axis))))
            if series.unit == "mm":
                budgets += _budget(series.label, travel, own, noise, warm)
        notes: tuple[str, ...] = (BEAM_NOTE,) if any(t.beam for t in found) else ()
        notes += (ZERO_NOTE,) if any(t.from_pose for t in found) else ()
        whole = _evaluation(self, f"survey {survey.source.name}", parts, notes)
        return replace(whole, sheets=(*whole.sheets, *budgets))

    def of_fit(self, model: FittedMachine) -> Evaluation:
        parts: list[Part] = []
        for joint in model.joints:
            if joint.type != "prismatic" or np.ptp(model.covered[joint.name]) == 0:
                continue
            q = model.path(joint, MODEL_TARGETS)
            k, axis = model.joints.index(joint), model.toward(joint)
            came = -np.ones_like(q)
            came[:, k] = 1.0
            up = model.errors(q, came) @ axis
            came[:, k] = -1.0
            down = model.errors(q, came) @ axis
            none = np.full(MODEL_TARGETS, np.nan)
            whole = Axis(q[:, k], up, down, none, none, 0)
            figures = whole.figures() if model.reversing(joint) else {"E": np.ptp(up, axis=-1)}
            words = WORDS if model.reversing(joint) else WORDS | {"E": WITHOUT_PLAY}
            quantities = [
                Quantity(name, joint.name, words[name], value, "mm", expanded, "covariance of the fit")
                for name, (value, expanded) in ((n, spread(v)) for n, v in figures.items())
            ]
            best = Axis(q[:, k], up[0], down[0], none, none, 0)
            parts.append((joint.name, "mm", best, quantities, ()))
        still = [label for label, _, _, own, _ in parts if len(own) == 1]
        play = (f"no play of {', '.join(still)} is in the model, which says nothing of B therefore",) if still else ()
        notes = (
            *play,
            "A and R are of repeated readings and cannot come from a fitted model; of the model these are the "
            "systematic figures, along the middle of the measured travels",
        )
        return replace(_evaluation(self, model.source, parts, notes), sheets=())


def _basis(name: str, known: dict[str, float], unit: str) -> str:
    if name in known:
        return "annex A"
    if unit == "rad":
        return "the survey declares no standard uncertainty of its angles (u_ea, u_eb, u_ec)"
    if name.startswith(("R", "B")):
        return "test.uncertainty.environment and the instrument's noise are not stated"
    return "neither instrument nor test.uncertainty.device is stated"


def remarks(series: Positions, axis: Axis) -> list[str]:
    """What the test lacks of what the standard has, in sentences."""
    out = []
    name = series.label
    travel = float(np.ptp(axis.targets))
    # a longer axis is tested once from each side over its whole travel (5.3.3)
    usual = 1 if series.unit == "mm" and travel > LONGEST_TRAVEL else USUAL_RUNS
    if axis.runs < usual:
        out.append(f"{name}: {counted(axis.runs, 'run')} from each side; the standard has {usual}")
    if axis.one_sided:
        out.append(f"{name}: {axis.one_sided}")
    if axis.apart:
        out.append(
            f"{name}: {axis.apart}, so that {', '.join(OF_BOTH)}, which compare them, are not determined. Give the way "
            "there and back one label of run; or write frame: fixed where one zero held for all runs"
        )
    if not axis.both:
        out.append(f"{name}: targets were approached from one side only, so that A, E, M, R and B are not given")
    fewest, of = _fewest_targets(series.unit, travel)
    if len(axis.targets) < fewest:
        out.append(f"{name}: {len(axis.targets)} targets; the standard has at least {fewest:.0f} in {of}")
    steps = np.diff(axis.targets)
    if len(steps) > 2 and np.ptp(steps) < 1e-6 * float(np.abs(steps).max()):
        out.append(f"{name}: targets in equal steps, which do not show periodic errors of that pitch")
    return out


def _fewest_targets(unit: str, travel: float) -> tuple[int, str]:
    """Targets that ISO 230-2:2014 (5.3) has at least, and over what, in words; travels in mm or rad."""
    if unit == "rad":
        degrees = float(np.degrees(travel))
        return next(n for n, most in ROTARY_TARGETS.items() if degrees <= most + 1e-6), f"{degrees:.4g}°"
    if travel > LONGEST_TRAVEL:
        return int(travel // LONGEST_INTERVAL) + 1, f"{travel:.4g} mm, one every {LONGEST_INTERVAL:g} mm"
    return max(FEWEST_TARGETS, int(np.ceil(FEWEST_TARGETS * travel / 1000))), f"{travel:.4g} mm, five a metre"


def _evaluation(
    kind: Positioning,
    source: str,
    parts: list[Part],
    notes: tuple[str, ...] = (),
) -> Evaluation:
    sheets = tuple(sheet(label, unit, axis) for label, unit, axis, _, _ in parts)
    charts = tuple(chart(label, unit, axis) for label, unit, axis, _, _ in parts)
    data: dict[str, Any] = {label: as_json(axis, unit) for label, unit, axis, _, _ in parts}
    quantities = tuple(q for _, _, _, own, _ in parts for q in own)
    every = (*notes, *(note for *_, own in parts for note in own))
    return Evaluation(kind.number, kind.title, source, quantities, sheets, charts, every, data)
