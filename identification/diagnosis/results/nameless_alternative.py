"""Whether a function without a name explains a finding better than the form of its name does.

The name's log evidence is compared with that of every nameless function of what was recorded (`recorded`: a motion
that follows a channel, the path, or the clock down to quick changes, as a random effect), each beside all other
findings. The name may depart from its textbook form by one of these functions too, which has less prior probability
the larger it is. Where nothing with a name is the cause, some function explains as much without the name, or one
function as much as several findings of one joint: what the path of a joint leaves behind resembles a play and a curve
of it together. And no name is smaller than what is clearly left without one: it may be a part of that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from errormodel.channels import root
from errormodel.effects.base import Effect
from identification.diagnosis.decisions.constants import (
    CLEARLY,
    DEPARTURES,
    EVEN,
    LEAST_EVIDENCE,
    MUCH,
    NAME_ODDS,
    NEAR,
)
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.linear.known_models import of_any_size
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.results.curve_of_axis import as_curve, of_its_axis, part_of_more
from identification.diagnosis.results.findings import Alternative, Finding, probabilities_of, probability_of
from identification.diagnosis.results.nameless_evidence import best_of, evidence_in_any_noise
from identification.diagnosis.results.physical_limits import nameless
from identification.diagnosis.results.recorded_functions import (
    ALIKE,
    Functions,
    alike_motions,
    in_one_motion,
    recorded,
    wandering,
)
from identification.diagnosis.search import correlated_noise as coloured
from identification.diagnosis.search.candidates import score_of
from identification.diagnosis.search.criteria import base_channels, moves
from identification.diagnosis.search.model import EffectModel, done_by_steps, of_groups, steps_of
from identification.diagnosis.search.scoring import DETECT, Step, posterior
from identification.results.terminal import counted

# minus the log prior probability of a departure as large as the form: the exponential distribution of `DEPARTURES`
DEPARTURE_COST = max(DEPARTURES.values()) / max(DEPARTURES)


class Refused(NamedTuple):
    """Why a finding has no name; `instead`: the function without one that explains as much, where that is why."""

    reason: str
    instead: Functions | None = None


@dataclass(frozen=True)
class _Remainder:
    """What a name leaves that one of some functions without a name explains: `part` of what the name itself explains.

    `form` is the model with the name, `trials` the logarithm of the number of functions.
    """

    form: LinearModel
    evidence: float
    part: float
    function: Functions | None
    trials: float

    @classmethod
    def of(cls, without: LinearModel, form: LinearModel, functions: Sequence[Functions]) -> _Remainder:
        evidence, explained, best = best_of(form, functions)
        part = explained / max(without.square - form.square, 1e-300)
        return cls(form, evidence, part, best, float(np.log(max(len(functions), 1))))

    def much(self, main: Effect, log: DecisionLog) -> str:
        """The function in words, where it is clear and explains much of what the name does; else ""."""
        if self.function is None or self.evidence - self.trials <= DETECT:
            return ""
        large = self.part > MUCH
        # what noise that is correlated from row to row explains as well is no remainder
        if large and evidence_in_any_noise(self.form, self.function) - self.trials <= DETECT:
            return ""
        words = _words(self.function)
        log.add("remainder-of-name", "refused" if large else "kept", main, self.part, MUCH, beside=words)
        return words if large else ""


def checked_alternative(
    finding: Finding, model: EffectModel, group: Sequence[Step], functions: Sequence[Functions], log: DecisionLog
) -> Finding:
    """The finding without its name where this is refused (`refusal`), or as a curve of its axis, which needs none."""
    main = group[0].effect
    if main.empirical or finding.nameless or (refused := refusal(model, group, functions, log)) is None:
        return finding
    curve, probability = of_its_axis(model, group, refused.instead)
    other = refused.instead is not None and not _of_its_motion(model.without(group), main, refused.instead)
    if curve is not None and probability >= EVEN and not other:
        log.add("curve-of-its-axis", "preferred", curve, probability, EVEN, beside=main)
        return as_curve(finding, curve, refused.reason, probability)
    without_name = nameless(finding, refused.reason)
    if probability_of(group[0]) >= EVEN:
        return without_name
    name = Alternative(main.effect, main.where, 0.0, False, finding.motion, finding.driver, finding.probability)
    without_name = replace(without_name, probability=sum(probabilities_of(group[0]).values()))  # that there is one
    return replace(without_name, alternatives=[name, *finding.alternatives])


def refusal(
    model: EffectModel, group: Sequence[Step], functions: Sequence[Functions], log: DecisionLog
) -> Refused | None:
    """Why a finding of a model has no name: one of the `functions` has more evidence, or leaves as much beside it."""
    main = group[0].effect
    if (probability := probability_of(group[0])) < EVEN:
        log.add("unlikely-name", "refused", main, probability, EVEN)
        return Refused("other explanations together are likelier")
    if words := part_of_more(model, group, log) or _part_of_itself(model, group, log):
        return Refused(words)
    without = model.without(group)
    if main.flexible:  # any curve of its motion by what drives it has this name
        own_curve = partial(_of_its_motion, without, main)
        functions = [f for f in functions if f.channels != main.drivers or not (main.random or own_curve(f))]
    effects = [s.effect for s in group if _one_name(main, s.effect)]
    evidence, form = _of_any_size(without, effects)
    rest = _Remainder.of(without, form, functions)
    words = rest.much(main, log)
    if not words and (others := _by_the_same(model, group)):
        bare = model.without([*group, *others])
        words = _Remainder.of(bare, _of_any_size(bare, effects)[1], functions).much(main, log)
    if words:
        return Refused(f"beside it as much is left, without a name ({words})")
    courses = in_one_motion(without, effects)
    single, _, motion = best_of(without, courses)
    single -= float(np.log(max(len(courses), 1)))  # each of these motions is as likely
    instead, _, best = best_of(without, functions)
    evidence += max(rest.evidence - DEPARTURE_COST * float(np.sqrt(rest.part)), 0.0)
    if NAME_ODDS < instead - evidence < CLEARLY and best is not None and _of_its_form(without, main, best):
        # any other form of the same motion by the same channels is as unlikely as an empirical term
        instead, _, best = best_of(without, [f for f in functions if not _of_its_form(without, main, f)])
    lead = evidence - instead + NAME_ODDS
    if lead <= 0 and best is not None:  # noise that is correlated from row to row follows the clock, and is no function
        [(_, in_noise)] = coloured.evidence(without, [effects])
        lead = max(lead, in_noise - evidence_in_any_noise(without, best) + NAME_ODDS)
    if (lead_of_motion := evidence - single + NAME_ODDS) < lead:
        lead, best = lead_of_motion, motion
    together = _of_one_joint(model, group) if lead > 0 else []
    if len(together) > 1 and (all_of_it := _lead_of_all(model, together, functions))[0] < lead:
        lead, best = all_of_it
    log.add("nameless-alternative", "kept" if lead > 0 else "refused", main, lead, 0.0, beside=_words(best))
    if lead > 0:
        return None
    findings = f" as the {counted(len(together), 'finding')} of this joint" if together else ""
    return Refused(f"a function without a name explains as much{findings} ({_words(best)})", best)


def _part_of_itself(model: EffectModel, group: Sequence[Step], log: DecisionLog) -> str:
    """In words that what refines a finding's form does more than all that has its name, in the rows; else ""."""
    main = group[0].effect
    named = [s.effect.effect == main.effect for s in group]
    if all(named):
        return ""
    done = dict(zip(map(id, model.steps), done_by_steps(model), strict=True))
    parts = np.array([done[id(s)] for s in group])
    own, rest = parts[named].sum(axis=0), parts[np.logical_not(named)].sum(axis=0)
    share = float(own @ own) / max(float(own @ own + rest @ rest), 1e-300)
    log.add("part-of-itself", "refused" if share < EVEN else "kept", main, share, EVEN)
    return "most of it is what refines its form" if share < EVEN else ""


def _by_the_same(model: EffectModel, group: Sequence[Step]) -> list[Step]:
    """The steps of findings without a name that the same channels drive: a name may be a part of them."""
    own = set(map(root, group[0].effect.drivers))
    return [
        step
        for g in model.findings
        if g[0].effect.empirical and g[0] is not group[0] and own & set(map(root, g[0].effect.drivers))
        for step in g
    ]


def _of_one_joint(model: EffectModel, group: Sequence[Step]) -> list[Sequence[Step]]:
    """The findings with a name that follow the path of a joint that one of them follows."""
    own = _followed(model, group[0].effect)
    return [g for g in model.findings if not g[0].effect.empirical and own & _followed(model, g[0].effect)]


def _followed(model: EffectModel, effect: Effect) -> set[str]:
    """Joints whose position or side drives an effect."""
    return {root(name).removeprefix("dir_") for name in effect.drivers} & {j.name for j in model.start.scene.moving}


def _lead_of_all(
    model: EffectModel, groups: Sequence[Sequence[Step]], functions: Sequence[Functions]
) -> tuple[float, Functions | None]:
    """Lead in log evidence of some findings together over one function without a name, and which.

    What the path of a joint leaves behind resembles several names together, of which none is needed beside it. Each
    after the first has the trials factor of the search that found it.
    """
    steps = steps_of(groups)
    mains = {g[0].effect for g in groups}
    without = of_groups(model.start, [g for g in model.findings if g[0].effect not in mains]).linear
    evidence, _ = _of_any_size(without, [s.effect for s in steps])
    instead, _, best = best_of(without, functions)
    return evidence - instead + NAME_ODDS - sum(float(np.log(max(s.trials, 1))) for s in steps[1:]), best


def with_names_again(model: EffectModel, log: DecisionLog) -> EffectModel:
    """The model with a name in place of each form that does not lead it clearly any more, beside all other findings.

    Under correlated noise, too, which explains a part of what a form explained. A name that is refused is none, and no
    alternative; a form that leads it comes back in its place. Where no name is likelier than all others, nothing is
    named. No name is there twice.
    """
    for k in range(len(model.findings)):
        model = _without_refused(model, k, log)
        while (other := _with_name(model, k)) is not None:
            name, main = other.findings[k][0], model.findings[k][0]
            if probability_of(name) < EVEN:
                break
            kept = _refused(other, k, log) is None
            lead = main.evidence - name.evidence
            log.add("name-again", "preferred" if kept else "refused", name.effect, lead, CLEARLY, beside=main.effect)
            if kept:
                model = other
                break
            model = _with_group(model, k, [_without_name(main, name), *model.findings[k][1:]])
    return _each_once(model)


def _each_once(model: EffectModel) -> EffectModel:
    """The model with findings that have got the name, place and drivers of another one as terms that refine that."""
    groups = dict[object, list[Step]]()
    for group in model.findings:
        own = groups.setdefault(group[0].effect.key, [])
        there = {of_any_size(s.effect) for s in own}
        own += [s for s in group if of_any_size(s.effect) not in there]
    return model if len(groups) == len(model.findings) else of_groups(model.start, list(groups.values()))


def _refused(model: EffectModel, number: int, log: DecisionLog) -> Refused | None:
    """Why a finding has no name, by all functions that were recorded."""
    functions = recorded(model.start, np.unique(model.start.index))
    return refusal(model, model.findings[number], functions, log)


def _without_refused(model: EffectModel, number: int, log: DecisionLog) -> EffectModel:
    """The model with the form that leads a name in its place, where the name is refused."""
    main, own = model.findings[number][0], DecisionLog()
    form = max((s for s in main.alternatives if s.effect.empirical), key=lambda s: s.evidence, default=main)
    if main.effect.empirical or form.evidence <= main.evidence or probability_of(main) < EVEN:
        return model
    if _refused(model, number, own) is None:
        return model
    log.join(own)
    others = tuple(s for s in main.alternatives if s is not form)
    return _with_group(model, number, [_without_name(replace(form, alternatives=others), main)])


def _without_name(step: Step, name: Step) -> Step:
    """A step without its alternatives by the name of another."""
    return replace(step, alternatives=tuple(s for s in step.alternatives if s.effect.effect != name.effect.effect))


def _with_name(model: EffectModel, number: int) -> EffectModel | None:
    """The model with the likeliest name that a form does not lead clearly in its place; None where there is none."""
    main = model.findings[number][0]
    names = [s for s in main.alternatives if not s.effect.empirical and main.evidence - s.evidence <= CLEARLY]
    if not main.effect.empirical or not names:
        return None
    name = max(names, key=posterior)
    others = tuple(s for s in (main, *main.alternatives) if s is not name)
    return _with_group(model, number, [replace(name, alternatives=others)])


def _with_group(model: EffectModel, number: int, group: Sequence[Step]) -> EffectModel:
    """The model with another finding in place of one."""
    groups = model.findings
    return of_groups(model.start, [*groups[:number], group, *groups[number + 1 :]])


def without_wanderers(model: EffectModel, log: DecisionLog) -> tuple[EffectModel, Functions | None]:
    """The model without findings whose motion has clearly more evidence as one that wanders in time, and that motion.

    What wanders resembles some temperature, warm-up or curve by chance, and goes another way later. What a temperature
    or a position drives changes in time as well, but takes many functions of the clock to describe. A finding that
    has at least half of its evidence beside what wanders is another thing; over all noises, where beside it nothing
    wanders but these.
    """
    groups, kept, wanders, instead_of = model.findings, list[list[Step]](), list[Functions](), None
    for group in groups:
        main = group[0].effect
        wanders = wanders or wandering(model.start, np.unique(model.start.index))
        without = model.without(group)
        evidence, form = _of_any_size(without, [s.effect for s in group])
        instead, _, best = best_of(without, wanders)
        lead, thermal = instead - evidence, base_channels(main) == {"temperature"}  # which resembles what wanders
        least = DETECT if thermal else max(DETECT, NEAR * evidence)  # no form is exact
        if (out := lead > least) and evidence > 0:  # it may be there beside what wanders, and then keeps its evidence
            further, _, beside = best_of(form, wanders)
            out = further - lead < EVEN * evidence and not _only_noise(without, form, group, best, beside)
        log.add("wanders-instead", "removed" if out else "kept", main, lead, least, beside=_words(best))
        kept += [] if out else [group]
        instead_of = best if out else instead_of
    return (model if len(kept) == len(groups) else of_groups(model.start, kept)), instead_of


def _only_noise(
    without: LinearModel, form: LinearModel, group: Sequence[Step], best: Functions | None, beside: Functions | None
) -> bool:
    """Whether a finding has at least half of its evidence beside what wanders over all noises, and these explain that.

    Parameters
    ----------
    form : the model with the finding; `best` and `beside`: what wanders most without it and with it.
    """
    alone, further = (
        0.0 if own is None else evidence_in_any_noise(linear, own) for linear, own in ((without, best), (form, beside))
    )
    [(_, own)] = coloured.evidence(without, [[s.effect for s in group]])
    return further < LEAST_EVIDENCE and own + further - alone >= EVEN * own > 0


def _of_any_size(linear: LinearModel, effects: Sequence[Effect]) -> tuple[float, LinearModel]:
    """Log evidence of effects in turn, each of its usual size or, as what has no name, of any; and their model."""
    evidence = 0.0
    for effect in effects:
        usual = (score_of(linear, effect) or (0.0,))[0]
        evidence += max(usual, 0.0, linear.random(linear.columns(effect)[0]).best()[1])
        linear = linear.with_effect(effect)
    return evidence, linear


def _of_its_form(linear: LinearModel, effect: Effect, function: Functions) -> bool:
    """Whether a function is a motion of the effect, or one alike at another element, by the effect's channels.

    Not by its own joint's position, of which any curve is usual.
    """
    by_its_channels = {*map(root, function.channels)} <= {*map(root, effect.drivers)} - {effect.where}
    return by_its_channels and _of_its_motion(linear, effect, function, 1 - NEAR)


def _of_its_motion(linear: LinearModel, effect: Effect, function: Functions, least: float = ALIKE) -> bool:
    """Whether a function is a motion of the effect, or one alike at another element (`alike_motions`)."""
    own, place = moves(linear, effect), (function.element, function.motion)
    return place in own or any(place in alike_motions(linear, *one, least) for one in own)


def _one_name(one: Effect, other: Effect) -> bool:
    """Whether two effects have one name, and one place in time or travel or another motion.

    A second lag is of it, and so is what a contact at about the same place does in another direction; a second jump of
    the same motion is not.
    """
    if one.effect != other.effect:
        return False
    places = [name for name, kind in one.shapes().items() if kind.place]
    together = all(getattr(one, name) == getattr(other, name) for name in places)
    return together or getattr(one, "motion", None) != getattr(other, "motion", None)


def _words(function: Functions | None) -> str:
    return f"{function.motion} of {function.element} by {' and '.join(function.channels)}" if function else ""
