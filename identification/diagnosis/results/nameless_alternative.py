"""Whether a function without a name explains a finding better than the form of its name does.

The name's log evidence is compared with that of every nameless function of what was recorded (`recorded`: a motion
that follows a channel, the path, or the clock down to quick changes, as a random effect), each beside all other
findings. The name may depart from its textbook form by one of these functions too, which has less prior probability
the larger it is. Where nothing with a name is the cause, some function explains as much without the name.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from errormodel.arrays import Array
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.random_effects import RandomEffects
from identification.diagnosis.results.findings import FORM_ODDS, Finding
from identification.diagnosis.results.physical_limits import nameless
from identification.diagnosis.results.recorded_functions import Functions
from identification.diagnosis.search.candidates import Candidates
from identification.diagnosis.search.model import EffectModel
from identification.diagnosis.search.refinement import DEPARTURES
from identification.diagnosis.search.scoring import Step

MOST_FUNCTIONS = 12  # whose evidence is computed, those with the largest score: the rest of some hundred has less
# minus the log prior probability of a departure as large as the form: the exponential distribution of `DEPARTURES`
DEPARTURE_COST = max(DEPARTURES.values()) / max(DEPARTURES)


def checked_alternative(
    finding: Finding, model: EffectModel, group: Sequence[Step], functions: Sequence[Functions], log: DecisionLog
) -> Finding:
    """The finding without its name where a nameless one of the `functions` has more evidence than its form."""
    main = group[0].effect
    if main.empirical or main.random or finding.nameless:
        return finding
    without = form = model.without(group)
    evidence = 0.0
    for effect in (s.effect for s in group if s.effect.effect == main.effect):  # a second sensor or lag is of the name
        own = Candidates.of(form, [effect]).scores(form).evidence
        evidence += float(own.max(initial=0.0))
        form = form.with_effect(effect)
    instead, _, best = best_of(without, functions)
    further, explained, _ = best_of(form, functions)
    departure = float(np.sqrt(explained / max(without.square - form.square, 1e-300)))
    lead = evidence + max(further - DEPARTURE_COST * departure, 0.0) - instead + FORM_ODDS
    beside = f"{best.motion} of {best.element} by {best.channels[0]}" if best else ""
    log.add("nameless-alternative", "kept" if lead > 0 else "refused", main, lead, 0.0, beside=beside)
    return finding if lead > 0 else nameless(finding, f"a function without a name explains as much ({beside})")


def best_of(linear: LinearModel, functions: Sequence[Functions]) -> tuple[float, float, Functions | None]:
    """Largest log Bayes factor of a motion that follows a channel, the sum of squares that it explains, and which."""
    seen, variance = len(linear.index), linear.square / linear.freedom
    able: list[tuple[float, int, Array]] = []
    for k, function in enumerate(functions):
        if function.motion:
            columns = function.values.T
            slopes = columns @ linear.residual[:seen]
            score = float(slopes @ slopes) / max(float(np.sum(columns**2)) * variance, 1e-300)
            able.append((score * np.sqrt(len(columns)), k, columns))
            able = sorted(able, key=lambda a: -a[0])[:MOST_FUNCTIONS]
    best: tuple[float, float, Functions | None] = (0.0, 0.0, None)
    for _, k, columns in able:
        random = RandomEffects.of(columns, linear.basis, linear.residual, linear.freedom)
        ratio, evidence, _ = random.best()
        if evidence > best[0]:
            best = evidence, random.square - float(random.left(ratio)), functions[k]
    return best
