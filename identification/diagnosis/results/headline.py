"""The headline of a diagnosis: findings by name and size, or that nothing was found."""

from __future__ import annotations

from errormodel.exceptions import enumerated
from identification.diagnosis.results.findings import Diagnosis, Finding
from identification.diagnosis.results.statements import SURE
from identification.diagnosis.results.verdict import AT_ONE_POSE, NOT_JUDGED
from identification.results.terminal import counted

VERDICTS = {
    "adequate": "Nothing was found: the model and the noise explain what was measured.",
    "explained": "{found}; what is left looks like noise.",
    "partly-explained": "{found}; something is left over that no finding explains.",
    "unexplained": "More than noise is left over, and no finding explains it.",
}
FEW = "{found}; too few values were measured to say whether what is left is noise."
MOST = 3  # findings by name


def headline(diagnosis: Diagnosis) -> str:
    """The findings by name and size, and whether more than noise is left; one sentence."""
    if diagnosis.verdict == "adequate" and AT_ONE_POSE in diagnosis.notes:
        return f"Nothing could be tested: {AT_ONE_POSE}."
    names = [_named(f) for f in diagnosis.findings]
    if len(names) > MOST + 1:
        names[MOST:] = [f"{len(names) - MOST} more"]
    found = enumerated(names) or "Nothing was found"
    few = NOT_JUDGED in (diagnosis.unexplained or "")
    text = FEW if few else VERDICTS[diagnosis.verdict]
    text = text.format(found=found[:1].upper() + found[1:])
    return f"{text} This is said without {counted(diagnosis.left_out, 'row')} left out." if diagnosis.left_out else text


def _named(finding: Finding) -> str:
    text = finding.brief or f"{finding.effect} at {finding.where}"
    doubtful = finding.probability < SURE and not finding.nameless
    return f"{text} (the name is not sure)" if doubtful else text
