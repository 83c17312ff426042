"""Maximum-likelihood shape parameters (periods, time constants, exponents) of the best candidates, off their grids."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from errormodel.arrays import Array
from errormodel.effects.base import Effect
from identification.diagnosis.decisions.constants import ABSORBED, FORM_ABSORBED, LEAST_EVIDENCE
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog, Outcome
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search.blocks import NOTHING
from identification.diagnosis.search.candidates import Candidates, Scores, score_of
from identification.diagnosis.search.criteria import log_likelihood_gain, log_likelihood_gains
from identification.diagnosis.search.refinement import discrepancy
from identification.diagnosis.search.scoring import DECIMALS, Step

ROUNDED = 0.01  # log Bayes factor: round-off of scores from columns in single precision
MOMENTS = 20  # places of a sudden change that are tried at a time
MOST_TRIED = 60  # lags that did not begin in equilibrium
FIRST_STATES = -0.7, -0.25, 0.25, 0.7  # of them the departures from which the best is sought, in changes of the sensor
MAYBE = 0.5  # of the best evidence
OF_A_NAME = 3  # proposals of one name that are examined beside the first ones


def optimise_shapes(
    linear: LinearModel,
    candidates: Candidates,
    first: int,
    least: float = -np.inf,
    log: DecisionLog = UNRECORDED,
) -> list[Step]:
    """The best proposals with optimised shapes, as steps, given the linear model.

    Parameters
    ----------
    first : how many, at least.
    least : log Bayes factor; nothing is returned where no proposal has as much.
    """
    scores = candidates.scores(linear)
    ranked = scores.by_key()
    if not ranked or ranked[0][0] < least:
        _record(log, linear, scores, ranked, [], least)
        for evidence, n in ranked[:1]:
            log.add("least-evidence", "refused", candidates.effects[n], evidence, least)
        return []
    numbers = _shortlist(candidates, ranked, first)
    _record(log, linear, scores, ranked, numbers, least)
    counted, able = _places(candidates, ranked), list[Step]()
    for n in numbers:
        if (step := _optimised(candidates, scores, linear, n)) is not None:
            places = counted[step.effect.effect]
            able.append(replace(step, trials=len(ranked), names=len(candidates.places), places=places))
    for step in able:
        gain = log_likelihood_gain(linear, step.delta_chi2)
        log.add("optimised-score", "examined", step.effect, step.evidence, gain=gain)
        if initial := getattr(step.effect, "initial", 0.0):
            log.add("not-settled", "examined", step.effect, initial)
    return able


def _record(
    log: DecisionLog,
    linear: LinearModel,
    scores: Scores,
    ranked: Sequence[tuple[float, int]],
    numbers: Sequence[int],
    least: float,
) -> None:
    """Take down the scores of a round: in the first one of all candidates, later of those that were examined before."""
    if not log.recording:
        return
    candidates, examined, first = scores.candidates, set(numbers), not log.followed
    values = dict(zip((n for _, n in ranked), (e for e, _ in ranked), strict=True))
    last = min((values[n] for n in numbers), default=None)
    gains = log_likelihood_gains(linear, scores.delta_chi2[[n for _, n in ranked]]).tolist()
    for (evidence, n), gain in zip(ranked, gains, strict=True):
        key = candidates.keys[n]
        if first or evidence > 0 or n in examined or key in log.followed:
            word: Outcome = "examined" if n in examined else "scored"
            log.add("candidate-score", word, candidates.effects[n], evidence, last, gain=gain)
    enough = min(float(np.log(len(ranked))), least) if ranked else 0.0
    log.followed |= {candidates.keys[n] for e, n in ranked if n in examined or e > enough}
    if first:
        known = {candidates.keys[n] for n in values}
        for key, own in candidates.of_key.items():
            if key not in known:
                effect = candidates.effects[own[0]]
                limit = FORM_ABSORBED if effect.empirical else ABSORBED
                absorbed = float(scores.absorbed[own].min())
                log.add("collinear-with-geometry", "not considered", effect, absorbed, limit)


def _shortlist(candidates: Candidates, ranked: Sequence[tuple[float, int]], first: int) -> list[int]:
    """The first proposals, and the best of each further name that its discrepancy may yet make the better one.

    Of a name with several places or sensors the best of these on the grid need not be the best one off it.
    """
    out = [n for _, n in ranked[:first]]
    counted, best = Counter(candidates.effects[n].effect for n in out), dict[str, float]()
    for evidence, n in ranked[:first]:
        best.setdefault(candidates.effects[n].effect, evidence)
    for evidence, n in ranked[first:]:
        if evidence < MAYBE * ranked[0][0]:
            break
        effect = candidates.effects[n]
        most = 1 if effect.empirical else OF_A_NAME
        if counted[effect.effect] < most and evidence >= best.setdefault(effect.effect, evidence) - LEAST_EVIDENCE:
            counted[effect.effect] += 1
            out.append(n)
    return out


def _places(candidates: Candidates, ranked: Sequence[tuple[float, int]]) -> dict[str, float]:
    """At how many places each effect is proposed, for each that explains as much as the best.

    Of an effect that does the same at ten places of twenty the data do not tell where it is, but it is as likely as one
    that is proposed at two.
    """
    best, alike = dict[str, float](), dict[str, float]()
    for evidence, n in ranked:  # best first
        name = candidates.effects[n].effect
        first = best.setdefault(name, evidence)
        alike[name] = alike.get(name, 0.0) + float(np.exp(evidence - first))
    return {name: candidates.places[name] / share for name, share in alike.items()}


def _optimised(candidates: Candidates, scores: Scores, linear: LinearModel, number: int) -> Step | None:
    """The proposal at its best."""
    effect = candidates.effects[number]
    family = tuple(candidates.effects[n] for n in candidates.of_key[effect.key])
    evidence = float(scores.evidence[number])
    return linear.answer(lambda: optimised(linear, effect, family, evidence), (effect,), "optimised", family)


def optimised(linear: LinearModel, proposal: Effect, family: Sequence[Effect], evidence: float) -> Step | None:
    """A proposal with its shape parameters moved off the grid of its family to where they fit best.

    Parameters
    ----------
    evidence : of the proposal, as it was scored among all.
    """
    from scipy.optimize import minimize_scalar

    if proposal.random:  # a curve repeats with the wave that it refines: its size is all that is found
        return _of_likeliest_size(linear, proposal, len(family))
    effect, motion = proposal, getattr(proposal, "motion", None)
    alike = [e for e in family if getattr(e, "motion", None) == motion]  # one motion may have another grid
    for name, kind in type(effect).shapes().items():
        value = getattr(effect, name) if kind.searched else None
        if not isinstance(value, float) or value == 0:
            continue
        # of two waves at once only one may change at an edge
        grid = sorted({x for e in alike if isinstance(x := getattr(e, name), float)})
        edge = 0.3 * abs(value)
        below = max((g for g in grid if g < value and g != 0), default=value - edge)
        above = min((g for g in grid if g > value and g != 0), default=value + edge)
        lowest, highest = type(effect).bounds(name)
        below, above = max(below, lowest), min(above, highest)

        def left(x: Iterable[float], name: str = name, effect: Effect = effect) -> list[float]:
            return linear.squares_with([effect.model_copy(update={name: float(v)}) for v in x])

        if kind.sudden:
            best = moment_between(linear.channel(effect.drivers[0]), below, above, value, left)
        else:
            found = minimize_scalar(
                lambda x, left=left: left([x])[0], bounds=(below, above), method="bounded", options={"maxiter": 20}
            )
            best = float(found.x)
        at_best, at_value = left([best, value])
        if at_best < at_value:
            effect = effect.model_copy(update={name: best})
    step = scored(linear, effect, len(family))
    if step is None or evidence > step.evidence_of_textbook + np.log(len(family)) + ROUNDED:
        # where the squares are least a size may be beyond what is usual
        step = scored(linear, proposal, len(family))
    return step and _not_settled(linear, step, family)


def _not_settled(linear: LinearModel, step: Step, family: Sequence[Effect]) -> Step:
    """The step with a member that did not have its sensor's temperature in the first row, where that is likelier.

    Its lag may be any that is tried: in equilibrium another one, or none, may fit best. What fades more slowly is any
    drift. It differs by no more than the sensor changes in the recording: beyond that it has another cause.
    """
    from scipy.optimize import minimize

    effect = step.effect
    taus = {tau for e in (effect, *family) if (tau := getattr(e, "tau", 0.0))}
    if not taus or "initial" not in type(effect).model_fields or effect.random or not linear.scene.duration:
        return step
    swing = float(np.ptp(linear.channel(effect.drivers[0])))
    logs = np.log(sorted(taus))

    def at(x: Array) -> Effect:
        values = {"tau": float(f"{np.exp(x[0]):.6g}"), "initial": float(f"{x[1] * swing:.4g}")}
        return effect.model_copy(update=values)

    def left(x: Array) -> float:
        return linear.square_with(at(x))

    begun = [np.array([tau, part]) for tau in logs for part in FIRST_STATES]
    first = begun[int(np.argmin(linear.squares_with([at(x) for x in begun])))]
    corners = first + np.array([[0.0, 0.0], [-0.5 if first[0] > logs[0] else 0.5, 0.0], [0.0, 0.2]])
    found = minimize(
        left,
        first,
        method="Nelder-Mead",
        bounds=[(float(logs[0]), float(logs[-1])), (-1.0, 1.0)],
        options={"initial_simplex": corners, "maxfev": MOST_TRIED},
    )
    other = scored(linear, at(found.x), len(family))
    return other if other is not None and other.evidence_of_textbook > step.evidence_of_textbook else step


def moment_between(
    x: Array, below: float, above: float, value: float, left: Callable[[Sequence[float]], list[float]]
) -> float:
    """Of the places between two neighbouring values of a channel within bounds, the one where least is `left`.

    Of many, first of every so many; then of all between the best of these and its neighbours.
    """
    values = np.unique(x)
    places = (values[1:] + values[:-1]) / 2
    while len(places := places[(places > below) & (places < above)]):
        every = -(-len(places) // MOMENTS)
        some = places[::every]
        value = float(some[int(np.argmin(left(some.tolist())))])
        if every == 1:
            break
        n = int(np.searchsorted(places, value))
        below, above = float(places[max(n - every, 0)]), float(places[min(n + every, len(places) - 1)])
    return value


def _of_likeliest_size(linear: LinearModel, proposal: Effect, shapes: int) -> Step | None:
    """Random effects of their likeliest size, scored as by `scored`: any size has the same columns and evidence."""
    random = linear.random(linear.columns(proposal)[0])
    if not np.isfinite(random.whole) or random.whole <= NOTHING:
        return None
    ratio, evidence, noise = random.best()
    effect = proposal.model_copy(update={"size": float(f"{np.sqrt(ratio * noise):.3g}")})
    gained = random.freedom * (1 - noise * random.freedom / random.square)
    count = len(linear.columns(proposal)[1])
    evidence = round(evidence - effect.cost(linear.scene) - float(np.log(shapes)), DECIMALS)
    return Step(effect, evidence, gained, random.absorbed, count)


def scored(
    linear: LinearModel, effect: Effect, shapes: int, trials: int = 0, names: int = 1, places: float = 1.0
) -> Step | None:
    """An effect scored as a step, given the linear model; None where it moves nothing.

    Parameters
    ----------
    shapes : how many of its shapes were tried: divides its Bayes factor.
    trials : keys (effects at places) searched: the trials factor.
    names, places : of how many effects they are, and how many of them are this one (`_places`).
    """
    own = score_of(linear, effect)
    if own is None:
        return None
    evidence, delta_chi2, absorbed = own
    of_form, delta_of_form = discrepancy(linear, effect)
    return Step(
        effect,
        round(evidence + of_form - float(np.log(shapes)), DECIMALS),
        delta_chi2 + delta_of_form,
        absorbed,
        len(linear.columns(effect)[1]),
        evidence_of_form=of_form,
        trials=trials,
        names=names,
        places=places,
    )
