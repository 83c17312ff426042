"""Whether the parameters of a named effect are physically possible: a name that physics contradicts is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from errormodel.effects.base import Effect
from errormodel.effects.unnamed import Unnamed
from identification.diagnosis.decisions.constants import SIZES
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.results.effect_size import Whole
from identification.diagnosis.results.findings import Finding
from identification.estimation.bounded import CONTRADICTED_SIGMA
from identification.estimation.result import Fit

# times the usual size: ten standard deviations of the widest prior distribution; in 93 recordings of two authors three
# right names had 31 to 57
LARGEST = 10 * max(SIZES)


def checked_name(finding: Finding, whole: Whole, final: Fit, log: DecisionLog) -> Finding:
    """The finding without its name where its parameters, in the final fit, are beyond what physics allows.

    Its form stays in the model where it follows commands: what it predicts was tested, what it is called was not.
    """
    main, chain = whole.effects[0], final.chain
    if main.empirical or main.random:
        return finding
    for amount in whole.amounts[: len(whole.ids[0])]:
        low = chain.parameters[chain.index[amount.name]].low
        beyond = (low - amount.value) / amount.std if amount.std else 0.0
        if beyond > CONTRADICTED_SIGMA:
            log.add("physical-bound", "refused", main, beyond, CONTRADICTED_SIGMA)
            far = f"{beyond:.0f} standard uncertainties beyond what physics allows"
            return nameless(finding, f"{amount.name} would be {far}")
    times, name = times_usual(main, whole.ids[0], final)
    if times <= LARGEST:
        return finding
    log.add("physical-size", "refused", main, times, LARGEST)
    return nameless(finding, f"{name} would be at least {times:.0f} times what is usual")


def times_usual(effect: Effect, ids: Sequence[str], final: Fit) -> tuple[float, str]:
    """How many times as large as usual a parameter of an effect is at least, and the name of that parameter."""
    s, terms = final.solution, effect.terms(lambda name: 1.0, final.chain.machine)
    sizes = {t.unit: t.size for t in terms}
    row = {s.unknowns[j]: k for k, j in enumerate(s.groups.base)}
    std = np.sqrt(np.diag(s.covariance)) * final.inflation
    times = [(0.0, "")]
    for name in (i for i in ids if i in row):
        value, size = abs(s.values[s.unknowns.index(name)]), sizes[final.chain.parameters[final.chain.index[name]].unit]
        times.append((float(value - CONTRADICTED_SIGMA * std[row[name]]) / size, name))
    return max(times)


def nameless(finding: Finding, reason: str) -> Finding:
    """The finding as an effect without a name, for a reason."""
    form = f"{finding.effect} of {finding.where}"
    return replace(
        finding,
        effect=Unnamed.effect,
        statement=(
            f"An effect without a name at {finding.where}. It follows the form of a {form}, but cannot be called one: "
            f"{reason}. As that form it reads: {finding.statement}"
        ),
        brief=f"an effect without a name at {finding.where}, in the form of a {finding.brief or form}",
        positive="",
    )
