"""Whether the parameters of a named effect are physically possible: a name that physics contradicts is none."""

from __future__ import annotations

from dataclasses import replace

from errormodel.effects.unnamed import Unnamed
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.results.effect_size import Whole
from identification.diagnosis.results.findings import Finding
from identification.diagnosis.search.candidates import SIZES
from identification.estimation.bounded import CONTRADICTED_SIGMA
from identification.estimation.result import Fit

# times the usual size, by judgement: thirty standard deviations of the widest of the prior distributions of sizes; the
# largest right name of the proof had 45
IMPOSSIBLE = 30 * max(SIZES)


def checked_name(finding: Finding, whole: Whole, final: Fit, log: DecisionLog) -> Finding:
    """The finding without its name where its parameters, in the final fit, are beyond what physics allows.

    Its form stays in the model: what it predicts was tested, what it is called was not.
    """
    main, chain = whole.effects[0], final.chain
    if main.empirical or main.random:
        return finding
    sizes = {t.unit: t.size for t in main.terms(lambda name: 1.0, chain.machine)}
    reason = ""
    for amount in whole.amounts[: len(whole.ids[0])]:
        low = chain.parameters[chain.index[amount.name]].low
        beyond = (low - amount.value) / amount.std if amount.std else 0.0
        times = (abs(amount.value) - CONTRADICTED_SIGMA * amount.std) / sizes[amount.unit]
        if beyond > CONTRADICTED_SIGMA:
            log.add("physical-bound", "refused", main, beyond, CONTRADICTED_SIGMA)
            reason = f"{amount.name} would be {beyond:.0f} standard uncertainties beyond what physics allows"
        elif times > IMPOSSIBLE:
            log.add("physical-size", "refused", main, times, IMPOSSIBLE)
            reason = f"{amount.name} would be at least {times:.0f} times what is usual"
        if reason:
            return nameless(finding, reason)
    return finding


def nameless(finding: Finding, reason: str) -> Finding:
    """The finding as an effect without a name, for a reason."""
    form = f"{finding.effect} of {finding.where}"
    return replace(
        finding,
        effect=Unnamed.effect,
        statement=(
            f"An effect without a name at {finding.where}. It follows the form of a {form}, but is none: {reason}. "
            f"As that form it reads: {finding.statement}"
        ),
        brief=f"an effect without a name at {finding.where} (in the form of a {form})",
        positive="",
    )
