"""Contents of ``diagnosis.json`` (``docs/file_formats.md``, section 4), and the posterior probability of a name."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from errormodel.arrays import Array
from errormodel.conventions import Motion
from errormodel.effects import registry
from errormodel.effects.base import Effect
from identification.diagnosis.decisions.constants import CHOSEN, CLEARLY, DECISIVE_ODDS, UNKNOWN
from identification.diagnosis.decisions.log import DecisionLog, named
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.row_residuals import ReadingSizes
from identification.diagnosis.results.effect_size import Amount
from identification.diagnosis.results.residual_dependence import Dependence
from identification.diagnosis.search.scoring import Step, posterior
from identification.estimation.result import noise_bounds

SCHEMA = "errormodel.diagnosis/1"


@dataclass(frozen=True)
class Alternative:
    """Another explanation, and whether the data distinguish it.

    Attributes
    ----------
    log10_bayes_factor : by this data alone, against the finding.
    probability : of the same kind as the finding's, so that the two never add up to more than 1; None of the same
        effect at another place, of which the finding's probability says nothing.
    place_probability : of that place, given the effect; None of other effects.
    reason : why the finding was preferred, where this data alone fits the alternative better; else "".
    """

    effect: str
    where: str
    log10_bayes_factor: float
    separable: bool
    motion: list[str] = field(default_factory=list)
    driver: list[str] = field(default_factory=list)
    probability: float | None = None
    reason: str = ""
    place_probability: float | None = None


@dataclass(frozen=True)
class HeldOut:
    """Held-out error before and after, um."""

    before: float
    after: float


@dataclass(frozen=True)
class Finding:
    """One entry of ``findings``.

    Beyond what that page lists: `size_um`, the root mean square of what it does at the tip over the survey's rows,
    `rows` (of outliers: data rows, from 1), `brief`, its name and size, and `positive`, what a positive parameter does
    where that is not a rise of the motion in its name. `period` in mm, of a rotary joint in degrees, and `periods`
    along each driver; `time_constants`, s, with their standard uncertainties. `probability` is that of the name,
    `place_probability` that of the place given the name.
    """

    effect: str
    where: str
    statement: str
    probability: float
    p_value: float
    heldout_rms_um: HeldOut
    next_measurement: str
    motion: list[str] = field(default_factory=list)
    driver: list[str] = field(default_factory=list)
    runs: list[str] | None = None
    time: list[float] | None = None
    period: float | None = None
    periods: list[float] = field(default_factory=list)
    parameters: list[Amount] = field(default_factory=list)
    time_constants: list[Amount] = field(default_factory=list)
    absorbed: float = 0.0
    moved: dict[str, float] = field(default_factory=dict)
    alternatives: list[Alternative] = field(default_factory=list)
    size_um: float = 0.0
    rows: list[int] | None = None
    brief: str = ""
    positive: str = ""
    place_probability: float = 1.0

    @property
    def nameless(self) -> bool:
        """Whether it is a form without physics: its word names nothing."""
        kind = registry().get(self.effect)  # None: a finding that is no effect of a machine, such as outliers
        return kind is not None and kind.empirical

    def as_json(self) -> dict[str, Any]:
        out = asdict(self)
        return {k: v for k, v in out.items() if k != "rows" or v is not None}


@dataclass(frozen=True)
class Untestable:
    """An effect that this data cannot show, why, and what would."""

    effect: str
    reason: str
    needs: str


@dataclass(frozen=True)
class Diagnosis:
    """All that ``diagnosis.json`` holds.

    Attributes
    ----------
    points : whether the noise is that of a coordinate, not of a reading.
    dof : degrees of freedom that the final fit has left, by which the noise is known.
    orientation_noise_urad : noise of one component of a measured orientation; None without any.
    """

    verdict: str
    noise_um: float
    baseline: dict[str, float | None]
    final: dict[str, float | None]
    findings: tuple[Finding, ...]
    untestable: tuple[Untestable, ...] = ()
    unexplained: str | None = None
    dependence: Dependence | None = None
    notes: tuple[str, ...] = field(default=())
    readings: tuple[ReadingSizes, ...] = ()
    points: bool = True
    dof: int = 0
    orientation_noise_urad: float | None = None

    @property
    def left_out(self) -> int:
        """Number of rows, wild or copied, that findings left out: the verdict is of the others."""
        return sum(len(f.rows or ()) for f in self.findings if f.effect == "outliers")

    @property
    def noise_interval_um(self) -> tuple[float, float]:
        """95 % interval of the noise, by the degrees of freedom."""
        low, high = noise_bounds(self.dof)
        return low * self.noise_um, high * self.noise_um

    def as_json(self) -> dict[str, Any]:
        more: dict[str, Any] = {"readings": [asdict(r) for r in self.readings]} if self.readings else {}
        if self.orientation_noise_urad is not None:
            more["orientation_noise_urad"] = self.orientation_noise_urad
        return {
            "schema": SCHEMA,
            "verdict": self.verdict,
            "noise_um": self.noise_um,
            "noise_interval_um": list(self.noise_interval_um),
            "baseline": self.baseline,
            "final": self.final,
            **more,
            "findings": [f.as_json() for f in self.findings],
            "untestable": [asdict(u) for u in self.untestable],
            "unexplained": self.unexplained,
            "dependence": self.dependence.as_json() if self.dependence else None,
            "notes": list(self.notes),
        }


SEPARABLE = math.log10(DECISIVE_ODDS)  # decimal logarithm of the Bayes factor that distinguishes two explanations
CHANCE = "none"
TINY = 1e-300
BETTER = 0.05  # decimal logarithm of the Bayes factor from which an alternative is said to fit better


def motions_of(effect: Effect, linear: LinearModel) -> list[str]:
    """Motions that an effect makes, in the order of its terms."""
    return list(dict.fromkeys(m for t in effect.terms(linear.channel, linear.chain.machine) for m in t.motion))


def alternatives_of(step: Step, linear: LinearModel, probability: float, most: int = 5) -> list[Alternative]:
    """The best other explanations, one for each effect and place, the most probable first.

    All named physics that the data do not distinguish from it, and at least so many (`most`) of all.

    Parameters
    ----------
    step, linear : what was chosen, and the model without it.
    probability : of the finding; the others share what it leaves.
    """
    left = (1 - probability) / (1 - probability_of(step))
    out = []
    for number, (alternative, likely) in enumerate(explanations(step)[1:]):
        if number >= most and (alternative.effect.empirical or log10_factor(step, alternative) < -SEPARABLE):
            continue
        key = alternative.effect.effect, alternative.effect.where
        own = None if key[0] == step.effect.effect else left * likely
        factor = log10_factor(step, alternative)
        more = motions_of(alternative.effect, linear), list(alternative.effect.drivers)
        why = preference(step, alternative) if factor > BETTER else ""
        out.append(Alternative(*key, factor, abs(factor) > SEPARABLE, *more, own, why))
    return sorted(out, key=lambda a: -1.0 if a.probability is None else -a.probability)


def explanations(step: Step) -> list[tuple[Step, float]]:
    """The best explanation of each effect and place with its probability: a step's own, then the likeliest first."""
    best: dict[tuple[str, str], Step] = {}
    for one in (step, *step.alternatives):
        best.setdefault((one.effect.effect, one.effect.where), one)
    names, total = probabilities_of(step), dict.fromkeys((name for name, _ in best), 0.0)
    weights = {key: float(np.exp(_weight(one, step) - _weight(step, step))) for key, one in best.items()}
    for (name, _), weight in weights.items():
        total[name] += weight
    first, *others = best
    keys = [first, *sorted(others, key=lambda k: -weights[k])]
    return [(best[k], names[k[0]] * weights[k] / max(total[k[0]], TINY)) for k in keys]


def elsewhere(main: Effect, motions: Sequence[tuple[str, Motion]]) -> list[Alternative]:
    """The same effect at other elements, whose `motions` (of element) the data do not distinguish from its own."""
    places = dict.fromkeys(element for element, _ in motions)
    return [
        Alternative(main.effect, place, 0.0, False, [m for e, m in motions if e == place], [*main.drivers])
        for place in places
    ]


def log_names(log: DecisionLog, main: Effect, probability: float, others: Sequence[Alternative]) -> None:
    """Take down the probability of a finding's name, and how its alternatives compare."""
    log.add("name-probability", "kept", main, probability)
    for a in others:
        log.compared("name-probability", a.effect, a.where, " ".join(a.driver), a.probability, None, named(main))
        log.compared(
            "distinguishable", a.effect, a.where, " ".join(a.driver), abs(a.log10_bayes_factor), SEPARABLE, named(main)
        )


def preference(step: Step, alternative: Step) -> str:
    """Why a step was preferred to an alternative that fits this data better."""
    if alternative.effect.empirical and not step.effect.empirical:
        return "a curve without a name can follow anything: known physics is preferred"
    if posterior(alternative) <= posterior(step):
        return "it would be likelier at some of the many places, or by some of the many drivers, that it may have"
    if alternative.evidence_of_form > step.evidence_of_form:
        return "it departs more from its textbook form"
    return "beside all other findings it is likelier, which it was not when this name was chosen"


def look_alikes(step: Step) -> list[Effect]:
    """Physics of other names that the data do not separate from a step, the likeliest first, each name once."""
    best: dict[str, Effect] = {}
    for alternative in step.alternatives:
        effect = alternative.effect
        other = effect.effect != step.effect.effect and not effect.empirical
        if other and abs(log10_factor(step, alternative)) <= SEPARABLE:
            best.setdefault(effect.effect, effect)
    return list(best.values())


def log10_factor(step: Step, alternative: Step) -> float:
    """Decimal logarithm of the Bayes factor of an alternative against a step."""
    return float((alternative.evidence - step.evidence) / np.log(10))


def probability_of(step: Step) -> float:
    """Of the named effect against other effects, a mere form, nothing, and what no catalogue has."""
    return probabilities_of(step)[step.effect.effect]


def probabilities_of(step: Step) -> dict[str, float]:
    """Posterior probability of each name of a step and its alternatives; the rest is chance, or an unknown effect."""
    best = {CHANCE: math.log(max(step.trials, 1)) + _log_prior(step, step)}
    for one in (step, *step.alternatives):
        name = one.effect.effect
        best[name] = max(best.get(name, -np.inf), _weight(one, step))
    best[step.effect.effect] += CHOSEN
    weights = {name: np.exp(value - max(best.values())) for name, value in best.items()}
    total = sum(weights.values()) + UNKNOWN * weights[step.effect.effect]
    return {name: float(weight / total) for name, weight in weights.items() if name != CHANCE}


def _weight(one: Step, step: Step) -> float:
    """Log posterior odds of a step or one of its alternatives."""
    # an alternative counts for no more than the chosen name: of 47 such names 45 were right (seeds 86602540 and
    # 10488088)
    own, chosen = (s.evidence + _log_prior(s, step) for s in (one, step))
    return min(own, chosen) - (CLEARLY if one.effect.empirical else 0.0)


def _log_prior(one: Step, step: Step) -> float:
    """Log prior of a step or one of its alternatives; of a form that of the likeliest name beside it.

    The choice compares the two by their evidence: the many places and channels of forms count for nothing.
    """
    names = [s for s in (step, *step.alternatives) if not s.effect.empirical]
    return max(names, key=posterior).log_prior if one.effect.empirical and names else one.log_prior


def p_value_of(step: Step) -> float:
    """Chance of such a delta chi-squared by noise alone, anywhere in the search (Bonferroni)."""
    from scipy.special import chdtrc

    return float(min(1.0, max(step.trials, 1) * chdtrc(step.count, step.delta_chi2)))


def moved_by(design: Array, names: Sequence[str], columns: Array, values: Array) -> dict[str, float]:
    """What the missing effect had put into the fitted parameters: ``M^+ h theta`` in their units, the largest first."""
    bias, *_ = np.linalg.lstsq(design, columns.T @ values, rcond=None)
    scaled = np.abs(bias) * np.linalg.norm(design, axis=0)
    order = np.argsort(-scaled)[:6]
    return {names[k]: float(-bias[k]) for k in order if scaled[k] > 0.05 * scaled.max()}
