"""Anisotropic noise of an undeclared laser tracker, by maximum likelihood from the residuals.

Residuals along a tracker's line of sight and across it differ. The station and the growth of both noises with the
distance are estimated once the best candidates are fitted: an effect that moves one axis would look like noise in it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array
from errormodel.instruments.laser_tracker import LaserTracker
from errormodel.instruments.plain import Plain
from errormodel.survey import Survey
from errormodel.surveys.columns import SIGMA_COLUMNS
from identification.diagnosis.decisions.constants import MISFIT_RATIO
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.residual_rows import by_rows, unwhitened
from identification.diagnosis.search.candidates import Candidates
from identification.diagnosis.search.scoring import DETECT
from identification.estimation.noise import is_round_off
from identification.estimation.result import Fit
from identification.observation.models import PositionView

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult

FEWEST = 60  # points with three components
MOST = 12  # proposals that are taken out first: what so many do not explain is not yet noise
CLEAR = 25.0  # log-likelihood ratio: seven parameters gain 3 to 4 by chance, 10 in noise with heavy tails
NEAREST, FARTHEST = 1e-3, 30.0  # of the points' extent: how far the instrument may be from their middle, and deviations
AWAY = 0.7  # of the extent: where stations are looked for first, all round
ON_PRINCIPAL_AXIS = (1.0, 3.0)  # of the extent: the same along that with the least variance
FAR = 2.5  # times the median length: residuals in a tail count as one there, or few would say where the tracker is
# no tracker measures nearer than its own head is wide; a station among the points would fit each row's own noise
CLOSEST_MM = 50.0
ORIGIN = 4.0  # log-likelihood that a station off the origin must gain: coordinates are usually the tracker's own
SHOWS = 0.01  # of the noise along the line of sight: a part of it that is smaller changes it by 5e-5, and is none
LEAST = 0.1  # of the noise: what a target's seat has in any case


def tracker_noise(
    fit: Fit, linear: LinearModel, candidates: Candidates, survey: Survey, log: DecisionLog = UNRECORDED
) -> Survey | None:
    """The survey as a tracker's, weighed by what its residuals show of it; None where they show none, or it is known.

    None as well where they are not noise yet: an arm's joints, each with a curve of its own, leave more than that.

    Parameters
    ----------
    linear, candidates : of the fit; what explains the residuals best is taken out of them, whatever its name.
    """
    named = survey.instrument.stated or not isinstance(survey.instrument, LaserTracker | Plain)
    if named or any(name in survey.table for name in SIGMA_COLUMNS):
        log.add("points-for-noise", "passed", "instrument", beside="the survey names the instrument or its uncertainty")
        return None
    if "position" not in fit.solution.sigma:
        log.add("points-for-noise", "passed", "instrument", beside="no point was measured")
        return None
    if is_round_off(fit.chain, fit.solution.sigma["position"]):
        log.add("points-for-noise", "passed", "instrument", beside="the residuals are round-off")
        return None
    cleared = _noise(fit, linear, candidates, log)
    if cleared is None:
        return None
    points, residuals = cleared
    tracker = seen_in(points, residuals, log)
    if tracker is None:
        return None
    covariance = tracker.covariance(points)
    assert covariance is not None
    mean = float(np.sqrt(np.trace(covariance.mean(axis=0)) / 3))
    relative = _tracker(tracker.station, _sizes(tracker) / mean)
    return replace(survey, instrument=relative, sized=False, notes=(*survey.notes, noise_note(tracker, points)))


def weighed_as_before(survey: Survey, seen: Survey, given: Survey) -> Survey:
    """A survey that was `seen` as a tracker's with the noise that was `given`, since more is known of its rows."""
    more = tuple(note for note in survey.notes if note not in seen.notes)
    return replace(survey, instrument=given.instrument, sized=given.sized, notes=(*given.notes, *more))


def line_of_sight(fit: Fit, linear: LinearModel, candidates: Candidates, log: DecisionLog = UNRECORDED) -> bool:
    """Whether the residuals still show a line of sight beside what was found; as before where they are not noise."""
    cleared = _noise(fit, linear, candidates, log)
    return cleared is None or seen_in(*cleared, log) is not None


def _noise(fit: Fit, linear: LinearModel, candidates: Candidates, log: DecisionLog) -> tuple[Array, Array] | None:
    """Points and residuals (n, 3) without what the candidates explain, mm in the axes of their measuring frame.

    None where too much explains them, or there are too few points.
    """
    cleared = _cleared(linear, candidates)
    if cleared is None:
        log.add("residuals-are-noise", "refused", "instrument", MOST, MOST)
        return None
    parts = [*_triples(fit, cleared)]
    points, residuals = (np.vstack(p) for p in zip(*parts, strict=True)) if parts else (np.empty((0, 3)),) * 2
    if len(points) < FEWEST:
        log.add("points-for-noise", "refused", "instrument", len(points), FEWEST)
        return None
    return points, residuals * fit.solution.sigma["position"]


def _cleared(linear: LinearModel, candidates: Candidates) -> LinearModel | None:
    """The linear model with proposals added until there is evidence for no more; None where there always is."""
    for _ in range(MOST):
        ranked = candidates.scores(linear).by_key()
        if not ranked or ranked[0][0] - np.log(len(ranked)) < DETECT:
            return linear
        linear = linear.with_effect(candidates.effects[ranked[0][1]])
    return None


def _triples(fit: Fit, linear: LinearModel) -> Iterator[tuple[Array, Array]]:
    """Points and residuals (m, 3) in the axes of their measuring frame, of rows with three components.

    In units of the fit's standard uncertainty.
    """
    for part, white in by_rows(fit, linear, linear.residual[: len(linear.index)]):
        if not isinstance(part, PositionView):
            continue
        whole = np.isfinite(white).all(axis=1)
        # rows that are weighed alike are so in the reference's axes
        turn = part.pose.rotation.T if part.whitener.ndim == 1 else np.eye(3)
        yield part.measured[whole], unwhitened(part, white)[whole] @ turn


def seen_in(points: Array, residuals: Array, log: DecisionLog = UNRECORDED) -> LaserTracker | None:
    """The tracker that residuals (n, 3) at points (n, 3) show, mm in the measuring frame; None where they show none.

    By likelihood against noise that is equal in all directions.
    """
    from scipy.optimize import minimize

    middle, extent = points.mean(axis=0), float(np.linalg.norm(np.ptp(points, axis=0)))
    length = np.linalg.norm(residuals, axis=1)
    farthest = FAR * float(np.median(length))
    if not extent or not farthest:
        return None
    residuals = residuals * (farthest / np.maximum(length, farthest))[:, None]
    noise = float(np.sqrt(np.mean(residuals**2)))
    data = (points - middle) / extent, residuals / noise
    floor, ceiling = 2 * np.log(LEAST), 2 * np.log(FARTHEST)
    bounds = [(-FARTHEST, FARTHEST)] * 3 + [(floor, ceiling)] + [(2 * np.log(NEAREST), ceiling)] * 3

    def likeliest(at: Array, bounds: list[tuple[float, float]]) -> OptimizeResult:
        return minimize(_minus, [*at, -1.0, -1.0, 0.0, 0.0], data, "L-BFGS-B", jac=True, bounds=bounds)

    def possible(found: OptimizeResult) -> bool:
        away = extent * float(np.linalg.norm(data[0] - found.x[:3], axis=1).min())
        return away > CLOSEST_MM and residuals.size / 2 - float(found.fun) > CLEAR

    axis = np.linalg.eigh(data[1].T @ data[1])[1][:, 0]  # a tracker's range has the least variance
    starts = [AWAY * np.array(d) for d in product((-1, 1), repeat=3)]
    starts += [side * far * axis for side, far in product((-1, 1), ON_PRINCIPAL_AXIS)]
    tried = [likeliest(start, bounds) for start in starts]
    best = min(filter(possible, tried), key=lambda f: f.fun, default=None)
    gained = residuals.size / 2 - float(min(tried if best is None else [best], key=lambda f: f.fun).fun)
    log.add("line-of-sight", "passed" if best is None else "found", "instrument", gained, CLEAR)
    if best is None:
        return None
    origin = -middle / extent
    usual = likeliest(origin, [*((float(x), float(x)) for x in origin), *bounds[3:]])
    best = usual if possible(usual) and usual.fun < best.fun + ORIGIN else best
    target, *others = noise * np.exp(best.x[3:] / 2) / [1, 1, extent, extent]
    tracker = _tracker(middle + extent * best.x[:3], [*others, target])
    along, across = _along_and_across(tracker, _away(tracker, points))
    if along < across:
        return tracker
    # the angles of trackers are worse than their range; a motion that varies is as large along one direction
    beyond = residuals.size / 2 - float(best.fun) - gain_of_covariance(residuals)
    turns = beyond > DETECT
    log.add("one-direction-instead", "found" if turns else "refused", "instrument", beyond, DETECT)
    return tracker if turns else None


def gain_of_covariance(residuals: Array) -> float:
    """Log likelihood ratio of residuals (n, 3) with one covariance to such with equal variances."""
    covariance = residuals.T @ residuals / len(residuals)
    equal = float(np.trace(covariance)) / len(covariance)
    determinant = float(np.linalg.slogdet(covariance)[1])
    return len(residuals) / 2 * (len(covariance) * float(np.log(equal)) - determinant)


def _tracker(station: Iterable[float], uncertainties: Iterable[float]) -> LaserTracker:
    """A tracker by its two of the range, its angle's and its target's, in any unit, to four figures."""
    fixed, growing, angle, target = (float(f"{x:.4g}") for x in uncertainties)
    at = [float(f"{x:.6g}") for x in station]
    return LaserTracker(station=at, range=[fixed, growing], angle=angle, target=target)


def _away(tracker: LaserTracker, points: Array) -> float:
    """Root mean square distance of points (n, 3) from a tracker."""
    return float(np.sqrt(np.mean(np.sum((points - tracker.station) ** 2, axis=1))))


def _along_and_across(tracker: LaserTracker, away: float) -> tuple[float, float]:
    """Standard uncertainty of points so far away (mm) along the line of sight and across it, one coordinate."""
    fixed, growing, angle, target = _sizes(tracker)
    return float(np.hypot(target, np.hypot(fixed, growing * away))), float(np.hypot(target, angle * away))


def noise_note(tracker: LaserTracker, points: Array) -> str:
    """What the noise is that was found, and what to write of the instrument: to 0.1 mm, and to three figures."""
    away = _away(tracker, points)
    along, across = _along_and_across(tracker, away)
    fixed, growing, angle, target = _sizes(tracker)
    sizes = {"fixed": fixed, "growing": growing * away, "target": target}  # mm, at the points
    seen = {name: size > SHOWS * along for name, size in sizes.items()}
    seen[max(("fixed", "growing"), key=sizes.__getitem__)] = True  # a range without any is none
    own = f"range: [{fixed * seen['fixed']:.3g}, {growing * seen['growing']:.3g}], angle: {angle:.3g}, "
    own += f"target: {target * seen['target']:.3g}"
    station = ", ".join(f"{round(x, 1) + 0.0:.1f}".removesuffix(".0") for x in tracker.station)
    block = f"instrument: {{type: {tracker.type}, station: [{station}], {own}}}"
    return (
        f"the residuals are those of an instrument with a line of sight: {1e3 * along:.3g} um along it and "
        f"{1e3 * across:.3g} um across, {away:.0f} mm away. Rows are weighed by that. If it was a tracker, survey.yaml "
        f"may say so: `{block}`, better with its maker's figures"
    )


def _minus(x: Array, places: Array, noise: Array) -> tuple[float, Array]:
    """Minus the log likelihood, up to a constant, and its gradient.

    `x` is the station and the logarithms of variances: of the target, of the range at the station and its growth with
    the distance, and of the angles' growth.
    """
    sight = places - x[:3]
    away = np.einsum("ni,ni->n", sight, sight) + 1e-12
    target, fixed, growing, angle = np.exp(x[3:])
    along, across = target + fixed + growing * away, target + angle * away
    dot = np.einsum("ni,ni->n", noise, sight)
    own = dot**2 / away
    rest = np.einsum("ni,ni->n", noise, noise) - own
    value = 0.5 * float(np.sum(own / along + rest / across + np.log(along) + 2 * np.log(across)))
    by_along, by_across = 0.5 * (1 / along - own / along**2), 0.5 * (2 / across - rest / across**2)
    by_own = 0.5 * (1 / along - 1 / across)
    by_away = by_along * growing + by_across * angle
    by_station = -2 * (by_away @ sight)
    by_station += (by_own * -2 * dot / away) @ noise + (by_own * 2 * dot**2 / away**2) @ sight
    logs = [
        target * float(np.sum(by_along + by_across)),
        fixed * float(np.sum(by_along)),
        growing * float(by_along @ away),
        angle * float(by_across @ away),
    ]
    return value, np.array([*by_station, *logs])


def _sizes(tracker: LaserTracker) -> Array:
    """Standard uncertainties (4,) of the range, in mm and mm/mm, the angle, rad, and the target, mm."""
    return np.array([*(tracker.range or (0.0, 0.0)), tracker.angle or 0.0, tracker.target])


def station_notes(fit: Fit, log: DecisionLog = UNRECORDED) -> Iterator[str]:
    """A note where residuals fit a declared station better if it is taken as a point of the machine's reference."""
    tracker = fit.survey.instrument
    stated = tracker.stated and fit.survey.sized  # else it was found in the residuals
    if not isinstance(tracker, LaserTracker) or not stated or len(fit.problem.frames) != 1:
        return
    (pose,) = fit.problem.frames.values()
    points, residuals = fit.survey.measured, fit.residuals
    whole = np.isfinite(points).all(axis=1) & np.isfinite(residuals).all(axis=1)
    moved = pose.apply(np.array([tracker.station]))[0]
    if whole.sum() < FEWEST:
        return
    other = tracker.model_copy(update={"station": tuple(float(x) for x in moved)})
    (declared, _), (turned, size) = (_log_likelihood(t, points[whole], residuals[whole]) for t in (tracker, other))
    # what is more than the noise of the other station has another cause, and its directions say nothing
    found = turned - declared > CLEAR and size < MISFIT_RATIO
    log.add("declared-station", "found" if found else "passed", "instrument", turned - declared, CLEAR)
    if found:
        x, y, z = np.round(moved, 1)
        yield (
            f"instrument.station: the residuals are those of a station at [{x:g}, {y:g}, {z:g}] of the measuring "
            "frame, where the stated one lies if it is a point of the machine. Write it in the measuring frame"
        )


def _log_likelihood(tracker: LaserTracker, points: Array, residuals: Array) -> tuple[float, float]:
    """Of residuals (n, 3), with the size of the noise estimated from them; and that variance over the declared one."""
    covariance = tracker.covariance(points)
    assert covariance is not None
    square = float(np.einsum("ni,nij,nj->", residuals, np.linalg.inv(covariance), residuals))
    likelihood = -residuals.size / 2 * float(np.log(square)) - 0.5 * float(np.linalg.slogdet(covariance)[1].sum())
    return likelihood, square / residuals.size
