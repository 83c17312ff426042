"""The verdict of a diagnosis: lack-of-fit test of the final residuals against repeats or the declared uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.diagnosis.data_checks.blunder import listed
from identification.diagnosis.decisions.constants import LEAST_P_VALUE, MISFIT_RATIO
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog, Outcome
from identification.diagnosis.linear.row_residuals import spread, vectors
from identification.diagnosis.results.pure_error import Repeats, repeats_of, whitened
from identification.diagnosis.results.residual_dependence import Dependence
from identification.diagnosis.results.wandering import wandering_text
from identification.estimation.checks import BEYOND_INSTRUMENT, FEW_DOF, beside_usual, contradictions, times_usual
from identification.estimation.result import Beyond, Fit, noise_bounds
from identification.results.terminal import counted

BINS = 8  # of each channel, in which to look for where most is left over
LEAST_ROWS = 12  # of a bin
NOT_JUDGED = "not judged"
AT_ONE_POSE = "no joint moved between the rows: they say nothing of the machine's error motions"
FAR = 8.0  # times the median size of all rows: Gaussian noise never gets there
FEW, MUCH = 0.05, 0.2  # of the rows, and of their sum of squares: rows so far out that are to be named
CLEAR = 4.0  # standard deviations by which a bin must stand out to be named


@dataclass(frozen=True)
class Verdict:
    """The contract's word, what is left over (None: nothing), what to say of the noise, and how much is beyond it, um.

    The last is the standard deviation of a coordinate: what exceeds repeats or the declared uncertainty, or what
    depends on anything recorded, whichever is larger; `systematic_by` is by what that is known. What exceeds a
    declared uncertainty, and nothing recorded predicts, may be scatter of each row.
    """

    word: str
    unexplained: str | None
    notes: tuple[str, ...] = ()
    systematic_um: float = 0.0
    systematic_by: Beyond | None = None


def judge(final: Fit, found: bool, dependence: Dependence | None = None, log: DecisionLog = UNRECORDED) -> Verdict:
    """The verdict on a fit, after `found` something or nothing.

    Misfit is what exceeds the scatter of repeated poses; without repeats, what exceeds a declared uncertainty; what
    depends on anything recorded; and what wanders along the rows. Other noise that depends on nothing recorded is not
    distinguished from a cause that was not. Observations that the machine without errors fits better contradict others.
    With fewer than `FEW_DOF` degrees of freedom it is not judged: residuals are as small by chance.
    """
    s = final.solution
    repeats = repeats_of(final)
    notes = [r.text for r in repeats]
    reason, ratio = "", 1.0  # of the variance that is left to what the noise lets expect
    declared = _exceeds_declared(final)
    for r in repeats:
        word: Outcome = "found" if r.misfit else "passed"
        rows = f"residuals of {r.observation}" if r.observation else "residuals"
        log.add("lack-of-fit-by-repeats", word, rows, r.ratio, MISFIT_RATIO, beside=f"p = {r.p_value:.2g}")
    misfits = [r for r in repeats if r.misfit]
    if not repeats and _declared(final) and s.dof > 0:
        word = "found" if declared else "passed"
        log.add("lack-of-fit-by-declared-uncertainty", word, "residuals", s.chi2 / s.dof, MISFIT_RATIO)
    if misfits:
        ratio = max((r.ratio for r in misfits if r.points), default=1.0)
        reason = "; ".join(map(_beside_repeats, misfits))
    elif repeats and declared:
        notes.append(
            f"the declared uncertainty is too small by a factor of {np.sqrt(s.chi2 / s.dof):.2f}: repeated poses "
            "scatter as much as the residuals"
        )
    elif declared:
        ratio = s.chi2 / s.dof
        reason = f"{_length(final):.1f} um rms where {_beside_declared(final, float(np.sqrt(ratio)))}"
    elif not repeats and (times := times_usual(final)) > 0:
        beyond = times > BEYOND_INSTRUMENT
        word, limit = "found" if beyond else "passed", BEYOND_INSTRUMENT**2
        log.add("lack-of-fit-by-declared-uncertainty", word, "residuals", times**2, limit, beside="of its type")
        reason = beside_usual(final, times) if beyond else ""
    if not found and _at_one_pose(final):
        notes.append(AT_ONE_POSE)
    wanders = wandering_text(final, log)
    few = "" if reason or s.dof >= FEW_DOF else _few(final)
    if few:
        log.add("few-degrees-of-freedom", "found", "residuals", s.dof, FEW_DOF)
    against = list(contradictions(final))
    if final.readings is not None:
        log.add("fit-worse-than-nominal", "found" if against else "passed", "residuals", len(against), 0)
    if not (reason or against or wanders or few) and dependence is None:
        return Verdict("explained" if found else "adequate", None, tuple(notes))
    points = final.fitted.n > 0
    text = f"{reason}; {largest(final)}" if reason else ""
    depends = ""
    if dependence is not None:  # what wanders too asks for the same measurement
        depends = dependence.statement if dependence.next_measurement in wanders else dependence.text
    text = "; ".join(filter(None, (text, *against, depends, wanders, few)))
    excess = _length(final) * float(np.sqrt(1 - 1 / ratio)) if points else 0.0
    systematic = max(excess, dependence.size_um if dependence else 0.0) / float(np.sqrt(3 if points else 1))
    by: Beyond = "repeats" if misfits else "recorded" if dependence is not None or wanders else "declared"
    verdict = "partly-explained" if found else "unexplained"
    return Verdict(verdict, text, tuple(notes), systematic, by if systematic else None)


def no_larger(dependence: Dependence | None, final: Fit) -> Dependence | None:
    """On what the rest depends, no larger than the rest: weighed by uncertainties a part may be more than the whole."""
    if dependence is None or not final.fitted.n:
        return dependence
    return replace(dependence, size_um=min(dependence.size_um, _length(final)))


def _beside_repeats(repeats: Repeats) -> str:
    """What is left beside what the scatter of repeated poses lets expect."""
    of = f" of {repeats.observation}" if repeats.observation else ""
    expected = repeats.left_um / float(np.sqrt(repeats.ratio))
    return f"{repeats.left_um:.1f} um rms{of} where repeated poses let expect {expected:.1f}"


def _few(fit: Fit) -> str:
    """That so few degrees of freedom do not tell noise from misfit, what they say of the noise, and what would do."""
    s, rows = fit.solution, max(len(fit.survey.fit), 1)
    count = sum(x.count for x in s.sums.values())
    low, high = (x * _length(fit) for x in noise_bounds(s.dof))
    more = int(np.ceil((FEW_DOF - s.dof) * rows / max(count, 1)))
    noise = f", by which the noise of a row is {low:.2g} to {high:.2g} um (95 %)" if s.dof > 0 else ""
    left = f"{counted(s.dof, 'degree')} of freedom"
    return (
        f"{NOT_JUDGED}: {count} measured values for {count - s.dof} unknowns leave {left}{noise}. "
        f"Measure at least {more} rows more like these, better {rows}, or declare fewer errors in machine.yaml"
    )


def _at_one_pose(fit: Fit) -> bool:
    """Whether all rows have the same command: no error motion and no cause that moves with a joint can show."""
    table = fit.survey.table
    names = [j.name for j in fit.chain.machine.joints]
    names += [f"from_{name}" for name in names]
    return all(table[name].nunique() <= 1 for name in names if name in table)


def largest(fit: Fit) -> str:
    """Where the residuals are largest, in words."""
    white, index, _ = whitened(fit)
    square = np.nanmean(white**2, axis=1)
    length = 1e3 * np.sqrt(np.nansum(vectors(fit)[index] ** 2, axis=1))
    table = fit.survey.table
    far = square > FAR**2 * np.nanmedian(square)
    held = float(square[far].sum() / max(square.sum(), 1e-300))
    if far.mean() <= FEW and held > MUCH:
        numbers = sorted(set(table["row"].to_numpy()[index[far]].tolist()))
        some = f"rows {listed(numbers)} hold" if len(numbers) > 1 else f"row {numbers[0]} holds"
        rms = float(np.sqrt(np.mean(length[far] ** 2)))
        return f"{some} {100 * held:.0f} % of the sum of its squares, with {rms:.1f} um rms"
    joints = {j.name: j for j in fit.chain.machine.joints}
    best, words = CLEAR, "it is spread evenly over positions and time"
    for name in (*joints, *(n for n in ("time",) if n in table)):
        values = table[name].to_numpy(dtype=np.float64)[index]
        edges = np.unique(np.quantile(values, np.linspace(0, 1, BINS + 1)))
        place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, max(len(edges) - 2, 0))
        for k in np.unique(place):
            here = place == k
            if here.sum() < LEAST_ROWS or here.all():
                continue
            error = np.sqrt(np.var(square) / here.sum())
            if (score := float((square[here].mean() - square.mean()) / max(error, 1e-300))) > best:
                factor, unit = (1.0, "s") if name == "time" else (1.0, "mm")
                if name in joints and joints[name].type == "rotary":
                    factor, unit = float(np.degrees(1.0)), "deg"
                low, high = factor * values[here].min(), factor * values[here].max()
                rms = float(np.sqrt(np.mean(length[here] ** 2)))
                what = "time" if name == "time" else f"{name} is"
                best, words = score, f"it is largest where {what} from {low:.5g} to {high:.5g} {unit} ({rms:.1f} um)"
    return words


def _exceeds_declared(fit: Fit) -> bool:
    from scipy.special import chdtrc

    s = fit.solution
    if not _declared(fit) or s.dof <= 0:
        return False
    return bool(chdtrc(s.dof, s.chi2) < LEAST_P_VALUE and s.chi2 / s.dof > MISFIT_RATIO)


def _declared(fit: Fit) -> bool:
    """Whether the uncertainty of points or readings is stated."""
    return bool(fit.declared & {"position", *(v.kind for v in fit.problem.readings)})


def _beside_declared(fit: Fit, times: float) -> str:
    """What the declared uncertainty lets expect of the rows' residuals, um, as the end of a sentence.

    Parameters
    ----------
    times : by which residuals exceed it, each direction weighed by its own.
    """
    variances = []
    for view in fit.problem.views:
        if view.whitener.ndim == 1 and view.kind == "position":
            variances.append(len(view.outputs) / np.square(view.whitener[view.whitener > 0]))
        elif view.kind == "position":
            whole = view.whitener[view.components.all(axis=1)]
            variances.append(np.square(np.linalg.inv(whole)).sum(axis=(1, 2)))
    every = np.concatenate([*variances, np.zeros(0)])
    expected = 1e3 * float(np.sqrt(np.mean(every))) if len(every) else _length(fit) / times
    if expected < _length(fit):
        return f"the declared uncertainty lets expect {expected:.1f}"
    return f"the declared uncertainty is exceeded by a factor of {times:.1f} in the directions in which it is small"


def _length(fit: Fit) -> float:
    """Root mean square of the rows' residuals, um, for the degrees of freedom that the fit has left."""
    s = fit.solution
    count = sum(x.count for x in s.sums.values())
    return spread(fit).rms_um * float(np.sqrt(count / max(s.dof, 1)))
