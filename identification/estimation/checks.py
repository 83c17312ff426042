"""Checks of a survey before and after its fit: runs, redundancy, declared uncertainty, coverage of the travels.

Each check raises an `InputError` that states the finding and the cure, or adds a note to the fit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.channels import POINTS
from errormodel.exceptions import InputError, nearest
from errormodel.serial_chain import ONLY_SERIAL
from errormodel.survey import Survey
from errormodel.surveys.observations import groups, observed
from identification.estimation.large_scales import large_scales
from identification.estimation.least_squares import Solution, identifiable
from identification.estimation.motions import MotionErrors
from identification.estimation.readings import ReadingErrors
from identification.estimation.result import Fit, Spread
from identification.observation.assembly import Problem
from identification.observation.frames import MACHINE_ERROR_SHARE
from identification.observation.identifiability import Groups
from identification.observation.models import anywhere

LEAST_EQUATIONS_PER_GROUP = 2  # equations a group, of a robust fit
FOREIGN_MACHINE_SHARE = 0.02  # of the machine's size: no error motions, but a blunder
UNEXPLAINED_SHARE = 0.5  # of so much, of most rows: a fit that leaves more is none
COVERED_TRAVEL_SHARE = 0.5  # of a travel: less is reported where something stays unknown
CAUTIOUS_DECLARATION_FACTOR = 2.0  # times: less is often declared too large, to be on the safe side
BY_CHANCE = 0.1  # so often are residuals that small where the declaration is that many times too large, and no more
FINEST_MM, EXACT_MM = 1e-5, 1e-10  # mm: readings that repeat within less are in another unit, or made by a computer
FEW_DOF = 10  # degrees of freedom: fewer leave residuals that small by chance
CONSTANT = 0.5  # of what a fit leaves: an offset alone that leaves less explains more
MOST_NAMED = 6  # rows in a note
WILD = 10.0  # times the distance of four rows of five: no error motion leads a row so far from the others
WILD_FROM = 10 * MACHINE_ERROR_SHARE  # of the machine's size: nor so far from where the nominal machine puts it
BETTER_ODDS, BETTER_VARIANCE = 100.0, 1.3  # to 1, and times: by which a machine without errors is better; by judgement
BEYOND_INSTRUMENT = 3.0  # times: machines do not repeat to less than instruments measure; by judgement
WRONG_UNIT_FACTOR = 100.0  # times: so far off is a declaration in another unit


def check_runs(chain: Chain, survey: Survey, other_runs: bool = False) -> None:
    """Raise InputError if an effect of the machine belongs to a run that has no row in the fit, unless `other_runs`."""
    runs = dict.fromkeys(survey.table["run"].astype(str))
    for name in chain.channels:
        if not other_runs and name.startswith("run(") and name[4:-1] not in runs:
            found = f"an effect of this machine goes with {name}, a run that no fitted row is of"
            raise InputError(str(survey.source), found, nearest(name[4:-1], runs))
        if name.startswith("of(") and name != POINTS and name[3:-1] not in survey.observations:
            found = f"an effect of this machine is of {name[3:-1]}, which is no observation of the survey"
            raise InputError(str(survey.source), found, nearest(name[3:-1], ["points", *survey.observations]))


def check_redundant(survey: Survey, problem: Problem) -> None:
    """Raise InputError if a robust fit has too few equations to distinguish an outlier from a parameter."""
    equations = sum(v.count for v in problem.views)
    rank = identifiable(problem.chain, problem.views, problem.unknowns).rank
    if equations < LEAST_EQUATIONS_PER_GROUP * rank:
        rows = -(-LEAST_EQUATIONS_PER_GROUP * rank * len(survey) // max(equations, 1))
        raise InputError(
            str(survey.source),
            f"{equations} measured values for {rank} groups of parameters: too few to say which rows are wrong",
            f"Measure at least {rows} rows like these, or fit without --robust",
        )


def check_enough(survey: Survey, problem: Problem, solution: Solution) -> None:
    """Raise InputError if the equations do not outnumber the groups that such rows, all over the travels, identify."""
    equations, rows = sum(s.count for s in solution.sums.values()), len(survey.fit)
    whole, lost = out_of_reach(problem, solution)
    known = solution.declared == set(solution.sums)  # declared noise: no degree of freedom is needed to estimate it
    if equations > whole.rank or (equations == whole.rank and known and not lost):
        return
    need = -(-(whole.rank + 1) * rows // max(equations, 1))
    found = (
        f"{rows} row{'s' if rows > 1 else ''} with {equations} measured values where {whole.rank} groups of parameters "
        "are identifiable"
    )
    if lost:
        more = f" and {len(lost) - 3} more" if len(lost) > 3 else ""
        found += f"; {len(lost)} fall: {', '.join(lost[:3])}{more}"
    else:
        found += ", with nothing left to judge the residuals by"
    cure = f"Measure at least {need} rows like these, better {2 * need}, or declare fewer errors in machine.yaml"
    raise InputError(str(survey.source), found, cure)


def out_of_reach(problem: Problem, solution: Solution) -> tuple[Groups, list[str]]:
    """Groups identifiable by such rows all over the travels, and the names of those that the fit did not identify."""
    whole = identifiable(problem.chain, [anywhere(v, 600) for v in problem.views], problem.unknowns)
    reached = {solution.groups.ids[j] for j in solution.groups.base}
    return whole, [whole.name(k) for k in range(whole.rank) if whole.ids[whole.base[k]] not in reached]


def looked_over(fit: Fit) -> Fit:
    """The fit with notes on groups that its poses do not identify and on an implausible declared uncertainty.

    Raises
    ------
    InputError
        No group is identifiable, the declared uncertainty is beyond the machine's size, or the misfit is too large for
        this machine.
    """
    before, after = (float(np.median(np.linalg.norm(r, axis=1))) for r in (fit.nominal_residuals, fit.residuals))
    other = (
        before > FOREIGN_MACHINE_SHARE * fit.chain.size and after > UNEXPLAINED_SHARE * before
    )  # nan where rows measured one component
    if other or (not fit.solution.groups.rank and another(fit.chain, fit.nominal)):
        raise InputError(str(fit.survey.source), "no parameter can be identified", far_off(fit.nominal))
    check_readings(fit)
    check_declared(fit)
    if not fit.problem.unknowns:
        found = "no parameter can be identified: machine.yaml declares no errors and the measuring frame is fixed"
        raise InputError(str(fit.survey.source), found, "Declare errors of shapes and joints in machine.yaml")
    if not fit.solution.groups.rank:
        found = "no parameter can be identified: nothing of what was measured depends on one"
        raise InputError(str(fit.survey.source), found, "Measure all over the travels, as `errormodel plan` says")
    fit = replace(
        fit,
        notes=(
            *fit.notes, *noise_notes(fit), *_of_instrument(fit), *contradictions(fit), *_beside(fit), *_wild(fit),
            *large_scales(fit),
        ),
    )  # fmt: skip
    volumetric = any(v.of_tool for v in fit.problem.views)  # who reads one joint means no other
    lost = out_of_reach(fit.problem, fit.solution)[1] if volumetric else []
    if not lost:
        return fit
    more = f" and {len(lost) - 3} more" if len(lost) > 3 else ""
    several = f"{len(lost)} groups" if len(lost) > 1 else "a group"
    short = [
        f"{j.name} covers {100 * share:.0f} %"
        for j in fit.chain.machine.joints
        if (share := float(np.ptp(fit.survey.table[j.name].dropna())) / (j.travel[1] - j.travel[0]))
        < COVERED_TRAVEL_SHARE
    ]
    where = f" ({', '.join(short)} of its travel)" if short else ""
    note = (
        f"rank-deficient: {several} of parameters that poses all over the travels would identify cannot be "
        f"distinguished from others here{where}: {', '.join(lost[:3])}{more}. Predictions away from these poses "
        "count that as unknown. Measure where the joints have not been (`errormodel plan`), or declare "
        "fewer errors in machine.yaml"
    )
    return replace(fit, notes=(*fit.notes, note))


def check_declared(fit: Fit) -> None:
    """Raise InputError where coordinates are declared less certain, in all rows, than the machine is large."""
    largest = [float(np.abs(v.whitener).max(initial=0.0)) for v in fit.problem.views if v.kind == "position"]
    if "position" in fit.solution.declared and 0.0 < max(largest, default=0.0) <= 1 / fit.chain.size:
        found = (
            f"the declared standard uncertainty of a coordinate is {1 / max(largest):.3g} mm in the best row, beyond "
            f"the machine's size ({fit.chain.size:.0f} mm): no parameter can be identified"
        )
        raise InputError(str(fit.survey.source), found, "Check the unit of sigma, or of the instrument (mm; k = 1)")


def check_readings(fit: Fit) -> None:
    """Raise InputError where readings lie further beside the nominal machine, or the fit, than errors of one go."""
    if fit.readings is None:
        return
    refuse_far_readings(fit.chain, fit.survey, fit.readings.nominal)
    _refuse_contradiction(fit, observed(fit.survey.table))


def refuse_far_readings(chain: Chain, survey: Survey, nominal: Array) -> None:
    """Raise InputError where single readings lie further beside the nominal machine than errors of a machine go.

    Parameters
    ----------
    nominal : (rows,) readings less those of a machine without errors whose set-ups fit them best, mm or rad; or NaN.
    """
    names = observed(survey.table)
    for label, observation in survey.observations.items():
        length = observation.reading == "length"
        limit = FOREIGN_MACHINE_SHARE * (chain.size if length else 1.0)
        gaps = np.abs(nominal[(names == label) & np.isfinite(nominal)])
        if not len(gaps) or np.median(gaps) < limit:
            continue
        size = f"{np.median(gaps):.3g} {'mm' if length else 'rad'}"
        found = (
            f"half of the readings of '{label}' lie more than {size} beside the nominal machine, however it is set up"
        )
        cure = (
            "Errors of a machine go less far: look for a wrong unit, sign, column, tool, known number of that "
            "observation, or type"
        )
        if not length:
            cure += ". A column angle is in rad unless units: {reading: arcsec} says another"
        raise InputError(f"{survey.source}, observation {label}", found, cure)


def _refuse_contradiction(fit: Fit, names: Array) -> None:
    """InputError where the fit takes some readings far from a machine that they fit, for others that lie beside it."""
    assert fit.readings is not None
    sizes: dict[str, tuple[float, float]] = {}
    for label, observation in fit.survey.observations.items():
        nominal, fitted = (r[(names == label) & np.isfinite(r)] for r in (fit.readings.nominal, fit.readings.fitted))
        if observation.reading == "length" and len(fitted):
            sizes[label] = float(np.sqrt(np.mean(nominal**2))), float(np.sqrt(np.mean(fitted**2)))
    worse = [k for k, (a, b) in sizes.items() if b > max(WILD * a, MACHINE_ERROR_SHARE * fit.chain.size)]
    if not worse:
        return
    wrong, lost = max(sizes, key=lambda k: sizes[k][0]), max(worse, key=lambda k: sizes[k][1])
    cause = "the rest of the survey"
    if wrong != lost:
        cause = f"those of '{wrong}', which lie {sizes[wrong][0]:.3g} mm beside it"
    raise InputError(
        f"{fit.survey.source}, observation {lost}",
        f"its readings lie {sizes[lost][0]:.2g} mm rms beside the nominal machine, and {sizes[lost][1]:.3g} mm beside "
        f"the fit, for {cause}: no machine has both",
        "Look for a wrong command, unit, tool, or known number there",
    )


def contradictions(fit: Fit) -> Iterator[str]:
    """What fits the machine without errors clearly better than the fitted one: the rest of the survey is against it.

    The likelihoods of normal readings are compared, each with the noise that these residuals show.
    """
    every = list[tuple[str, ReadingErrors | MotionErrors]]()
    if fit.readings is not None:
        every += [(e.observation, e) for e in fit.readings.errors(fit.survey)]
    if fit.motions is not None:
        every += [(e.symbol, e) for e in fit.motions.errors(fit.survey)]
    worse = list[tuple[str, ReadingErrors | MotionErrors]]()
    for name, e in every:
        ratio = (e.fitted / max(e.nominal, 1e3 * EXACT_MM)) ** 2
        clear = ratio > BETTER_VARIANCE and e.n * np.log(ratio) / 2 > np.log(BETTER_ODDS)
        if clear and e.fitted > 1e3 * FINEST_MM:
            worse.append((name, e))
    if not worse:
        return
    name, first = worse[0]
    others = ", ".join(f"{n} ({e.nominal:.3g} {e.unit}, {e.fitted:.3g})" for n, e in worse[1:])
    cause, where = "the rest of the survey", "there and in the rest"
    most = _most_misfit(fit)
    if most and most[0] not in dict(worse):
        own, where = dict(every)[most[0]], f"in {most[0]} first"
        cause = f"those of {most[0]} ({own.nominal:.3g} {own.unit} rms beside the former, {own.fitted:.3g} the latter)"
    yield (
        f"readings of {name} fit the machine without errors better ({first.nominal:.3g} {first.unit} rms) than the "
        f"fitted one ({first.fitted:.3g}){f', so do those of {others}' if others else ''}; the fit contradicts them "
        f"for {cause}: look for a wrong unit, sign, temperature or known number, {where}, and for an effect that the "
        "machine lacks"
    )


def _most_misfit(fit: Fit) -> tuple[str, float] | None:
    """As of `Readings.most_misfit`."""
    s = fit.solution
    return fit.readings.most_misfit(fit.problem.readings, s.sigma, s.chi2) if fit.readings else None


def noise_notes(fit: Fit) -> Iterator[str]:
    """Notes on a declared uncertainty that the residuals contradict, and on noise below what instruments resolve."""
    s = fit.solution
    for kind, sigma in s.sigma.items():
        if kind == "displacement" and kind not in s.declared and EXACT_MM < sigma < FINEST_MM and s.dof > FEW_DOF:
            yield (
                f"noise of a reading of {1e6 * sigma:.2g} nm, {kind}: no instrument repeats to that. Check the unit of "
                "the readings (units of survey.yaml)"
            )
    yield from _far_within_declared(fit)
    if not fit.declared or s.dof <= 0 or s.chi2 <= 0:
        return
    from scipy.special import chdtr

    ratio = float(np.sqrt(s.chi2 / s.dof))
    unit = (
        " sigma of a survey is in mm (rad for angles): look for another unit"
        if max(ratio, 1 / ratio) > WRONG_UNIT_FACTOR
        else ""
    )
    if ratio > WRONG_UNIT_FACTOR:
        most = _most_misfit(fit)
        above = f", those of {most[0]} {most[1]:.3g} times" if most else ""
        yield f"the residuals are {ratio:.3g} times as large as the declared uncertainty{above}.{unit}"
    elif s.dof >= FEW_DOF and chdtr(s.dof, CAUTIOUS_DECLARATION_FACTOR**2 * s.chi2) < BY_CHANCE:
        yield (
            f"{_seen(fit, ratio)}the declared uncertainty is {1 / ratio:.3g} times as large as the residuals show, and "
            f"standard uncertainties follow what is declared.{unit}"
        )


def _far_within_declared(fit: Fit) -> Iterator[str]:
    """Notes on observations whose readings lie far closer to the fit than their declared uncertainty lets them."""
    own: dict[str, list[Array]] = {}
    if fit.readings is None:
        return
    for group in groups(fit.survey.table, fit.survey.observations):
        if group.sigma is not None:
            own.setdefault(group.label, []).append(fit.readings.fitted[group.index] / group.sigma)
    for label, parts in own.items():
        all_of = np.concatenate(parts)
        size = float(np.sqrt(np.nanmean(np.square(all_of)))) if np.isfinite(all_of).sum() > FEW_DOF else 1.0
        if size < 1 / WRONG_UNIT_FACTOR:
            yield (
                f"readings of {label} lie within {size:.1g} of their declared standard uncertainty of the fit: they "
                "hardly change, in the unit that is assumed (mm, rad). Check the unit of the readings (units of "
                "survey.yaml), or of sigma"
            )


def times_usual(fit: Fit) -> float:
    """The noise of a coordinate, in what instruments of this type make; 0 where it is stated, or nothing is usual."""
    seen = np.isfinite(fit.survey.measured).any(axis=1)
    usual = fit.survey.instrument.usual_sigma(fit.survey.measured[seen])
    if usual is None or fit.survey.instrument.stated or "position" in fit.declared or fit.solution.dof < FEW_DOF:
        return 0.0
    return fit.sigma_mm / usual


def beside_usual(fit: Fit, times: float) -> str:
    """What a noise so many times the usual one of the instrument means."""
    return (
        f"the noise of a coordinate, {1e3 * fit.sigma_mm:.3g} um, is {times:.2g} times what a "
        f"{fit.survey.instrument.type} makes at most ({1e3 * fit.sigma_mm / times:.3g} um): either the machine "
        "does not repeat better, or something is left out: an effect, a target or tool that lies elsewhere, a wrong "
        "time or temperature"
    )


def _of_instrument(fit: Fit) -> Iterator[str]:
    times = times_usual(fit)
    if times > BEYOND_INSTRUMENT:
        yield f"{beside_usual(fit, times)}. `errormodel diagnose` looks for it"


def _seen(fit: Fit, ratio: float) -> str:
    """The noise of a coordinate as declared and as seen, where nothing else was measured."""
    if {*fit.solution.sums} != {"position"}:
        return ""
    return f"declared {1e3 * fit.sigma_mm / ratio:.3g} um, seen {1e3 * fit.sigma_mm:.3g} um: "


def _beside(fit: Fit) -> Iterator[str]:
    """A note where one offset of all points explains more than the fit: the target, or the frame, is elsewhere."""
    seen = np.isfinite(fit.nominal_residuals).all(axis=1)
    if fit.survey.frame != "fixed" or seen.sum() < FEW_DOF:
        return
    nominal, left = fit.nominal_residuals[seen], fit.residuals[seen]
    shift = nominal.mean(axis=0)
    with_offset, fitted = (float(np.sqrt(np.nanmean(np.square(r).sum(axis=1)))) for r in (nominal - shift, left))
    if fitted < 1e-9 * fit.chain.size or with_offset > CONSTANT * fitted:
        return
    x, y, z = shift
    yield (
        f"frame: fixed, and the points lie {x:.3f}, {y:.3f}, {z:.3f} mm (x, y, z) beside the nominal ones on average: "
        f"this offset alone leaves {1e3 * with_offset:.3g} um rms, the fit {1e3 * fitted:.3g}. Check where the target "
        "and the origin are taken to be, or say frame: shared"
    )


def _wild(fit: Fit) -> Iterator[str]:
    """A note on rows far beside the fit, which their weight draws to them; a robust fit leaves them out and says so."""
    distance = np.linalg.norm(np.nan_to_num(fit.residuals), axis=1)
    seen = np.isfinite(fit.residuals).any(axis=1)
    if fit.sorting is not None or not seen.any():
        return
    usual = float(np.quantile(distance[seen], 0.8))
    wild = np.flatnonzero(distance > max(WILD * usual, 1e-9 * fit.chain.size))
    if len(wild):
        table = fit.survey.table.iloc[wild]
        first = table[["file", "row"]].head(MOST_NAMED)
        rows = ", ".join(f"{file} row {row}" for file, row in first.itertuples(index=False))
        more = ", ..." * (len(wild) > MOST_NAMED)
        yield (
            f"far beside the fit: {rows}{more}, up to {distance[wild].max():.3g} mm, where four of five rows "
            f"are within {usual:.2g} mm. They draw the fit to them: look at them, leave their mx my mz empty, or fit "
            "with --robust"
        )


def another(chain: Chain, nominal: Spread) -> bool:
    """Whether the rms misfit to the nominal machine is too large for error motions of this machine."""
    return bool(nominal.n) and 1e-3 * nominal.rms_um > FOREIGN_MACHINE_SHARE * chain.size


def far_off(nominal: Spread, *, tried: bool = False) -> str:
    """Message to the user: the misfit, and mistakes that cause such a misfit, which were `tried` or may be."""
    known = "usual ones alone do not put it right" if tried else "`errormodel diagnose` tries these"
    return (
        f"What was measured lies {1e-3 * nominal.rms_um:.3g} mm rms beside the nominal machine, further than errors of "
        "a machine go: look for a wrong unit (degrees or radians), sign, column, tool or machine; "
        f"{known}. {ONLY_SERIAL}"
    )
